"""Transfer functions of the truths: scalar -> opacity, color, extinction."""

import numpy as np

from ..scene import Scene

# An alpha of 1 would be an infinite extinction.  It is capped at the optical depth of 1 - 2^-24, the float32 number
# below 1.
TAU_CAP = 24.0 * np.log(2.0)


def piecewise_linear(points, values) -> np.ndarray:
    """Interpolate piecewise linear points.

    Parameters
    ----------
    points : sequence of (x, y, ...)
        A repeated x is a right-continuous step.
    values : float, any shape

    Returns
    -------
    float64
        The shape of ``values``, with one more axis where the points have several y.  Outside the points the values at
        the ends hold; at NaN the result is NaN.
    """
    table = np.asarray(sorted(points, key=lambda p: p[0]), dtype=np.float64)
    x, y = table[:, 0], table[:, 1:]
    v = np.asarray(values, dtype=np.float64)
    right = np.searchsorted(x, v, side="right")  # first point strictly above v, so that steps are right-continuous
    low, high = np.clip(right - 1, 0, len(x) - 1), np.clip(right, 0, len(x) - 1)
    gap = x[high] - x[low]
    share = np.where(gap > 0.0, (v - x[low]) / np.where(gap > 0.0, gap, 1.0), 0.0)
    share = np.where(right == 0, 0.0, share)
    result = y[low] + share[..., None] * (y[high] - y[low])
    result[np.isnan(v)] = np.nan
    return result[..., 0] if y.shape[1] == 1 else result


def opacity_unit_distance(transfer_function, volume) -> float:
    """The distance that alpha refers to, in the volume's unit: the function's own, else the smallest spacing."""
    own = transfer_function.opacity_unit_distance
    return float(np.sqrt((volume.affine[:3, :3] ** 2).sum(axis=0)).min() if own is None else own)


def world_opacity_distance(scene: Scene, transfer_function=None) -> float:
    """World length of the distance that a transfer function's alpha refers to, by default the scene's own one's."""
    function = transfer_function or scene.transfer_function
    # Of the volume's unit: the cube root of the volume of a unit cube after the volume's matrix.
    world_length = float(np.cbrt(abs(np.linalg.det(scene.volume_matrix[:3, :3]))) * scene.scene_scale)
    return opacity_unit_distance(function, scene.volume) * world_length


def optical_depth(alpha) -> np.ndarray:
    """Optical depth of one opacity unit distance, for an opacity ``alpha``; at most TAU_CAP."""
    with np.errstate(divide="ignore"):
        return np.minimum(-np.log1p(-np.minimum(alpha, 1.0)), TAU_CAP)


def extinction(transfer_function, values, world_distance: float) -> np.ndarray:
    """Physical scalars -> extinction in 1/world length; NaN is transparent.

    ``world_distance``: world length of the opacity unit distance.
    """
    alpha = np.nan_to_num(piecewise_linear(transfer_function.opacity, values), nan=0.0)
    return optical_depth(alpha) / world_distance


def mean_extinction(transfer_function, low, high, world_distance: float) -> np.ndarray:
    """Mean extinction over all values from ``low`` to ``high`` (N,), physical; 0 where they are NaN.

    Between two points the opacity a is linear, and the integral of -log(1 - a) is (1 - a) log(1 - a) + a.
    """
    points = sorted(transfer_function.opacity, key=lambda point: point[0])
    x, a = np.array(points, dtype=np.float64).T
    low, high = np.minimum(low, high), np.maximum(low, high)
    total = optical_depth(a[0]) * np.maximum(np.minimum(high, x[0]) - low, 0.0)
    total = total + optical_depth(a[-1]) * np.maximum(high - np.maximum(low, x[-1]), 0.0)
    for left, right, begin, end in zip(x[:-1], x[1:], a[:-1], a[1:]):
        if right > left:
            ends = [begin + (end - begin) * (np.clip(v, left, right) - left) / (right - left) for v in (low, high)]
            width = np.clip(high, left, right) - np.clip(low, left, right)
            rise = ends[1] - ends[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = (_antiderivative(ends[1]) - _antiderivative(ends[0])) / rise
            total = total + width * np.where(np.abs(rise) > 1e-6, mean, optical_depth(0.5 * (ends[0] + ends[1])))
    narrow = high - low <= 1e-9 * np.maximum(np.abs(low), np.abs(high))
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = total / (high - low)
    own = optical_depth(np.nan_to_num(piecewise_linear(points, 0.5 * (low + high))))
    return np.nan_to_num(np.where(narrow, own, mean)) / world_distance


def _antiderivative(a) -> np.ndarray:
    """Of the optical depth of an opacity."""
    rest = np.maximum(1.0 - a, 0.0)
    return rest * np.log(np.maximum(rest, 1e-300)) + a


def extinction_and_color(transfer_function, values, world_distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Physical scalars -> (extinction, as ``extinction``; unassociated color (..., 3)); NaN is transparent."""
    color = np.nan_to_num(piecewise_linear(transfer_function.color, values), nan=0.0)
    return extinction(transfer_function, values, world_distance), color


class Segments:
    """A transfer function cut at its points into segments, on which opacity and color are linear.

    Attributes
    ----------
    knots : (K,) float64
        Segment i lies below knot i; the last one lies above all knots.
    visible : (K + 1,) bool
        Whether the opacity is above zero in each segment.
    ends : tuple of float
        The lowest and the highest point.
    """

    def __init__(self, transfer_function):
        opacity, color = transfer_function.opacity, transfer_function.color
        knots = np.unique(np.array([p[0] for p in (*opacity, *color)], dtype=np.float64))
        self.ends = float(knots[0]), float(knots[-1])
        slopes_alpha, slopes_color = (self._lines(points, knots) for points in (opacity, color))
        shown = (slopes_alpha[0] > 0.0) | (slopes_alpha[1] != 0.0)
        # A knot between two transparent segments cuts nothing.
        needed = np.flatnonzero(shown[:-1] | shown[1:])
        kept = np.append(needed, len(knots)) if len(needed) else np.array([len(knots)])
        self.knots = knots[needed]
        self.visible = shown[kept]
        self._middle = self._middles(knots)[kept]
        self._alpha, self._alpha_slope = (line[kept] for line in slopes_alpha)
        self._color, self._color_slope = (line[kept] for line in slopes_color)
        self._seen_before = np.concatenate(([0], np.cumsum(self.visible)))

    @staticmethod
    def _middles(knots: np.ndarray) -> np.ndarray:
        aside = 1.0 + np.abs(knots[[0, -1]])
        return np.concatenate((knots[:1] - aside[0], 0.5 * (knots[:-1] + knots[1:]), knots[-1:] + aside[1]))

    def _lines(self, points, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The value in the middle of each segment, and the slope; both (K + 1, ...)."""
        middle = self._middles(knots)
        aside = 0.25 * np.concatenate(([1.0], np.diff(knots), [1.0]))
        value = piecewise_linear(points, middle)
        rise = piecewise_linear(points, middle + aside) - piecewise_linear(points, middle - aside)
        return value, (rise.T / (2.0 * aside)).T

    def of(self, values) -> np.ndarray:
        """The segment of each value; a value on a knot belongs to the segment above."""
        return np.searchsorted(self.knots, values, side="right")

    def show_between(self, low, high) -> np.ndarray:
        """Whether the opacity is above zero anywhere from ``low`` to ``high``; False where one of them is NaN."""
        # A value on a knot may belong to the segment above it, the limit from below to the one under it.
        first, last = np.searchsorted(self.knots, low), np.searchsorted(self.knots, high, side="right")
        seen = self._seen_before[last + 1] > self._seen_before[first]
        return seen & ~(np.isnan(low) | np.isnan(high))

    def evaluate(self, segment: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Opacity (P, N) and color (P, 3, N) of values (P, N), each row in its ``segment`` (P,)."""
        off = values - self._middle[segment][:, None]
        alpha = self._alpha[segment][:, None] + self._alpha_slope[segment][:, None] * off
        color = self._color[segment][..., None] + self._color_slope[segment][..., None] * off[:, None]
        return np.maximum(alpha, 0.0), np.maximum(color, 0.0)
