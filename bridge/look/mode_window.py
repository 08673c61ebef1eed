"""The level and window with which a mode of grays begins, so that its first picture is neither blank nor saturated."""

from __future__ import annotations

import numpy as np

from ...rle_splat.scene import MODES
from ..volumes import box, facts
from .preset_entries import modality_of

XRAY_ALPHA = 0.04  # opacity of the brightest value for each smallest spacing, as the preset faint has it
# Optical depth of the volume's mean value along its longest side, above air: half of the light.  Lines through the
# middle of a body have about twice that.
XRAY_DEPTH = 0.7
# Physical values shown black and white, in HU; of a MIP up to MOST_OF_MIP where there is dense bone.
OF_CT = {"mip": (-200.0, 1000.0), "minip": (-1000.0, 0.0), "average": (-1000.0, 200.0)}
MOST_OF_MIP = 1400.0
# Percentiles of the values, for other scans.  The largest value of a line is seldom below the median.
PERCENTS = {"mip": (50.0, 99.9), "minip": (1.0, 75.0), "average": (1.0, 95.0)}
AIR = 1.0  # percentile that stands for air


def suit(volume_object) -> None:
    """Set the level and window that suit a volume's mode; nothing changes without a stored histogram."""
    properties = volume_object.rle_splat
    histogram = facts.stored_histogram(properties)
    if histogram is None or properties.mode == MODES[0] or not histogram.counts.any():
        return
    if properties.mode == "xray":
        low, high = _of_xray(volume_object, histogram)
    elif modality_of(properties) == "CT":
        low, high = OF_CT[properties.mode]
        if properties.mode == "mip":
            high = min(max(high, _percentiles(histogram, PERCENTS["mip"])[1]), MOST_OF_MIP)
    else:
        low, high = _percentiles(histogram, PERCENTS[properties.mode])
    properties.window_center, properties.window_width = 0.5 * (low + high), max(high - low, 1e-6)
    properties.preset_center = properties.window_center


def _percentiles(histogram, percents) -> list[float]:
    """Physical values below which these shares of the voxels lie, to the width of a bin."""
    edges = np.linspace(histogram.low, histogram.high, len(histogram.counts) + 1)
    shares = np.concatenate(([0.0], np.cumsum(histogram.counts) / histogram.counts.sum()))
    return [float(np.interp(percent / 100.0, shares, edges)) for percent in percents]


def _of_xray(volume_object, histogram) -> tuple[float, float]:
    """A window in which the mean value of the volume has the optical depth XRAY_DEPTH along its longest side."""
    low, *_ = _percentiles(histogram, (AIR,))
    mean = np.average(np.maximum(histogram.centers - low, 0.0), weights=histogram.counts)
    steps = _longest_side(volume_object, histogram.shape_xyz)
    width = -np.log1p(-XRAY_ALPHA) * steps * float(mean) / XRAY_DEPTH
    return low, low + max(width, histogram.high - low)


def _longest_side(volume_object, shape_xyz) -> float:
    """The longest side of a volume in its smallest spacings; its longest row of voxels where the box is gone."""
    corners = box.world_corners(volume_object)
    if shape_xyz is None or len(corners) == 0:
        return float(max(shape_xyz or (1,)))
    sides = np.linalg.norm(corners[[1, 2, 4]] - corners[0], axis=1)
    spacings = sides / np.maximum(np.array(shape_xyz) - 1, 1)
    least = spacings[spacings > 0.0].min(initial=np.inf)
    return float(sides.max() / least) if np.isfinite(least) else 1.0
