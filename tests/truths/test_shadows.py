"""Proves what reaches a voxel of a light: against Beer and Lambert in closed form, against the integral along the ray
from each voxel to the light, and against similar triangles for the shadows of meshes."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.lighting import ReferenceLight, shading_of
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.effects.analyze import analyze
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.pipeline.shadow_pass import shadow_pass_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import Clock, drain
from rle_splat.scene import NO_RAYS, Clip, Light, Quality, RleSplatError, Scene
from rle_splat.shade.light_samples import fixed_samples, light_samples, sky_directions
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.lamps import point, pose, sun
from tests.ways import NUMPY, both, by

CODE = 1.0 / 65535  # of what is stored
MATT = Shade(ambient=0.0, diffuse=1.0, specular=0.0, shininess=1.0)
SKEWED = np.array(((0.9, 0.1, 0.0, 3.0), (-0.2, 1.1, 0.1, 1.0), (0.0, 0.2, 0.8, -2.0), (0.0, 0.0, 0.0, 1.0)))
# Extinction is the value: 1 - exp(-value) for each unit of length, in steps far smaller than a code.
VALUES = np.linspace(0.0, 3.0, 3001)
EXTINCTION_IS_VALUE = TransferFunction(
    opacity=tuple(zip(VALUES, -np.expm1(-VALUES))), color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=1.0, shade=MATT
)  # fmt: skip


def scene_of(field, affine=None, lights=(), **more) -> Scene:
    volume = Volume(np.asarray(field, np.float32), np.eye(4) if affine is None else affine)
    camera, _ = turntable(volume, 30, 20, 1.2, False, 40.0)
    usual = {"camera": camera, "transfer_function": EXTINCTION_IS_VALUE, "headlight": False, "volume_shadows": True}
    return Scene(volume, width=24, height=24, lights=tuple(lights), **(usual | more))


def reaching(scene, classification="pre", stage="shadows", way="numpy", threads=0):
    """(m, 3) indices x, y, z of voxels, of post those of the nodes of its grid of light, which has a layer around the
    volume, and (m,) what reaches each of the scene's light."""
    cache = StageCache()
    quality = Quality(classification=classification, threads=threads, name="")
    with by(way):
        render(scene, quality, cache=cache)
    held = {place[0]: cache.job().get(*place, None) for place in cache.contents}
    if classification == "post":
        nodes = held[stage]
        return np.argwhere(np.ones(nodes.shape, bool))[:, ::-1] - 1, nodes.ravel() * CODE
    voxels = held["visible"]
    row = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
    ny = voxels.shape_xyz[1]
    at = np.stack((voxels.column.astype(int), row % ny, row // ny), axis=1)
    return at, held[stage] * CODE


def smooth(shape, rng, most=0.3):
    """A random field of waves some ten voxels long, 0 to ``most``, that fades away towards the sides."""
    z, y, x = np.mgrid[tuple(slice(n) for n in shape)]
    field = sum(np.cos(a * x + b * y + c * z + d) for a, b, c, d in rng.uniform(-0.7, 0.7, (5, 4)))
    field = most * (field - field.min()) / np.ptp(field)
    for axis, n in enumerate(shape):
        fading = np.minimum(1.5 * np.sin(np.pi * (np.arange(n) + 1) / (n + 1)), 1.0) ** 2
        field *= np.expand_dims(fading, tuple({0, 1, 2} - {axis}))
    return field


def integrated(scene, voxels, ends, steps=3000):
    """(n,) transmittance from index positions to world ``ends``, in the extinction of voxels, zero outside."""
    matrix, padded = scene.index_to_world, np.pad(scene.volume.voxels.astype(np.float64), 1)
    ends = np.linalg.solve(matrix[:3, :3], (ends - matrix[:3, 3]).T).T
    share = (np.arange(steps) + 0.5) / steps
    left = []
    for begin, end in zip(voxels, ends):
        at = begin + 1.0 + (end - begin) * share[:, None]
        at = at[((at >= 0.0) & (at < np.array(padded.shape[::-1]) - 1.0)).all(axis=1)]
        cell = at.astype(int)
        found = 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, at - cell, 1.0 - (at - cell)).prod(axis=1)
            x, y, z = (cell + corner).T
            found = found + weight * padded[z, y, x]
        left.append(np.exp(-np.sum(found) * np.linalg.norm(matrix[:3, :3] @ (end - begin)) / steps))
    return np.array(left)


# --- Beer and Lambert -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("along", [(0, 0, -1), (0.5, 0.3, -1), (-0.6, 0.2, 1), (1, 0.4, -0.3), (0.2, -1, 0.7)])
def test_a_sun_through_a_homogeneous_box_is_beer_lambert(along):
    """Post fills the box of voxel centers: the way to the face that the light comes in by tells all.  Of rays that stay
    clear of the faces they go along: there a sheet pixel is half in the box and half out of it."""
    lit = scene_of(np.full((11, 12, 13), 0.2), SKEWED, [sun(along)])
    points, found = reaching(lit, "post")
    back = np.linalg.solve(SKEWED[:3, :3], -np.asarray(along) / np.linalg.norm(along))
    most = np.array((12, 11, 10))
    enter, leave = (np.where((back > 0.0) == far, most - points, -points) / back for far in (False, True))
    begin, end, principal = np.maximum(enter.max(axis=1), 0.0), leave.min(axis=1), np.abs(back).argmax()
    way = np.maximum(end - begin, 0.0)
    beside = np.delete(np.arange(3), principal)
    ends = np.stack([points + t[:, None] * back for t in (begin, end)])[..., beside]
    clear = (leave[:, principal] == end) & ((ends > 1.5) & (ends < most[beside] - 1.5)).all(axis=(0, 2))
    assert clear.sum() > 100 and np.ptp(way[clear]) > 5
    np.testing.assert_allclose(found[clear], np.exp(-0.2 * way[clear]), atol=3 * CODE)


@pytest.mark.parametrize("classification", ["pre", "post"])
def test_a_slab_is_beer_lambert_for_sun_and_point_at_any_angle(classification):
    """A slab as wide as the box: half a voxel of ramp above it for pre, a face of the box for post."""
    field = np.zeros((12, 40, 40))
    field[:8] = 0.4
    flat = field[:8] if classification == "post" else field
    ramp = 0.0 if classification == "post" else 0.5
    for light in (sun((0, 0, -1)), sun((0.6, -0.3, -1)), point((19.0, 21.0, 60.0)), point((35.0, 20.0, 25.0))):
        voxels, found = reaching(scene_of(flat, None, [light]), classification)
        matrix = light.matrix_world
        way = np.array((0, 0, 1)) if light.type == "SUN" else matrix[:3, 3] - voxels
        way = np.broadcast_to(matrix[:3, 2] if light.type == "SUN" else way, voxels.shape)
        length = np.linalg.norm(way, axis=1) / way[:, 2]
        away = (way[:, :2] / way[:, 2:]) * (8 - voxels[:, 2:])
        middle = ((voxels[:, :2] + away > 3) & (voxels[:, :2] + away < 36)).all(axis=1)
        middle &= ((voxels[:, :2] > 3) & (voxels[:, :2] < 36)).all(axis=1) & (voxels[:, 2] < 8)
        middle &= np.abs(way[:, :2]).max(axis=1) < way[:, 2]  # other rays go along the slab rather than through it
        expected = np.exp(-0.4 * length * (np.clip(7 - voxels[:, 2], 0, 7) + ramp))
        assert middle.sum() > 1500
        np.testing.assert_allclose(found[middle], expected[middle], atol=3 * CODE)


def test_a_light_in_the_midst_of_a_medium_reaches_by_distance():
    lit = scene_of(np.full((21, 21, 21), 0.1), None, [point((10.2, 9.7, 10.4))])
    voxels, found = reaching(lit, "post")
    away, inside = np.linalg.norm(voxels - (10.2, 9.7, 10.4), axis=1), (np.abs(voxels - 10) <= 10).all(axis=1)
    off, clear = np.abs(found - np.exp(-0.1 * away)), (np.abs(voxels - 10) <= 9).all(axis=1)
    assert inside.sum() > 4000 and off[clear].max() < 0.01
    assert off[inside].max() < 0.02  # beside a face a sheet pixel is half in the box and half out of it


LIGHTS = {
    "sun along x": sun((1, 0.3, -0.2)), "sun along y": sun((-0.5, 0.9, 0.6)), "sun along z": sun((0.1, 0.2, -0.9)),
    "far point": point((60, -30, 45)), "near point": point((12, -8, 26)), "point within": point((13.3, 12.2, 9.7)),
    "spot": Light("SPOT", matrix_world=pose((-15.0, 11.0, 13.0), (1, 0, 0)), spot_size=3.0),
    "area": Light("AREA", matrix_world=pose((8.0, 40.0, 11.0), (0, -1, 0)), size=1e-3),
}  # fmt: skip


@pytest.mark.parametrize("name", LIGHTS)
def test_a_smooth_medium_takes_what_the_integral_says(name):
    rng, light = np.random.default_rng(7), LIGHTS[name]
    lit = scene_of(smooth((20, 22, 24), rng), SKEWED, [light])
    voxels, found = reaching(lit)
    some = rng.choice(len(voxels), 60, replace=False)
    at = voxels[some] @ SKEWED[:3, :3].T + SKEWED[:3, 3]
    ends = at + 60.0 * light.matrix_world[:3, 2] if light.type == "SUN" else np.broadcast_to(
        light.matrix_world[:3, 3], at.shape
    )  # fmt: skip
    true = integrated(lit, voxels[some], ends)
    assert np.ptp(true) > 0.3
    assert np.abs(found[some] - true).max() < 0.02 and np.sqrt(((found[some] - true) ** 2).mean()) < 0.006


@pytest.mark.parametrize("light", [LIGHTS["sun along x"], LIGHTS["point within"]])
def test_kernels_say_the_same_as_their_reference_on_any_number_of_threads(light):
    lit = scene_of(smooth((20, 22, 24), np.random.default_rng(7)), SKEWED, [light])
    lit = replace(lit, triangles=np.array([[(2.0, 0.0, 9.0), (20.0, 2.0, 6.0), (5.0, 19.0, 8.0)]]))
    _, reference = reaching(lit)
    _, alone = reaching(lit, way="numba", threads=1)
    _, both = reaching(lit, way="numba", threads=2)
    np.testing.assert_array_equal(alone, both)
    assert np.ptp(reference) > 0.5
    np.testing.assert_allclose(alone, reference, atol=2.5 * CODE)


@pytest.mark.parametrize("keep", ["inside", "outside"])
def test_what_a_clip_cuts_away_casts_no_shadow(keep):
    """Beer and Lambert through what is left of a box between two heights, cut between two slices and at one."""
    clip = Clip("box", np.diag((100.0, 100.0, 3.25, 1.0)) + np.outer((0, 0, 8.25, 0), (0, 0, 0, 1)), keep)  # 5 to 11.5
    voxels, found = reaching(scene_of(np.full((20, 7, 7), 0.2), None, [sun((0, 0, -1))], clips=(clip,)), "post")
    middle = (np.abs(voxels[:, :2] - 3) < 1.5).all(axis=1)  # others begin beside the box
    z, found = voxels[middle, 2], found[middle]
    within = np.clip(11.5 - np.maximum(z, 5), 0.0, None)
    way = within if keep == "inside" else np.clip(19 - np.maximum(z, 0), 0, None) - within
    assert np.ptp(way) > 5
    np.testing.assert_allclose(np.log(found), -0.2 * way, atol=0.2 * 0.55)
    past = (z < 4) | (z > 12)  # half a voxel at a cut is more or less its own
    np.testing.assert_allclose(found[past], np.exp(-0.2 * way[past]), atol=3 * CODE)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_shadows_do_not_depend_on_the_unit_of_length(scale):
    def scene(s):
        lights = [sun((1, 0.3, -0.5)), point(np.array((5.5, 4.2, 30.0)) * s, energy=s * s)]
        field = smooth((9, 10, 11), np.random.default_rng(1), 1.0)
        function = replace(EXTINCTION_IS_VALUE, opacity=((0.0, 0.0), (1.0, 0.5)))
        camera, _ = turntable(Volume(field.astype(np.float32), np.eye(4)), scene_scale=s)
        return scene_of(field, None, lights, transfer_function=function, camera=camera, scene_scale=s)

    usual, other = reaching(scene(1.0))[1], reaching(scene(scale))[1]
    assert np.ptp(usual) > 0.3
    np.testing.assert_allclose(other, usual, atol=1.5 * CODE)


@pytest.mark.parametrize("shape", [(1, 5, 5), (5, 1, 5), (5, 5, 1), (1, 1, 1)])
def test_a_volume_one_voxel_thick_takes_the_light_of_its_ramps(shape):
    """A voxel that light comes straight down on lies half a voxel of its own medium deep."""
    flat = int(np.argmin(shape))  # along z, y or x
    along = np.zeros(3)
    along[2 - flat] = -1.0
    lit = scene_of(np.full(shape, 0.5), None, [sun(along)])
    np.testing.assert_allclose(reaching(lit)[1], np.exp(-0.25), atol=2 * CODE)


def test_nothing_to_shade_and_lights_in_odd_places_are_no_trouble():
    empty = scene_of(np.zeros((4, 4, 4)), None, [sun((0, 0, -1))])
    assert len(reaching(empty)[1]) == 0
    field = smooth((9, 10, 11), np.random.default_rng(1), 1.0)
    seen_edge_on = np.array([[(5, 5, 4), (7, 9, 4), (1, 2, 4)], [(0, 0, 0)] * 3], np.float64)
    for light in (point((5, 5, 4)), point((0, 0, 0)), point((-5, 4, 4)), point((1e9, 2e8, 1e8)), sun((1, 1, 1))):
        voxels, found = reaching(scene_of(field, None, [light], triangles=seen_edge_on))
        assert np.isfinite(found).all() and found.min() >= 0.0 and found.max() <= 1.0
        at_light = (np.abs(voxels - light.matrix_world[:3, 3]).max(axis=1) == 0) & (light.type == "POINT")
        assert (found[at_light] == 1.0).all()


# --- meshes and penumbras -------------------------------------------------------------------------------------------


def square(half, height, middle=(24.0, 24.0)):
    x, y = middle
    a, b, c, d = ((x + i * half, y + j * half, height) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return np.array(((a, b, c), (a, c, d)))


@pytest.mark.parametrize(("light", "grown"), [(sun((0, 0, -1)), 1.0), (point((24.0, 24.0, 62.0)), 62 / 31)])
def test_the_shadow_of_a_square_follows_similar_triangles(light, grown):
    """A square halfway up to a point of light casts a square twice as wide on the floor; under a sun its own size."""
    lit = scene_of(np.full((2, 49, 49), 1e-4), None, [light], triangles=square(7.3, 31.0))
    voxels, found = reaching(lit)
    on_floor = voxels[:, 2] == 0
    off = np.abs(voxels[on_floor, :2] - 24.0).max(axis=1) - 7.3 * grown
    light_there = found[on_floor]
    assert light_there[off < -1.5].max() < 0.01 and light_there[off > 1.5].min() > 0.99
    area = (1.0 - light_there).sum()
    assert abs(np.sqrt(area) - 2 * 7.3 * grown) < 0.15


def test_a_mesh_shades_what_lies_behind_it_and_nothing_before_it():
    lit = scene_of(np.full((20, 9, 9), 1e-4), None, [sun((0, 0, -1))], triangles=square(30.0, 10.3, (4, 4)))
    voxels, found = reaching(lit)
    assert found[voxels[:, 2] >= 10].min() > 0.99  # the slice right behind it, 0.3 away, keeps the surface lit
    assert found[voxels[:, 2] <= 9].max() < 0.01


@pytest.mark.parametrize("classification", ["pre", "post"])
def test_a_mesh_wholly_behind_the_volume_shades_it_too(classification):
    """A wall between the volume and a sun that shines from behind and above."""
    volume = Volume(np.pad(np.full((5, 5, 5), 2.5, np.float32), 4), np.eye(4))
    camera, matrix = turntable(volume, 30, 20, 1.2, False, 40.0)
    right, up, back = camera.matrix_world[:3, :3].T
    corners = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]]) * 100.0
    wall = corners @ np.stack((right, up)) - 30.0 * back
    lit = scene_of(volume.voxels, None, [sun(back - 1.5 * up, energy=3.0)], camera=camera, volume_matrix=matrix)
    shaded = replace(lit, triangles=wall[[[0, 1, 2], [0, 2, 3]]])
    quality = Quality(classification=classification)
    light, dark = (render(scene, quality).rgba for scene in (lit, shaded))
    light_most, dark_most = light[..., :3].max(), dark[..., :3].max()
    assert light_most > 0.05 and dark_most < 0.005 * light_most
    unshadowed = replace(shaded, volume_shadows=False)
    assert not analyze(unshadowed, quality)["mesh occlusion"].on


@pytest.mark.parametrize(
    ("light", "width"),
    [
        (sun((0, 0, -1), angle=2 * np.arctan(0.2)), 2 * 0.2 * 30),
        (point((24.0, 24.0, 60.0), radius=5.0), 2 * 5.0 * 30 / 30),
        (Light("AREA", matrix_world=pose((24.0, 24.0, 60.0)), size=10.0, shape="DISK"), 2 * 5.0 * 30 / 30),
    ],
)
def test_a_penumbra_is_as_wide_as_the_light_and_the_distance_say(light, width):
    """The edge of a plate 30 above the floor: the light that reaches the floor rises over ``width``, and no further;
    where half of it is seen, half of it is there, and it never falls on the way."""
    plate = square(100.0, 30.0, (124.0, 24.0))  # its edge at x = 24
    lit = scene_of(np.full((2, 49, 49), 1e-4), None, [light], triangles=plate)
    voxels, found = reaching(lit)
    row = (voxels[:, 2] == 0) & (voxels[:, 1] == 24)
    x, here = voxels[row, 0], found[row]
    assert here[x > 24 + width / 2 + 1.5].max() < 0.02 and here[x < 24 - width / 2 - 1.5].min() > 0.98
    assert (np.diff(here) < 0.02).all()
    assert abs(np.interp(24.0, x, here) - 0.5) < 0.08
    # A disc's seen share between a quarter and three quarters of the way across.
    rises = np.interp((0.25, 0.75), here[::-1], x[::-1])
    assert abs((rises[0] - rises[1]) / width - 0.404) < 0.12


def test_a_light_takes_as_many_samples_as_its_penumbra_asks_for():
    box = np.indices((2, 2, 2)).reshape(3, 8).T * 100.0
    assert [len(light_samples(sun((0, 0, -1), angle=a), box, 1.0)) for a in (0.0, 0.005, 0.05, 1.0)] == [1, 1, 6, 16]
    assert [len(light_samples(point((50, 50, 400), radius=r), box, 1.0)) for r in (0.5, 1.0)] == [1, 2]
    for light in (sun((1, 2, -1), angle=0.07), point((50, 50, 400), radius=6.0)):
        true = -light.matrix_world[:3, 2] if light.type == "SUN" else light.matrix_world[:3, 3]
        for samples in (light_samples(light, box, 1.0), light_samples(light, box, 0.1, sharp=True)):
            assert len(samples) in (1, 5, 8)
            np.testing.assert_allclose(samples.mean(axis=0), true, atol=1e-9)
        assert np.array_equal(light_samples(light, box, 0.1), fixed_samples(light, box)), "those of the model"


# --- the sky --------------------------------------------------------------------------------------------------------


def test_any_plane_hides_half_of_the_sky():
    sky = sky_directions()
    np.testing.assert_allclose(np.linalg.norm(sky, axis=1), 1.0, atol=1e-12)
    for normal in np.random.default_rng(2).normal(size=(1000, 3)):
        assert (sky @ normal > 0.0).mean() == 0.5


def test_the_directions_of_the_sky_are_even():
    """Means over the sphere of polynomials up to degree four, and no direction far from all of them."""
    sky = sky_directions()
    x, y, z = sky.T
    for values, mean in ((x, 0.0), (z**2, 1 / 3), (x * y, 0.0), (y**4, 1 / 5), (x**2 * z**2, 1 / 15)):
        assert abs(values.mean() - mean) < 0.035
    anywhere = np.random.default_rng(3).normal(size=(10000, 3))
    nearest = (anywhere / np.linalg.norm(anywhere, axis=1, keepdims=True) @ sky.T).max(axis=1)
    assert np.degrees(np.arccos(nearest.min())) < 32.0


def above_ground(extinction: float, end: int) -> float:
    """Share of the sky over the topmost voxels of a flat ground, ``end`` slices from where rays leave the volume.

    The two slices next to a voxel hide nothing.  In the others, the ramp of one voxel above the ground is interpolated
    twice: between voxels and between rows of the sheet, which lie anywhere between them (``phase``).
    """
    phase, total = (np.arange(50) + 0.5) / 50, 0.0
    for way in sky_directions():
        length = 1.0 / np.abs(way).max()  # from slice to slice
        rise, flat = way[2] * length, np.abs(way[2]) * length < 1.0
        heights = np.arange(3, end)[:, None] * rise
        lower, upper = (np.clip(1.0 - heights - row, 0.0, 1.0).sum(axis=0) for row in (-phase, 1.0 - phase))
        depth = flat * extinction * ((1.0 - phase) * lower + phase * upper)
        total += (rise > 0.0) * np.exp(-depth * length).mean()
    return total / len(sky_directions())


def test_half_of_the_sky_is_left_on_opaque_ground_and_none_deep_in_it():
    ground = np.zeros((14, 15, 15))
    ground[:8] = 3.0
    lit = scene_of(ground, None, [sun((0, 0, -1))], volume_shadows=False, ambient_occlusion=1.0, world=(1, 1, 1))
    voxels, found = reaching(lit, stage="ambient occlusion")
    middle = (np.abs(voxels[:, :2] - 7) < 3).all(axis=1)
    surface, deep = middle & (voxels[:, 2] == 7), middle & (voxels[:, 2] == 3)
    assert abs(found[surface].mean() - above_ground(3.0, 8)) < 0.02 and found[deep].max() < 0.01


def test_the_sky_in_a_thin_medium_is_the_mean_of_beer_lambert():
    thin = np.full((25, 25, 25), 0.05)
    lit = scene_of(thin, None, [sun((0, 0, -1))], volume_shadows=False, ambient_occlusion=1.0, world=(1, 1, 1))
    voxels, found = reaching(lit, "post", "ambient occlusion")
    center = (voxels == 12).all(axis=1)
    lengths = 1.0 / np.abs(sky_directions()).max(axis=1)
    true = np.exp(-0.05 * 12 * lengths).mean()
    assert abs(found[center][0] - true) < 2e-3


# --- what is done with it -------------------------------------------------------------------------------------------


def lit_blob(**more):
    field = smooth((16, 16, 16), np.random.default_rng(3), 1.5)
    field[field < 0.6] = 0.0
    return scene_of(field, None, [sun((0.4, 0.7, -1.0), energy=3.0)], **more)


@NUMPY
def test_a_voxels_color_loses_what_its_light_loses(way):
    """Of one light alone every shaded color is its share of what it would be, with a normal or without."""
    shaded, plain = lit_blob(), lit_blob(volume_shadows=False)
    _, share = reaching(shaded)
    colors = [classify_and_shade(scene, Quality(), Clock())[1] for scene in (shaded, plain)]
    assert np.ptp(share) > 0.5
    np.testing.assert_allclose(colors[0], colors[1] * share[:, None], atol=2e-6)


@NUMPY
def test_a_voxel_without_a_normal_keeps_the_share_of_all_light_that_arrives(way):
    field = np.full((9, 9, 9), 0.3)
    tf = replace(EXTINCTION_IS_VALUE, shade=replace(MATT, ambient=0.25))
    lights = [sun((0, 0, -1), energy=np.pi), sun((0, 0, 1), energy=np.pi, casts_shadow=False)]
    scene = scene_of(field, None, lights, transfer_function=tf)
    _, share = reaching(scene)
    colors = classify_and_shade(scene, Quality(), Clock())[1]
    np.testing.assert_allclose(colors[:, 0], (0.25 + share + 1.0) / 2.25, atol=1e-5)


@pytest.mark.parametrize("classification", ["pre", "post"])
def test_kernels_shade_in_shadow_as_their_reference_does(classification):
    scene = lit_blob(ambient_occlusion=0.7, world=(0.2, 0.3, 0.4))
    tf = replace(scene.transfer_function, shade=Shade(0.1, 0.6, 0.3, 9.0))
    scene = replace(scene, transfer_function=tf, lights=(*scene.lights, point((30, 8, 8), energy=2e4)))
    quality = Quality(classification=classification)
    ours, reference = both(lambda: render(scene, quality).rgba)
    assert np.abs(ours - reference).max() < 2e-3
    plain = render(replace(scene, volume_shadows=False, ambient_occlusion=0.0), quality).rgba
    assert np.abs(ours - plain).max() > 0.1


@NUMPY
def test_the_world_lights_a_medium_alike_from_everywhere(way):
    scene = lit_blob(volume_shadows=False, world=(0.2, 0.5, 1.0))
    colors = [classify_and_shade(s, Quality(), Clock())[1] for s in (scene, replace(scene, world=None))]
    with_normal = np.abs(colors[0] - colors[1]).max(axis=1) > 0.0
    assert with_normal.sum() > 0.9 * len(with_normal)
    gained = (colors[0] - colors[1])[with_normal]
    np.testing.assert_allclose(gained, np.broadcast_to((0.2, 0.5, 1.0), gained.shape), atol=1e-6)
    z, y, x = np.nonzero(scene.volume.voxels)
    np.testing.assert_allclose(ReferenceLight(scene).color((z, y, x)), colors[0], atol=1e-5)


@NUMPY
@pytest.mark.parametrize("classification", ["pre", "post"])
def test_without_shadows_nothing_is_swept_and_nothing_changes(classification, way):
    quality = Quality(classification=classification)
    usual = render(replace(lit_blob(), volume_shadows=False), quality)
    cache = StageCache()
    for scene in (
        replace(lit_blob(), lights=tuple(replace(light, casts_shadow=False) for light in lit_blob().lights)),
        replace(lit_blob(), effects={"shadows": False, "ambient occlusion": False}, ambient_occlusion=1.0),
    ):
        rendering = render(scene, quality, cache=cache)
        np.testing.assert_array_equal(rendering.rgba, usual.rgba)
        assert "shadows" not in cache.made and "ambient occlusion" not in cache.made
        rows = {row["name"]: row for row in rendering.report["effects"]}
        assert not rows["shadows"]["on"] and rows["shadows"]["ms"] == 0.0 == rows["ambient occlusion"]["ms"]
    lightless = replace(lit_blob(), lights=(sun((0, 0, -1), casts_shadow=False),))
    assert analyze(lightless, quality)["shadows"].reason == "no light casts shadows"


@NUMPY
@pytest.mark.parametrize("classification", ["pre", "post"])
def test_only_what_shadows_depend_on_sweeps_again(stage, classification, way):
    cache, quality = StageCache(), Quality(classification=classification)
    scene = lit_blob()

    def sweeps(changed):
        before = cache.made.get("shadows", 0)
        render(changed, quality, cache=cache)
        return cache.made.get("shadows", 0) - before

    assert sweeps(scene) == 1
    assert sweeps(replace(scene, camera=stage.looking((40, 40, 40), (8, 8, 8)))) == 0
    brighter = replace(scene.lights[0], energy=9.0, color=(1, 0, 0))
    assert sweeps(replace(scene, lights=(brighter,))) == 0
    assert sweeps(replace(scene, lights=(brighter, sun((0, 1, 0))))) == 1
    thinner = replace(scene.transfer_function, opacity=((0.0, 0.0), (3.0, 0.5)))
    assert sweeps(replace(scene, transfer_function=thinner)) == 1


def test_the_truth_of_pre_refuses_shadows_in_a_sentence():
    with pytest.raises(RleSplatError, match="turn off shadows"):
        shading_of(lit_blob(), "T1")
    assert "light" in shading_of(lit_blob(), "T2")


def test_the_shadow_pass_compares_sheets_with_sheets():
    """The steep pixels of a picture are others without its shadows: what rays see better is not taken for light."""
    scene, quality = lit_blob(), Quality(rays=0.15, warp_filter="bilinear", sheet_density=0.5)
    rendering, share = drain(shadow_pass_steps(scene, quality))
    plain, expected = drain(shadow_pass_steps(scene, replace(quality, rays=NO_RAYS)))
    assert rendering.report["rays"]["pixels"] > 20 and (rendering.rgba != plain.rgba).any()
    np.testing.assert_array_equal(share, expected)


def test_codes_of_lamps_that_stay_are_those_of_a_picture_of_its_own():
    """Where one of three lamps moves, the other two's codes are copied: the picture is that without a cache."""
    field = smooth((19, 18, 20), np.random.default_rng(5))
    others = [sun((0.5, 0.3, -1)), sun((1, 0.4, -0.3))]
    quality, cache = Quality(name=""), StageCache()
    for number, along in ((0, (0, 0, -1)), (1, (0.2, -1, 0.7)), (2, (-0.6, 0.2, 1))):
        lamps = [*others[:number], sun(along), *others[number:]]
        scene = scene_of(field, SKEWED, lamps)
        found, alone = render(scene, quality, cache=cache), render(scene, quality)
        np.testing.assert_array_equal(found.rgba, alone.rgba)
    moved = scene_of(field, SKEWED, [*others, sun((0.1, 0.9, 0.2))])
    before = cache.made["shadows"]
    found = render(moved, quality, cache=cache)
    assert cache.made["shadows"] == before + 1
    np.testing.assert_array_equal(found.rgba, render(moved, quality).rgba)


@pytest.mark.parametrize(("quality", "most"), (("draft", 0.003), ("standard", 0.003)))
def test_a_ball_with_an_opacity_step_is_lit_as_evenly_as_without_shadows(quality, most):
    """Where the sun faces the surface, at most at 60 degrees, nothing but the surface itself could shade it."""
    index = np.stack(np.indices((60, 60, 60))[::-1], axis=-1) - 29.37
    inside = np.clip(0.5 + 0.25 * (22.0 - np.linalg.norm(index, axis=-1)), 0.0, 1.0)
    step = TransferFunction("step", None, ((0.0, 0.0), (0.5, 0.0), (0.5, 0.8)), ((0.0, 1.0, 1.0, 1.0),), 1.0, MATT)
    volume = Volume(inside.astype(np.float32), np.eye(4))
    camera, _ = turntable(volume, 25, 20, 0.8, False, 25.0)
    axes = camera.matrix_world[:3, :3]
    towards = axes @ (-0.35, 0.35, 0.87)
    lit = Scene(volume, step, camera, 240, 240, lights=(sun(-towards),), headlight=False, volume_shadows=True)
    shadowed, plain = (
        render(one, Quality.preset(quality), cache=StageCache()).rgba[..., 0]
        for one in (lit, replace(lit, volume_shadows=False))
    )
    across = (np.indices((240, 240))[::-1] + 0.5) / 240 * camera.ortho_scale - 0.5 * camera.ortho_scale
    right, up = across[0] / 22.0, -across[1] / 22.0
    normal = np.stack((right, up, np.sqrt(np.maximum(1.0 - right**2 - up**2, 0.0))))
    facing = np.einsum("i,i...", (-0.35, 0.35, 0.87), normal) > 0.5
    ratio = (shadowed / np.maximum(plain, 1e-9))[(normal[2] > 0.3) & facing]
    assert len(ratio) > 5000 and ratio.mean() > 0.995
    assert np.diff(np.quantile(ratio, (0.01, 0.99)))[0] < most
