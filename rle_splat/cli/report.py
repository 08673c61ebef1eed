"""Numbers and reports in lines for people."""


def number_text(value: float) -> str:
    """A number with at most six significant digits."""
    return f"{value:.6g}"


def say_beginning(report: dict) -> None:
    """Print the remarks of a report, and its transfer function."""
    for remark in report["remarks"]:
        print(remark)
    function = report["transfer_function"]
    print(f"Transfer function {function['name']}: {function['reason']}")
