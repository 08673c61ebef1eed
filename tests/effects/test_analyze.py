"""Which effects a scene calls for and why, what overrides do, and that an effect that is off leaves no trace."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import effects as prices
from benchmarks.scenes import shells
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.effects.analyze import EFFECTS, analyze, analyze_effects
from rle_splat.pipeline.encode_scene import encode
from rle_splat.pipeline.render import render
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

CLASSIFICATIONS = ("pre", "post")
SIZE = 32
Z, Y, X = np.mgrid[:14, :15, :16] - 7.0
VOLUME = Volume((90.0 - 12.0 * np.sqrt(X**2 + Y**2 + Z**2)).astype(np.float32), np.eye(4))
FUNCTION = TransferFunction(
    opacity=((0.0, 0.0), (40.0, 0.5)), color=((0.0, 0.9, 0.4, 0.2), (90.0, 0.3, 0.6, 0.9)),
    shade=Shade(0.3, 0.6, 0.4, 30.0),
)  # fmt: skip
SUN = Light(type="SUN", energy=2.0, color=(1.0, 0.8, 0.6))
BEFORE = np.array((((-20.0, 6.0, -20.0), (8.0, 6.0, -20.0), (8.0, 6.0, 40.0)),))
BEHIND = BEFORE + (0.0, 200.0, 0.0)


def scene_of(**more) -> Scene:
    camera, matrix = turntable(VOLUME, 25.0, 15.0, 1.2, True, 40.0)
    return Scene(**{
        "volume": VOLUME, "transfer_function": FUNCTION, "camera": camera, "width": SIZE, "height": SIZE,
        "volume_matrix": matrix, **more,
    })  # fmt: skip


def unshaded() -> TransferFunction:
    return replace(FUNCTION, shade=None)


def near_plane(scene) -> Scene:
    """The clip distance moved to the middle of the volume."""
    middle = np.linalg.inv(scene.camera.matrix_world) @ scene.index_to_world @ (7.5, 7.0, 6.5, 1.0)
    return replace(scene, camera=replace(scene.camera, clip_start=float(-middle[2])))


def told(scene, name, classification="post"):
    effect = analyze(scene, Quality(classification=classification))[name]
    return effect.on, effect.reason


@pytest.mark.parametrize(
    ("more", "name", "on", "reason"),
    [
        ({}, "shading", True, "diffuse 0.6 and ambient 0.3 under a headlight"),
        ({"lights": (SUN, SUN)}, "shading", True, "diffuse 0.6 and ambient 0.3 under 2 light(s) of the scene"),
        ({"headlight": False}, "shading", False, "the scene has no light"),
        ({"transfer_function": unshaded()}, "shading", False, "the transfer function has no shading"),
        ({}, "lights", False, "the scene has no lights"),
        ({"lights": (SUN, SUN, Light(type="POINT"))}, "lights", True, "2 sun, 1 point"),
        ({"lights": (SUN,), "transfer_function": unshaded()}, "lights", False, "nothing is shaded"),
        ({}, "headlight", True, "white and parallel, along the camera's axis"),
        ({"headlight": False}, "headlight", False, "the scene has no headlight"),
        ({"transfer_function": unshaded()}, "headlight", False, "nothing is shaded"),
        ({}, "specular", True, "specular 0.4, shininess 30"),
        ({"transfer_function": replace(FUNCTION, shade=Shade(0.3, 0.6, 0.0, 30.0))}, "specular", False, "specular 0"),
        ({"headlight": False}, "specular", False, "nothing is shaded"),
        ({}, "mesh occlusion", False, "the scene has no meshes"),
        ({"triangles": BEFORE}, "mesh occlusion", True, "meshes are in or in front of the volume"),
        ({"triangles": BEHIND}, "mesh occlusion", False, "no mesh is in or in front of the volume"),
        ({}, "clipping", False, "no clip plane of the camera cuts the volume"),
    ],
)  # fmt: skip
def test_each_effect_is_on_or_off_for_a_reason(more, name, on, reason):
    was_on, why = told(scene_of(**more), name)
    assert was_on == on and why.startswith(reason)


def test_a_clip_plane_in_the_volume_is_an_effect():
    assert told(near_plane(scene_of()), "clipping") == (True, "a clip plane of the camera cuts the volume")


def test_the_report_lists_the_table_in_its_order_and_prices_only_what_is_on():
    listed = render(scene_of(lights=(SUN,), headlight=False, triangles=BEFORE)).report["effects"]
    assert [effect["name"] for effect in listed] == list(EFFECTS)
    by_name = {effect["name"]: effect for effect in listed}
    assert by_name["shading"]["ms"] > 0.0 and by_name["mesh occlusion"]["ms"] > 0.0
    assert by_name["specular"]["ms"] is None and by_name["lights"]["ms"] is None  # within the shading
    assert [e["ms"] for e in listed if not e["on"]] == [0.0] * sum(not e["on"] for e in listed)
    assert not by_name["headlight"]["on"] and not by_name["clipping"]["on"]


def test_a_mesh_that_no_ray_meets_is_found_off_with_what_it_took_to_look():
    aside = BEFORE + (500.0, 0.0, 0.0)
    entry = next(e for e in render(scene_of(triangles=aside)).report["effects"] if e["name"] == "mesh occlusion")
    assert not entry["on"] and entry["reason"] == "no mesh is in or in front of the volume" and entry["ms"] > 0.0


# What has an effect, and what has never heard of it.
PAIRS = {
    "shading": (scene_of(), scene_of(transfer_function=unshaded())),
    "lights": (scene_of(lights=(SUN,)), scene_of()),
    "headlight": (scene_of(lights=(SUN,)), scene_of(lights=(SUN,), headlight=False)),
    "specular": (scene_of(), scene_of(transfer_function=replace(FUNCTION, shade=Shade(0.3, 0.6, 0.0, 30.0)))),
    "mesh occlusion": (scene_of(triangles=BEFORE), scene_of()),
    "clipping": (near_plane(scene_of()), scene_of()),
}

PRICED = [label for label, price in prices.PRICES.items() if price.effect not in PAIRS]  # modes and two clips, too


@pytest.mark.parametrize(
    ("name", "classification", "way"),
    (*((name, one, "numba") for name in PAIRS for one in CLASSIFICATIONS),
     *((name, CLASSIFICATIONS[number % 2], "numpy") for number, name in enumerate(PAIRS))),
    indirect=["way"],
)  # fmt: skip
def test_an_effect_forced_off_leaves_the_picture_of_a_scene_without_it(name, classification, way):
    quality = Quality(classification=classification)
    having, without = PAIRS[name]
    forced = render(replace(having, effects={name: False}), quality)
    plain = render(without, quality)
    np.testing.assert_array_equal(forced.rgba.view(np.uint32), plain.rgba.view(np.uint32))
    np.testing.assert_array_equal(forced.depth.view(np.uint32), plain.depth.view(np.uint32))
    entry = next(e for e in forced.report["effects"] if e["name"] == name)
    assert entry == {"name": name, "on": False, "reason": "by hand", "ms": 0.0}
    assert np.abs(render(having, quality).rgba - forced.rgba).max() > 0.01  # the effect does show


def blurred(scene) -> Scene:
    """The scene with its lens opened, so that a small picture shows it."""
    return replace(scene, camera=replace(scene.camera, aperture_radius=6.0 * scene.camera.aperture_radius))


@pytest.mark.slow
@pytest.mark.parametrize("classification", CLASSIFICATIONS)
@pytest.mark.parametrize("label", PRICED)
def test_so_do_the_others_forced_off(label, classification):
    """In the benchmarks' scenes."""
    quality, price = Quality(classification=classification), prices.PRICES[label]
    base = prices.Setting("shells", *shells(24), True, ()).at(prices.AZIMUTH, 24)
    having, without = prices.given(base, label), base if price.over is None else prices.given(base, price.over)
    having = blurred(having) if label == "depth of field" else having
    forced = render(replace(having, effects={price.effect: False}), quality)
    shown, plain = render(having, quality), render(without, quality)
    np.testing.assert_array_equal(forced.rgba.view(np.uint32), plain.rgba.view(np.uint32))
    entry = next(e for e in forced.report["effects"] if e["name"] == price.effect)
    assert entry == {"name": price.effect, "on": False, "reason": "by hand", "ms": 0.0}
    shows = np.abs(shown.rgba - forced.rgba).max() > 0.003
    assert shows == (price.effect != "indirect light" or classification == "post")  # pre has no indirect light


def test_every_effect_of_the_table_is_forced_off():
    assert {*PAIRS, *(prices.PRICES[label].effect for label in PRICED)} == set(EFFECTS)


@pytest.mark.parametrize("classification", CLASSIFICATIONS)
def test_forcing_on_what_is_on_changes_no_bit(classification):
    quality = Quality(classification=classification)
    scene = near_plane(scene_of(lights=(SUN,), triangles=BEFORE))
    on = replace(scene, effects=dict.fromkeys(("shading", "lights", "headlight", "specular", "mesh occlusion"), True))
    assert np.array_equal(render(on, quality).rgba.view(np.uint32), render(scene, quality).rgba.view(np.uint32))
    assert told(on, "specular") == (True, "by hand: specular 0.4, shininess 30")


def test_forcing_on_what_the_scene_lacks_takes_a_stated_default():
    dark = scene_of(transfer_function=unshaded(), headlight=False)
    assert told(replace(dark, effects={"shading": True}), "shading") == (
        True, "by hand: diffuse 0.75 and ambient 0.25 under a headlight",
    )  # fmt: skip
    usual = scene_of(transfer_function=replace(FUNCTION, shade=Shade()))
    forced = replace(dark, effects={"shading": True})
    assert np.array_equal(render(forced).rgba.view(np.uint32), render(usual).rgba.view(np.uint32))
    matt = scene_of(transfer_function=replace(FUNCTION, shade=Shade(0.3, 0.6, 0.0, 30.0)), effects={"specular": True})
    assert told(matt, "specular") == (True, "by hand: specular 0.2, shininess 30")
    assert told(scene_of(effects={"clipping": True}), "clipping")[0]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"effects": {"mesh occlusion": True}}, "mesh occlusion is turned on by hand, but the scene has no meshes"),
        ({"effects": {"lights": True}}, "lights is turned on by hand, but the scene has no lights"),
        ({"effects": {"glitter": True}}, "There is no effect called 'glitter'; choose mode, gradient opacity"),
        ({"effects": {"shading": False, "specular": True}}, "specular is turned on by hand, but nothing is shaded"),
    ],
)
def test_what_cannot_be_forced_is_refused_in_one_sentence(more, sentence):
    with pytest.raises(RleSplatError, match=sentence.replace("(", r"\\(")):
        render(scene_of(**more))


def test_what_the_scene_was_made_without_has_the_reason_that_it_was_given():
    reasons = {"motion blur": "the camera depends on a driver", "shading": "never said of what is on"}
    given, plain = scene_of(reasons_off=reasons), scene_of()
    for quality in (Quality(), Quality.preset("fine", classification="post")):
        effects = analyze(given, quality)
        assert (effects["motion blur"].on, effects["motion blur"].reason) == (False, reasons["motion blur"])
        assert effects["shading"] == analyze(plain, quality)["shading"] and effects["shading"].on
        found, still = render(given, quality), render(plain, quality)
        assert np.array_equal(found.rgba, still.rgba) and found.report["rays"] == still.report["rays"]
    with pytest.raises(RleSplatError, match="motion blur is turned on by hand, but the camera depends on a driver"):
        analyze(replace(given, effects={"motion blur": True}), Quality())


def test_effects_are_forced_by_true_or_false_alone():
    with pytest.raises(RleSplatError, match=r"true \(on\) or false \(off\)"):
        scene_of(effects={"shading": "on"})


def test_what_is_left_has_lost_what_is_off_and_is_left_alone_the_second_time():
    scene = scene_of(lights=(SUN,), triangles=BEHIND, transfer_function=unshaded())
    left = analyze_effects(scene, Quality())[1]
    assert left.lights == () and left.triangles is None and not left.headlight
    again = analyze_effects(left, Quality())[1]
    assert analyze(again, Quality()).on == analyze(scene, Quality()).on == ()


def test_a_rle_file_says_that_its_light_is_baked():
    scene = scene_of()
    stored = replace(scene, volume=encode(scene), headlight=False)
    assert told(stored, "shading", "pre") == told(stored, "specular", "pre") == (False, "baked into the .rle file")
    encoded = encode(replace(scene, effects={"shading": False}))
    plain = render(replace(scene, transfer_function=unshaded()), Quality(classification="pre"))
    from_file = render(replace(stored, volume=encoded), Quality(classification="pre"))
    assert np.array_equal(from_file.rgba.view(np.uint32), plain.rgba.view(np.uint32))
