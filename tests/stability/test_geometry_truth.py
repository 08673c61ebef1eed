"""Group C of the catalogue, what is held against the truth: matrices, places of the eye, clip planes, wide cameras."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade
from rle_splat.pipeline.render import render, render_steps
from rle_splat.runtime.steps import drain
from rle_splat.scene import NO_DEPTH, Light, Quality, RleSplatError
from tests.stability.scenes import from_above, transfer
from tests.stability.test_geometry import LEVEL, placed, turned
from tests.truths.conftest import OPACITY_IS_VALUE, Stage

STAGE = Stage()
FIELD = 0.4 * FIELDS["smooth"](24)
FINE = Quality(classification="pre", depth_rule="gauss2", sheet_density=2.0, termination=1 / 65536)
IDENTITY = np.eye(3)
PLANS = {"pre": FINE, "post": replace(FINE, classification="post")}  # held against T1 and against T2
TRUTHS: dict = {}


@pytest.fixture(params=PLANS)
def plan(request):
    """The plan by its classification."""
    return PLANS[request.param]


def lens_of(fov):
    """Focal length that sees ``fov`` degrees across a 36 mm sensor."""
    return 18.0 / np.tan(np.radians(0.5 * fov))


def volume_for(plan, field=FIELD, linear=IDENTITY):
    """The field under a linear map.  A post-classified medium ends at the box of the voxels' centers: a voxel of
    nothing goes round it, for where a medium is cut off the truth jumps, and no picture follows that to a level."""
    if plan.classification == "post":
        return STAGE.volume(np.pad(field, 1), placed(linear, -linear @ np.ones(3)))
    return STAGE.volume(field, placed(linear))


def true_picture(scene, name, plan=FINE):
    """T1, or T2 for post-classified sheets, of a scene, kept under ``name`` for other tests; every third pixel, which
    is what a sharp bound needs."""
    which = "T2" if plan.classification == "post" else "T1"
    if (name, which) not in TRUTHS:
        columns, rows = np.meshgrid(np.arange(1, scene.width, 3), np.arange(1, scene.height, 3))
        rgba, _ = truth(scene, which, pixels=(columns.ravel() + 0.5, rows.ravel() + 0.5), tolerance=1e-6)
        TRUTHS[name, which] = rgba.reshape(*columns.shape, 4)
    return TRUTHS[name, which]


def errors(scene, name, plan=FINE):
    """(root mean square, largest) steps of 255 from the reference."""
    rgba = render(scene, plan).rgba
    assert np.isfinite(rgba).all()
    off = (rgba[1::3, 1::3] - true_picture(scene, name, plan)) / LEVEL
    return float(np.sqrt((off**2).mean())), float(np.abs(off).max())


# --- C8 to C10: matrices --------------------------------------------------------------------------------------


@pytest.mark.parametrize("stretch", ((1.0, 1.0, 1e3), (1e3, 1.0, 1.0), (1e-3, 1.0, 1.0), (1.0, 1e3, 1e-3)), ids=str)
@pytest.mark.parametrize("direction", ((0.5, 0.8, -0.3), (0.9, -0.2, 0.4)), ids=str)
def test_C8_voxels_a_thousand_times_as_long_as_wide(record, plan, stretch, direction):
    """A close-up of the middle, twenty of the middling lengths high, against the truth."""
    field = 0.6 * blobs((16, 16, 16), 3, count=6, width=(2.0, 3.0))
    linear, middle = np.diag(stretch), 7.5 * np.array(stretch)
    far = 40.0 * max(stretch)
    camera = STAGE.looking(
        middle - far * np.array(direction),
        middle,
        (0.21, 0.13, 0.94),
        type="ORTHO",
        ortho_scale=20.0 * float(np.median(stretch)),
        clip_start=1e-3 * far,
        clip_end=10.0 * far,
    )
    seen = replace(OPACITY_IS_VALUE, opacity_unit_distance=2.0 * min(stretch))
    scene = STAGE.before(volume_for(plan, field, linear), camera, (60, 60), transfer_function=seen)
    planes = render(scene, plan).report["plan"]["base_planes"]
    name = ("C8", stretch, direction)
    assert true_picture(scene, name, plan)[..., 3].max() > 0.1
    in_index = np.abs(np.array(direction) / stretch)
    wrong = sum(plane["principal_axis"][1] != "xyz"[in_index.argmax()] for plane in planes)
    record("C8", "planes of another principal axis than that of the index space", wrong, 0)
    record("C8", "sheets of 16 slices, Gauss's rule", max(plane["sheets"] for plane in planes), 34)
    record("C8", "sheet pixels per picture pixel", max(p["width"] * p["height"] for p in planes) / 3600, 16)
    rms, largest = errors(scene, name, plan)
    record("C8", "rms steps of 255 from the reference at 1:1000", rms, 0.5)
    record("C8", "steps of 255 from the reference at 1:1000", largest, 8.0)


LEAN = np.array(((1.0, 1.5, 0.0), (0.0, 1.0, -0.8), (0.0, 0.0, 1.0)))
MIRROR = np.diag((-1.0, 1.0, 1.0))
MATRICES = {"sheared": LEAN, "mirrored": MIRROR, "both": LEAN @ MIRROR, "all mirrored": -np.eye(3), "turned": LEAN.T}


@pytest.mark.parametrize("name", MATRICES)
@pytest.mark.parametrize("kind", ("PERSP", "ORTHO"))
def test_C9_sheared_and_mirrored_matrices(record, plan, name, kind):
    linear = MATRICES[name]
    middle = linear @ np.full(3, 11.5)
    camera = STAGE.looking(
        middle + (40.0, -60.0, 35.0), middle, type=kind, lens=60.0, ortho_scale=50.0, clip_start=0.1, clip_end=1e3
    )
    scene = STAGE.before(volume_for(plan, FIELD, linear), camera, (60, 60))
    rms, largest = errors(scene, ("C9", name, kind), plan)
    record("C9", "rms steps of 255 from the reference, sheared and mirrored", rms, 0.1)
    record("C9", "steps of 255 from the reference, sheared and mirrored", largest, 1.0)


@pytest.mark.parametrize("name", MATRICES)
def test_C9_normals_go_by_the_inverse_transpose(record, name):
    """The same ball of a medium in the world on an upright grid and on a sheared or mirrored one, lit by a sun: what
    differs is the sampling.  Normals that turned with the grid would differ by tenths."""

    def ball(linear):
        count = 40
        index = np.moveaxis(np.indices((count,) * 3, dtype=np.float64)[::-1], 0, -1) - 19.5
        r = np.linalg.norm(index @ linear.T, axis=-1)
        field = 0.5 / (1.0 + np.exp((r - 8.0) / 1.5))
        lit = replace(OPACITY_IS_VALUE, shade=Shade(ambient=0.1, diffuse=0.9, specular=0.0))
        volume = STAGE.volume(np.where(field > 1e-4, field, 0.0), placed(linear, -linear @ np.full(3, 19.5)))
        camera = STAGE.looking((30.0, -45.0, 25.0), (0.0, 0.0, 0.0), type="ORTHO", ortho_scale=24.0)
        sun = Light("SUN", energy=math.pi, matrix_world=placed(turned((1.0, 0.4, 0.2), 1.0)))
        scene = STAGE.before(volume, camera, (48, 48), transfer_function=lit, lights=(sun,))
        return render(scene, replace(FINE, depth_rule="midpoint-4")).rgba

    linear = 0.5 * (MATRICES[name] + np.diag(np.diag(MATRICES[name]))) * 0.8  # half the shear: still well sampled
    upright = ball(0.8 * np.eye(3))
    assert upright[..., 3].max() > 0.9 and np.ptp(upright[20:28, 20:28, 0]) < 0.5
    error = float(np.sqrt(((ball(linear) - upright) ** 2).mean())) / LEVEL
    record("C9", "rms steps of 255 between a lit ball on a sheared grid and on an upright one", error, 2.0)


@pytest.mark.parametrize("axis", (0, 1, 2))
def test_C10_singular_and_nearly_singular_matrices(record, plan, axis):
    camera = STAGE.looking((40.0, -60.0, 35.0), (11.5, 11.5, 11.5), type="ORTHO", ortho_scale=50.0)
    volume, silent, not_finite = volume_for(plan), 0, 0
    for scale in (1.0, 1e-20, 1e20):
        for flat in (0.0, 1e-13, 1e-300):
            linear = scale * np.eye(3)
            linear[axis, axis] *= flat
            for matrix in (linear, turned((1.0, 2.0, 3.0), 1.0) @ linear, np.zeros((3, 3))):
                try:
                    render(STAGE.before(volume, camera, (8, 8), volume_matrix=placed(matrix)), plan)
                    silent += 1
                except RleSplatError as problem:
                    assert "flattens the volume" in str(problem) and str(problem).endswith(".")
    record(
        "C10",
        "singular matrices without a sentence",
        silent,
        0,
        looser="no thickness is said in a sentence too, not drawn as nothing: a volume never vanishes unexplained",
    )
    for flat in (1e-3, 1e-6, 1e-9, 1e-11):
        linear = np.eye(3)
        linear[axis, axis] = flat
        for kind in ("ORTHO", "PERSP"):
            scene = STAGE.before(volume, replace(camera, type=kind), (24, 24), volume_matrix=placed(linear))
            rgba = render_all(scene, plan).rgba
            not_finite += (~np.isfinite(rgba)).sum() + (rgba < 0.0).sum() + (rgba[..., 3] > 1.0).sum()
    record("C10", "numbers not finite or out of range, one axis 1e-3 to 1e-11 of the others", not_finite, 0)


def render_all(scene, quality=FINE):
    """The picture, transparent where nothing is in view."""
    return drain(render_steps(scene, quality, refuse_empty_view=False))


# --- C11, C12: where the eye is -------------------------------------------------------------------------------

EYES = {
    "outside": (-14.0, -11.0, 20.0), "anywhere": (11.3, 10.2, 12.1), "on a voxel": (11.0, 10.0, 12.0),
    "half way": (11.5, 10.5, 12.5), "on the ramps' face": (-1.0, 10.3, 12.2), "on the face": (0.0, 10.3, 12.2),
    "on a corner": (23.0, 23.0, 23.0),
}  # fmt: skip


def from_eye(plan, eye, fov, size=(66, 66)):
    camera = STAGE.looking(eye, (13.7, 14.1, 10.4), lens=lens_of(fov), clip_start=1e-4, clip_end=1e3)
    return STAGE.before(volume_for(plan), camera, size)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("fov", (60.0, 120.0))
def test_C11_camera_inside_and_outside_dense_cells(record, plan, eye, fov):
    """The same plan inside and outside: a fractional first cell, and up to six pyramids with their seams."""
    rms, largest = errors(from_eye(plan, EYES[eye], fov), ("C11", eye, fov), plan)
    outside, largest_outside = errors(from_eye(plan, EYES["outside"], 60.0), ("C11", "outside", 60.0), plan)
    record("C11", "rms error inside, in units of twice that outside", rms / (2.0 * outside), 1.0)
    record("C11", "largest error inside, in units of twice that outside", largest / (2.0 * largest_outside), 1.0)


def test_C11_camera_inside_empty_cells(record, plan):
    field = np.pad(FIELD, 6)
    camera = STAGE.looking((3.0, 4.0, 30.0), (18.0, 18.0, 18.0), lens=lens_of(70.0), clip_start=1e-4)
    scene = STAGE.before(STAGE.volume(field), camera, (66, 66))
    outside, _ = errors(from_eye(plan, EYES["outside"], 60.0), ("C11", "outside", 60.0), plan)
    record(
        "C11",
        "rms error inside, in units of twice that outside",
        errors(scene, "C11 empty", plan)[0] / (2.0 * outside),
        1.0,
    )


def test_C11_camera_that_looks_away_sees_nothing(record, plan):
    lit = 0
    for kind in ("PERSP", "ORTHO"):
        camera = STAGE.looking((60.0, 12.0, 12.0), (90.0, 12.0, 12.0), type=kind, ortho_scale=6.0)
        scene = STAGE.before(volume_for(plan), camera, (16, 16))
        lit += (render_all(scene, plan).rgba != 0.0).sum()
        with pytest.raises(RleSplatError, match="does not see the volume"):
            render(scene, plan)
    record("C11", "numbers that are not zero with the volume behind the camera", lit, 0)


@pytest.mark.parametrize("where", (9.0, 8.5, 9.0 - 1e-3, 0.0, -1.0))
def test_C11_moving_the_eye_across_a_slice_is_continuous(record, plan, where):
    def seen(y):
        camera = STAGE.looking((11.2, y, 12.4), (12.0, 40.0, 12.0), lens=20.0, clip_start=1e-4)
        return render(STAGE.before(volume_for(plan), camera, (48, 48)), plan).rgba

    pictures = [seen(where + d) for d in (-2e-3, -5e-4, -1e-7, 0.0, 1e-7, 5e-4, 2e-3)]
    jump = max(np.abs(b - a).max() for a, b in pairwise(pictures)) / LEVEL
    assert pictures[0].max() > 0.3
    record("C11", "steps of 255 by which an eye's step of 1e-7 to 2e-3 across a slice changes the picture", jump, 1.0)


def test_C12_no_mirrored_ghost_behind_the_eye(record, plan):
    """A medium behind the eye never shows: a bright block at the back leaves the picture of the front unchanged."""
    empty = np.zeros((24, 24, 24))
    behind = empty.copy()
    behind[:, :8] = 0.5
    behind[12, 20, 12] = empty[12, 20, 12] = 0.5
    changed = 0
    for eye in (11.0, 11.0 + 1e-9, 11.4):
        camera = STAGE.looking((12.0, eye, 12.0), (12.0, 20.0, 12.0), lens=lens_of(100.0), clip_start=1e-3)
        pictures = [render(STAGE.before(STAGE.volume(field), camera, (48, 48)), plan).rgba for field in (empty, behind)]
        assert pictures[0].max() > 0.05
        changed += (pictures[0] != pictures[1]).sum()
    record("C12", "numbers that matter behind the eye changes", changed, 0)


@pytest.mark.filterwarnings("error::RuntimeWarning")  # no division by a slice's distance of zero
@pytest.mark.parametrize("beside", (0.0, 1e-15, -1e-12, 1e-9, 1e-6, 9.9e-4, 1.1e-3))
def test_C12_a_slice_through_the_eye(record, plan, beside):
    """On a slice of each axis at once, and a hair before and behind it."""
    camera = STAGE.looking(
        np.array((11.0, 10.0, 12.0)) + beside, (13.7, 14.1, 10.4), lens=lens_of(100.0), clip_start=1e-4
    )
    scene = STAGE.before(volume_for(plan), camera, (66, 66))
    rms, _ = errors(scene, ("C12", beside), plan)
    outside, _ = errors(from_eye(plan, EYES["outside"], 60.0), ("C11", "outside", 60.0), plan)
    record("C12", "rms error with the eye on a slice, in units of twice that outside", rms / (2.0 * outside), 1.0)


# --- C13, C15: clip planes and wide cameras -------------------------------------------------------------------


@pytest.mark.parametrize("kind", ("PERSP", "ORTHO"))
@pytest.mark.parametrize("clip", ((20.0, 26.5), (0.1, 24.3), (25.7, 500.0), (1e-9, 1e12), (1e-12, 24.3)), ids=str)
def test_C13_clip_planes_inside_the_volume(record, plan, kind, clip):
    camera = STAGE.looking(
        (-14.0, -1.0, 20.0), (12.0, 12.0, 11.0), type=kind, lens=40.0, ortho_scale=34.0, clip_start=clip[0],
        clip_end=clip[1],
    )  # fmt: skip
    rms, largest = errors(STAGE.before(volume_for(plan), camera, (66, 66)), ("C13", kind, clip), plan)
    record("C13", "rms steps of 255 from the reference with clip planes inside", rms, 0.2)
    record("C13", "steps of 255 from the reference with clip planes inside", largest, 2.0)


@pytest.mark.parametrize("side", ("start", "end"))
def test_C13_moving_a_clip_plane_is_continuous(record, plan, side):
    """A fiftieth of a slice more or less never makes more than the medium in it, extinction 0.51 a voxel at most."""
    scene = STAGE.on_turntable(FIELD, 0.0, 0.0, size=(32, 32))
    middle = float(np.linalg.norm(scene.camera.matrix_world[:3, 3] - (11.5, 11.5, 11.5)))
    pictures = []
    for shift in np.arange(-0.15, 0.65, 0.02):
        clip = {"clip_start": middle + shift} if side == "start" else {"clip_start": 0.01, "clip_end": middle + shift}
        moved = replace(scene, camera=replace(scene.camera, **clip))
        pictures.append(render(moved, replace(plan, termination=0.0)).rgba)
    assert np.abs(pictures[0] - pictures[-1]).max() > 0.04
    jump = max(np.abs(a - b).max() for a, b in pairwise(pictures)) / (0.02 * 0.52)
    record("C13", "change per voxel that a clip plane moves, in units of the densest voxel's", jump, 1.0)


@pytest.mark.parametrize("classification", ("pre", "post"))
@pytest.mark.parametrize("rule", ("slice", "simpson"))
def test_C13_the_depth_of_a_medium_that_a_clip_plane_cuts(record, rule, classification, way):
    """In a homogeneous medium half the light is gone ln 2 / extinction behind the plane, wherever it cuts a slab; seen
    askew no depth lies before the plane or beyond the other."""
    dense = transfer(((0.0, 1.0 - math.exp(-2.0)),))
    block = from_above(np.ones((8, 6, 6), np.uint8), dense)
    quality = Quality(classification=classification, depth_rule=rule, termination=0.0)
    for clip in (11.5, 11.8, 12.03, 13.25):  # the first slice's center is 11 away
        scene = replace(block, camera=replace(block.camera, clip_start=clip))
        depth = render(scene, quality).depth[2:4, 2:4]
        off = abs(depth - (clip + 0.5 * math.log(2.0))).max()
        record("C13", "voxels that the half depth is off behind a clip plane", off, 1e-5)
    scene = STAGE.on_turntable(FIELD, 37.0, 24.0, size=(40, 40), fit=0.9)
    middle = float(np.linalg.norm(scene.camera.matrix_world[:3, 3] - 11.5))
    near, far = middle - 3.3, middle + 3.1
    depth = render(replace(scene, camera=replace(scene.camera, clip_start=near, clip_end=far)), quality).depth
    found = depth[depth < NO_DEPTH].astype(np.float64)
    assert found.size > 20
    beyond = max(near - found.min(), found.max() - far, 0.0)
    record("C13", "voxels that a depth lies before or beyond the clip planes", beyond, 1e-5)


@pytest.mark.parametrize("eye", ("outside", "anywhere", "on a voxel", "on the face"))
def test_C15_fields_of_view_of_170_degrees(record, plan, eye):
    rms, largest = errors(from_eye(plan, EYES[eye], 170.0), ("C15", eye), plan)
    record("C15", "rms steps of 255 from the reference, 170 degrees wide", rms, 0.1)
    record("C15", "steps of 255 from the reference, 170 degrees wide", largest, 1.0)


@pytest.mark.parametrize("shift", ((5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0), (1.5, -2.5)), ids=str)
@pytest.mark.parametrize("kind", ("PERSP", "ORTHO"))
def test_C15_lens_shift_and_pixel_aspect(record, plan, shift, kind):
    """A camera shifted by several sensor widths, moved aside so that the volume stays in the picture.

    It looks along an axis at a medium cut by the faces, where the kinks of all slices fall on the same pixels: the
    worst case of the warp, hence the bound; every shift must give the same error, as it gives the same rays.
    """
    size, distance = 40.0, 50.0
    eye = np.array((12.0, 12.0 - distance, 12.0)) - (shift[0] * size, 0.0, shift[1] * size)
    camera = STAGE.looking(
        eye, eye + (0.0, 1.0, 0.0), type=kind, ortho_scale=size, lens=36.0 * distance / size, shift_x=shift[0],
        shift_y=shift[1], clip_start=0.1, clip_end=1e4, pixel_aspect=(1.0, 2.0),
    )  # fmt: skip
    rms, largest = errors(STAGE.before(volume_for(plan), camera, (66, 33)), ("C15", shift, kind), plan)
    record("C15", "rms steps of 255 from the reference, lens shifted by 5, pixels 1:2", rms, 0.6)
    record("C15", "steps of 255 from the reference, lens shifted by 5, pixels 1:2", largest, 6.0)
