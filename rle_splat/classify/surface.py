"""The surface between the voxels that are opaque enough and the others, as a field whose zero it is, and its colors.

The field is a distance in values, not in opacity: beside the surface it is linear in the value, so that the surface
lies where the interpolated value has the opacity that was asked for, however steep the transfer function is.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress
from ..scene import Labels, RleSplatError
from ..volume.sample import labels_at, values_at
from ..volume.volume import Volume
from .transfer_function import TransferFunction

SUNK = 1e3  # times the span of values: the field outside of the volume, which closes surfaces at its sides
NEAR_CUT = 1e-3  # times the span of values and the distance in voxels: the field within a voxel of a cut
BYTES_PER_VOXEL = 12  # the field, its copy in a grid, and what one is made from the other with
SAMPLES, STEP = 8, 0.5  # how many samples below the surface its color is of, and voxels from one to the next


@dataclass(frozen=True, eq=False)
class Solid:
    """What a surface is the boundary of.

    Parameters
    ----------
    threshold : float
        Opacity, above 0, of the transfer function at the surface.
    kept : tuple of (bodies, is_hole)
        For each clip object its half-spaces, (n, 4) float64 plane equations in voxel indices that are at most 0 inside
        and whose values are distances in voxels, and whether what is inside all of them is cut away.
    """

    volume: Volume
    function: TransferFunction
    threshold: float
    kept: tuple = ()
    labels: Labels | None = None

    @property
    def span(self) -> float:
        """The largest difference of values of the volume, above 0."""
        low, high = self.volume.value_range
        return (high - low) or 1.0


def largest_opacity(function: TransferFunction, labels: Labels | None) -> float:
    """The largest opacity that a transfer function, or one of a label, gives to a value."""
    functions = [function, *(() if labels is None else labels.functions.values())]
    return max(alpha for one in functions if one is not None for _, alpha in one.opacity)


def crossings(function: TransferFunction, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the opacity of values crosses a threshold.

    Parameters
    ----------
    threshold : float
        Opacity.

    Returns
    -------
    values : (n,) ndarray of float64
        Ascending.
    inside : (n + 1,) ndarray of bool
        Whether values before, between and after them are at least as opaque.
    """
    found = []
    for (low, before), (high, after) in pairwise(function.opacity):
        if (before >= threshold) != (after >= threshold):
            found.append(low + (high - low) * (threshold - before) / (after - before))
    values = np.array(found)
    first = function.opacity[0][1] >= threshold
    return values, (np.arange(len(values) + 1) % 2 == 1) ^ first


def signed_distance(values, function: TransferFunction | None, threshold: float, span: float) -> np.ndarray:
    """Distances of values to the nearest one with the threshold's opacity, at most ``span``; above 0 where more opaque.

    NaN counts as transparent, and so does everything without a function.
    """
    if function is None:
        return np.full(np.shape(values), -span)
    places, inside = crossings(function, threshold)
    ends = np.concatenate(([-np.inf], places, [np.inf]))
    interval = np.searchsorted(places, values, side="right")
    distance = np.minimum(np.minimum(values - ends[interval], ends[interval + 1] - values), span)
    signed = np.where(inside[interval], distance, -distance)
    return np.where(np.isnan(values), -span, signed)


def field_steps(solid: Solid):
    """Generator of Progress: the field of a solid; return it.

    Returns
    -------
    (nz + 2, ny + 2, nx + 2) ndarray of float32
        Above 0 inside, with one more voxel on each side, which is outside.

    Raises
    ------
    RleSplatError
        If there is not enough memory, or nothing is inside.
    """
    volume, span = solid.volume, solid.span
    shape = tuple(n + 2 for n in volume.voxels.shape)
    refuse_beyond(BYTES_PER_VOXEL * int(np.prod(shape, dtype=np.int64)), "The surface needs")
    field = np.full(shape, -SUNK * span, np.float32)
    has_inside = False
    for z in range(len(volume.voxels)):
        values = volume.physical(volume.voxels[z])
        plane = _plane(solid, values, z, span)
        field[z + 1, 1:-1, 1:-1] = plane
        has_inside = has_inside or bool((plane > 0.0).any())
        yield Progress((z + 1) / len(volume.voxels), "finding the surface")
    if not has_inside:
        raise RleSplatError(
            "No voxel that is shown is as opaque as that; lower the opacity, or change the transfer function or what "
            "cuts the volume."
        )
    return field


def _plane(solid: Solid, values: np.ndarray, z: int, span: float) -> np.ndarray:
    """(ny, nx) float64: the field of one plane of physical values."""
    field = signed_distance(values, solid.function, solid.threshold, span)
    if solid.labels is not None:
        labels = np.asarray(solid.labels.volume.voxels[z])
        for label, function in solid.labels.functions.items():
            chosen = labels == label
            field[chosen] = signed_distance(values[chosen], function, solid.threshold, span)
    y, x = np.indices(values.shape)
    for sides, is_hole in solid.kept:
        beyond = np.max([a * x + b * y + c * z + d for a, b, c, d in sides], axis=0)
        inside = beyond if is_hole else -beyond
        # Within a voxel of the cut it alone decides where the surface lies, further away the values alone.
        field = np.minimum(field, np.where(np.abs(inside) < 1.0, NEAR_CUT * inside, np.sign(inside)) * span)
    return field


def color_steps(solid: Solid, points: np.ndarray, normals: np.ndarray):
    """Generator of Progress: the color of points of a surface, unlit; return it.

    A point has the color that SAMPLES below it show together to someone who looks along its normal.

    Parameters
    ----------
    points : (n, 3) ndarray of float
        Voxel indices x, y, z.
    normals : (n, 3) ndarray of float
        Of length 1, in voxels, outwards.

    Returns
    -------
    (n, 3) ndarray of float32
        Scene-linear.
    """
    seen, left = np.zeros((len(points), 3)), np.ones(len(points))
    for sample in range(SAMPLES):
        places = points - (0.5 + sample) * STEP * normals
        table = _classify(solid, places)
        length = STEP * float(solid.volume.spacing.min())
        alpha = 1.0 - np.power(1.0 - np.minimum(table[:, 3], 0.9999), length / table[:, 4])
        weight = left * np.maximum(alpha, 1e-6)  # where all is transparent, its color still counts
        seen += weight[:, None] * table[:, :3]
        left -= weight
        yield Progress((sample + 1) / SAMPLES, "coloring the surface")
    return (seen / (1.0 - left)[:, None]).astype(np.float32)


def _classify(solid: Solid, places: np.ndarray) -> np.ndarray:
    """(n, 5) float64: color, opacity and opacity unit distance at voxel indices."""
    values = values_at(solid.volume, places)
    found = _evaluate(solid.function, values, solid.volume)
    if solid.labels is not None:
        labels = labels_at(solid.labels.volume, places)
        for label, function in solid.labels.functions.items():
            chosen = labels == label
            if function is not None and chosen.any():
                found[chosen] = _evaluate(function, values[chosen], solid.volume)
    return found


def _evaluate(function: TransferFunction, values: np.ndarray, volume: Volume) -> np.ndarray:
    unit = function.opacity_unit_distance or float(volume.spacing.min())
    return np.concatenate((function.table(values), np.full((len(values), 1), unit)), axis=1)
