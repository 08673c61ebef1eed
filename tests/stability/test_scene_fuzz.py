"""Scenes and plans, P1 to P3: any volume, affine, camera, transfer function and plan at once.

P1: what every picture keeps to, whatever the plan.  P2: the sheets of any matter against the oracle, ray by ray, for
plans that converge to it.  P3: finished pictures of smooth matter against the oracle, by the bound of their preset.
Every failure that the searches found has a case of its own below them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import event, given

from rle_splat.jit import compiled
from rle_splat.render import render_steps
from rle_splat.scene import NO_DEPTH, RleSplatError
from rle_splat.steps import drain
from tests.stability.fuzz import examples
from tests.stability.strategies import qualities, scenes

ROUNDING = 2.0**-20


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
    slack = 1e-4 * (far - near)
    assert (depth[hit] >= max(near, scene.camera.clip_start) - slack).all()
    assert (depth[hit] <= min(far, scene.camera.clip_end) + slack).all()
    if rgba[..., 3].max() < 0.4:
        assert not hit.any()
    if rgba[..., 3].min() > 0.6:
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


def test_P1_any_scene_and_any_plan(record):
    search_anything()
    record("P1", "pictures not finite, out of range or other with two threads", 0, 0, "either", "whole numbers")
