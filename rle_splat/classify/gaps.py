"""Close short gaps between kept voxels. Each costs a few voxels more and saves a run.

The cost of a run is mostly a mispredicted branch at its end, and in a noisy scan most gaps are one or two voxels wide
(X-ray foot: a tenth more voxels give half as many runs). The picture does not change if every sheet is classified by
its own samples: either all voxels of a sample are kept, or nothing between them is visible (``relevant``).
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel, run_either
from ..runtime.parallel import share_out
from . import reference
from .reference import SHORT, WORD
from .relevant import NO_BITS


def close_gaps(bits: np.ndarray, shape_xyz, *, threads: int = 0) -> None:
    """Keep the voxels in gaps of at most SHORT voxels, in place.

    Gaps are closed along the rows, then across the rows of each plane; these are the scanlines of all principal axes.

    Parameters
    ----------
    bits : (nz * ny, words) ndarray of uint64
        Bits of the kept voxels, as of ``relevant.relevant_steps``.
    shape_xyz : (nx, ny, nz)
    threads : int
        0 for one per core.
    """
    run_either(threads, _close_planes, reference.close_gaps, bits, shape_xyz[1])


# --- kernels ----------------------------------------------------------------------------------------------------
#
# This is a binary closing: dilate every kept voxel over the SHORT voxels after it, then erode. Gaps of at most SHORT
# voxels between kept voxels are kept too.


@kernel
def _close_planes(bits, n_rows):
    """Close the gaps of all planes of ``bits``; ``n_rows``: rows per plane."""
    share_out(_close_some, bits.shape[0] // n_rows, (bits.reshape(-1), n_rows, bits.shape[1]))


@kernel(inner=True)
def _close_some(begin, end, bits, n_rows, words):
    """``_close_planes`` for planes [begin, end)."""
    spread, across = np.empty(words + 1, np.uint64), np.empty((n_rows + SHORT) * words, np.uint64)
    for z in range(begin, end):
        plane = bits[z * n_rows * words : (z + 1) * n_rows * words]
        some = False
        for y in range(n_rows):
            some |= _close_row(plane[y * words : (y + 1) * words], spread)
        if some:
            _close_across(plane, words, across)


@kernel(inner=True)
def _close_row(row, spread):
    """Close the gaps along a row; return whether it has kept voxels. ``spread``: scratch, one word longer."""
    seen = NO_BITS
    for n in range(row.size):
        seen |= row[n]
    if seen == NO_BITS:
        return False
    before = NO_BITS
    for n in range(spread.size):
        here = row[n] if n < row.size else NO_BITS
        found = here
        for k in range(1, SHORT + 1):
            found |= (here << np.uint64(k)) | (before >> np.uint64(WORD - k))
        spread[n] = found
        before = here
    for n in range(row.size):
        found = spread[n]
        for k in range(1, SHORT + 1):
            found &= (spread[n] >> np.uint64(k)) | (spread[n + 1] << np.uint64(WORD - k))
        row[n] = found
    return True


@kernel(inner=True)
def _close_across(plane, words, spread):
    """Close the gaps across the rows of ``plane`` (flat, ``words`` per row). ``spread``: scratch, SHORT rows longer."""
    spread[:] = NO_BITS
    for k in range(SHORT + 1):
        for n in range(plane.size):
            spread[n + k * words] |= plane[n]
    for n in range(plane.size):
        plane[n] = spread[n]
    for k in range(1, SHORT + 1):
        for n in range(plane.size):
            plane[n] &= spread[n + k * words]
