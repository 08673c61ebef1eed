"""What a picture to a tolerance makes of a scene's effects: those without a truth are refused while they are on, not
when they are forced off; pre leaves shadows out, with a word in the report; single rays are in the report's times."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rle_splat.accuracy.planner.checks import check_tolerance_applies
from rle_splat.accuracy.planner.tolerance import render_within
from rle_splat.classify.transfer_function import GradientOpacity, Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Channel, Labels, Light, Mist, Pose, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

SIZE = 24
Z, Y, X = np.mgrid[:16, :16, :16] / 15.0
VOLUME = Volume(np.exp(-8.0 * ((X - 0.5) ** 2 + (Y - 0.4) ** 2 + (Z - 0.5) ** 2)).astype(np.float32), np.eye(4))
FUNCTION = TransferFunction("ball", None, ((0.1, 0.0), (1.0, 0.3)), ((0.0, 0.9, 0.2, 0.1), (1.0, 0.9, 0.9, 0.4)), 1.0,
                        Shade(0.3, 0.6, 0.0, 1.0))  # fmt: skip
SUN = Light(type="SUN", energy=3.0)


def scene_of(**more) -> Scene:
    camera, matrix = turntable(VOLUME, 28.0, 17.0, 1.1, True, 45.0)
    return Scene(**{
        "volume": VOLUME, "transfer_function": FUNCTION, "camera": camera, "width": SIZE, "height": SIZE,
        "volume_matrix": matrix, "headlight": True, **more,
    })  # fmt: skip


def lens(scene: Scene) -> Scene:
    return replace(scene, camera=replace(scene.camera, focus_distance=3.0, aperture_radius=2.0))


def moving(scene: Scene) -> Scene:
    moved = scene.volume_matrix.copy()
    moved[0, 3] += 8.0
    poses = tuple(Pose(scene.camera.matrix_world, matrix) for matrix in (scene.volume_matrix, moved))
    return replace(scene, motion=poses)


# An effect without a truth -> a scene that has it, and what the refusal names.
WITHOUT_TRUTH = {
    "mist": (scene_of(mist=Mist(10.0, 30.0)), "mist"),
    "gradient opacity": (
        scene_of(transfer_function=replace(FUNCTION, gradient_opacity=GradientOpacity(0.0, 0.2))), "gradient opacity"
    ),
    "mode": (scene_of(mode="mip"), "mode mip"),
    "labels": (scene_of(labels=Labels(Volume((X > 0.5).astype(np.uint8), np.eye(4)), {1: None})), "labels"),
    "channels": (scene_of(channels=(Channel(VOLUME, FUNCTION),)), "for channels the classification post"),
    "depth of field": (lens(scene_of()), "depth of field"),
    "motion blur": (moving(scene_of()), "motion blur"),
    "shadows": (scene_of(lights=(SUN,), headlight=False, volume_shadows=True), "without shadows"),
    "ambient occlusion": (scene_of(ambient_occlusion=1.0), "without shadows"),
}  # fmt: skip


BY_POST = "without shadows", "for channels the classification post"  # what is refused with pre alone


@pytest.mark.parametrize("name", WITHOUT_TRUTH)
def test_an_effect_without_a_truth_is_refused_unless_it_is_forced_off(name):
    scene, words = WITHOUT_TRUTH[name]
    for quality in (Quality(classification="pre"), Quality(classification="post")):
        if quality.classification == "pre" or words not in BY_POST:
            with pytest.raises(RleSplatError, match=words):
                check_tolerance_applies(scene, quality)
        else:  # whose truth has shadows, and channels
            check_tolerance_applies(scene, quality)
        check_tolerance_applies(replace(scene, effects={name: False}), quality)


@pytest.mark.parametrize("name", ("mist", "gradient opacity", "mode", "motion blur"))
def test_a_picture_with_the_effect_forced_off_keeps_its_tolerance(name):
    """Against the truth of the scene without it; and it is that scene's picture."""
    quality = Quality(classification="pre")
    rendering = render_within(replace(WITHOUT_TRUTH[name][0], effects={name: False}), 8.0, quality, probes=200)
    assert rendering.report["error"]["kept"] and rendering.report["error"]["measured"] <= 8.0
    assert next(row["reason"] for row in rendering.report["effects"] if row["name"] == name) == "by hand"
    told = rendering.report["plan"]
    plan = {knob: told[knob] for knob in ("depth_rule", "sheet_density", "warp_filter", "termination")}
    np.testing.assert_array_equal(rendering.rgba, render(scene_of(), replace(quality, **plan)).rgba)


def test_a_picture_with_indirect_light_keeps_its_tolerance():
    """The error is that against a truth with it: the plain scene's picture is further off than measured."""
    lit = scene_of(lights=(SUN,), headlight=False, volume_shadows=True, indirect_light=1.0)
    rendering = render_within(lit, 2.0, Quality(classification="post"), probes=200)
    assert rendering.report["error"]["kept"] and rendering.report["error"]["truth"] == "T2"
    plain = render(replace(lit, indirect_light=0.0), Quality.preset("fine"))
    assert 255.0 * np.abs(rendering.rgba - plain.rgba).max() > 4.0


def test_a_mesh_that_is_forced_off_is_no_part_of_what_was_measured():
    triangle = np.array([[(4.0, 8.0, 4.0), (14.0, 8.0, 4.0), (9.0, 8.0, 14.0)]])
    scene, remark = (
        scene_of(triangles=triangle),
        "The error was measured only where no mesh ends a ray or one beside it.",
    )
    for effects, said in (({}, True), ({"mesh occlusion": False}, False)):
        report = render_within(replace(scene, effects=effects), 8.0, Quality(classification="pre"), probes=200).report
        assert (remark in report["remarks"]) == said


SHADED = dict(lights=(SUN,), headlight=False)


@cache
def plain_within():
    return render_within(scene_of(**SHADED), 8.0, Quality(classification="pre"), probes=200)


@pytest.mark.parametrize(
    "more, left_out",
    [
        ({"volume_shadows": True, "ambient_occlusion": 0.5}, ["shadows", "ambient occlusion"]),
        ({"volume_shadows": True}, ["shadows"]), ({"ambient_occlusion": 0.5}, ["ambient occlusion"]),
        ({"effects": {"shadows": True}}, ["shadows"]), ({}, []),
        ({"volume_shadows": True, "effects": {"shadows": False}}, []),
        ({"volume_shadows": True, "lights": (replace(SUN, casts_shadow=False),)}, []),
    ],
)  # fmt: skip
def test_shadows_that_are_left_out_are_said_to_be(more, left_out):
    quality = Quality(classification="pre")
    plain = plain_within()
    found = render_within(scene_of(**{**SHADED, **more}), 8.0, quality, probes=200, leave_out_shadows=True)
    np.testing.assert_array_equal(found.rgba, plain.rgba)
    said = [remark for remark in found.report["remarks"] if "has none" in remark]
    expected = f"A picture with a maximum error has no {' and no '.join(left_out)}, because its"
    assert len(said) == bool(left_out) and all(remark.startswith(expected) for remark in said)
    for row in found.report["effects"]:
        if row["name"] in ("shadows", "ambient occlusion"):
            assert not row["on"] and row["ms"] == 0.0
            assert (row["reason"] == "it is not available with a maximum error") == (row["name"] in left_out)


@pytest.mark.parametrize("leave_out_shadows", (False, True))
def test_post_keeps_its_tolerance_with_shadows(leave_out_shadows):
    scene, quality = scene_of(**SHADED, volume_shadows=True, ambient_occlusion=0.5), Quality(classification="post")
    found = render_within(scene, 8.0, quality, probes=200, leave_out_shadows=leave_out_shadows)
    assert found.report["error"]["truth"] == "T2" and found.report["error"]["kept"]
    on = {row["name"]: row["on"] for row in found.report["effects"]}
    assert on["shadows"] and on["ambient occlusion"]
    assert not any("has none" in remark for remark in found.report["remarks"])


def test_single_rays_are_in_the_times_of_a_picture_to_a_tolerance():
    narrow = replace(FUNCTION, opacity=((0.35, 0.0), (0.5, 0.7), (0.65, 0.0)), shade=None)
    report = render_within(scene_of(transfer_function=narrow), 0.5, Quality(classification="post"), probes=200).report
    stages = report["stages_ms"]
    assert report["rays"]["pixels"] > 0 and report["error"]["rays"]["ms"] > 0.0
    assert stages["rays"] == report["error"]["rays"]["ms"]
    assert stages["total"] > stages["splat"] + stages["warp"] + stages["rays"]
    assert report["error"]["ms"] == pytest.approx(stages["splat"] + stages["warp"] + stages["rays"])
    by_sheets = render_within(scene_of(), 8.0, Quality(classification="pre"), probes=0).report
    assert by_sheets["stages_ms"]["rays"] == 0.0


@pytest.mark.parametrize("tolerance", (32.0, 1e-6))
def test_under_shadows_of_meshes_other_pixels_may_err_twice_as_much_as_the_probes(tolerance):
    scene = scene_of(lights=(SUN,), headlight=False, volume_shadows=True)
    middle = (scene.index_to_world @ (7.5, 7.5, 7.5, 1.0))[:3]
    aside = middle + 40.0 * np.eye(3)[None]
    for shown, margin in ((replace(scene, triangles=aside), 2.0), (scene, 1.0)):
        report = render_within(shown, tolerance, Quality(threads=1), probes=200).report
        error = report["error"]
        assert error["kept"] == (margin * error["measured"] <= tolerance)
        if tolerance < 1.0:
            assert not error["kept"] and error["floor"] == margin * error["measured"]
            words = "2 times what was measured against" if margin > 1.0 else ", measured against"
            assert words in " ".join(report["remarks"])
        else:
            assert error["kept"] and error["floor"] is None


def test_small_tolerances_are_kept_under_shadows_and_occlusion():
    """With one node of light per voxel this scene errs 2.1 levels."""
    wall = replace(FUNCTION, opacity=((0.3, 0.0), (0.4, 0.8)))
    scene = scene_of(transfer_function=wall, lights=(SUN,), headlight=False, volume_shadows=True, ambient_occlusion=0.7)
    error = render_within(scene, 0.5, Quality(threads=1), probes=200).report["error"]
    assert error["kept"] and error["measured"] <= 0.5
