"""Colors in files are sRGB; those of the program are scene-linear."""

from __future__ import annotations


def linear(color) -> tuple | None:
    """Convert an sRGB color, three numbers from 0 to 1, to scene-linear RGB (IEC 61966-2-1); None stays None."""
    if color is None:
        return None
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color)
