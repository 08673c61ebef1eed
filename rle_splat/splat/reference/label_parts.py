"""Reference implementation of ``label_fields`` and ``label_block``, in numpy: all points at a time."""

from __future__ import annotations

import numpy as np

from ...classify.label_cells import MIXED, NO_KIND
from ..label_fields import HALVINGS

CORNERS = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(8, 3)[:, ::-1]  # of a cell, as x, y, z


def numbers_at(field, points) -> np.ndarray:
    """(n,) function numbers of points (n, 3), x, y, z; see ``label_fields.number_at``."""
    shape = np.array((field.n_x, field.n_y, field.n_z))
    points = np.clip(points, 0.0, shape - 1.0)
    cell = np.minimum(points.astype(np.int64), shape - 2)
    first = (cell[:, 2] * field.n_y + cell[:, 1]) * field.n_x + cell[:, 0]
    numbers = field.numbers[first].astype(np.int64)
    mixed = np.flatnonzero(numbers & MIXED)
    if len(mixed):
        numbers[mixed] = _largest(field, cell[mixed], points[mixed] - cell[mixed])
    return numbers


def _largest(field, cell, share) -> np.ndarray:
    """(n,) the function with the largest weight in mixed cells."""
    corners = cell[:, None] + CORNERS
    places = (corners[..., 2] * field.n_y + corners[..., 1]) * field.n_x + corners[..., 0]
    rows = np.repeat(np.arange(len(field.row_start) - 1), np.diff(field.row_start))
    records = np.searchsorted(rows * field.n_x + field.column, places)
    own = field.numbers[places].astype(np.int64) & NO_KIND
    kinds, weights = (each.reshape(len(field.column), -1)[records] for each in (field.kinds, field.weights))
    of_corner = np.where(CORNERS, share[:, None], 1.0 - share[:, None]).prod(axis=-1)
    totals = [((kinds == own[:, [n], None]) * weights * of_corner[..., None]).sum(axis=(1, 2)) for n in range(8)]
    return own[np.arange(len(own)), np.argmax(totals, axis=0)]


def numbers_on_rays(field, s) -> np.ndarray:
    """(H, W) function numbers of the rays of all pixels, ``s`` (H, W) voxels along the viewing direction."""
    along, across = field.along[0] + s * field.along[1], field.across[0][:, None] + s * field.across[1][:, None]
    points = [along, across]
    points.insert(field.axis, field.sign * s)
    return numbers_at(field.cells, np.stack(points, axis=-1).reshape(-1, 3)).reshape(s.shape)


def label_parts(field, begin, end, count: int) -> np.ndarray:
    """(count, H, W) float32: what of the slab from ``begin`` to ``end``, (H, W) each, belongs to each function."""
    end = np.maximum(begin, end)
    near, far = numbers_on_rays(field, begin), numbers_on_rays(field, end)
    low, high = np.zeros(begin.shape), np.ones(begin.shape)
    if (near != far).any():
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            same = numbers_on_rays(field, begin + middle * (end - begin)) == near
            low, high = np.where(same, middle, low), np.where(same, high, middle)
    share = np.where(near == far, 1.0, 0.5 * (low + high)).astype(np.float32)
    numbers = np.arange(count)[:, None, None]
    return (numbers == near) * share + (numbers == far) * (np.float32(1.0) - share)
