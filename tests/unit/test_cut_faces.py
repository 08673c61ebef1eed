"""The faces of cuts: where they lie, and which part of them is shown, against areas known in closed form."""

import numpy as np
import pytest

from rle_splat.runtime.steps import drain
from rle_splat.segment.cut_faces import CutFace, Sampled, face_matrices, face_share, plane_around
from rle_splat.volume.slices import resample_steps
from rle_splat.volume.volume import Volume

pytest.importorskip("cc3d")

N = 48  # voxels along each side
MIDDLE = 0.5 * (N - 1)
RADIUS = 15.0
INF = float("inf")
OUTER = ((100.0 - RADIUS, INF),)  # visible: the ball


@pytest.fixture(scope="module")
def ball():
    """Values of 100 minus the distance from the middle, in voxels."""
    z, y, x = np.mgrid[:N, :N, :N] - MIDDLE
    return Volume((100.0 - np.sqrt(x**2 + y**2 + z**2)).astype(np.float32), np.eye(4))


def plane(half=(20.0, 20.0), middle=(0.0, 0.0, 0.0)):
    """A plane across z: its space to voxel indices; ``middle`` from that of the ball."""
    matrix = np.diag((*half, 1.0, 1.0))
    matrix[:3, 3] = np.add(MIDDLE, middle)
    return matrix


def sampled(volume, matrix, width, height):
    return Sampled(*drain(resample_steps(volume, matrix, width, height)), matrix)


def share(volume, matrix, face, is_filled=True, size=(120, 120)):
    around = sampled(volume, plane_around(volume, matrix), 96, 96)
    return face_share(sampled(volume, matrix, *size), around, face, is_filled)


def area(found, half=(20.0, 20.0)):
    """Shown area in square voxels."""
    return found.sum() * 4.0 * half[0] * half[1] / found.size


@pytest.mark.parametrize("depth", [0.0, 6.3, 11.0])
def test_the_outline_is_that_of_the_visible_values(ball, depth):
    found = share(ball, plane(middle=(0.0, 0.0, depth)), CutFace(OUTER))
    assert area(found) == pytest.approx(np.pi * (RADIUS**2 - depth**2), rel=0.004)
    assert ((found > 0.0) & (found < 1.0)).sum() < 0.06 * found.size  # a line of pixels is partly shown


def test_what_visible_values_enclose_is_shown_or_not(ball):
    shell = CutFace(((100.0 - RADIUS, 100.0 - RADIUS + 3.0),))
    assert area(share(ball, plane(), shell)) == pytest.approx(np.pi * RADIUS**2, rel=0.004)
    ring = np.pi * (RADIUS**2 - (RADIUS - 3.0) ** 2)
    assert area(share(ball, plane(), shell, is_filled=False)) == pytest.approx(ring, rel=0.01)


@pytest.mark.parametrize("gap, is_closed", [(1.0, True), (12.0, False)])
def test_what_only_a_narrow_gap_opens_is_enclosed(ball, gap, is_closed):
    voxels = ball.voxels.copy()
    _, y, x = np.mgrid[:N, :N, :N] - MIDDLE
    voxels[(np.abs(y) < 0.5 * gap) & (x > 0.0)] = 0.0
    found = share(Volume(voxels, np.eye(4)), plane(), CutFace(((100.0 - RADIUS, 100.0 - RADIUS + 3.0),)))
    assert found[20 * 3, 20 * 3] == float(is_closed)


def test_the_rectangle_of_a_face_opens_nothing(ball):
    """What is enclosed on the plane stays so where the face ends within it."""
    shell = CutFace(((100.0 - RADIUS, 100.0 - RADIUS + 3.0),))
    found = share(ball, plane((10.0, 10.0), (10.0, 10.0, 0.0)), shell)
    assert area(found, (10.0, 10.0)) == pytest.approx(0.25 * np.pi * RADIUS**2, rel=0.006)


def test_other_cuts_limit_a_face(ball):
    half = (False, ((1.0, 0.0, 0.0, -MIDDLE),))  # what is beyond the middle along x is cut away
    assert area(share(ball, plane(), CutFace(OUTER, (half,)))) == pytest.approx(0.5 * np.pi * RADIUS**2, rel=0.005)
    sides = tuple((*(sign * np.eye(3)[axis]), -sign * MIDDLE - 4.0) for axis in range(3) for sign in (1.0, -1.0))
    found = area(share(ball, plane(), CutFace(OUTER, ((True, sides),))))
    assert found == pytest.approx(np.pi * RADIUS**2 - 8.0**2, rel=0.005)


def test_labels_show_other_values_or_nothing(ball):
    labels = np.zeros((N, N, N), np.uint8)
    labels[:, :, N // 2 :] = 3
    hidden = CutFace(OUTER, shown_of=(((), (3,)),), labels_key=1, labels=labels)
    assert area(share(ball, plane(), hidden)) == pytest.approx(0.5 * np.pi * RADIUS**2, rel=0.005)
    inner = CutFace(OUTER, shown_of=((((95.0, INF),), (3,)),), labels_key=1, labels=labels)
    both = 0.5 * np.pi * (RADIUS**2 + 5.0**2)
    assert area(share(ball, plane(), inner)) == pytest.approx(both, rel=0.005)


def test_a_value_that_is_no_number_is_not_shown(ball):
    voxels = ball.voxels.copy()
    voxels[:, :, N // 2 :] = np.nan
    everything = CutFace(((-INF, INF),))
    found = share(Volume(voxels, np.eye(4)), plane(), everything, is_filled=False)
    assert np.isfinite(found).all() and found[:, :58].min() == 1.0 and found[:, 62:].max() == 0.0


def test_nothing_visible_shows_nothing(ball):
    assert not share(ball, plane(), CutFace(())).any()
    assert not share(ball, plane(middle=(0.0, 0.0, 100.0)), CutFace(OUTER)).any()  # beside the volume
    assert share(ball, plane(), CutFace(OUTER), size=(1, 1)).item() == 1.0


def test_the_plane_around_holds_the_face_and_the_volume(ball):
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    matrix = plane((3.0, 5.0), (4.0, -7.0, 2.0))
    matrix[:3, :3] = turn @ matrix[:3, :3]
    around = plane_around(ball, matrix)
    corners = np.linalg.inv(around) @ matrix @ np.array([(x, y, 0.0, 1.0) for x in (-1, 1) for y in (-1, 1)]).T
    np.testing.assert_allclose(corners[2], 0.0, atol=1e-12)
    assert np.abs(corners[:2]).max() < 1.0
    rim = np.array([(np.cos(a), np.sin(a), 0.0, 1.0) for a in np.linspace(0.0, 6.28, 50)])
    far = (around @ rim.T)[:3]
    assert ((far < -0.5) | (far > N - 0.5)).any(axis=0).all()  # beyond it the plane is outside of the volume


def test_a_box_has_six_faces_that_look_outward():
    faces = face_matrices("box")
    middles = {tuple(face[:3, 3]) for face in faces}
    assert middles == {tuple(side * np.eye(3)[axis]) for axis in range(3) for side in (-1.0, 1.0)}
    for face in faces:
        np.testing.assert_array_equal(face[:3, 2], face[:3, 3])
        np.testing.assert_allclose(face[:3, :3] @ face[:3, :3].T, np.eye(3))
    assert len(face_matrices("plane")) == 1
