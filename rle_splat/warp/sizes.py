"""Memory that the warp takes; nothing here loads a compiler."""

from __future__ import annotations

from .filters import is_prefiltered

PICTURE_PIXEL = 20  # bytes of a finished pixel: color and depth
COEFFICIENTS = 16  # bytes of a sheet pixel as coefficients of a filter that needs them
WRITTEN = 48  # bytes of a finished pixel while it is put into a file


def filter_bytes(warp_filter: str) -> int:
    """Bytes of a sheet pixel that a filter takes besides."""
    return COEFFICIENTS * is_prefiltered(warp_filter)
