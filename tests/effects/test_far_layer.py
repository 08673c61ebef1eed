"""Proves that what is seen past silhouettes is the same, to the bit, whether all of it is splatted a second time or
only the blocks of pixels whose rays end elsewhere than before them."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects import mesh_occlusion
from rle_splat.pipeline.render import render
from rle_splat.scene import Clip, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

FUNCTION = TransferFunction(opacity=((0.2, 0.0), (0.6, 0.3)), color=((0.0, 0.9, 0.3, 0.1), (1.0, 0.2, 0.5, 0.9)))
# Two sheets of triangles across the volume, one before the other, with corners inside the picture.
MESH = np.array([
    ((-8, -9, -3), (9, -6, -4), (-5, 3, 8)), ((-5, 2, -8), (11, 5, -6), (6, 1, 9)),
    ((40, 5, 0), (40, 9, 0), (44, 5, 3)),
], float)  # fmt: skip


def scene_of(perspective, **more):
    volume = Volume(np.random.default_rng(5).random((22, 20, 18), np.float32), np.eye(4))
    camera, matrix = turntable(volume, 30.0, 20.0, perspective=perspective)
    return Scene(volume, FUNCTION, camera, 90, 80, matrix, triangles=MESH, **more)


CASES = {
    "post": ({}, "post"), "pre": ({}, "pre"), "mip": ({"mode": "mip"}, "post"),
    "xray": ({"mode": "xray"}, "post"), "crop": ({"crop": (20, 15, 77, 70)}, "post"),
    "clipped": ({"clips": (Clip("box", np.diag((4.0, 5.0, 4.0, 1.0)), "outside"),)}, "post"),
    "little left": ({"clips": (Clip("box", np.diag((4.0, 5.0, 4.0, 1.0))),)}, "post"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("case", "perspective", "way"),
    (*((case, bool(number % 2), "numba") for number, case in enumerate(CASES)), ("post", True, "numba"),
     ("pre", False, "numba"), *((case, False, "numpy") for case in ("post", "pre", "mip", "crop"))),
    indirect=["way"],
)  # fmt: skip
def test_only_what_differs_is_splatted_again_and_the_picture_is_the_same(case, perspective, way, monkeypatch):
    more, classification = CASES[case]
    scene = scene_of(perspective, **more)
    quality = Quality(classification=classification)
    left_out = []
    asked = mesh_occlusion.leave_out_like
    monkeypatch.setattr(mesh_occlusion, "leave_out_like", lambda *a: left_out.append(asked(*a)) or left_out[-1])
    found = render(scene, quality)
    assert left_out and all(0.1 < like.mean() < 1.0 for like in left_out)

    def whole(layers, region, planes, reach):
        numbered = list(enumerate(planes))
        return [(layers.near, region, numbered), (layers.far, region, numbered)]

    monkeypatch.setattr(mesh_occlusion, "layers_to_splat", whole)
    monkeypatch.setattr(mesh_occlusion, "leave_out_like", lambda plane, *_: np.zeros((plane.height, plane.width), bool))
    expected = render(scene, quality)
    np.testing.assert_array_equal(found.rgba, expected.rgba)
    np.testing.assert_array_equal(found.depth, expected.depth)
    without = render(replace(scene, triangles=None), quality)
    assert np.abs(without.rgba - found.rgba).max() > 0.04, "the meshes hide nothing, so nothing was tested"
