"""Numbers in lines for people."""


def number_text(value: float) -> str:
    """A number with at most six significant digits."""
    return f"{value:.6g}"
