"""What went wrong where no operator is there to report it: in the panel and on the console."""

from __future__ import annotations

from ..rle_splat.scene import RleSplatError


def sentence_of(problem: Exception) -> str:
    """What a user reads of an exception."""
    known = isinstance(problem, RleSplatError)
    return str(problem) if known else f"The volume was not splatted: {problem!r}."


def complain(settings, sentence: str) -> None:
    """Show a sentence in the panel of a scene's settings, and print it."""
    settings.message = sentence
    tell(sentence)


def tell(sentence: str) -> None:
    """Print a sentence on the console."""
    print(f"RLE Splat: {sentence}")


def as_ranges(frames) -> str:
    """Ascending frame numbers in words: "2, 5-7"."""
    ranges: list[list[int]] = []
    for frame in frames:
        if ranges and frame == ranges[-1][1] + 1:
            ranges[-1][1] = frame
        else:
            ranges.append([frame, frame])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)
