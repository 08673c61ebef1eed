"""Geometry of sheets seen from a light: the factorization of the splat with the light in place of the eye.

Everything is in voxel-index space (algorithm.md 1.4 and 4.2). A sweep passes the slices of one principal axis
in the direction of the light. One grid, the sheet, serves all slices; a sheet pixel is one ray of light. Parallel rays
are sheared; rays from a point have one slope each. So nothing is resampled from slice to slice, and shadows do not
get softer with distance.

    sheet pixel  X = scale * i + offset_x,  Y = scale * j + offset_y      for voxel (i, j) of a slice
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..volume.axes import AXES

LEAST_DISTANCE = 1e-3  # slices; a slice nearer to the light contains the light and casts no shadow
MARGIN = 1  # sheet pixels around the needed ones


@dataclass(frozen=True, eq=False)
class Sweep:
    """One pass of light through a grid along a principal axis, away from the light.

    Arrays of length n have one entry per slice, in the order in which the light meets them.

    Attributes
    ----------
    axis : {0, 1, 2}
        x, y or z.
    slices : (n,) ndarray of int64
        Slice numbers.
    scale, offset_x, offset_y : (n,) ndarray of float64
        Map from voxels to sheet pixels; see the module.
    before, whole : (n,) ndarray of float32
        Weight of a slice for its own voxels, and for those behind it.
    spans : (n, 4) ndarray of int64
        Voxels that this sweep lights: i from, i to, j from, j to, half-open.
    width, height : int
        Size of the sheet.
    length : (6,) ndarray of float64
        Coefficients of 1, X, Y, X^2, XY, Y^2 of the squared world length between two slices along the ray of sheet
        pixel (X, Y).
    to_sheet : (4, 4) ndarray of float64
        World to homogeneous (X w, Y w, w); its last row gives the slices along the axis, up from ``slices[0]``.
    skipped : int
        Number of slices directly before a voxel that do not block its light.
    source : (3,) ndarray of float64 or None
        Voxel index of the light, whose pyramid of rays this is; None of parallel light.
    """

    axis: int
    slices: np.ndarray
    scale: np.ndarray
    offset_x: np.ndarray
    offset_y: np.ndarray
    before: np.ndarray
    whole: np.ndarray
    spans: np.ndarray
    width: int
    height: int
    length: np.ndarray
    to_sheet: np.ndarray
    skipped: int = 0
    source: np.ndarray | None = None

    @property
    def side(self) -> int:
        """The pyramid: twice its axis, and one more where it opens upwards; -1 of parallel light."""
        return -1 if self.source is None else 2 * self.axis + int(self.slices[0] > self.source[AXES[self.axis][2]])

    def without_nearest(self, skipped: int) -> Sweep:
        """Copy in which a voxel is blocked neither by itself nor by the ``skipped`` slices before it."""
        return replace(self, skipped=skipped, before=np.zeros_like(self.before))


def sun_sweeps(direction, index_to_world, shape_xyz, boxed: bool) -> list[Sweep]:
    """Sweep of parallel light.

    Parameters
    ----------
    direction : (3,) array_like
        World direction in which the light shines.
    index_to_world : (4, 4) ndarray of float64
    shape_xyz : (nx, ny, nz)
    boxed : bool
        Whether the medium ends at the centers of the outermost voxels; else it ramps to zero within one more voxel.

    Returns
    -------
    list of Sweep
        One sweep.
    """
    along = np.linalg.solve(index_to_world[:3, :3], np.asarray(direction, np.float64))
    axis = int(np.argmax(np.abs(along)))
    a, b, c = AXES[axis]
    sign = 1 if along[c] > 0.0 else -1
    slope = along / abs(along[c])
    slices = np.arange(shape_xyz[c])[::sign]
    distance = np.arange(len(slices), dtype=np.float64)
    offsets, sizes = [], []
    for part in (a, b):
        shift = -slope[part] * distance
        offsets.append(shift - shift.min() + MARGIN)
        sizes.append(int(np.ceil(np.ptp(shift))) + shape_xyz[part] + 2 * MARGIN)
    before, whole = _weights(distance + 1.0, boxed, False)
    spans = np.tile((0, shape_xyz[a], 0, shape_xyz[b]), (len(slices), 1))
    length = np.zeros(6)
    length[0] = np.square(index_to_world[:3, :3] @ slope).sum()
    # Sheet coordinates of a world point, from its voxel index: X = i - slope_a (k - k0) + offset at k0.
    rows = np.zeros((4, 4))
    for row, part, offset in ((0, a, offsets[0]), (1, b, offsets[1])):
        rows[row, part], rows[row, c] = 1.0, -sign * slope[part]
        rows[row, 3] = offset[0] + sign * slope[part] * slices[0]
    rows[2, 3] = 1.0
    rows[3, c], rows[3, 3] = sign, -sign * slices[0]
    to_sheet = rows @ np.linalg.inv(index_to_world)
    return [
        Sweep(
            axis, slices.astype(np.int64), np.ones(len(slices)), *offsets, before, whole, spans.astype(np.int64),
            *sizes, length, to_sheet,
        )
    ]  # fmt: skip


def point_sweeps(position, index_to_world, shape_xyz, boxed: bool, beside: bool = False) -> list[Sweep]:
    """Sweeps of light from a point.

    Parameters
    ----------
    position : (3,) array_like
        World.
    index_to_world : (4, 4) ndarray of float64
    shape_xyz : (nx, ny, nz)
    boxed : bool
        As in ``sun_sweeps``.
    beside : bool
        Whether points beside voxels are lit: then sheets hold all rays that pass within one voxel of the grid.

    Returns
    -------
    list of Sweep
        One for each pyramid of rays that meets voxels; six if the light is inside the volume. Voxels on the border of
        two pyramids are in both.
    """
    source = np.linalg.solve(index_to_world[:3, :3], np.asarray(position, np.float64) - index_to_world[:3, 3])
    found = []
    for axis in AXES:
        for sign in (1, -1):
            sweep = _pyramid(source, index_to_world, shape_xyz, axis, sign, boxed, beside)
            if sweep is not None:
                found.append(sweep)
    return found


def _pyramid(source, index_to_world, shape_xyz, axis: int, sign: int, boxed: bool, beside: bool) -> Sweep | None:
    """The sweep of one pyramid of rays from ``source``, (3,) voxel index; None if it meets no voxel."""
    a, b, c = AXES[axis]
    slices = np.arange(shape_xyz[c])[::sign]
    distance = sign * (slices - source[c])
    slices, distance = slices[distance > LEAST_DISTANCE], distance[distance > LEAST_DISTANCE]
    spans, reached = np.zeros((len(slices), 4), np.int64), np.zeros((len(slices), 4))
    for column, part in ((0, a), (2, b)):
        # Clip before converting to integers: far indices would not fit.
        low, high = (np.clip(source[part] + side * distance, -1.0, shape_xyz[part]) for side in (-1.0, 1.0))
        reached[:, column], reached[:, column + 1] = low, high
        spans[:, column] = np.maximum(np.ceil(low), 0)
        spans[:, column + 1] = np.minimum(np.floor(high), shape_xyz[part] - 1) + 1
    met = (spans[:, ::2] < spans[:, 1::2]).all(axis=1)
    if beside:
        met = (reached[:, ::2] < reached[:, 1::2]).all(axis=1)
    else:
        reached = spans - (0, 1, 0, 1)
    if not met.any():
        return None
    last = int(np.flatnonzero(met)[-1]) + 1
    slices, distance, spans, reached, met = (each[:last] for each in (slices, distance, spans, reached, met))
    spans[~met] = 0
    pitch = 1.0 / distance[-1]  # slope per sheet pixel: one sheet pixel is one voxel of the furthest slice
    scale = 1.0 / (distance * pitch)
    lows, offsets, sizes = [], [], []
    for column, part in ((0, a), (2, b)):
        slopes = (reached[met, column : column + 2] - source[part]) / distance[met, None]
        low = slopes.min() - MARGIN * pitch
        lows.append(low)
        offsets.append(-source[part] * scale - low / pitch)
        sizes.append(int(np.ceil(np.ptp(slopes) / pitch)) + 1 + 2 * MARGIN)
    before, whole = _weights(distance, boxed, 0.0 <= source[c] <= shape_xyz[c] - 1)
    matrix = index_to_world[:3, :3]
    along = matrix[:, a] * lows[0] + matrix[:, b] * lows[1] + matrix[:, c] * sign
    across, down = matrix[:, a] * pitch, matrix[:, b] * pitch
    length = np.array((
        along @ along, 2.0 * along @ across, 2.0 * along @ down, across @ across, 2.0 * across @ down, down @ down,
    ))  # fmt: skip
    # X w = (i - place_a) / pitch - low / pitch * w, where w is the distance in slices.
    rows = np.zeros((4, 4))
    rows[2, c], rows[2, 3] = sign, -sign * source[c]
    for row, part, low in ((0, a, lows[0]), (1, b, lows[1])):
        rows[row, part], rows[row, 3] = 1.0 / pitch, -source[part] / pitch
        rows[row] -= low / pitch * rows[2]
    rows[3, c], rows[3, 3] = sign, -sign * slices[0]
    to_sheet = rows @ np.linalg.inv(index_to_world)
    return Sweep(
        axis, slices.astype(np.int64), scale, *offsets, before, whole, spans, *sizes, length, to_sheet, source=source,
    )  # fmt: skip


def _weights(distance, boxed: bool, inside: bool) -> tuple[np.ndarray, np.ndarray]:
    """Weights of slices by the trapezoidal rule: before their own voxels, and in all.

    ``distance`` (n,): of each slice from the light, in slices; ``inside``: whether the light is between the slices.
    """
    before, whole = np.full(len(distance), 0.5, np.float32), np.ones(len(distance), np.float32)
    if inside:  # the medium of the first slice extends to the light
        before[0] = distance[0]
    elif boxed:
        before[0] = 0.0
    else:  # the medium ramps up before the first slice, and the light may be inside the ramp
        before[0] = min(0.5, distance[0])
    whole[0] = before[0] + np.float32(0.5)
    return before, whole
