"""Whether a CT was taken with contrast medium in the vessels, by the histogram of its body above soft tissue.

Bone also has values above soft tissue.  But it is thin or porous, so that averages of about 4 mm change from one to the
next.  Those within a heart or an aorta that are filled with contrast medium do not.
"""

import numpy as np

from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.reduced import reduce_steps
from ..volume.volume import Volume
from .body import body_steps

BLOCK = 4.0  # mm, the sides of the averages
ENHANCED = (220.0, 600.0)  # HU; the preset ct-angiography shows values from 220 HU well
SOFT = (-20.0, 100.0)  # HU, muscle and organs
SPREAD = 60.0  # HU by which an average may differ from its six neighbors
LEAST_SHARE = 0.012  # of the averages of soft tissue; scans with contrast medium have 0.05 and more, others up to 0.003


def contrast_share_steps(volume: Volume):
    """Generator of fractions done: how much contrast medium a CT shows.

    Parameters
    ----------
    volume : Volume
        In HU and millimeters.

    Returns
    -------
    float
        Number of uniform averages with contrast medium in the body, relative to those of soft tissue. From LEAST_SHARE
        on the scan is one with contrast medium.
    """
    factors = tuple(max(1, min(round(BLOCK / step), count)) for step, count in zip(volume.spacing, volume.shape_xyz))
    coarse = yield from reduce_steps(volume, factors)
    try:
        body = drain(body_steps(coarse))
    except RleSplatError:  # a scan of a part without air around it
        body = np.ones(coarse.voxels.shape, bool)
    values = coarse.physical(coarse.voxels)
    uniform = body & _is_uniform(values)
    enhanced, soft = (np.count_nonzero(uniform & (values >= low) & (values < high)) for low, high in (ENHANCED, SOFT))
    return float(enhanced / max(soft, 1))


def _is_uniform(values: np.ndarray) -> np.ndarray:
    """Which values differ by at most SPREAD from all six neighbors; values at the borders have fewer."""
    uniform = np.isfinite(values)
    for axis in range(3):
        near = np.abs(np.diff(values, axis=axis)) <= SPREAD
        for end in (slice(None, -1), slice(1, None)):
            uniform[(slice(None),) * axis + (end,)] &= near
    return uniform
