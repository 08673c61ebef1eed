"""The intermediate image: what the sheets add up to on the base plane, before the warp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.buffer_pool import empty
from ..view.base_plane import BasePlane


@dataclass(frozen=True, eq=False)
class IntermediateImage:
    """``pixels``: (H, W, 4) float32, premultiplied scene-linear color and *transmittance*.

    ``half_depth``: (H, W) float32, position along the viewing direction of the principal axis (``sign *
    position``, voxels) at which the transmittance falls below one half; inf where it does not.
    ``filled``: (2, H) int32, of each row the first column that may have anything in it and the one behind the last, no
    more than the first where there are none: elsewhere pixels are transparent, without color.
    """

    base_plane: BasePlane
    pixels: np.ndarray
    half_depth: np.ndarray
    filled: np.ndarray

    @classmethod
    def blank(cls, plane: BasePlane) -> IntermediateImage:
        """One that is to be filled in."""
        size = plane.height, plane.width
        return cls(plane, empty((*size, 4), np.float32), empty(size, np.float32), np.empty((2, plane.height), np.int32))

    @property
    def arrays(self) -> tuple:
        return self.pixels, self.half_depth, self.filled

    def note_filled(self) -> None:
        """Find ``filled`` again, of pixels that were changed."""
        note_filled(self.pixels, self.filled)

    def find_filled_part(self, reach: int) -> tuple[slice, slice] | None:
        """The rows and columns of the smallest rectangle that holds all there is, and ``reach`` on either side as far
        as the image goes; None where there is nothing."""
        first, last = self.filled
        rows = np.flatnonzero(first < last)
        if len(rows) == 0:
            return None
        height, width = self.half_depth.shape
        ends = (int(rows[0]), int(rows[-1]) + 1, height), (int(first[rows].min()), int(last[rows].max()), width)
        return tuple(slice(max(begin - reach, 0), min(end + reach, count)) for begin, end, count in ends)


def note_filled(pixels: np.ndarray, filled: np.ndarray) -> None:
    """Fill ``filled`` (2, H) for ``pixels`` (H, W, 4), both of an IntermediateImage."""
    blank = np.array((0.0, 0.0, 0.0, 1.0), np.float32)
    some = (pixels.view(np.complex128) != blank.view(np.complex128))[..., 0]  # 16 bytes at once: 20 times as fast
    filled[0], filled[1] = some.argmax(axis=1), some.shape[1] - some[:, ::-1].argmax(axis=1)
    filled[:, ~some.any(axis=1)] = 0
