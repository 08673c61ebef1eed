"""Light on nodes, read beside voxels: kernels against numpy, and both against rays through interpolated extinction."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.visible import VisibleVoxels
from rle_splat.effects.shadows import (
    FULL,
    Occluders,
    light_passes,
    node_light_steps,
    pool_occluders_steps,
    scattered_light_steps,
    sky_passes,
    voxel_light_steps,
)
from rle_splat.encode.encode import table_steps
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip
from rle_splat.shade.light_nodes import read_nodes_steps
from rle_splat.shade.light_samples import sky_directions
from rle_splat.shade.sample_light import ONE
from rle_splat.shade.surface_points import STEPS, points_for
from tests.lamps import point, pose, sun

SKEWED = np.array(((0.9, 0.1, 0.0, 3.0), (-0.2, 1.1, 0.1, 1.0), (0.0, 0.2, 0.8, -2.0), (0.0, 0.0, 0.0, 1.0)))
CODE = 1.0 / float(ONE)


def occluders_of(field, matrix=None, threads=1, triangles=None, clips=()):
    """Voxels above 0 of extinction ``field`` (nz, ny, nx), 1 / world length."""
    matrix, kept = np.eye(4) if matrix is None else matrix, field > 0.0
    nz, ny, nx = field.shape
    rows = kept.reshape(-1, nx)
    starts = np.concatenate(([0], np.cumsum(rows.sum(axis=1)))).astype(np.int64)
    pieces = (np.diff(rows.astype(np.int8), axis=1, prepend=0) == 1).sum(axis=1).astype(np.int32)
    column, values = np.nonzero(kept)[2].astype(np.uint16), field[kept].astype(np.float32)
    voxels = VisibleVoxels((nx, ny, nz), starts, pieces, column, values, 0)

    def extinction_steps():
        yield 0.0
        return values

    return Occluders(
        voxels, extinction_steps, lambda axis: table_steps(voxels, axis, threads=threads), matrix, triangles, clips, (),
        boxed=True, threads=threads,
    )  # fmt: skip


def read(passes, occluders, voxels, offsets, side=1, strength=1.0):
    """(m,) int16: ONE times the light at points beside ``voxels``, from a grid on those of ``occluders``."""
    nodes = drain(node_light_steps(*passes, occluders))
    codes = np.full((len(voxels), 4), -1, np.int16)
    points = points_for(None, np.zeros_like(offsets), offsets, occluders.matrix)
    drain(read_nodes_steps(nodes, side, strength, voxels, points, None, codes, 3, threads=occluders.threads))
    assert (codes[:, :3] == -1).all()
    return codes[:, 3]


def beside(light, occluders, offsets):
    return read(light_passes(light, occluders, nodes=True), occluders, occluders.voxels, offsets)


def coarsely_beside(light, occluders, offsets, side=2):
    pooled = drain(pool_occluders_steps(occluders, side))
    return read(light_passes(light, pooled, nodes=True, sharp=True), pooled, occluders.voxels, offsets, side)


SUNS = [(0, 0, -1), (0, 1, 0), (-1, 0, 0), (0.5, 0.3, -1), (-0.6, 0.2, 1), (1, 0.4, -0.3), (0.2, -1, 0.7)]
PLACES = [(9.3, 8.2, 40.0), (30.0, 31.0, 3.0), (9.1, 8.7, 9.4), (-20.0, 9.0, 9.0), (4.0, 2.0, 8.0)]


def points_of(occluders, offsets, side=1):
    """(m, 3) voxel indices x, y, z where light is read: as many nodes away as ``offsets`` has voxels."""
    voxels = occluders.voxels
    row = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
    ny = voxels.shape_xyz[1]
    return np.stack((voxels.column.astype(float), row % ny, row // ny), axis=1) + side * offsets / STEPS


def integrated(field, matrix, begins, ends, steps=2000):
    """(n,) transmittance between index positions, through trilinear extinction that ends at the outermost voxels."""
    padded, left = np.pad(field.astype(np.float64), ((0, 1),) * 3), []
    share = (np.arange(steps) + 0.5) / steps
    for begin, end in zip(begins, ends):
        at = begin + (end - begin) * share[:, None]
        at = at[((at >= 0.0) & (at <= np.array(field.shape[::-1]) - 1.0)).all(axis=1)]
        cell, found = at.astype(int), 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, at - cell, 1.0 - (at - cell)).prod(axis=1)
            x, y, z = (cell + corner).T
            found = found + weight * padded[z, y, x]
        left.append(np.exp(-np.sum(found) * np.linalg.norm(matrix[:3, :3] @ (end - begin)) / steps))
    return np.array(left)


def between_nodes(field, matrix, points, end_of, side=1):
    """(n,) transmittance to points, interpolated between that to the nodes around each; ``end_of(begins)``: of rays."""
    at = (points - 0.5 * (side - 1)) / side
    at = np.clip(at, -1.0, np.ceil(np.array(field.shape[::-1]) / side))
    cell = np.minimum(np.floor(at), np.ceil(np.array(field.shape[::-1]) / side) - 1.0)
    found = 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, at - cell, 1.0 - (at - cell)).prod(axis=1)
        nodes = (cell + corner) * side + 0.5 * (side - 1)
        found = found + weight * integrated(field, matrix, nodes, end_of(nodes), steps=500)
    return found


def far_along(matrix, begins, direction):
    """Index positions (n, 3) against a world direction, out of any small volume."""
    way = np.linalg.solve(matrix[:3, :3], np.asarray(direction, float))
    return begins - 60.0 * way / np.abs(way).max()


def smooth(shape, seed=3, most=0.3):
    """Random waves some ten voxels long, 0 to ``most``, that are 0 at the faces."""
    z, y, x = np.mgrid[tuple(slice(n) for n in shape)]
    rng = np.random.default_rng(seed)
    field = sum(np.cos(a * x + b * y + c * z + d) for a, b, c, d in rng.uniform(-0.7, 0.7, (5, 4)))
    field = most * (field - field.min()) / np.ptp(field)
    for axis, n in enumerate(shape):
        fading = np.minimum(1.5 * np.sin(np.pi * np.arange(n) / (n - 1)), 1.0) ** 2
        field *= np.expand_dims(fading, tuple({0, 1, 2} - {axis}))
    return field


def random_offsets(occluders, most=3.0, seed=1):
    rng = np.random.default_rng(seed)
    return np.rint(STEPS * rng.uniform(-most, most, (len(occluders.voxels), 3))).astype(np.int16)


def some(occluders, count=40):
    return np.random.default_rng(0).choice(len(occluders.voxels), count, replace=False)


@pytest.mark.parametrize("along", SUNS)
@pytest.mark.parametrize("matrix", [np.eye(4), SKEWED])
def test_suns_are_rays_through_interpolated_extinction(along, matrix):
    field = smooth((19, 18, 20))
    occluders = occluders_of(field, matrix)
    offsets = random_offsets(occluders)
    codes, chosen = beside(sun(along), occluders, offsets), some(occluders)
    begins = points_of(occluders, offsets)[chosen]
    expected = between_nodes(field, matrix, begins, lambda nodes: far_along(matrix, nodes, along))
    off = np.abs(codes[chosen] * CODE - expected)
    assert np.ptp(expected) > 0.3
    assert off.max() < 0.035 and off.mean() < 0.006


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("matrix", [np.eye(4), SKEWED])
def test_lamps_are_rays_through_interpolated_extinction(place, matrix):
    field = smooth((19, 18, 20))
    occluders = occluders_of(field, matrix)
    offsets = random_offsets(occluders)
    lamp = matrix[:3, :3] @ place + matrix[:3, 3]
    codes, chosen = beside(point(lamp), occluders, offsets), some(occluders)
    begins = points_of(occluders, offsets)[chosen]
    far = np.linalg.norm(begins - place, axis=1) > 2.0  # nearer than that, half of a slice weighs as much as the way
    expected = between_nodes(field, matrix, begins, lambda nodes: np.broadcast_to(place, nodes.shape))
    off = np.abs(codes[chosen] * CODE - expected)[far]
    assert np.ptp(expected) > 0.3
    assert off.max() < 0.03 and off.mean() < 0.007


@pytest.mark.parametrize("light", [*map(sun, SUNS), *map(point, PLACES[:2])])
def test_the_grid_of_drafts_is_near_the_rays_of_all_voxels(light):
    """Against rays through the extinction of every voxel to where light is read."""
    field = smooth((24, 22, 26), most=0.15)
    occluders = occluders_of(field, SKEWED)
    offsets = random_offsets(occluders, 1.5)
    codes, chosen = coarsely_beside(light, occluders, offsets), some(occluders, 150)  # means over fewer err more
    begins = points_of(occluders, offsets, side=2)[chosen]
    place = np.linalg.solve(SKEWED[:3, :3], light.matrix_world[:3, 3] - SKEWED[:3, 3])
    along = -light.matrix_world[:3, 2]
    is_sun = light.type == "SUN"

    def end_of(nodes):
        return far_along(SKEWED, nodes, along) if is_sun else np.broadcast_to(place, nodes.shape)

    off = codes[chosen] * CODE - between_nodes(field, SKEWED, begins, end_of, side=2)
    straight = codes[chosen] * CODE - integrated(field, SKEWED, begins, end_of(begins))
    assert np.ptp(codes[chosen]) > 0.3 * ONE
    # The waves are five nodes long: one by one rays err by what means of eight voxels leave out, but not in the mean.
    assert np.abs(off).max() < 0.1 and abs(off.mean()) < 0.005
    assert np.abs(straight).max() < 0.13 and abs(straight.mean()) < 0.006


def test_a_coarse_grid_is_the_same_whatever_is_made_at_once(monkeypatch):
    """Averaged, listed and placed in scanlines plane by plane, as large volumes are: every node as if at once."""
    field = smooth((19, 18, 23), most=0.5)
    field[field < 0.2] = 0.0
    clip = Clip("plane", matrix_world=pose((9.0, 8.0, 10.0), (0.3, 0.2, -1)))

    def pooled():
        found = drain(pool_occluders_steps(occluders_of(field, SKEWED, clips=(clip,)), 2))
        return found, drain(found.blocking_steps(0))

    whole, across = pooled()
    steps = []
    for module, name in (
        ("effects.shadows", "LISTED_AT_ONCE"), ("encode.pooling", "VOXELS_AT_ONCE"), ("effects.clip_cover", "AT_ONCE"),
        ("encode.encode", "RECORDS_AT_ONCE"), ("encode.encode", "TOUCHED_AT_ONCE"),
    ):  # fmt: skip
        monkeypatch.setattr(sys.modules[f"rle_splat.{module}"], name, 100)
    drain(pool_occluders_steps(occluders_of(field, SKEWED, clips=(clip,)), 2), steps.append)
    assert len(steps) >= 20 and steps == sorted(steps)
    pieces, across_pieces = pooled()
    for name in ("row_start", "row_pieces", "column", "stored", "bits"):
        ours, theirs = getattr(pieces.voxels, name), getattr(whole.voxels, name)
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)
    for ours, theirs in zip(across_pieces[1:], across[1:]):
        np.testing.assert_array_equal(ours, theirs)
    dense = np.zeros(whole.voxels.shape_xyz[::-1])
    row = np.repeat(np.arange(dense.shape[0] * dense.shape[1]), np.diff(whole.voxels.row_start))
    dense.reshape(-1, dense.shape[2])[row, whole.voxels.column] = drain(whole.extinction_steps())
    np.testing.assert_allclose(dense, _means(field, clip), rtol=1e-5, atol=1e-7)


def _means(field, clip):
    """Means over cubes of two voxels of what a plane keeps of a field."""
    index = np.moveaxis(np.indices(field.shape)[::-1], 0, -1)
    own = (np.linalg.inv(clip.matrix_world) @ SKEWED)[2]
    kept = np.clip(0.5 - (index @ own[:3] + own[3]) / np.linalg.norm(own[:3]), 0.0, 1.0)
    kept = kept if clip.keep == "inside" else 1.0 - kept
    padded = np.pad(field * kept, [(0, n % 2) for n in field.shape])
    nz, ny, nx = (n // 2 for n in padded.shape)
    return padded.reshape(nz, 2, ny, 2, nx, 2).mean(axis=(1, 3, 5))


@pytest.mark.parametrize("along", SUNS)
def test_a_homogeneous_box_ends_at_its_outermost_voxels(along):
    field = np.full((11, 12, 13), 0.2)
    occluders = occluders_of(field, SKEWED)
    offsets = random_offsets(occluders)
    at = points_of(occluders, offsets)
    chosen = np.flatnonzero(((at >= 0.0) & (at <= np.array(field.shape[::-1]) - 1.0)).all(axis=1))[::7]
    codes = beside(sun(along), occluders, offsets)[chosen] * CODE
    off = codes - integrated(field, SKEWED, at[chosen], far_along(SKEWED, at[chosen], along))
    # At nodes on faces half of a slice counts; between those and the layer around the box light rises to all of it.
    assert abs(off.mean()) < 0.025 and np.sqrt((off**2).mean()) < 0.08


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_plate_shades_by_how_much_of_it_lies_before_the_point(axis, sign):
    """A plate of one voxel, next to nothing before it: its own nodes have all of the light, those behind the rest."""
    field = np.full((15, 15, 15), 1e-6)
    np.moveaxis(field, 2 - axis, 0)[7] = 1.0
    occluders = occluders_of(field)
    offsets = np.zeros((len(occluders.voxels), 3), np.int16)
    offsets[:, axis] = np.random.default_rng(2).integers(-2048, 2048, len(offsets))
    along = np.zeros(3)
    along[axis] = sign
    codes = beside(sun(along), occluders, offsets)
    behind = sign * (points_of(occluders, offsets)[:, axis] - 7.0)
    expected = np.interp(behind, (0.0, 1.0), np.exp((-0.0, -1.0)))
    np.testing.assert_allclose(codes * CODE, expected, atol=1e-3)  # positions are whole steps of 1 / 1024


@pytest.mark.parametrize("light", [sun((0.5, 0.3, -1)), sun((1, 0.4, -0.3)), point((9.1, 8.7, 9.4)), point((9, 30, 9))])
@pytest.mark.parametrize("meshes", [False, True])
@pytest.mark.parametrize("find", [beside, coarsely_beside])
def test_kernels_are_as_numpy_on_any_number_of_threads(light, meshes, find, monkeypatch):
    monkeypatch.setattr("rle_splat.shade.light_nodes.NODES_AT_ONCE", 1)
    monkeypatch.setattr("rle_splat.shade.light_nodes.READ_AT_ONCE", 500)
    field = smooth((22, 40, 20), most=0.5)
    field[field < 0.15] = 0.0
    triangles = np.array([[(2.0, 0.0, 9.0), (20.0, 2.0, 6.0), (5.0, 30.0, 8.0)]]) if meshes else None
    found = []
    for threads in (1, 2, 3):
        occluders = occluders_of(field, SKEWED, threads, triangles)
        found.append(find(light, occluders, random_offsets(occluders)))
    with use_reference():
        reference = find(light, occluders, random_offsets(occluders))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    off = np.abs(found[0] * CODE - reference * CODE)
    assert np.ptp(reference) > 0.5 * ONE
    assert (off > 3 * CODE).mean() < (1e-3 if meshes else 1e-9)  # the edge of a mesh is a step


@pytest.mark.parametrize("light", [sun((0.5, 0.3, -1)), point((9.1, 8.7, 9.4)), replace(sun((0, 0, -1)), angle=0.5)])
def test_scattered_light_is_the_octaves_of_each_point_of_a_lamp(light):
    """T as it is swept alone, and U of the powers of what each point of the lamp sends; on any number of threads."""
    field = smooth((19, 18, 20), most=3.0)

    def lit(find_steps, part=1.0, threads=1):
        occluders = occluders_of(part * field, SKEWED, threads)
        return drain(find_steps(*light_passes(light, occluders, nodes=True), occluders)) / FULL

    found, alone = lit(scattered_light_steps), lit(node_light_steps)
    np.testing.assert_allclose(found[0], alone, atol=4 * CODE)
    assert np.ptp(alone) > 0.5
    # A medium that is half as dense, and one of a quarter.
    expected = (2.0 * lit(node_light_steps, 0.5) + lit(node_light_steps, 0.25)) / 3.0
    np.testing.assert_allclose(found[1], expected, atol=4 * CODE)
    np.testing.assert_array_equal(found, lit(scattered_light_steps, threads=2))


def test_nodes_have_the_light_of_their_voxels():
    """Points at the voxels are as voxels, but that their own share is interpolated, too."""
    occluders = occluders_of(smooth((19, 18, 20), most=0.1))
    none = np.zeros((len(occluders.voxels), 3), np.int16)
    for light in (sun((0, 0, -1)), sun((0.5, 0.3, -1)), point((9.3, 8.2, 40.0))):
        found = beside(light, occluders, none) * CODE
        within = drain(voxel_light_steps(*light_passes(light, occluders, nodes=False), occluders)) / FULL
        np.testing.assert_allclose(found, within, atol=7e-3)


def test_every_point_is_in_one_pyramid_of_a_lamp():
    """A lamp within a uniform medium, and points anywhere around it: none is forgotten, so none is unshadowed."""
    occluders = occluders_of(np.full((21, 21, 21), 0.2))
    offsets = random_offsets(occluders, 2.0)
    place = np.array((10.25, 9.5, 10.125))
    codes = beside(point(place), occluders, offsets) * CODE
    at = points_of(occluders, offsets)
    inside = (np.abs(at - 10.0) < 9.0).all(axis=1) & (np.linalg.norm(at - place, axis=1) > 2.0)
    expected = np.exp(-0.2 * np.linalg.norm(at - place, axis=1))
    np.testing.assert_allclose(codes[inside], expected[inside], atol=0.02)


def test_a_mesh_shades_points_behind_it_and_none_before_it():
    field = np.full((20, 9, 9), 1e-4)
    square = np.array(
        [[(-30, -30, 10.3), (30, -30, 10.3), (30, 30, 10.3)], [(-30, -30, 10.3), (30, 30, 10.3), (-30, 30, 10.3)]]
    )
    occluders = occluders_of(field, triangles=square.astype(float))
    offsets = random_offsets(occluders)
    codes = beside(sun((0, 0, -1)), occluders, offsets) * CODE
    height = points_of(occluders, offsets)[:, 2]
    # The node half a slice behind a mesh is lit, and light falls to the next one.
    assert codes[height > 10].min() > 0.99 and codes[height < 9].max() < 0.01


def test_the_sky_beside_voxels_is_the_mean_over_its_directions():
    field = smooth((19, 18, 20))
    occluders = occluders_of(field, SKEWED)
    offsets = random_offsets(occluders)
    codes, chosen = read(sky_passes(occluders, nodes=True), occluders, occluders.voxels, offsets), some(occluders, 60)
    begins = points_of(occluders, offsets)[chosen]
    of_each = [
        between_nodes(field, SKEWED, begins, lambda nodes, along=along: far_along(SKEWED, nodes, along))
        for along in sky_directions()
    ]
    np.testing.assert_allclose(codes[chosen] * CODE, np.mean(of_each, axis=0), atol=8e-3)


@pytest.mark.parametrize("shape", [(1, 5, 5), (5, 1, 5), (5, 5, 1), (1, 1, 1), (2, 2, 2)])
def test_thin_volumes_and_lights_in_odd_places_are_no_trouble(shape):
    occluders = occluders_of(np.full(shape, 0.5))
    offsets = random_offsets(occluders, 31.0)
    for light in (point((2, 2, 0)), point((0, 0, 0)), point((1e9, 2e8, 1e8)), sun((1, 1, 1)), sun((0, 0, -1))):
        for chosen in (offsets, np.zeros_like(offsets)):
            found = beside(light, occluders, chosen)
            assert found.shape == (len(occluders.voxels),) and found.min() > 0
    empty = occluders_of(np.zeros((4, 4, 4)))
    assert len(beside(sun((0, 0, -1)), empty, np.empty((0, 3), np.int16))) == 0


@pytest.mark.parametrize("light", (sun((0.3, -0.5, -0.8)), point((9.0, 4.0, 12.0))), ids=("sun", "point"))
def test_kernels_read_light_on_a_lamps_side_as_numpy_does(light):
    """Vectors of all directions and lengths, in a skewed volume: the point beside a voxel moves towards the lamp."""
    random = np.random.default_rng(4)
    occluders = occluders_of(random.random((7, 9, 11)), SKEWED, threads=2)
    count = len(occluders.voxels)
    normals = random.integers(-ONE // 2, ONE // 2, (count, 3)).astype(np.int16)
    normals[::5] = 0
    offsets = random.integers(-2048, 2048, (count, 3)).astype(np.int16)
    nodes = drain(node_light_steps(*light_passes(light, occluders, nodes=True), occluders))
    found = []
    for given in (light, None):
        points = points_for(given, normals, offsets, occluders.matrix)
        for way in (nullcontext, use_reference):
            codes = np.zeros((count, 1), np.int16)
            with way():
                drain(read_nodes_steps(nodes, 1, np.float32(1.0), occluders.voxels, points, None, codes, 0, threads=2))
            found.append(codes[:, 0] * CODE)
    np.testing.assert_allclose(found[0], found[1], atol=1e-3)
    assert np.abs(found[0] - found[2]).max() > 0.1, "the lamp's side counts"
