"""What a lens and a shutter blur: against the thin lens's formula, how far things move, and means of sharp pictures."""

import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects.analyze import analyze
from rle_splat.effects.exposure import list_exposures
from rle_splat.effects.lens import MOST_POINTS, blur_pixels, lens_pictures, lens_points, through_lens
from rle_splat.effects.motion import MOST_PICTURES, at_time, distance_moved, motion_pictures
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import NO_DEPTH, Camera, Pose, Quality, RleSplatError, Scene
from rle_splat.view.eye import index_view
from rle_splat.view.projection import world_to_pixel
from rle_splat.volume.volume import Volume

SIZE = 128


def speck(depth, **lens):
    """A soft blot of a medium at ``depth`` before the camera, seen through a lens that is focused at 4."""
    position = np.arange(-6.0, 7.0)
    square = position**2 + (position**2)[:, None] + (position**2)[:, None, None]
    volume = Volume(np.rint(255.0 * np.exp(-0.25 * square)).astype(np.uint8), np.diag((0.02, 0.02, 0.02, 1.0)))
    placed = np.eye(4)
    placed[:3, 3] = (-0.12, -0.12, -depth - 0.12)
    function = TransferFunction("speck", None, [(0, 0), (255, 0.05)], [(0, 1, 1, 1), (255, 1, 1, 1)], None, None)
    camera = Camera(lens=50.0, clip_start=0.01, **{"focus_distance": 4.0, "aperture_radius": 0.1, **lens})
    return Scene(volume, function, camera, SIZE, SIZE, placed, headlight=False)


def pinhole(scene):
    return replace(scene, camera=replace(scene.camera, aperture_radius=0.0))


def spread(alpha):
    """Mean square distance from the middle of a blot, pixels squared, across and down; and its sum."""
    alpha = alpha.astype(np.float64)
    row, column = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    total = alpha.sum()
    return [((at - (alpha * at).sum() / total) ** 2 * alpha).sum() / total for at in (column, row)], total


def check_disk(scene, depth, expected):
    """The speck is blurred to a disk of diameter ``expected``, pixels."""
    blurred, total = spread(render(scene, Quality()).rgba[..., 3])
    sharp, sharp_total = spread(render(pinhole(scene)).rgba[..., 3])
    # A disk of diameter d has a mean square of d^2/16 along any axis; blurs add theirs.
    found = 4.0 * np.sqrt(np.array(blurred) - np.array(sharp))
    assert found == pytest.approx(np.full(2, expected), rel=0.06)
    assert total == pytest.approx(sharp_total, rel=0.03), "a lens takes no light away"
    assert blur_pixels(scene.camera, SIZE, SIZE, depth) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("depth", [2.5, 3.0, 6.0])
def test_a_speck_is_blurred_to_the_disk_of_the_thin_lens(depth):
    scene = speck(depth)
    # Object distance z, focus f, aperture diameter 2R, picture scale per unit depth S: S 2R |z - f| / (z f).
    check_disk(scene, depth, SIZE * 50.0 / 36.0 * 0.2 * abs(depth - 4.0) / (depth * 4.0))


@pytest.mark.parametrize("depth", [2.5, 3.0, 6.0])
def test_an_orthographic_camera_blurs_by_the_distance_from_the_focus_alone(depth):
    scene = speck(depth, type="ORTHO", ortho_scale=2.5)
    # A cone of rays of radius R at the camera whose tip is in focus: 2R |z - f| / f across, of SIZE pixels for 2.5.
    check_disk(scene, depth, SIZE / 2.5 * 0.2 * abs(depth - 4.0) / 4.0)


def test_slanted_rays_move_what_is_out_of_focus_and_keep_its_depth():
    """To the side by slant times the distance from the focus; the nearer end to the other side than the further."""
    for depth in (3.0, 6.0):
        scene = speck(depth, type="ORTHO", ortho_scale=2.5, aperture_radius=0.0)
        slanted = replace(scene, camera=replace(scene.camera, slant=(0.2, -0.1)))
        pictures = [render(one) for one in (scene, slanted)]
        row, column = np.mgrid[:SIZE, :SIZE]
        middles = [
            np.array([(picture.rgba[..., 3] * at).sum() for at in (column, row)]) / picture.rgba[..., 3].sum()
            for picture in pictures
        ]
        # What rays that go to the right as they go ahead meet behind the focus, they show further to the left.
        expected = SIZE / 2.5 * (depth - 4.0) * np.array((-0.2, -0.1))
        assert middles[1] - middles[0] == pytest.approx(expected, abs=0.05)
        one, two = (
            view.depth[:3] @ np.full(3, 6.0) + view.depth[3]
            for view in (index_view(s.camera, s.index_to_world, SIZE, SIZE) for s in (scene, slanted))
        )
        assert one == two == pytest.approx(depth)


def test_what_lies_in_the_plane_of_focus_is_sharp():
    scene = speck(4.0)
    assert lens_pictures(scene) == 1
    forced = replace(scene, camera=replace(scene.camera, aperture_radius=2.0))
    assert lens_pictures(forced) > 1
    (across, down), _ = spread(render(forced).rgba[..., 3])
    (sharp_across, sharp_down), _ = spread(render(pinhole(scene)).rgba[..., 3])
    assert (across, down) == (pytest.approx(sharp_across, abs=0.15), pytest.approx(sharp_down, abs=0.15))


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("point", [(1.0, 0.0), (-0.3, 0.8)])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_every_point_of_the_lens_sees_the_plane_of_focus_at_the_same_pixels(fit, point, kind):
    turned = np.eye(4)
    turned[:3, :3] = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]
    turned[:3, 3] = (1.0, -2.0, 3.0)
    camera = Camera(
        turned, kind, lens=35.0, sensor_fit=fit, shift_x=0.2, shift_y=-0.1, pixel_aspect=(1.0, 1.5),
        focus_distance=7.0, aperture_radius=0.4, ortho_scale=6.0,
    )  # fmt: skip
    random = np.random.default_rng(1)
    points = np.c_[random.uniform(-2.0, 2.0, (20, 2)), np.full(20, -7.0), np.ones(20)] @ turned.T
    other = np.c_[random.uniform(-2.0, 2.0, (20, 2)), np.full(20, -4.0), np.ones(20)] @ turned.T

    def pixels(of, positions):
        seen = positions @ world_to_pixel(of, 160, 90).T
        return seen[:, :2] / seen[:, 2:]

    moved = through_lens(camera, point)
    assert np.abs(pixels(moved, points) - pixels(camera, points)).max() < 1e-9
    assert np.abs(pixels(moved, other) - pixels(camera, other)).max() > 1.0


@pytest.mark.parametrize("blades", [0, 3, 6])
def test_points_fill_the_aperture_evenly(blades):
    """Second moments of a disk (1/4) and of a regular polygon of corners at 1: (2 + cos(2 pi / n)) / 12."""
    along = 0.25 if not blades else (2.0 + np.cos(2.0 * np.pi / blades)) / 12.0
    for count in (4, 9, 4000):
        points = lens_points(count, blades)
        assert np.cov(points.T, bias=True) == pytest.approx(along * np.eye(2), abs=1e-12)
        assert np.abs(points.mean(axis=0)).max() < 1e-12
    quarters = np.histogram(np.arctan2(*points.T), bins=4)[0]
    if blades != 3:  # equal by symmetry
        assert quarters == pytest.approx(np.full(4, 1000), rel=0.02)
    if blades:
        inner = np.cos(np.pi / blades)
        normals = (2.0 * np.arange(blades) + 1.0) * np.pi / blades
        assert (points @ np.stack((np.cos(normals), np.sin(normals)))).max() < inner + 0.01


def test_rotation_and_ratio_shape_the_aperture():
    plain, turned = lens_points(200, 5), lens_points(200, 5, rotation=0.3)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    assert turned == pytest.approx(plain @ turn.T, abs=1e-12)
    assert lens_points(200, 0, ratio=2.0) == pytest.approx(lens_points(200) * (0.5, 1.0), abs=1e-12)


def test_a_camera_without_a_lens_makes_one_picture_and_the_same_bits():
    scene = speck(3.0, aperture_radius=0.0)
    focused = replace(scene, camera=replace(scene.camera, focus_distance=1.0))
    assert list_exposures(scene) == [scene]
    assert np.array_equal(render(scene).rgba, render(focused).rgba)


@pytest.mark.parametrize(("more", "on", "words"), [
    ({}, True, "blurs up to 3.5 pixels"), ({"aperture_radius": 0.0}, False, "the camera has no depth of field"),
    ({"type": "ORTHO", "ortho_scale": 2.0}, True, "blurs up to 3."),
    ({"aperture_radius": 0.001}, False, "nothing is blurred"),
])  # fmt: skip
def test_depth_of_field_says_why(more, on, words):
    scene = speck(3.0)
    effect = analyze(replace(scene, camera=replace(scene.camera, **more)), Quality())["depth of field"]
    assert effect.on == on and words in effect.reason


def test_depth_of_field_turned_off_by_hand_is_the_sharp_picture():
    scene = speck(3.0)
    by_hand = render(replace(scene, effects={"depth of field": False}))
    assert np.array_equal(by_hand.rgba, render(pinhole(scene)).rgba)
    assert "by hand" in next(row["reason"] for row in by_hand.report["effects"] if row["name"] == "depth of field")


def test_the_price_of_a_blur_is_that_of_its_further_pictures():
    def row(report, name):
        return next(row for row in report["effects"] if row["name"] == name)

    blurred, sharp = render(speck(3.0)).report, render(pinhole(speck(3.0))).report
    assert 0.0 < row(blurred, "depth of field")["ms"] < blurred["stages_ms"]["total"]
    assert row(sharp, "depth of field")["ms"] == 0.0
    both = replace(moving(0.5, depth=3.0), camera=speck(3.0).camera)
    report = render(both).report
    assert row(report, "motion blur")["on"] and row(report, "motion blur")["ms"] > 0.0
    assert row(report, "depth of field")["on"] and not row(report, "depth of field")["ms"]


def test_wide_blurs_take_no_more_pictures_than_there_are_points():
    assert lens_pictures(speck(1.0, aperture_radius=50.0)) == MOST_POINTS


@pytest.mark.parametrize("wrong", [
    {"aperture_radius": -1.0}, {"aperture_radius": np.nan}, {"focus_distance": 0.0}, {"aperture_ratio": 0.0},
    {"aperture_blades": 2.5}, {"aperture_blades": -1}, {"aperture_rotation": np.inf}, {"aperture_radius": 1.0},
])  # fmt: skip
def test_a_lens_that_is_none_is_refused_in_a_sentence(wrong):
    (name,) = wrong
    with pytest.raises(RleSplatError, match=name):
        Camera(**wrong)


def moving(dx, poses=2, depth=4.0):
    """The speck moving ``dx`` to the right while the shutter is open."""
    scene = speck(depth, aperture_radius=0.0)
    placed = []
    for time in np.linspace(0.0, 1.0, poses):
        matrix = np.array(scene.volume_matrix)
        matrix[0, 3] += dx * (time - 0.5)
        placed.append(Pose(scene.camera.matrix_world, matrix))
    return replace(scene, motion=tuple(placed))


@pytest.mark.parametrize("poses", [2, 5])
def test_a_speck_is_drawn_out_along_its_way(poses):
    scene = moving(0.5, poses)
    pixels = 0.5 / 4.0 * SIZE * 50.0 / 36.0
    assert distance_moved(scene) == pytest.approx(pixels * 4.0 / 3.88, rel=1e-6)  # the box's nearer face
    (across, down), total = spread(render(scene).rgba[..., 3])
    (sharp_across, sharp_down), sharp_total = spread(render(replace(scene, motion=())).rgba[..., 3])
    # A line of length l has a mean square of l^2 / 12.
    assert np.sqrt(12.0 * (across - sharp_across)) == pytest.approx(pixels, rel=0.03)
    assert down == pytest.approx(sharp_down, abs=0.05) and total == pytest.approx(sharp_total, rel=0.02)


def test_a_moving_camera_blurs_as_a_volume_that_moves_the_other_way():
    volume_moves = moving(0.4)
    still = volume_moves.volume_matrix
    poses = []
    for pose in volume_moves.motion:
        matrix = np.array(volume_moves.camera.matrix_world)
        matrix[0, 3] -= pose.volume_matrix[0, 3] - still[0, 3]
        poses.append(Pose(matrix, still))
    camera_moves = replace(volume_moves, motion=tuple(poses))
    difference = np.abs(render(volume_moves).rgba - render(camera_moves).rgba)
    assert difference.max() < 0.5 / 255.0


def test_the_picture_is_the_mean_of_still_ones():
    scene = moving(0.3)
    stills = [render(one).rgba.astype(np.float64) for one in list_exposures(scene)]
    assert len(stills) == motion_pictures(scene) > 4
    assert np.abs(render(scene).rgba - np.mean(stills, axis=0)).max() < 1e-6


@pytest.mark.parametrize("blurred", [speck(3.0), moving(0.3)], ids=["depth of field", "motion blur"])
def test_depth_is_that_of_the_scene_as_it_stands(blurred):
    dense = replace(blurred.transfer_function, opacity=((0, 0), (255, 1.0)))
    blurred = replace(blurred, transfer_function=dense)
    still = render(pinhole(replace(blurred, motion=())))
    assert np.array_equal(render(blurred).depth, still.depth) and (still.depth < NO_DEPTH).any()


def test_times_are_spread_evenly_over_the_shutter():
    positions = sorted(one.volume_matrix[0, 3] for one in list_exposures(moving(0.5)))
    steps = np.diff(positions)
    assert steps == pytest.approx(np.full(len(steps), 0.5 / len(positions)), rel=1e-9)


def test_poses_are_followed_in_turn():
    scene = moving(0.4, poses=5)
    for time, x in ((0.0, -0.2), (0.1, -0.16), (0.5, 0.0), (1.0, 0.2)):
        assert at_time(scene, time).volume_matrix[0, 3] == pytest.approx(scene.volume_matrix[0, 3] + x, abs=1e-12)


def test_what_stands_still_is_one_picture_of_the_same_bits():
    scene = moving(0.0)
    assert motion_pictures(scene) == 1
    assert np.array_equal(render(scene).rgba, render(replace(scene, motion=())).rgba)


def test_lens_and_shutter_share_their_pictures():
    both = moving(0.2, depth=3.0)
    both = replace(both, camera=replace(both.camera, aperture_radius=0.1))
    assert len(list_exposures(both)) == max(motion_pictures(both), len(list_exposures(replace(both, motion=()))))
    lens_alone, _ = spread(render(replace(both, motion=())).rgba[..., 3])
    shutter_alone, _ = spread(render(pinhole(both)).rgba[..., 3])
    sharp, _ = spread(render(replace(pinhole(both), motion=())).rgba[..., 3])
    together, _ = spread(render(both).rgba[..., 3])
    expected = np.array(lens_alone) + np.array(shutter_alone) - np.array(sharp)  # independent blurs add
    assert np.array(together) == pytest.approx(expected, rel=0.08)


def test_a_long_way_takes_no_more_pictures_than_the_most():
    assert motion_pictures(moving(100.0)) == MOST_PICTURES


@pytest.mark.parametrize("blurred", [speck(3.0), moving(0.3)], ids=["depth of field", "motion blur"])
@pytest.mark.parametrize("classification", ["pre", "post"])
def test_what_all_pictures_of_a_blur_have_in_common_is_made_once(blurred, classification, monkeypatch):
    """Where whoever calls passes no stage cache, as the command line."""
    stores, quality = [], Quality(classification=classification)

    class Noted(StageCache):
        def __init__(self, *room):
            super().__init__(*room)
            stores.append(self)

    monkeypatch.setattr(sys.modules["rle_splat.pipeline.render"], "StageCache", Noted)
    found = render(blurred, quality)
    made = sum((Counter(store.made) for store in stores), Counter())
    assert len(list_exposures(blurred)) > 4 and {"pre": "visible", "post": "scalars"}[classification] in made
    assert set(made.values()) == {1}, made
    given = StageCache(0)
    again = render(blurred, quality, cache=given)
    assert np.array_equal(found.rgba, again.rgba) and max(given.made.values()) == len(list_exposures(blurred)) + 1
    stores.clear()
    render(pinhole(replace(blurred, motion=())), quality)
    assert [store.keeps for store in stores] == [False], "a single picture keeps nothing"


def test_a_single_pose_is_refused():
    scene = moving(0.1)
    with pytest.raises(RleSplatError, match="at least two"):
        replace(scene, motion=scene.motion[:1])
