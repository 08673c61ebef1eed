"""Proves that what clip objects cut away is not looked at: voxels put on scanlines, as the kernels count them."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Clip, Quality, Scene
from rle_splat.splat import scalar_splat, scratch, splat
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

pytest.importorskip("numba")

N = 96
THIN = TransferFunction(
    name="thin", opacity=((0.0, 0.0), (1.0, 0.02)), color=((0.0, 0.9, 0.3, 0.1), (1.0, 0.1, 0.3, 1.0)),
    opacity_unit_distance=1.0, shade=None,
)  # fmt: skip
QUALITIES = {
    "post": Quality(threads=1, termination=0.0),
    "post, own sheets": Quality(depth_rule="simpson", threads=1, termination=0.0),
    "pre": Quality(classification="pre", threads=1, termination=0.0),
}


@pytest.fixture
def counted(monkeypatch):
    """``counted(scene, quality)``: (scanlines walked, voxels put on a line) while the scene is rendered, thin enough
    that no early end of rays decides."""
    made = []
    monkeypatch.setattr(scratch, "MOST_KEPT", 0)  # each plane counts in a scratch of its own
    monkeypatch.setattr(scratch, "_KEPT", [])

    def keeping(original):
        def scratch_for(*arguments, **more):
            made.append(original(*arguments, **more))
            return made[-1]

        return scratch_for

    for module in (splat, scalar_splat):
        monkeypatch.setattr(module, "scratch_for", keeping(module.scratch_for))

    def count(scene, quality):
        made.clear()
        render(scene, quality)
        return tuple(sum(int(one.line.reach[:, number].sum()) for one in made) for number in (2, 3))

    return count


WHOLE: dict = {}  # counts of scenes of which nothing is cut away


def scene_of(perspective, *clips) -> Scene:
    z, y, x = np.indices((N, N, N))
    full = Volume((0.6 + 0.4 * np.sin(0.3 * (x + 2 * y - z))).astype(np.float32), np.eye(4))
    camera, matrix = turntable(full, 12.0, 8.0, 1.25, perspective, 30.0)
    return Scene(full, THIN, camera, 160, 160, matrix, headlight=False, clips=clips)


def box(half, keep="inside"):
    matrix = np.diag((*np.broadcast_to(half, 3), 1.0)).astype(float)
    matrix[:3, 3] = 0.5 * (N - 1)
    return Clip("box", matrix, keep)


def half_plane():
    matrix = np.eye(4)
    matrix[:3, 3] = 0.5 * (N - 1)
    return Clip("plane", matrix)


# Clip objects, and the shares of the voxels and of the scanlines that may be touched: what is left, and a rim of blocks
# of 16 pixels by 16 rows about it, a tenth above what was counted.  (Scanlines through a hole are walked beside it.)
CUTS = {
    "half": ((half_plane(),), 0.74, 0.74),
    "a hundredth": ((box(0.105 * N),), 0.034, 0.093),
    "a slice": ((box((0.5 * N, 0.01 * N, 0.5 * N)),), 0.046, 0.046),
    "a rod": ((box((0.5 * N, 0.02 * N, 0.02 * N)),), 0.009, 0.009),
    "a hole": ((box((0.4 * N, N, 0.4 * N), "outside"),), 0.66, 1.0),
}


@pytest.mark.parametrize(
    ("cut", "quality", "perspective"),
    [(cut, one, bool((c + q) % 2)) for c, cut in enumerate(CUTS) for q, one in enumerate(QUALITIES)],
)
def test_what_is_cut_away_is_not_visited(counted, cut, quality, perspective):
    clips, voxels, scanlines = CUTS[cut]
    if (quality, perspective) not in WHOLE:
        WHOLE[quality, perspective] = counted(scene_of(perspective), QUALITIES[quality])
    whole, left = WHOLE[quality, perspective], counted(scene_of(perspective, *clips), QUALITIES[quality])
    assert whole[1] > N**3 and left[1] > 0
    assert left[1] < voxels * whole[1] and left[0] <= scanlines * whole[0]


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_clip_distances_of_a_camera_keep_the_splat_as_short(counted, quality):
    scene = scene_of(False)
    distance = float((np.linalg.inv(scene.camera.matrix_world) @ np.append(np.full(3, 0.5 * (N - 1)), 1.0))[2])
    thin = replace(scene, camera=replace(scene.camera, clip_start=-distance - 2.0, clip_end=-distance + 2.0))
    whole, left = (counted(one, QUALITIES[quality]) for one in (scene, thin))
    assert 0 < left[1] < 0.14 * whole[1]


def test_nothing_is_visited_where_nothing_is_left(counted):
    away = np.eye(4)
    away[:3, 3] = 5.0 * N
    assert counted(scene_of(False, Clip("box", away)), QUALITIES["post"]) == (0, 0)
