"""Several volumes in one picture, against the transmittance and the color of boxes on paper."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline import several
from rle_splat.pipeline.render import render_steps
from rle_splat.pipeline.several import find_shared_pixels, several_steps
from rle_splat.runtime.steps import drain
from rle_splat.scene import NO_DEPTH, Camera, Pose, Quality
from rle_splat.view.box_order import box_of, near_to_far

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

N = 9
QUALITY = Quality(classification="pre", depth_rule="simpson")  # homogeneous, so pre is exact
RED, BLUE = (0.9, 0.3, 0.1), (0.1, 0.4, 0.8)


def moved(by):
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


@pytest.fixture(scope="module")
def box(stage):
    """Makes homogeneous boxes of 8 x 8 x 8 units about (4, 4, 4), moved, seen along -Z from above."""
    volume = stage.volume(np.ones((N, N, N)))
    camera = Camera(moved((4.0, 4.0, 40.0)), type="ORTHO", ortho_scale=8.0)
    plain = replace(stage.before(volume, camera, (16, 16)), headlight=False)

    def made(by, sigma, color):
        function = TransferFunction(
            opacity=((0.0, 0.0), (0.5, 0.0), (0.5, 1.0 - np.exp(-sigma))), color=((0.0, *color),),
            opacity_unit_distance=1.0, shade=None,
        )  # fmt: skip
        return replace(plain, transfer_function=function, volume_matrix=moved(by))

    return made


def picture(scenes, **how):
    steps = several_steps(
        scenes, lambda scene, _: render_steps(scene, QUALITY, cache=None, refuse_empty_view=False), **how
    )
    return drain(steps)


def over(*layers):
    """RGBA of homogeneous layers from near to far: (optical depth, color)."""
    rgb, left = np.zeros(3), 1.0
    for depth, color in layers:
        rgb += left * (1.0 - np.exp(-depth)) * np.array(color)
        left *= np.exp(-depth)
    return np.array((*rgb, 1.0 - left))


def mixed(*matter):
    """Optical depth and color of (depth, color) in the same place."""
    whole = sum(depth for depth, _ in matter)
    return whole, sum(depth * np.array(color) for depth, color in matter) / whole


def test_two_boxes_that_overlap_have_the_light_of_the_paper(box):
    """Lengths along the ray: a box with its ramps is N units deep, which its truth says."""
    near, far = box((0, 0, 5), 0.06, RED), box((0, 0, 0), 0.1, BLUE)
    found = picture([near, far])
    middle = found.rgba[5:11, 5:11].reshape(-1, 4)
    # Each box is N - 1 units and a ramp of one unit at both ends, with half of its matter.
    fine = np.linspace(-2.0, N + 6.0, 20001)
    densities = [np.interp(fine - at, (-1.0, 0.0, N - 1.0, N), (0.0, s, s, 0.0)) for at, s in ((5, 0.06), (0, 0.1))]
    step = fine[1] - fine[0]
    layers = [
        mixed((a * step, RED), (b * step, BLUE)) for a, b in zip(*(one[::-1] for one in densities)) if a + b > 0.0
    ]
    np.testing.assert_allclose(middle, np.broadcast_to(over(*layers), middle.shape), atol=0.5 / 255.0)
    # On paper without the ramps: one box alone, both, the other alone.
    plain = over((0.06 * 5.0, RED), mixed((0.06 * 4.0, RED), (0.1 * 4.0, BLUE)), (0.1 * 5.0, BLUE))
    np.testing.assert_allclose(middle, np.broadcast_to(plain, middle.shape), atol=4.0 / 255.0)
    assert found.report["volumes"]["mixed"] and found.report["volumes"]["pictures"] == 8
    # Nearest first is another picture by far.
    laid = picture([near, far], most_spans=1)
    assert np.abs(laid.rgba - found.rgba)[5:11, 5:11].max() > 4.0 / 255.0
    assert any("drawn over one another" in remark for remark in laid.report["remarks"])


def test_volumes_are_mixed_in_bands_of_rows(box, monkeypatch):
    """So that no step of a viewport's picture is the mixture of all its pixels."""
    scenes = [box((0, -4, 0), 0.2, RED), box((0, 4, 3), 0.1, BLUE), box((0, 0, 20), 0.1, BLUE)]
    whole = picture(scenes)
    steps, bands = several_steps(scenes, lambda scene, _: render_steps(scene, QUALITY)), []
    monkeypatch.setattr(several, "BAND", 3 * 16)
    found = drain(steps, lambda step: bands.append(step.message == "Mixing volumes"))
    np.testing.assert_array_equal(found.rgba, whole.rgba)
    np.testing.assert_array_equal(found.depth, whole.depth)
    assert sum(bands) >= 2 * 16 // 3


def test_the_order_in_which_volumes_are_given_changes_nothing(box):
    scenes = [box((0, 0, 5), 0.3, RED), box((1, 0, 0), 0.2, BLUE), box((0, 2, 2), 0.25, (0.2, 0.9, 0.3))]
    first = picture(scenes, most_spans=4)
    for order in ((1, 0, 2), (2, 1, 0)):
        again = picture([scenes[n] for n in order], most_spans=4)
        np.testing.assert_allclose(again.rgba, first.rgba, atol=1e-6)
        np.testing.assert_array_equal(again.depth < NO_DEPTH, first.depth < NO_DEPTH)


def test_boxes_apart_are_laid_over_one_another_from_near_to_far(box):
    near, far = box((0, 0, 12), 0.1, RED), box((0, 0, 0), 0.2, BLUE)
    expected = over((0.1 * N, RED), (0.2 * N, BLUE))
    for scenes in ([near, far], [far, near]):
        found = picture(scenes)
        np.testing.assert_allclose(found.rgba[8, 8], expected, atol=0.5 / 255.0)
        assert found.report["volumes"] == {"count": 2, "pictures": 2, "mixed": False}
        # 40 - 20.5 is where the near box begins; 0.9 of its optical depth is above log 2.
        assert found.depth[8, 8] == pytest.approx(19.5 + np.log(2.0) / 0.1, abs=0.3)


def test_the_depth_of_a_mixture(box):
    near, far = box((0, 0, 5), 0.06, RED), box((0, 0, 0), 0.1, BLUE)
    found = picture([near, far])
    # 5 units of 0.06, then both: half is gone 2.46 units into the overlap, which begins at z = 8 and half a ramp.
    expected = 40.0 - (8.5 - (np.log(2.0) - 0.3) / 0.16)
    assert found.depth[8, 8] == pytest.approx(expected, abs=0.05)


def test_only_pixels_that_show_both_are_mixed(box):
    one, other = box((0, -4, 0), 0.2, RED), box((0, 4, 3), 0.1, BLUE)
    left, top, right, bottom = find_shared_pixels([one, other])
    assert (left, right) == (0, 16) and 0 < top < bottom < 16
    found = picture([one, other])
    assert found.report["volumes"]["mixed"]
    for scene, rows in zip((one, other), (slice(bottom, 16), slice(0, top))):
        alone = drain(render_steps(scene, QUALITY))
        np.testing.assert_array_equal(found.rgba[rows], alone.rgba[rows])
    far = box((0, -40, 0), 0.2, RED)
    assert find_shared_pixels([far, other]) is None


def test_one_of_two_volumes_is_the_picture_of_it_alone(box):
    alone, clear = box((0, 0, 0), 0.3, RED), box((0, 0, 4), 0.0, BLUE)
    found = picture([alone, clear])
    expected = drain(render_steps(alone, QUALITY))
    inside = slice(3, 13), slice(3, 13)  # at the box's sides each slab rings a little
    np.testing.assert_allclose(found.rgba[inside], expected.rgba[inside], atol=0.2 / 255.0)
    np.testing.assert_array_equal(picture([alone]).rgba, expected.rgba)


def test_a_volume_before_the_clip_distances_is_left_out(box):
    near, far = (
        replace(scene, camera=replace(scene.camera, clip_start=36.0))
        for scene in (box((0, 0, 5), 0.06, RED), box((0, 0, 0), 0.1, BLUE))
    )
    found = picture([near, far])
    expected = drain(render_steps(far, QUALITY))
    np.testing.assert_allclose(found.rgba, expected.rgba, atol=1e-6)
    assert found.rgba[..., 3].max() > 0.2 and found.report["volumes"]["count"] == 2


def test_overlapping_volumes_in_motion_are_laid_over_one_another(box):
    near, far = box((0, 0, 5), 0.3, RED), box((0, 0, 0), 0.2, BLUE)
    still = tuple(Pose(near.camera.matrix_world, near.volume_matrix) for _ in range(2))
    found = picture([replace(near, motion=still), far])
    assert "the nearest on top, because motion blur is on." in found.report["remarks"][-1]
    np.testing.assert_allclose(found.rgba[8, 8], over((0.3 * N, RED), (0.2 * N, BLUE)), atol=0.5 / 255.0)


def test_near_to_far(box):
    camera = box((0, 0, 0), 0.1, RED).camera
    boxes = [box_of(moved(by), (N, N, N)) for by in ((0, 0, 0), (0, 0, 30), (20, 0, 3), (0, 0, 15), (1, 1, 16))]
    groups = near_to_far(boxes, camera)
    assert sorted(n for group in groups for n in group) == [0, 1, 2, 3, 4] and [3, 4] in groups and [2] in groups
    assert groups.index([1]) < groups.index([3, 4]) < groups.index([0])
    groups = near_to_far(boxes, Camera(moved((4.0, 4.0, -90.0)) @ np.diag((1.0, -1.0, -1.0, 1.0)), type="PERSP"))
    assert groups.index([0]) < groups.index([3, 4]) < groups.index([1])


def test_boxes_that_hide_each_other_in_a_circle_are_one_group():
    """Three long bars, each over the next."""
    long, turn = np.diag((3.0, 0.3, 0.3, 1.0)), 2.0 * np.pi / 3.0
    bars = []
    for n in range(3):
        c, s = np.cos(n * turn), np.sin(n * turn)
        tilt = np.eye(4)
        tilt[:3, :3] = ((1, 0, 0), (0, 1, 0), (0.35, 0, 1))
        spin = np.array(((c, -s, 0, 0), (s, c, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))
        bars.append(box_of(spin @ moved((-12.0, -8.0, 0)) @ tilt @ long, (N, N, N)))
    camera = Camera(moved((0.0, 0.0, 90.0)), type="ORTHO", ortho_scale=8.0)
    assert near_to_far(bars, camera) == [[0, 1, 2]]
    assert sorted(near_to_far(bars[:2], camera)) == [[0], [1]]
