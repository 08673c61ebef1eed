"""Proves that classification on a finer grid tends to the truth T2, the classified interpolated scalar: at the order
that algorithm.md 1.10 measured, lit and unlit, from outside and inside, and as well at the faces of the volume, where
clip planes cut it and behind meshes, as anywhere else."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import radius_from_center
from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import LEVEL, difference
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.scene import Light
from rle_splat.volume.volume import Volume

SIZE = 24
SHADE = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.0)
FINE = dict(depth_rule="gauss2", sheet_density=2.0, termination=1 / 8192)


def tent(half_width, radius=8.0, unit=1.0, shade=None):
    """A shell round ``radius``, ``half_width`` voxels to either side, of a distance that is counted in ``unit``."""
    points = ((radius - half_width, 0.0), (radius, 0.5), (radius + half_width, 0.0))
    return TransferFunction(
        opacity=tuple((unit * r, alpha) for r, alpha in points), opacity_unit_distance=1.0, shade=shade,
        color=((0.0, 0.9, 0.3, 0.1), (2.0 * radius * unit, 0.2, 0.5, 0.9)),
    )


def t2(scene, **more):
    rgba, _ = truth(scene, "T2", tolerance=1e-6, **shading_of(scene, "T2"), **more)
    return rgba.reshape(scene.height, scene.width, 4)


def errors(stage, scene, refinements=(1, 2, 3, 4), **knobs):
    """The difference from T2 for each refinement, 1 for the paper's classification."""
    true = t2(scene)
    assert true[..., 3].max() > 0.5
    return [
        stage.error(
            scene, true, **(FINE | knobs),
            **(dict(classification="refined", refinement=s) if s > 1 else dict(classification="pre")),
        )
        for s in refinements
    ]


def orders(found):
    """Observed orders of convergence from 1 to 2 and from 2 to 4."""
    rmse = [difference.rmse for difference in found]
    return np.log2(rmse[0] / rmse[1]), np.log2(rmse[1] / rmse[3])


@pytest.mark.parametrize(
    ("half_width", "least", "perspective"),
    ((0.5, 1.1, False), (1.0, 1.3, False), (2.0, 1.5, False), (4.0, 1.6, False), (2.0, 1.5, True)),
)
def test_errors_fall_as_the_table_says(stage, half_width, least, perspective):
    """algorithm.md 1.10: against T2 the error of the alpha channel, and of every other, falls by about s^-1.6."""
    field = radius_from_center(SIZE)
    scene = stage.on_turntable(
        field, size=(48, 48), perspective=perspective, transfer_function=tent(half_width),
    )
    found = errors(stage, scene)
    assert min(orders(found)) > least
    rmse = [difference.rmse for difference in found]
    assert rmse == sorted(rmse, reverse=True) and found[3].largest < 0.4 * found[0].largest


LIT = {
    "headlight": dict(headlight=True),
    "sun and point": dict(lights=(
        Light("SUN", (1.0, 0.8, 0.6), 2.0, np.diag((1.0, -1.0, -1.0, 1.0))),
        Light("POINT", (0.6, 0.8, 1.0), 15_000.0, np.eye(4) + np.outer((40.0, -20.0, 30.0, 0.0), (0, 0, 0, 1))),
    )),
}  # fmt: skip


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("lit", LIT)
def test_lit_pictures_tend_to_the_lit_truth(stage, lit, perspective):
    """Light falls on the voxels of the scan and is interpolated: so does the truth, and refinement meets it.  Stored
    as bytes, on voxels that are no cubes."""
    field = np.round(7.0 * radius_from_center(SIZE)).astype(np.uint8)
    scene = stage.on_turntable(
        field, size=(48, 48), perspective=perspective, spacing=(1.0, 1.0, 1.3),
        transfer_function=tent(2.0, unit=7.0, shade=SHADE), **LIT[lit],
    )
    scene = replace(scene, volume=Volume(field, scene.volume.affine))
    dark = t2(replace(scene, headlight=False, lights=()))
    found = errors(stage, scene)
    assert difference(dark, t2(scene)).rmse > 4.0 and min(orders(found)) > 1.4
    assert found[3].rmse < 0.5


def test_a_camera_inside(stage):
    camera = stage.looking((12.0, 10.5, 11.0), (22.0, 16.0, 13.0), lens=25.0, clip_start=0.01)
    volume = stage.volume(radius_from_center(SIZE))
    scene = stage.before(volume, camera, (48, 48), transfer_function=tent(2.0))
    found = errors(stage, scene)
    assert min(orders(found)) > 1.3 and found[3].rmse < 0.8


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("depth_rule", ("slice", "simpson"))
def test_a_medium_cut_by_the_faces_is_as_good_as_the_rest(stage, perspective, depth_rule):
    """A medium everywhere in the box of voxel centers, and none outside: no slab of half a voxel is added, and none is
    missing.  Away from its silhouette, where a pixel more or less is all or nothing, errors are those of the inside."""
    z, y, x = np.mgrid[:16, :16, :16]
    field = 0.2 + 0.04 * x + 0.1 * np.sin(0.5 * y + 0.3 * z)
    scene = stage.on_turntable(field, size=(96, 96), perspective=perspective)
    true = t2(scene)
    inside = true[..., 3] > 0.0
    for _ in range(4):
        for axis in (0, 1):
            inside = inside & np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    knobs = FINE | dict(depth_rule=depth_rule, termination=0.0)
    refined = stage.render(scene, classification="refined", refinement=3, **knobs).rgba
    found = np.abs(refined - true)[inside] / LEVEL
    paper = stage.render(scene, classification="pre", **knobs).rgba
    paper = np.abs(paper - true)[inside] / LEVEL
    assert inside.sum() > 1000 and paper.mean() > 2.0
    assert found.max() < 4.0 and np.sqrt((found**2).mean()) < 0.12
    assert np.abs((refined - true)[inside].mean()) < 0.05 * LEVEL


def test_nothing_is_shown_outside_the_box(stage):
    """A box of one opaque value, square on: its silhouette is that of the voxel centers, to the pixel."""
    field = np.ones((8, 8, 8))
    scene = stage.on_turntable(field, azimuth=0.0, elevation=0.0, size=(80, 80), fit=1.0)  # ten pixels a voxel
    for refinement in (2, 3, 4):
        alpha = stage.render(scene, classification="refined", refinement=refinement, **FINE).rgba[..., 3]
        assert (alpha[7:-7, 7:-7] > 0.9).all()
        assert (alpha[:3] < 1e-6).all() and (alpha[:, -3:] < 1e-6).all()
    paper = stage.render(scene, classification="pre", **FINE).rgba[..., 3]
    assert (paper[2, 10:-10] > 0.0).all()  # it reaches a voxel further


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_clip_planes_and_meshes_cut_a_refined_volume(stage, perspective):
    """A clip plane through the middle, and then a wall that stands across: rays end where the truth's do."""
    scene = stage.on_turntable(
        radius_from_center(SIZE), size=(48, 48), perspective=perspective, transfer_function=tent(2.0),
    )
    camera = scene.camera
    middle = scene.index_to_world @ (11.5, 11.5, 11.5, 1.0)
    backwards = camera.matrix_world[:3, 2] / np.linalg.norm(camera.matrix_world[:3, 2])
    depth = float(backwards @ (camera.matrix_world[:3, 3] - middle[:3]))
    knobs = dict(classification="refined", refinement=3, **FINE)

    whole = t2(scene)
    near = replace(scene, camera=replace(camera, clip_start=depth))
    assert difference(t2(near), whole).rmse > 5.0
    assert stage.error(near, t2(near), **knobs).rmse < 1.2

    right, up = camera.matrix_world[:3, 0], camera.matrix_world[:3, 1]
    at = middle[:3] + 0.3 * backwards
    corners = [at + 200.0 * (a * right + b * up) for a, b in ((-1, -1), (3, -1), (-1, 3))]
    walled = replace(scene, triangles=np.array([corners]))
    true = t2(scene, far=depth - 0.3)
    assert difference(true, whole).rmse > 5.0
    assert stage.error(walled, true, **knobs).rmse < 1.2


@pytest.mark.parametrize(("record", "most"), ((8, 0.05), (6, 0.6), (4, 2.5)))
def test_short_records_of_a_refined_volume(stage, record, most):
    """What a record of fewer bytes loses, and no more."""
    scene = stage.on_turntable(
        radius_from_center(16), size=(32, 32), transfer_function=tent(2.0, 5.0, shade=SHADE), headlight=True
    )
    knobs = dict(classification="refined", refinement=2, backend="auto" if record == 4 else "numpy")
    full, short = (stage.render(scene, record=bytes_, **knobs).rgba for bytes_ in (16, record))
    assert 0.0 < difference(short, full).largest < most


def test_the_same_picture_from_both_backends_and_any_number_of_threads(stage):
    field = np.round(7.0 * radius_from_center(16)).astype(np.uint8)
    scene = stage.on_turntable(field, size=(40, 40), transfer_function=tent(2.0, 5.0, 7.0, SHADE), headlight=True)
    for volume in (scene.volume, Volume(field, scene.volume.affine)):
        for model in ("extinction", "opacity"):
            knobs = dict(classification="refined", refinement=3, model=model)
            one, two, slow = (
                stage.render(replace(scene, volume=volume), **knobs, **machine).rgba
                for machine in (dict(threads=1), dict(threads=2), dict(backend="numpy"))
            )
            assert (one == two).all() and one.max() > 0.3
            np.testing.assert_allclose(one, slow, atol=2e-5)


def test_it_says_against_which_truth(stage):
    scene = stage.on_turntable(radius_from_center(8), size=(8, 8), transfer_function=tent(2.0, 3.0))
    report = stage.render(scene, classification="refined", refinement=2).report
    assert report["error"]["truth"] == "T2"
    assert (report["plan"]["classification"], report["plan"]["refinement"]) == ("refined", 2)
    assert report["volume"]["shape_xyz"] == [8, 8, 8] and report["volume"]["visible_voxels"] > 8**3 * 0.5
    assert stage.render(scene, classification="pre").report["error"]["truth"] == "T1"


def test_opacities_refer_to_the_scans_spacing(stage):
    """Without a distance of its own, a transfer function's opacities are of the smallest spacing of the voxels that
    were scanned, however fine the grid is."""
    function = replace(tent(3.0), opacity_unit_distance=None)
    scene = stage.on_turntable(
        radius_from_center(SIZE), size=(48, 48), spacing=(0.7, 0.5, 0.9), transfer_function=function,
    )
    assert errors(stage, scene, (3,))[0].rmse < 1.0


def test_half_depths(stage):
    """Where the transmittance falls below one half; towards the rim, where the shell is seen edge-on, less exactly."""
    scene = stage.on_turntable(radius_from_center(SIZE), size=(48, 48), transfer_function=tent(3.0))
    rgba, depth = (part.reshape(48, 48, -1) for part in truth(scene, "T2", tolerance=1e-6))
    picture = stage.render(scene, classification="refined", refinement=4, **FINE)
    dense = rgba[..., 3] > 0.8
    found = np.abs(picture.depth - depth[..., 0])[dense]
    assert dense.sum() > 100 and np.median(found) < 0.01 and np.percentile(found, 75) < 0.05


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_a_crop_is_a_part_of_the_picture_to_the_bit(stage, perspective):
    scene = stage.on_turntable(
        radius_from_center(SIZE), size=(48, 48), perspective=perspective, transfer_function=tent(2.0),
    )
    knobs = dict(classification="refined", refinement=3)
    part, whole = (stage.render(replace(scene, crop=crop), **knobs).rgba for crop in ((9, 14, 31, 27), None))
    assert part.max() > 0.3 and (part == whole[14:27, 9:31]).all()
