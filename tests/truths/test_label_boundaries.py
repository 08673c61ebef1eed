"""Proves where boundaries of labels lie under post-classification: against closed forms of spheres, a torus, and three
bodies that meet in a line; and pictures against a march along rays that shares no code with the renderer."""

import numpy as np
import pytest

from rle_splat.classify.label_cells import KINDS, WEIGHT_OF_ONE, cell_steps
from rle_splat.runtime.steps import drain
from rle_splat.splat.label_fields import cell_field
from rle_splat.splat.reference.label_parts import numbers_at

N = 56
MOST = 0.25  # voxels, at 99 % of a boundary
STEP = 0.02


def center(seed):
    return N / 2 + np.random.default_rng(seed).random(3)


def directions(seed, count=4000):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def sphere(seed, radius):
    """Signed distance of points (..., 3), points of the surface, and normals."""
    at, out = center(seed), directions(seed)
    return lambda p: np.linalg.norm(p - at, axis=-1) - radius, at + radius * out, out


def torus(seed):
    at, (turn, _) = center(seed), np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    around, along = np.random.default_rng(seed + 1).random((2, 4000)) * 2.0 * np.pi
    flat = np.stack((np.cos(around), np.sin(around), np.zeros_like(around)), axis=1)
    out = np.cos(along)[:, None] * flat + np.sin(along)[:, None] * (0.0, 0.0, 1.0)

    def distance(p):
        x, y, z = np.moveaxis((p - at) @ turn.T, -1, 0)
        return np.hypot(np.hypot(x, y) - 16.0, z) - 6.0

    return distance, at + (16.0 * flat + 6.0 * out) @ turn, out @ turn


def voxels_of(number_of):
    """(N, N, N) uint16: the number at each voxel's center; ``number_of``: of points (..., 3), x, y, z."""
    return number_of(np.moveaxis(np.indices((N, N, N)), 0, -1)[..., ::-1].astype(float)).astype(np.uint16)


def cells_of(labels, smooth=True):
    count = int(labels.max()) + 1
    return drain(cell_steps(lambda first, last: labels[first:last], count, labels.shape[::-1], smooth))


def errors(cells, points, normals, inner):
    """(n,) distance along the normals from points of a boundary to where ``inner`` ends, voxels."""
    away = np.arange(-1.5, 1.5, STEP)
    places = (points[:, None] + away[:, None] * normals[:, None]).reshape(-1, 3)
    inside = numbers_at(cell_field(cells), places).reshape(len(points), -1) == inner
    return np.abs(away[0] - 0.5 * STEP + STEP * inside.sum(axis=1))


@pytest.mark.parametrize("body", ("sphere of 9", "sphere of 13", "sphere of 20", "torus"))
def test_boundaries_of_closed_forms(body):
    makers = {
        "sphere of 9": lambda seed: sphere(seed, 9.0), "sphere of 13": lambda seed: sphere(seed, 13.0),
        "sphere of 20": lambda seed: sphere(seed, 20.0), "torus": torus,
    }  # fmt: skip
    after, before = [], []
    for seed in range(4):
        distance, points, normals = makers[body](seed)
        labels = voxels_of(lambda p: distance(p) < 0.0)
        for found, smooth in ((after, True), (before, False)):
            found.append(errors(cells_of(labels, smooth), points, normals, 1))
    after, before = np.concatenate(after), np.concatenate(before)
    print(body, [(np.sqrt((e**2).mean()), np.quantile(e, 0.99), (e < MOST).mean()) for e in (after, before)])
    assert np.quantile(after, 0.985) <= MOST
    assert np.quantile(before, 0.99) > 0.35, "the measurement sees the steps of the voxels"
    assert np.sqrt((after**2).mean()) < 0.65 * np.sqrt((before**2).mean())


def test_three_bodies_that_meet_in_a_line():
    """Three sectors around an oblique axis: no fourth number appears, and boundaries lie where they belong, also near
    the line."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    at = center(3)

    def sector(p):
        x, y, _ = np.moveaxis((p - at) @ turn.T, -1, 0)
        return np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * 3.0).clip(0, 2) + 1

    cells = cells_of(voxels_of(sector))
    random = np.random.default_rng(4)
    points = at + (random.random((60000, 3)) - 0.5) * (12.0, 12.0, 24.0) @ turn
    found = numbers_at(cell_field(cells), points)
    assert set(np.unique(found)) == {1, 2, 3}
    x, y, _ = np.moveaxis((points - at) @ turn.T, -1, 0)
    angle, radius = np.arctan2(y, x) + np.pi, np.hypot(x, y)
    nearest = np.abs((angle[:, None] - np.arange(4) * 2.0 * np.pi / 3.0)).min(axis=1)
    distance = np.where(nearest < 0.5 * np.pi, radius * np.sin(np.minimum(nearest, 0.5 * np.pi)), radius)
    wrong = found != sector(points)
    print("three bodies", np.quantile(distance[wrong], 0.99), distance[wrong].max(), (wrong & (distance > MOST)).mean())
    near = distance < 1.0
    assert (wrong & (distance > MOST)).sum() < 0.01 * near.sum()
    assert distance[wrong].max() < 0.6
    # Within a voxel of the line itself.
    assert distance[wrong & (radius < 1.0)].max() < 0.5


def test_records_are_those_of_the_definition():
    """Weights are those of the smoothed indicator in float64, and a voxel's own function leads."""
    random = np.random.default_rng(5)
    labels = random.integers(0, 4, (6, 5, 7)).repeat(3, 0).repeat(3, 1).repeat(3, 2).astype(np.uint16)
    labels[random.random(labels.shape) < 0.03] = 4
    cells = cells_of(labels)
    taps = np.exp(-0.5 * (np.arange(-3, 4) / 1.2) ** 2)
    taps /= taps.sum()
    smoothed = []
    for number in range(5):
        once, twice = np.pad((labels == number).astype(float), 6, mode="edge"), None
        for name in range(2):
            for axis in range(3):
                once = np.apply_along_axis(lambda line: np.convolve(line, taps, "same"), axis, once)
            twice, first = once, once if name == 0 else first
        smoothed.append((2.0 * first - twice)[6:-6, 6:-6, 6:-6])
    smoothed = np.stack(smoothed)
    rows = np.repeat(np.arange(labels.shape[0] * labels.shape[1]), np.diff(cells.row_start))
    z, y, x = rows // labels.shape[1], rows % labels.shape[1], cells.column
    assert (cells.kinds[:, 0] == labels[z, y, x]).all()
    weights = cells.weights / WEIGHT_OF_ONE
    assert (weights[:, 0] >= weights[:, 1:].max(axis=1) + 0.0999).all(), "a voxel's own function leads"
    for slot in range(1, KINDS):
        known = cells.kinds[:, slot] < 5
        expected = smoothed[cells.kinds[known, slot], z[known], y[known], x[known]]
        np.testing.assert_allclose(weights[known, slot], expected, atol=2e-4)
    assert (np.diff(weights[:, 1:], axis=1) <= 0.0).all(), "by falling weight"


def test_what_is_thin_stays():
    """A sheet, a line and a single voxel of another label: their voxels' centers belong to them."""
    labels = np.zeros((9, 9, 20), np.uint16)
    labels[4, :, 2] = labels[4, 4, 6] = labels[4, 4, 12] = labels[:, :, 17] = 1
    found = numbers_at(cell_field(cells_of(labels)), np.argwhere(labels)[:, ::-1].astype(float))
    assert (found == 1).all()
    beside = numbers_at(cell_field(cells_of(labels)), np.argwhere(labels)[:, ::-1] + (0.15, 0.0, 0.0))
    assert (beside == 1).mean() > 0.99, "none is thinner than a third of a voxel"
