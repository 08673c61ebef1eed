"""Modes: what a pixel shows of its ray instead of emission and absorption (algorithm.md 4.2).

    xray      absorption alone: 1 - exp(-sum of optical depths), white, so that bone is bright as on film
    mip       the largest value on the ray
    minip     the smallest value on the ray
    average   the mean value over the path of the ray

In the last three, values are interpolated inside each sheet, and the transfer function is applied once per pixel, to
the value found: its color, and its opacity relative to the function's largest, so that the opacity curve acts as a
viewer's window from transparent to opaque.  (Opacity per length has no meaning here.)

Only voxels that can decide a pixel are kept.  For the largest value these are the corners of cells that reach the
lowest shown value, because anything lower is transparent; for the smallest value, of cells that reach down to the
highest shown value.  A mean needs every voxel.

Where labels hide voxels, these get a value that decides no pixel: the smallest of the volume, as a viewer's mask does;
the largest for the smallest value on a ray; the most transparent for an X-ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..classify.points import LARGEST, pieces, positive_intervals
from ..encode.scalars import MOST
from ..scene import NO_DEPTH

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction

TO_STORED = {"mip": 1.0, "minip": -1.0, "average": 0.0}  # which value is wanted, were the slope positive
# What is below the lowest value shown, in parts of the values above it, still counts: not to end in a step.
MARGIN = 1.0 / 16.0
# Values are counted up to so many spans of the function's points beyond them: counts of values further away would take
# the digits of all others.
FAR = 1000.0
# Of the range of values: a MinIP is transparent so close to the largest one, where that stands for hidden voxels.
NEAR_LARGEST = 1.0 / 64.0
LEAST_COVERED = 1.0 / 256.0  # of a pixel; with less of it in the box its value is not known well enough


def find_value_hidden(volume, tf, mode: str):
    """The stored value that stands for hidden voxels, of the type of the volume's voxels.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    mode : str
        Of ``scene.MODES``, but not "composite".
    """
    low, high = volume.value_range
    found = high if mode == "minip" else low
    if mode == "xray":
        found = min((low, high, *np.clip([value for value, _ in tf.opacity], low, high)), key=tf.alpha_at)
    kind = volume.voxels.dtype
    stored = (found - volume.intercept) / volume.slope
    return kind.type(round(stored)) if kind.kind in "iu" else kind.type(stored)


def find_shown_values(tf, mode: str) -> np.ndarray:
    """The values that may decide a pixel.

    Parameters
    ----------
    tf : TransferFunction
    mode : str
        Of ``scene.MODES``, but not "composite".

    Returns
    -------
    (k, 2) ndarray of float64
        Half-open intervals of physical values: a cell with any of them may decide a pixel in this mode.
    """
    if mode == "average":
        return np.array(((-np.inf, np.inf),))
    shown = positive_intervals(pieces(tf.opacity))
    if len(shown) == 0:
        return shown
    if mode == "mip":
        return np.array(((shown[0, 0], np.inf),))
    if mode == "minip":
        return np.array(((-np.inf, shown[-1, 1]),))
    return shown


@dataclass(frozen=True, eq=False)
class ValueMap:
    """How the values of rays are counted in sheets, and how the picture shows them.

    Attributes
    ----------
    slope, intercept : float
        From stored to physical values.
    sign : float
        1 for the largest of the stored values, -1 for the smallest, 0 for the mean.
    origin : float
        ``sign`` (or 1) times the stored value from which values are counted.
    most : float
        The largest count; larger ones stand for it.
    least : float
        A stored value below all others.
    hollow : bool
        Whether a ray without any kept voxel shows ``origin``, which is transparent.
    end : float
        Physical value from which on a pixel is transparent, because its ray meets hidden voxels alone.
    """

    tf: TransferFunction
    slope: float
    intercept: float
    sign: float
    origin: float
    most: float
    least: float
    hollow: bool
    end: float = math.inf

    @property
    def nbytes(self) -> int:
        """Bytes for the stage cache: none of note."""
        return 0

    def picture(self, rgba, depth):
        """Color a picture of values by the transfer function.

        Parameters
        ----------
        rgba : (H, W, 4) ndarray of float32
            Warped counts in the first channel, coverage in the last.
        depth : (H, W) ndarray of float32
            Planar depth in world units.

        Returns
        -------
        rgba : (H, W, 4) ndarray of float32
            Premultiplied, scene-linear.
        depth : (H, W) ndarray of float32
            NO_DEPTH where nothing is seen.
        """
        covered = rgba[..., 3]
        seen = covered > LEAST_COVERED
        share = covered[seen].astype(np.float64)
        stored = (rgba[..., 0][seen] / share + self.origin) * (self.sign or 1.0)
        values = stored * self.slope + self.intercept
        shown = self.tf.table(values)
        strongest = max(alpha for _, alpha in self.tf.opacity)
        alpha = shown[:, 3] / strongest * share if strongest > 0.0 else np.zeros_like(share)
        found = np.zeros_like(rgba)
        alpha[values >= self.end] = 0.0
        found[seen] = np.concatenate((shown[:, :3] * alpha[:, None], alpha[:, None]), axis=1)
        return found, np.where(found[..., 3] > 0.0, depth, np.float32(NO_DEPTH))


def value_map(volume, tf, mode: str, ends, is_masked: bool = False) -> ValueMap:
    """The ValueMap of a volume in a mode.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    mode : str
        "mip", "minip" or "average".
    ends : (low, high)
        Smallest and largest stored value that is splatted.
    is_masked : bool
        Whether hidden voxels have the value of ``find_value_hidden``.
    """
    end = math.inf
    if is_masked and mode == "minip":
        low, high = volume.value_range
        end = high - NEAR_LARGEST * (high - low)
    sign = TO_STORED[mode] * math.copysign(1.0, volume.slope)
    points = [(sign or 1.0) * (value - volume.intercept) / volume.slope for value, *_ in (*tf.opacity, *tf.color)]
    reach = FAR * (max(points) - min(points)) or math.inf
    nearest, furthest = max(min(points) - reach, -MOST), min(max(points) + reach, MOST)
    low, high = sorted(min(max((sign or 1.0) * end, nearest), furthest) for end in ends)
    slack = 1e-6 * max(abs(low), abs(high), 1e-30)
    with np.errstate(over="ignore"):
        shown = (np.clip(find_shown_values(tf, mode), -LARGEST, LARGEST) - volume.intercept) / volume.slope
    begin = float(((sign or 1.0) * shown).min(initial=np.inf))
    origin = low - max(slack, 1e-3 * (high - low))
    if begin > low:
        origin = max(origin, min(begin, high) - MARGIN * (high - min(begin, high)) - slack)
    if volume.voxels.dtype.kind in "iu":
        origin = math.floor(origin)  # counts of whole numbers stay whole
    hollow = not tf.alpha_at(volume.physical((sign or 1.0) * origin)) > 0.0
    return ValueMap(
        tf, volume.slope, volume.intercept, sign, origin, high - origin,
        min(ends) - 1e-6 * max(map(abs, ends)) - 1e-6, bool(hollow), end,
    )  # fmt: skip
