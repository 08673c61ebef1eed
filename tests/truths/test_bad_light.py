"""Light from places and on volumes that it is not made for: lamps within the volume, no gradient, NaN, a full box."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.effects.analyze import analyze
from rle_splat.pipeline.render import render
from rle_splat.scene import Clip, Light, Quality, Scene
from rle_splat.shade.light_samples import light_samples
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

N, MIDDLE = 24, 11.5
QUALITY = Quality.preset("fine", threads=1)
TRACED = replace(QUALITY, exact_light=True)
BOTH = pytest.mark.parametrize("quality", (QUALITY, TRACED), ids=("grid", "traced"))
SUN = Light("SUN", energy=3.0)


def function(**shade) -> TransferFunction:
    return TransferFunction(
        opacity=((0.0, 0.0), (40.0, 0.0), (120.0, 0.8)), color=((0.0, 0.9, 0.6, 0.4),), opacity_unit_distance=1.0,
        shade=Shade(0.2, 0.7, 0.0, 20.0, **shade),
    )  # fmt: skip


def ball() -> np.ndarray:
    """Values that fall by 200 from the middle to the faces; the surface is 0.7 to 1.1 times as far as these."""
    z, y, x = np.indices((N, N, N)) / MIDDLE - 1.0
    return np.clip(260.0 - 200.0 * np.sqrt(x * x + y * y + z * z), 0.0, 255.0).astype(np.float32)


def scene_of(field, tf=None, **more) -> Scene:
    volume = Volume(np.asarray(field, np.float32), np.eye(4))
    camera, matrix = turntable(volume, 30.0, 20.0, 1.2)
    return Scene(volume, tf or function(), camera, 32, 32, matrix, headlight=False, volume_shadows=True, **more)


def lamp(x: float, y: float, z: float, energy: float = 900.0, **more) -> Light:
    """A lamp where a voxel of these indices is in the world of ``scene_of``."""
    matrix = np.eye(4)
    matrix[:3, 3] = scene_of(np.zeros((N, N, N))).index_to_world[:3] @ (x, y, z, 1.0)
    return Light(**{"type": "POINT", "energy": energy, "matrix_world": matrix, **more})


def errors(scene: Scene, quality: Quality = QUALITY) -> np.ndarray:
    """(N,) levels: the largest error of a channel, of every other pixel in which something is seen, over the brightest
    of the truth, if that is above 1."""
    rgba = render(scene, quality).rgba
    assert np.isfinite(rgba).all() and (rgba >= 0.0).all()
    rows, columns = np.nonzero(rgba[..., 3] > 0.1)
    rows, columns = rows[::2], columns[::2]
    true = truth(scene, "T2", pixels=(columns + 0.5, rows + 0.5), tolerance=1e-4, **shading_of(scene, "T2"))[0]
    return np.abs(rgba[rows, columns] - true).max(axis=1) / LEVEL / max(true.max(), 1.0)


def cut_around_the_middle() -> Clip:
    """A box that removes what is within six voxels of the middle."""
    matrix = scene_of(np.zeros((N, N, N))).index_to_world @ np.diag((6.0, 6.0, 6.0, 1.0))
    matrix[:3, 3] = lamp(MIDDLE, MIDDLE, MIDDLE).matrix_world[:3, 3]
    return Clip("box", matrix, "outside")


PLACES = {
    "in the middle": dict(lights=(lamp(MIDDLE, MIDDLE, MIDDLE),)),
    "on a voxel": dict(lights=(lamp(12.0, 12.0, 12.0),)),
    "within, where nothing is shown": dict(lights=(lamp(1.0, 1.0, 1.0),)),
    "on a corner": dict(lights=(lamp(0.0, 0.0, 0.0),)),
    "in the plane of a face": dict(lights=(lamp(60.0, 23.0, 12.0, 9e4),)),
    "an area around the volume": dict(lights=(lamp(MIDDLE, MIDDLE, MIDDLE, type="AREA", size=40.0),)),
    "in a cut": dict(lights=(lamp(MIDDLE, MIDDLE, MIDDLE),), clips=(cut_around_the_middle(),)),
}


@BOTH
@pytest.mark.parametrize("place", PLACES)
def test_a_lamp_within_the_volume_is_that_of_the_truth(place, quality):
    found = errors(scene_of(ball(), **PLACES[place]), quality)
    assert np.median(found) < 1.0 and np.quantile(found, 0.9) < 6.0


def test_a_lamp_in_the_middle_has_samples():
    box = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    with np.errstate(all="raise"):
        found = light_samples(Light("POINT", radius=0.1, energy=1.0), box, 0.01)
    assert len(found) == 16 and np.linalg.norm(found, axis=1).max() < 0.2


@BOTH
def test_a_lamp_on_a_face_is_finite(quality):
    """Next to a lamp light has no bound, so no error is asked for."""
    rgba = render(scene_of(ball(), lights=(lamp(23.0, MIDDLE, MIDDLE),)), quality).rgba
    assert np.isfinite(rgba).all() and rgba.max() > 1.0


WORLDS = {"a sun": {}, "the sky": dict(lights=(), world=(0.3, 0.3, 0.3), ambient_occlusion=0.7)}


@BOTH
@pytest.mark.parametrize("world", WORLDS)
def test_a_constant_cube_is_lit_as_the_truth_is(world, quality):
    """Its silhouette is a step from opaque to nothing: that is left out."""
    found = errors(scene_of(np.full((16, 16, 16), 200.0), **{"lights": (SUN,), **WORLDS[world]}), quality)
    assert np.quantile(found, 0.8) < 3.0


@BOTH
@pytest.mark.parametrize("axis", (0, 1, 2))
def test_a_volume_one_voxel_thick_has_a_remark(axis, quality):
    shape = [12, 12, 12]
    shape[axis] = 1
    made = render(scene_of(np.full(shape, 200.0), lights=(SUN,), world=(0.3, 0.3, 0.3), ambient_occlusion=0.5), quality)
    assert (made.rgba == 0.0).all() and "one voxel thick" in " ".join(made.report["remarks"])


@BOTH
def test_a_smoothness_larger_than_the_volume_is_that_of_the_truth(quality):
    found = errors(scene_of(ball(), function(smoothness=100.0), lights=(SUN,)), quality)
    assert np.median(found) < 2.0 and np.quantile(found, 0.9) < 8.0


def test_nan_beside_a_surface_is_lit_as_the_truth_is():
    """With shadows only where light is traced: on a grid light that grazes NaN passes a voxel deep."""
    field = np.where(np.indices((N, N, N))[2] > 13, np.nan, ball())
    for casts, quality in ((False, QUALITY), (True, TRACED)):
        found = errors(scene_of(field, lights=(replace(SUN, casts_shadow=casts),)), quality)
        assert np.median(found) < 1.0 and np.quantile(found, 0.9) < 8.0
    assert np.isfinite(render(scene_of(field, lights=(SUN,)), QUALITY).rgba).all()


def test_a_mesh_that_fills_the_box_leaves_the_front_alone():
    """A closed box as large as the volume: no light comes in, so the front is dark but for ambient light."""
    corners = scene_of(ball()).index_to_world @ np.vstack((np.indices((2, 2, 2)).reshape(3, 8) * (N - 1.0), np.ones(8)))
    faces = [(0, 1, 3), (0, 3, 2), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4)]
    faces += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 3, 7), (1, 7, 5)]
    rgba = render(scene_of(ball(), lights=(SUN,), triangles=corners[:3].T[np.array(faces)]), QUALITY).rgba
    assert np.isfinite(rgba).all()
    without = render(scene_of(ball(), lights=(SUN,)), QUALITY).rgba
    assert rgba[..., :3].max() < 0.5 * without[..., :3].max()


def test_a_black_world_is_no_light():
    scene = scene_of(ball(), lights=(), world=(0.0, 0.0, 0.0))
    effects = analyze(scene, QUALITY)
    assert not scene.shines and effects["shading"].reason == "the scene has no light"
    assert np.median(errors(scene)) < 1.0
    np.testing.assert_array_equal(render(scene, QUALITY).rgba, render(replace(scene, world=None), QUALITY).rgba)


def test_a_world_of_a_million_is_a_million_times_as_bright():
    """Of sheets alone: which pixels are single rays depends on the brightness."""
    sheets = Quality.preset("draft", threads=1)
    dark = scene_of(ball(), lights=(replace(SUN, energy=0.0),))
    none, one, many = (
        render(replace(dark, world=(w, w, w)), sheets).rgba[..., :3].astype(np.float64) for w in (0.0, 1.0, 1e6)
    )
    np.testing.assert_allclose(many - none, 1e6 * (one - none), rtol=1e-3, atol=1.0)


def test_the_price_of_a_thousand_lamps_stands_before_the_picture():
    many = tuple(lamp(40.0 + 0.01 * n, 30.0, 50.0) for n in range(1000))
    reason = {n: analyze(scene_of(ball(), lights=many[:n]), QUALITY)["shadows"].reason for n in (3, 1000)}
    assert reason[3] == "cast by 3 point"
    assert reason[1000] == "cast by 1000 point: each takes a sweep through the volume, and memory"
    rgba = render(scene_of(ball(), lights=many), Quality.preset("draft", threads=1)).rgba
    assert np.isfinite(rgba).all() and rgba.max() > 1.0
