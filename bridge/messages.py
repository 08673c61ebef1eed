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
    print(f"RLE Splat: {sentence}")
