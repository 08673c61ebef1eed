"""Scenes and plans, P1 to P3: any volume, affine, camera, transfer function and plan at once.

P1: what every picture keeps to, whatever the plan.  P2: the sheets of any matter against the oracle, ray by ray, for
plans that converge to it.  P3: finished pictures of smooth matter against the oracle, by the bound of their preset.
Every failure that the searches found has a case of its own below them.
"""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st

from rle_splat.accuracy.truths import truth
from rle_splat.jit import compiled
from rle_splat.render import render_steps, warp
from rle_splat.scene import NO_DEPTH, Quality, RleSplatError
from rle_splat.steps import drain
from tests.stability.fuzz import examples
from tests.stability.strategies import plain_scenes, qualities, scenes

ROUNDING = 2.0**-20
TRUE = {"pre": "T1", "post": "T2"}


def picture(scene, quality):
    """The Rendering, transparent where nothing is in view; None where a sentence refuses it."""
    try:
        return drain(render_steps(scene, quality, refuse_empty_view=False))
    except RleSplatError as problem:
        assert str(problem).endswith(".") and "\n" not in str(problem)
        event(f"refused: {str(problem)[:30]}")
        return None


def brightest(scene) -> float:
    """No channel of unlit matter, or of matter under a headlight, exceeds this times its alpha."""
    look = scene.transfer_function
    most = max(max(point[1:]) for point in look.color)
    if look.shade is not None and scene.headlight:
        most = most * max(look.shade.ambient + look.shade.diffuse, 1.0) + look.shade.specular
    return most


def depths_of_box(scene, beyond=4.0):
    """Least and largest planar depth of the volume, so many voxels round it included."""
    to_camera = np.linalg.inv(scene.camera.matrix_world)
    counts = np.array(scene.volume.shape_xyz)
    corners = [(-beyond + c * (counts - 1 + 2 * beyond)) for c in np.ndindex(2, 2, 2)]
    world = np.array(corners) @ scene.index_to_world[:3, :3].T + scene.index_to_world[:3, 3]
    depth = -(world @ to_camera[2, :3] + to_camera[2, 3])
    return depth.min(), depth.max()


def check_picture(scene, quality, made):
    """What any picture keeps to."""
    rgba, depth = made.rgba.astype(np.float64), made.depth.astype(np.float64)
    assert rgba.shape == (scene.height, scene.width, 4) and depth.shape == rgba.shape[:2]
    assert np.isfinite(rgba).all() and np.isfinite(depth).all()
    assert rgba.min() >= 0.0 and rgba[..., 3].max() <= 1.0
    if not scene.lights:
        most = brightest(scene)
        assert (rgba[..., :3] - most * rgba[..., 3:]).max() <= ROUNDING * most
    hit = depth < NO_DEPTH
    near, far = depths_of_box(scene)
    assert (depth[hit] >= scene.camera.clip_start * (1.0 - 1e-6)).all()
    assert (depth[hit] <= scene.camera.clip_end * (1.0 + 1e-6)).all()
    if quality.minification == "off":
        slack = 0.2 * (far - near)  # a sheet pixel's depth serves the pixels beside it
        assert (depth[hit] >= near - slack).all() and (depth[hit] <= far + slack).all()
    if rgba[..., 3].max() < 0.25:  # alpha is filtered between sheet pixels, depth is not
        assert not hit.any()
    if rgba[..., 3].min() > 0.75:
        assert hit.all()


@given(scenes(), qualities())
@examples(60)
def search_anything(scene, quality):
    made = picture(scene, quality)
    if made is None:
        return
    check_picture(scene, quality, made)
    if not compiled():
        return
    twice = picture(scene, replace(quality, threads=2))
    for one, two in ((made.rgba, twice.rgba), (made.depth, twice.depth)):
        assert (one.view(np.uint32) == two.view(np.uint32)).all()
    twin = picture(scene, replace(quality, backend="numpy"))
    check_picture(scene, quality, twin)


# --- P2: sheets against the oracle ----------------------------------------------------------------------------

# Levels by which a ray through a sheet pixel may err where sheets are 16 to a voxel: rms and largest.
SHEET_BOUNDS = {"pre": (1.0, 6.0), "post": (1.0, 6.0)}
WORST: dict = {}


def note(key, *figures):
    WORST[key] = tuple(max(pair) for pair in zip(figures, WORST.get(key, (0.0,) * len(figures)), strict=True))


def sheet_errors(scene, quality, seed=0):
    """Levels off the oracle (N, 4), colour and transmittance, of up to 64 sheet pixels, each along its own ray."""
    caught = []

    def catching(images, *rest):
        caught.extend(images)
        return warp(images, *rest)

    with patch("rle_splat.render.warp", catching):
        drain(render_steps(scene, quality, refuse_empty_view=False))
    found, random = [np.empty((0, 4))], np.random.default_rng(seed)
    for image in caught:
        plane = image.base_plane
        x, y = np.meshgrid(*plane.points())
        a, b, c = np.tensordot(plane.homography, np.stack((x, y, np.ones_like(x))), 1)
        dx, dy = plane.slopes(x, y)
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = a / c, b / c
            mine = (c > 0.0) & (np.maximum(abs(dx), abs(dy)) <= 1.0)
            mine &= (abs(2.0 * column / scene.width - 1.0) < 1.0) & (abs(2.0 * row / scene.height - 1.0) < 1.0)
        chosen = np.flatnonzero(mine)
        chosen = random.permutation(chosen)[: 64 // len(caught)]
        if chosen.size == 0:
            continue
        true, _ = truth(
            scene, TRUE[quality.classification], pixels=(column.ravel()[chosen], row.ravel()[chosen]), tolerance=1e-6
        )
        true[:, 3] = 1.0 - true[:, 3]
        found.append(255.0 * (image.pixels.reshape(-1, 4)[chosen] - true) / max(brightest(scene), 1.0))
    return np.concatenate(found)


def rms(errors):
    return float(np.sqrt((errors**2).mean())) if errors.size else 0.0


def search_sheets(classification):
    wide = dict(curves=("ramp",)) if classification == "post" else {}

    @given(plain_scenes(**wide))
    @examples(40)
    def search(scene):
        plan = Quality(classification=classification, depth_rule="midpoint-16", termination=0.0, threads=1)
        off = sheet_errors(scene, plan)
        note(classification, rms(off), abs(off).max(initial=0.0))
        most_rms, most = SHEET_BOUNDS[classification]
        assert rms(off) <= most_rms and abs(off).max(initial=0.0) <= most

    return search


search_pre_sheets, search_post_sheets = search_sheets("pre"), search_sheets("post")


# --- P3: pictures against the oracle --------------------------------------------------------------------------

# Levels off the oracle of smooth matter, rms and largest, by preset.
PICTURE_BOUNDS = {"draft": (10.0, 60.0), "standard": (2.0, 15.0), "fine": (1.0, 10.0), "strict": (0.5, 5.0)}


def picture_errors(scene, quality, seed=0):
    """Levels off the oracle (N, 4) of 64 pixels of the finished picture."""
    made = drain(render_steps(scene, quality, refuse_empty_view=False)).rgba.reshape(-1, 4)
    chosen = np.random.default_rng(seed).permutation(len(made))[:64]
    rows, columns = np.divmod(chosen, scene.width)
    true, _ = truth(scene, TRUE[quality.classification], pixels=(columns + 0.5, rows + 0.5), tolerance=1e-5)
    return 255.0 * (made[chosen] - true) / max(brightest(scene), 1.0)


@given(
    plain_scenes(
        matter=("blobs",), curves=("ramp",), sizes=(11, 14), most_pixels=32, anisotropy=2.0, widest=100.0, shift=0.3
    ),
    st.sampled_from(("pre", "post")),
)
@examples(25)
def search_pictures(scene, classification):
    for preset, (most_rms, most) in PICTURE_BOUNDS.items():
        off = picture_errors(scene, Quality.preset(preset, classification, threads=1))
        note((classification, preset), rms(off), abs(off).max())
        assert rms(off) <= most_rms and abs(off).max() <= most


def test_P1_any_scene_and_any_plan(record):
    search_anything()
    record("P1", "pictures not finite, out of range or other with two threads", 0, 0, "either", "whole numbers")
