"""The body in a scan: what is left without the table, the head holder, cloths and air around it.

All but the last step works on voxels of about 2 mm: balls roll through the tissue, and what is thinner than a ball is
cut off, so that a table that touches the body is cut off too.  A nose and an ear, which are short, come back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..runtime.steps import Progress, announce, drain, rescale
from ..scene import Labels, RleSplatError
from ..volume.hounsfield import looks_like_hounsfield
from ..volume.reduced import reduce_steps
from ..volume.volume import PATIENT, NamedLabel, Volume
from .label_map import BACKGROUND, empty_map, put_segment
from .masks import CC3D, grow_steps, keep_largest_steps, label_parts, load, shrink_steps

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction

AIR = -1000.0  # HU; lower values are those beyond a scanner's field of view
VOXEL = 2.0  # mm, the largest side of the voxels that the body is looked for in, and the air left around it
RADII = (8.0, 4.0, 2.0)  # mm, of the balls, the largest first
ADULT = 200.0  # mm; lengths are smaller in the same ratio in a scan whose longest side is shorter
ENOUGH = 0.75  # share of the largest body of all balls that the body of the chosen one has at least
# mm; what the ball cuts off is a nose, an ear or a thin wall up to this length, with the streaks of fillings.
SHORT = 130.0
SIDES = 3  # on so many of four sides in a slice what is inside the body has tissue
LEAST_AIR = 0.002  # share of the voxels that must be outside of the body
BINS, ROUNDS = 1024, 100  # of the histogram that the threshold is sought in, and of the search
CLIPPED = 0.5  # percent of the values at either end that do not count in the histogram
REDUCED, FOUND = 0.4, 0.95  # shares of the time until voxels are larger, and until the body is found
SAMPLES = 1 << 20  # voxels that are looked at
# Share of the voxels shown that lie beside the body from which on these are hidden.  A head holder has 0.16 to 0.23,
# tables of two chests have 0.007 to 0.32 by the preset; of one with 0.0015 nothing is seen.
LEAST_BESIDE = 0.006
LEAST_SHOWN = 0.01  # opacity
BODY = 1  # the label of the body
NAMES = NamedLabel(BACKGROUND, "Background"), NamedLabel(BODY, "Body")


def body_labels(volume: Volume, transfer_function: TransferFunction) -> Labels | None:
    """Labels that hide what lies beside the body in a CT, if a transfer function shows much of it.

    Parameters
    ----------
    volume : Volume
        A scan in HU and millimeters.
    transfer_function : TransferFunction
        That of the scene.

    Returns
    -------
    Labels or None
        For ``Scene.labels``: 1 is the body, 0 is hidden. None for a volume that is not in HU or changes with time, if
        no body is found, and if less than 0.6 % of the voxels shown lie beside it.
    """
    return drain(body_labels_steps(volume, transfer_function))


def body_labels_steps(volume: Volume, transfer_function):
    """Generator of Progress: return what ``body_labels`` does; the label map has the names, too."""
    if volume.value_unit != "HU" or volume.frames > 1:
        return None
    try:
        body = yield from body_steps(volume)
    except RleSplatError:
        return None
    step = max(1, round((volume.voxels.size / SAMPLES) ** (1.0 / 3.0)))
    every = (slice(None, None, step),) * 3
    shown = transfer_function.alpha_at(volume.physical(volume.voxels[every])) > LEAST_SHOWN
    if np.count_nonzero(shown & ~body[every]) < LEAST_BESIDE * max(np.count_nonzero(shown), 1):
        return None
    return Labels(_map_of(volume, body), {BACKGROUND: None})


def map_steps(volume: Volume):
    """Generator of Progress: the label map of ``body_labels``, whatever is shown; RleSplatError without a body."""
    return _map_of(volume, (yield from body_steps(volume)))


def _map_of(volume: Volume, body) -> Volume:
    return replace(put_segment(empty_map(volume), BODY, body), named_labels=NAMES)


def body_steps(volume: Volume):
    """Generator of Progress: the voxels of the body, with what it encloses and about 2 mm of air around it.

    The ball is the largest one with which the body does not become much smaller: a skull's walls are thin.  The air
    around the body belongs to it, so that its skin is not cut where it fades into the air. Where the scanner's field of
    view cuts the body, the body goes on beyond it: a chest wall that is cut to a thin strip is no thin part.

    Parameters
    ----------
    volume : Volume
        A scan in millimeters whose body is brighter than the air around it.  Slices are those across the patient's long
        axis, or along z where the file does not say how it lies in the patient.

    Returns
    -------
    (nz, ny, nx) ndarray of bool

    Raises
    ------
    RleSplatError
        If there is no body with air around it, or not enough memory.
    """
    scale = min(1.0, float((volume.spacing * volume.shape_xyz).max()) / ADULT)
    factors = tuple(
        max(1, min(int(scale * VOXEL / step + 0.1), count)) for step, count in zip(volume.spacing, volume.shape_xyz)
    )
    coarse = yield from announce(reduce_steps(volume, factors), 0.0, REDUCED, "averaging voxels")
    values = _values(coarse, volume)
    tissue, depth = values > _threshold(values), _depth_in_view(values, coarse)
    share = (FOUND - REDUCED) / len(RADII)
    bodies = []
    for number, radius in enumerate(RADII):
        steps = _without_thin_parts(tissue, depth, coarse, scale * radius, scale * VOXEL)
        bodies.append((yield from rescale(steps, REDUCED + number * share, REDUCED + (number + 1) * share)))
    sizes = [np.count_nonzero(body) for body in bodies]
    body = next(one for one, size in zip(bodies, sizes) if size >= ENOUGH * max(sizes))
    if not body.any() or np.count_nonzero(~body) < LEAST_AIR * body.size:
        raise RleSplatError(
            "No body with air around it was found in the scan; make a segment of a range of values instead."
        )
    body = _fill_sides(body | _short_parts(tissue & ~body, body, scale * SHORT / coarse.spacing[::-1]), _across(coarse))
    grown = yield from rescale(grow_steps(body, coarse.spacing, scale * VOXEL), FOUND, 1.0)
    grown &= body | ~tissue  # none of the table
    return _enlarge(grown, factors, volume.voxels.shape)


def _values(coarse: Volume, volume: Volume) -> np.ndarray:
    """(nz, ny, nx) float64: physical values of the larger voxels, without those that are lower than air."""
    values = coarse.physical(coarse.voxels)
    finite = np.isfinite(values)
    if not finite.all():
        values[~finite] = values[finite].min(initial=0.0)
    return np.maximum(values, AIR) if volume.value_unit == "HU" or looks_like_hounsfield(volume) else values


def _threshold(values: np.ndarray) -> float:
    """The value between air and tissue that has the least cross entropy.

    C. H. Li, P. K. S. Tam, "An iterative algorithm for minimum cross entropy thresholding", Pattern Recognition Letters
    19 (1998), equation 10, of values from the lowest one on.
    """
    low, high = np.percentile(values, (CLIPPED, 100.0 - CLIPPED))
    if not low < high:
        return float(high)
    counts, edges = np.histogram(np.clip(values, low, high), BINS)
    centers = 0.5 * (edges[1:] + edges[:-1]) - low
    threshold = centers @ counts / counts.sum()
    for _ in range(ROUNDS):
        before, upper = threshold, centers > threshold
        below, above = (centers[part] @ counts[part] / counts[part].sum() for part in (~upper, upper))
        threshold = (above - below) / np.log(above / below)
        if abs(threshold - before) < 0.5 * (edges[1] - edges[0]):
            break
    return float(low + threshold)


def _across(coarse: Volume) -> list[int]:
    """The two axes of the arrays in the slices across the patient's long axis."""
    along = int(np.abs(coarse.affine[2, :3]).argmax()) if coarse.space == PATIENT else 2
    return [axis for axis in range(3) if axis != 2 - along]


def _depth_in_view(values: np.ndarray, coarse: Volume) -> np.ndarray:
    """(nz, ny, nx) float64: mm from each voxel to the side of its slice or of the scanner's round field of view.

    It is below 0 outside of the circle, and without one if the values there are not all equal.
    """
    first, second = _across(coarse)
    half = [0.5 * values.shape[axis] * coarse.spacing[2 - axis] for axis in (first, second)]
    places = [np.linspace(-one, one, 2 * values.shape[axis] + 1)[1::2] for axis, one in zip((first, second), half)]
    depth = np.minimum.outer(*(one - np.abs(place) for one, place in zip(half, places)))
    round_depth = max(half) - np.hypot.outer(*places)
    along = ({0, 1, 2} - {first, second}).pop()
    depth, round_depth = (np.broadcast_to(np.expand_dims(one, along), values.shape) for one in (depth, round_depth))
    outside = values[round_depth < -coarse.spacing.max()]
    return np.minimum(depth, round_depth) if outside.size and np.ptp(outside) == 0.0 else depth


def _without_thin_parts(tissue: np.ndarray, depth: np.ndarray, coarse: Volume, radius: float, margin: float):
    """Generator of Progress: the largest part through which a ball rolls, tissue close to it, and all it encloses.

    The ball rolls beyond the field of view, too; tissue at its edge is no thin part if it is connected there to others.
    ``depth``: of ``_depth_in_view``.
    """
    spacing = coarse.spacing
    if not tissue.any():
        return tissue
    beyond = depth < 0.0
    core = yield from rescale(shrink_steps(tissue | beyond, spacing, radius), 0.0, 0.3)
    core = (core & ~beyond) | (tissue & (depth < radius + margin) & ~beyond)
    if not core.any():
        return core
    core = yield from rescale(keep_largest_steps(core), 0.3, 0.5)
    near = yield from rescale(grow_steps(core, spacing, radius + 1.5 * margin), 0.5, 0.9)
    yield Progress(0.9, "filling the body")
    return _fill_sides(tissue & near, _across(coarse))


def _short_parts(cut: np.ndarray, body: np.ndarray, most) -> np.ndarray:
    """The connected parts of ``cut`` that touch the body, have at most so many voxels along each axis, and do not reach
    the volume's sides, where a part of a table is short, too."""
    parts = label_parts(cut)
    boxes = load("cc3d", CC3D).statistics(parts, no_slice_conversion=True)["bounding_boxes"].astype(int)
    first, last = boxes[:, ::2], boxes[:, 1::2]
    short = ((first > 0) & (last < np.array(cut.shape) - 1) & (last - first < most)).all(axis=1)
    touching = np.zeros(len(short), bool)
    for axis in range(3):
        along, beside = np.moveaxis(parts, axis, 0), np.moveaxis(body, axis, 0)
        touching[along[1:][beside[:-1]]] = touching[along[:-1][beside[1:]]] = True
    short &= touching
    short[0] = False  # outside of all parts
    return short[parts]


def _fill_sides(mask: np.ndarray, axes) -> np.ndarray:
    """A mask and what has it on SIDES of four sides in a slice: lungs, also those that the scan's side cuts open."""
    count = np.zeros(mask.shape, np.uint8)
    for axis in axes:
        for turn in (slice(None), slice(None, None, -1)):
            way = tuple(turn if one == axis else slice(None) for one in range(3))
            count[way] += np.logical_or.accumulate(mask[way], axis=axis)
    return mask | (count >= SIDES)


def _enlarge(mask: np.ndarray, factors, shape) -> np.ndarray:
    """A mask of blocks of voxels, ``factors`` along x, y, z, as one of the voxels (nz, ny, nx)."""
    z, y, x = (np.arange(count) // factor for count, factor in zip(shape, factors[::-1]))
    return mask[np.ix_(z, y, x)]
