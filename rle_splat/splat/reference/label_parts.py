"""Reference implementation of ``label_fields`` and ``label_block``, in numpy: all points at a time."""

from __future__ import annotations

import numpy as np

from ...classify.label_cells import CORNERS, NO_KIND, SEVERAL
from ..label_fields import LEAST_LEAD, PER_WEIGHT


def labels_at(field, points) -> tuple[np.ndarray, np.ndarray]:
    """(n,) function numbers of points (n, 3), x, y, z, and their leads; see ``label_fields.label_at``."""
    shape = np.array((field.n_x, field.n_y, field.n_z))
    points = np.clip(points, 0.0, shape - 1.0)
    cell = np.minimum(points.astype(np.int64), shape - 2)
    corners = cell[:, None] + CORNERS[:, ::-1]
    places = (corners[..., 2] * field.n_y + corners[..., 1]) * field.n_x + corners[..., 0]
    of_corner = np.where(CORNERS[:, ::-1], (points - cell)[:, None], 1.0 - (points - cell)[:, None]).prod(axis=-1)
    words = field.numbers[places].astype(np.int64)
    own = words & NO_KIND
    same = own == own[:, :1]
    leads = (np.where(same, 1.0, -1.0) * field.leads[places] * of_corner).sum(axis=1)
    other = own[np.arange(len(own)), np.argmin(same, axis=1)]
    numbers = np.where(leads >= 0.0, own[:, 0], other)
    leads = np.abs(leads)
    several = np.flatnonzero(words[:, 0] & SEVERAL)
    if len(several):
        numbers[several], leads[several] = _largest(field, places[several], own[several], of_corner[several])
    return numbers, leads


def _largest(field, places, own, of_corner) -> tuple[np.ndarray, np.ndarray]:
    """(n,) the function with the largest weight where more than two count, and its lead."""
    rows = np.repeat(np.arange(len(field.row_start) - 1), np.diff(field.row_start))
    records = np.searchsorted(rows * field.n_x + field.column, places)
    kinds, weights = (each.reshape(len(field.column), -1)[records] for each in (field.kinds, field.weights))
    totals = [((kinds == own[:, [n], None]) * weights * of_corner[..., None]).sum(axis=(1, 2)) for n in range(8)]
    totals = np.stack(totals, axis=1)
    found = own[np.arange(len(own)), np.argmax(totals, axis=1)]
    second = np.where(own == found[:, None], -np.inf, totals).max(axis=1)
    return found, (totals.max(axis=1) - second) * PER_WEIGHT


def labels_on_rays(field, s) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) function numbers of the rays of all pixels and their leads, ``s`` (H, W) voxels along the viewing
    direction."""
    along, across = field.along[0] + s * field.along[1], field.across[0][:, None] + s * field.across[1][:, None]
    points = [along, across]
    points.insert(field.axis, field.sign * s)
    found = labels_at(field.cells, np.stack(points, axis=-1).reshape(-1, 3))
    return tuple(each.reshape(s.shape) for each in found)


def share_of_near(near, far, labels_between) -> np.ndarray:
    """(...) float64: what of a stretch belongs to the function at its begin; ``near``, ``far``: numbers and leads of
    both ends; ``labels_between(share)``: those in between."""
    share = _crossing(near[1], far[1])
    number, lead = labels_between(share)
    nearer, further = share * _crossing(near[1], lead), share + (1.0 - share) * _crossing(lead, far[1])
    share = np.where(number == near[0], further, np.where(number == far[0], nearer, share))
    return np.where(near[0] == far[0], 1.0, share)


def _crossing(near_lead, far_lead) -> np.ndarray:
    return near_lead / np.maximum(near_lead + far_lead, LEAST_LEAD)


def label_parts(field, begin, end, count: int) -> np.ndarray:
    """(count, H, W) float32: what of the slab from ``begin`` to ``end``, (H, W) each, belongs to each function."""
    end = np.maximum(begin, end)
    near, far = labels_on_rays(field, begin), labels_on_rays(field, end)
    share = share_of_near(near, far, lambda share: labels_on_rays(field, begin + share * (end - begin)))
    share = share.astype(np.float32)
    numbers = np.arange(count)[:, None, None]
    return (numbers == near[0]) * share + (numbers == far[0]) * (np.float32(1.0) - share)
