"""Messages from handlers, where no operator can report them: shown in the panel and printed on the console."""

from ..rle_splat.scene import RleSplatError


def sentence_of(problem: Exception) -> str:
    """The sentence that a user reads for an exception."""
    known = isinstance(problem, RleSplatError)
    if known:
        return str(problem)
    return f"The volume could not be rendered because of an internal error; please report it: {problem!r}."


def the_volume(*names: str) -> str:
    """Deleted volumes as the subject of a sentence, also where a name is unknown ("")."""
    return " ".join(["The volume", " and ".join(repr(name) for name in sorted(names) if name)]).strip()


def complain(settings, sentence: str) -> None:
    """Show a sentence in the panel and print it."""
    settings.message = sentence
    tell(sentence)


def tell(sentence: str) -> None:
    """Print a sentence on the console."""
    print(f"RLE Splat: {sentence}")


def as_ranges(frames) -> str:
    """Ascending frame numbers as text, such as "2, 5-7"."""
    ranges: list[list[int]] = []
    for frame in frames:
        if ranges and frame == ranges[-1][1] + 1:
            ranges[-1][1] = frame
        else:
            ranges.append([frame, frame])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)
