"""Proves that nothing is mirrored, rolled or swapped: a lopsided phantom in all 24 axis-aligned views, compared with
plain numpy transposes and flips of the array; no camera mathematics is involved in the expectation."""

import itertools

import numpy as np
import pytest

from rle_splat.accuracy.metrics import LEVEL
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.scene import Camera

SIZE, ZOOM = 11, 5  # voxels a side; pixels a voxel, odd so that voxel centers fall on pixel centers
SIGMA = 1.5
RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.8, 0.8, 0.8)
COLORS = np.array(((0.0, 0.0, 0.0), RED, GREEN, BLUE, WHITE))


def lopsided():
    """Labels (x, y, z): red towards +x, green towards +y, blue towards +z, a white L near the low corner.

    Different colors on one axis-parallel line keep two voxels apart, so that they do not mix.
    """
    label = np.zeros((SIZE,) * 3, dtype=int)
    label[8:10, 5, 5] = 1
    label[5, 8:11, 5] = 2
    label[5, 5, 8:10] = 3
    label[1:5, 1, 2] = 4
    label[1, 1:4, 2] = 4
    label[5, 1, 5] = 1
    label[8, 8, 1] = 3
    label[8, 8, 5] = 2
    label[1, 8, 8] = 1
    label[3, 8, 8] = 3
    return label


LABELS = TransferFunction(
    name="labels", opacity_unit_distance=1.0, shade=None,
    opacity=((0.5, 0.0), (0.5, -np.expm1(-SIGMA))),
    color=tuple((i, *c) for i, c in enumerate(COLORS)),
)  # fmt: skip
AXES = [sign * axis for axis in np.eye(3, dtype=int) for sign in (1, -1)]
VIEWS = [(r, u) for r, u in itertools.product(AXES, AXES) if abs(r) @ abs(u) == 0]


def projected(label, right, up):
    """(rows, columns, 4): compose the array's voxels front to back, looking along -(right x up)."""
    ahead = -np.cross(right, up)
    order = [int(np.argmax(np.abs(v))) for v in (up, right, ahead)]
    seen = label.transpose(order)
    flips = [up.sum() > 0, right.sum() < 0, ahead.sum() < 0]  # row 0 is the highest along up
    for axis, flip in enumerate(flips):
        seen = np.flip(seen, axis) if flip else seen
    result, transmitted = np.zeros(seen.shape[:2] + (4,)), np.ones(seen.shape[:2])
    for k in range(SIZE):
        alpha = np.where(seen[..., k] > 0, -np.expm1(-SIGMA), 0.0)
        result[..., :3] += (transmitted * alpha)[..., None] * COLORS[seen[..., k]]
        transmitted = transmitted * (1.0 - alpha)
    result[..., 3] = 1.0 - transmitted
    return result


def axis_camera(right, up, kind):
    back = np.cross(right, up)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((right, up, back), axis=1)
    distance = 3000.0 if kind == "PERSP" else 30.0  # so far that parallax is a hundredth of a voxel
    matrix[:3, 3] = 0.5 * (SIZE - 1) + distance * back
    return Camera(matrix, kind, ortho_scale=SIZE, lens=36.0 * distance / SIZE, clip_end=1e4)


def test_there_are_24_different_pictures():
    pictures = {projected(lopsided(), r, u).tobytes() for r, u in VIEWS}
    assert len(VIEWS) == 24 and len(pictures) == 24


@pytest.mark.parametrize("kind", ("ORTHO", "PERSP"))
@pytest.mark.parametrize("right, up", VIEWS, ids=lambda v: "".join("-+"[int(v.sum() > 0)] + "xyz"[abs(v).argmax()]))
def test_axis_aligned_view(stage, right, up, kind):
    label = lopsided()
    scene = stage.before(
        stage.volume(label.transpose(2, 1, 0)), axis_camera(right, up, kind), (SIZE * ZOOM,) * 2,
        transfer_function=LABELS,
    )  # fmt: skip
    picture = stage.render(scene, sheet_density=2.0).rgba[ZOOM // 2 :: ZOOM, ZOOM // 2 :: ZOOM]
    assert np.abs(picture - projected(label, right, up)).max() < 12.0 * LEVEL
