"""Proves what labels and channels show: slabs of known opacity in closed form, a hidden label that is as transparent
voxels are, and channels whose extinctions add up."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.planner.tolerance import render_within
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Channel, Labels, Light, Quality, RleSplatError
from rle_splat.volume.volume import Volume

N = 12
RED, GREEN, BLUE = (0.9, 0.1, 0.2), (0.2, 0.8, 0.1), (0.1, 0.3, 1.0)


def flat(alpha, color, unit=1.0, shade=None):
    """A transfer function of one opacity and color from the value 10 on."""
    return TransferFunction(
        opacity=((10.0, 0.0), (10.0, alpha)), color=((0.0, *color),), opacity_unit_distance=unit, shade=shade
    )


def random_voxels(seed, kind=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, (N, N + 1, N + 2)).astype(kind)


def seen_along_y(stage, voxels, tf, kind=np.uint8, size=(32, 32), **more):
    """A scene looked at along +y, x to the right and z up: a tent for each of the voxels of a column."""
    volume = Volume(np.ascontiguousarray(voxels, kind), np.eye(4))
    scene = stage.on_turntable(np.zeros(volume.voxels.shape), 0.0, 0.0, size=size, fit=1.2)
    return replace(scene, volume=volume, transfer_function=tf, **more)


def layers(*thicknesses):
    """(N, sum, N) labels 0, 1, 2...: layers along y."""
    return np.broadcast_to(
        np.repeat(np.arange(len(thicknesses)), thicknesses)[None, :, None], (N, sum(thicknesses), N)
    ).astype(np.int16)


def middle(picture):
    height, width = picture.shape[:2]
    return picture[height // 2 - 2 : height // 2 + 2, width // 2 - 2 : width // 2 + 2].reshape(-1, 4).mean(axis=0)


def composed(*parts):
    """RGBA of homogeneous (depth, color) parts, front to back."""
    transmittance, rgb = 1.0, np.zeros(3)
    for depth, color in parts:
        rgb += transmittance * -np.expm1(-depth) * np.array(color)
        transmittance *= np.exp(-depth)
    return np.array((*rgb, 1.0 - transmittance))


def depth_of(alpha, length):
    return -length * np.log1p(-alpha)


@pytest.mark.parametrize("kind", (np.uint8, np.float32))
def test_each_label_has_its_own_slab(stage, kind):
    """Three layers of one value: own transfer function, another one, none.  Between two layers extinction ramps over
    one voxel, half of which belongs to each."""
    labels = layers(5, 4, 3)
    functions = {1: flat(0.3, GREEN, 2.0), 2: None}
    scene = seen_along_y(
        stage, np.full(labels.shape, 100), flat(0.1, RED), kind,
        labels=Labels(Volume(labels, np.eye(4)), functions, smooth=False),
    )  # fmt: skip
    picture = stage.render(scene, depth_rule="midpoint-4")
    # In the ramp between the layers red and green are mixed: which comes first is off by that ramp's depth, squared.
    expected = composed((depth_of(0.1, 5), RED), (depth_of(0.3, 4) / 2.0, GREEN))
    np.testing.assert_allclose(middle(picture.rgba)[3], expected[3], atol=0.05 * LEVEL)
    np.testing.assert_allclose(middle(picture.rgba), expected, atol=1.0 * LEVEL)
    effect = next(effect for effect in picture.report["effects"] if effect["name"] == "labels")
    assert effect["on"] and effect["reason"] == "1 segment(s) with a transfer function, 1 hidden" and effect["ms"] > 0.0


@pytest.mark.parametrize("kind", (np.uint8, np.int16))
def test_hiding_a_label_is_rendering_with_its_voxels_transparent(stage, kind, way):
    voxels = random_voxels(1, kind)
    labels = random_voxels(2, np.int32) % 3
    tf = TransferFunction(
        opacity=((50.0, 0.0), (255.0, 0.4)), color=((0.0, *RED), (255.0, *BLUE)), opacity_unit_distance=1.0, shade=None
    )
    hidden = Labels(Volume(np.ascontiguousarray(labels), np.eye(4)), {2: None}, smooth=False)
    scene = seen_along_y(stage, voxels, tf, kind, labels=hidden)
    without = replace(scene, labels=None, volume=Volume(np.where(labels == 2, kind(0), voxels), np.eye(4)))
    one, other = (stage.render(each, classification="pre") for each in (scene, without))
    assert one.rgba.tobytes() == other.rgba.tobytes() and one.depth.tobytes() == other.depth.tobytes()
    assert one.report["volume"]["visible_voxels"] == other.report["volume"]["visible_voxels"]
    whole = stage.render(replace(scene, labels=None), classification="pre")
    assert np.abs(one.rgba - whole.rgba).max() > 20 * LEVEL


def test_two_channels_add_their_extinctions(stage):
    ones = np.full((N, 6, N), 100)
    tf, other = flat(0.15, RED), flat(0.2, BLUE, 3.0)
    channel = Channel(Volume(np.full(ones.shape, 40, np.uint16), np.eye(4)), other)
    scene = seen_along_y(stage, ones, tf, channels=(channel,))
    picture = stage.render(scene)
    red, blue = depth_of(0.15, 6), depth_of(0.2, 6) / 3.0
    color = (red * np.array(RED) + blue * np.array(BLUE)) / (red + blue)
    np.testing.assert_allclose(middle(picture.rgba), composed((red + blue, color)), atol=0.05 * LEVEL)
    # The other way round it is the same medium.
    swapped = replace(scene, volume=channel.volume, transfer_function=other, channels=(Channel(scene.volume, tf),))
    np.testing.assert_allclose(stage.render(swapped).rgba, picture.rgba, atol=1e-6)
    # In the opacity model too: alphas of what is added, per the first function's distance.
    paper = render(scene, Quality.paper()).rgba
    alpha = -np.expm1(-(red + blue) / 6)
    np.testing.assert_allclose(middle(paper)[3], 1.0 - (1.0 - alpha) ** 6, atol=0.5 * LEVEL)


@pytest.mark.parametrize("shade", (None, Shade(0.2, 0.7, 0.3, 15.0)), ids=("unlit", "lit"))
@pytest.mark.parametrize("kind", (np.uint8, np.float32))
def test_a_channel_without_anything_in_it_changes_no_bit(stage, kind, shade):
    voxels = random_voxels(3, kind)
    tf = TransferFunction(
        opacity=((50.0, 0.0), (255.0, 0.4)), color=((0.0, *RED), (255.0, *BLUE)), opacity_unit_distance=1.0,
        shade=shade,
    )  # fmt: skip
    scene = seen_along_y(stage, voxels, tf, kind, lights=(Light(),))
    empty = Volume(np.zeros(voxels.shape, np.uint8), np.eye(4))
    alone = stage.render(scene, classification="pre")
    for channel in (Channel(empty, tf), Channel(empty, flat(0.0, RED))):
        with_it = stage.render(replace(scene, channels=(channel,)), classification="pre")
        assert with_it.rgba.tobytes() == alone.rgba.tobytes()
    assert not any(e["on"] for e in with_it.report["effects"] if e["name"] == "channels"), "an opacity of zero"


@pytest.mark.parametrize("classification", ("post", "pre"))
def test_labels_leave_the_classification(stage, classification):
    labels = Labels(Volume(layers(5, 7), np.eye(4)), {1: flat(0.2, BLUE)})
    scene = seen_along_y(stage, np.full((N, N, N), 100), flat(0.1, RED), labels=labels)
    picture = render(scene, Quality(classification=classification))
    assert picture.report["plan"]["classification"] == classification and not picture.report["remarks"]
    by_hand = render(scene, Quality(depth_rule="preintegrated-2", rays=0.4, name="custom"))
    assert by_hand.report["plan"]["depth_rule"] == "preintegrated-2" and by_hand.report["rays"]["pixels"] > 0
    off = render(replace(scene, effects={"labels": False}), Quality(classification=classification))
    never = render(replace(scene, labels=None), Quality(classification=classification))
    assert off.rgba.tobytes() == never.rgba.tobytes() and off.report["plan"]["classification"] == classification
    assert off.report["stages_ms"]["mixing"] == 0.0


@pytest.mark.parametrize(("mode", "stands"), [("mip", 0), ("average", 0), ("xray", 0), ("minip", 255)])
@pytest.mark.parametrize("slope", (1.0, -1.0))
@pytest.mark.parametrize("smooth", (True, False))
def test_modes_of_values_leave_hidden_voxels_out(stage, mode, stands, slope, smooth):
    """A picture is that of a volume whose hidden voxels hold what decides no pixel, and no other function is used."""
    labels = random_voxels(2, np.int32)[:N, :N, :N] // 128  # half of the voxels are hidden
    labels[:3] = 1  # and a part of the picture
    voxels = random_voxels(4)[:N, :N, :N]
    voxels.flat[:2] = 0, 255
    window = TransferFunction(opacity=((0.0, 0.0), (255.0, 0.5)), color=((0.0, *RED),), shade=None)
    hidden = Labels(Volume(labels, np.eye(4)), {1: None, 0: flat(0.2, BLUE)}, smooth=smooth)
    scene = seen_along_y(stage, voxels, window, labels=hidden, mode=mode)

    def stored(values):
        values, intercept = (values, 0.0) if slope > 0.0 else (255 - values, 255.0)
        return Volume(values, np.eye(4), slope=slope, intercept=intercept)

    picture = stage.render(replace(scene, volume=stored(voxels)))
    masked = stored(np.where(labels == 1, np.uint8(stands), voxels))
    expected = stage.render(replace(scene, volume=masked, labels=None)).rgba
    whole = stage.render(replace(scene, volume=stored(voxels), labels=None)).rgba
    outside, inside = slice(24, None), slice(None, 18)  # rows behind which everything is hidden, and the others
    assert picture.rgba[outside].max() < 0.2 * LEVEL and whole[outside].max() > 0.2
    np.testing.assert_allclose(picture.rgba[inside], expected[inside], atol=1e-6)
    assert np.abs(expected[inside] - whole[inside]).max() > 10 * LEVEL
    effect = next(effect for effect in picture.report["effects"] if effect["name"] == "labels")
    assert effect["on"] and effect["reason"] == f"1 hidden; the mode {mode} uses one transfer function"


def test_modes_of_values_use_no_function_of_a_label(stage):
    labels = Labels(Volume(layers(5, 7), np.eye(4)), {1: flat(0.3, BLUE)})
    scene = seen_along_y(stage, random_voxels(4)[:N, :N, :N], flat(0.1, RED), labels=labels, mode="mip")
    picture = render(scene, Quality())
    assert picture.rgba.tobytes() == render(replace(scene, labels=None), Quality()).rgba.tobytes()
    assert not next(effect for effect in picture.report["effects"] if effect["name"] == "labels")["on"]


def test_nothing_is_redone_when_the_camera_moves(stage):
    from rle_splat.pipeline.stage_cache import StageCache

    labels = Labels(Volume(layers(5, 7), np.eye(4)), {1: flat(0.3, BLUE)})
    scene = seen_along_y(stage, np.full((N, N, N), 100), flat(0.1, RED), labels=labels)
    cache = StageCache()
    render(scene, Quality(), cache=cache)
    made = dict(cache.made)
    camera = replace(scene.camera, ortho_scale=2.0 * scene.camera.ortho_scale)
    moved = render(replace(scene, camera=camera), Quality(), cache=cache)
    assert cache.made == made
    changed = replace(labels, functions={1: flat(0.3, GREEN)})
    other = render(replace(scene, camera=camera, labels=changed), Quality(), cache=cache)
    assert np.abs(other.rgba - moved.rgba).max() > 10 * LEVEL, "another color is another picture"


def test_what_does_not_fit_is_refused_in_a_sentence(stage):
    scene = seen_along_y(stage, np.full((N, N, N), 100), flat(0.1, RED))
    labels = Volume(layers(5, 6), np.eye(4))
    with pytest.raises(RleSplatError, match="label volume has 12 x 11 x 12 voxels and the volume has 12 x 12 x 12"):
        replace(scene, labels=Labels(labels))
    with pytest.raises(RleSplatError, match="The channel has"):
        replace(scene, channels=(Channel(labels, flat(0.1, RED)),))
    with pytest.raises(RleSplatError, match="whole numbers, not float32"):
        Labels(Volume(np.zeros((2, 2, 2), np.float32), np.eye(4)))
    with pytest.raises(RleSplatError, match="'liver'"):
        Labels(labels, {"liver": None})
    with pytest.raises(RleSplatError, match="choose a quality"):
        render_within(replace(scene, labels=Labels(Volume(layers(5, 7), np.eye(4)), {1: None})), 1.0)
