"""Plain data: it prints as one short line, without its arrays, and refuses values of another type."""

import inspect
import re
from typing import get_args

import numpy as np
import pytest

import rle_splat
from rle_splat import (
    Camera,
    Labels,
    Light,
    Quality,
    Rendering,
    RleSplatError,
    Scene,
    Volume,
    encode,
    encode_folder,
    estimate_memory,
    preset,
    preset_names,
    read_encoded,
    render,
    write_encoded,
    write_figure,
    write_picture,
    write_volume,
)
from rle_splat.scene import MODE_TEXTS, QUALITY_PRESETS, QualityName
from rle_splat.scene.scene import Mode

PICTURE = Rendering(np.zeros((3, 4, 4)), np.zeros((3, 4)), {})


def scene_with(**given):
    return Scene(Volume(np.zeros((3, 4, 5), np.uint8), np.eye(4)), preset("ct-bone"), Camera(), **given)


def test_volumes_scenes_and_pictures_print_as_one_line():
    voxels, affine = np.full((3, 4, 5), 1000, np.int16), np.diag((0.5, 0.5, 1.25, 1.0))
    ct = Volume(voxels, affine, value_unit="HU", modality="CT", name="a")
    assert repr(ct) == "<Volume CT 'a', 5 x 4 x 3 int16, 0.5 x 0.5 x 1.25 mm, HU>"
    assert repr(Volume(voxels, np.eye(4))) == "<Volume '', 5 x 4 x 3 int16, 1 x 1 x 1 mm>"
    scene = Scene(ct, preset("ct-bone"), Camera())
    assert repr(scene) == f"<Scene of {ct!r}, 512 x 512 pixels>"
    assert repr(encode(scene, axes=(2,))) == "<StoredVolume '', 5 x 4 x 3, pre-classified, along z>"
    assert repr(PICTURE) == "<Rendering of 4 x 3 pixels>"


def test_a_list_of_lights_is_taken_as_a_tuple():
    light = Light()
    assert scene_with(lights=[light]).lights == (light,)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Volume([[[1]]], np.eye(4)), "not a list"),
        (lambda: Labels(np.zeros((2, 2, 2), int)), "not a ndarray"),
        (lambda: render(None, 2), "not 2"),
        (lambda: write_picture(PICTURE, "out.png", background="pink"), "three finite numbers"),
        (lambda: scene_with(labels=Volume(np.zeros((3, 4, 5), np.uint8), np.eye(4))), "a Labels object, not a Volume"),
        (lambda: scene_with(lights=Light()), "a tuple of Light objects"),
        (lambda: Scene(np.zeros((3, 3, 3)), preset("ct-bone"), Camera()), "The volume is an array; make a Volume"),
        (lambda: Scene(None, "ct-bone", Camera()), "not the name 'ct-bone'; fit_preset"),
        (lambda: Scene(None, (preset("ct-bone"), None), Camera()), "transfer_function must be one object, not a tuple"),
        (lambda: Scene(None, preset("ct-bone"), (Camera(), np.eye(4))), "camera must be one object, not a tuple"),
        (lambda: scene_with(channels=("pet",)), "a tuple of Channel objects"),
        (lambda: write_picture("out.png", PICTURE), r"write_picture\(rendering, path\) takes a Rendering first, not"),
        (lambda: write_figure("out.svg", PICTURE), r"write_figure\(figure, path\) takes a MadeFigure first, not"),
        (lambda: write_volume("out.nrrd", PICTURE), r"write_volume\(volume, path\) takes a Volume first, not"),
        (lambda: write_encoded("out.rle", PICTURE), r"write_encoded\(stored, path\) takes a StoredVolume first, not"),
        (lambda: Camera(type="ORTHO"), "needs ortho_scale"),
        (lambda: Camera(aperture_radius=1.0), "needs focus_distance"),
        (lambda: Camera(type="ORTHO", ortho_scale=100.0, slant=(0.1, 0.0)), "needs focus_distance"),
    ],
    ids=[
        "voxels",
        "labels",
        "quality",
        "background",
        "labels of a scene",
        "lights",
        "array",
        "name",
        "function",
        "camera",
        "channels",
        "order of a picture",
        "order of a figure",
        "order of a volume",
        "order of encoded voxels",
        "orthographic",
        "lens",
        "slant",
    ],
)
def test_a_value_of_another_type_gets_one_sentence(make, words):
    with pytest.raises(RleSplatError, match=words) as raised:
        make()
    assert str(raised.value).count(". ") == 0


def test_every_parameter_of_the_interface_has_a_type():
    functions = {name: one for name in rle_splat.__all__ if inspect.isfunction(one := getattr(rle_splat, name))}
    typed = {name: inspect.signature(one) for name, one in functions.items()}
    assert len(typed) > 20
    untyped = [
        (name, found.name)
        for name, signature in typed.items()
        for found in signature.parameters.values()
        if found.annotation is found.empty
    ]
    assert not untyped and not [name for name, one in typed.items() if one.return_annotation is one.empty]


def test_types_of_names_list_all_names():
    assert get_args(QualityName) == tuple(QUALITY_PRESETS) and get_args(Mode) == tuple(MODE_TEXTS)
    assert preset_names()[0] == "ct-bone" and all(preset(name).opacity for name in preset_names())


def test_a_qualitys_name_is_taken_wherever_a_quality_is(tmp_path):
    """The signatures say so; here is what the name means for functions that draw nothing."""
    for name in rle_splat.__all__:
        function = getattr(rle_splat, name)
        found = inspect.signature(function).parameters.get("quality") if inspect.isfunction(function) else None
        assert found is None or re.search("QualityName|Literal", str(found.annotation)), name
    volume = Volume(np.full((4, 4, 4), 1000, np.int16), np.eye(4), value_unit="HU", modality="CT")
    scene, fine = Scene(volume, preset("ct-bone"), Camera()), Quality.preset("fine")
    assert estimate_memory(volume, preset("ct-bone"), "fine") == estimate_memory(volume, preset("ct-bone"), fine)
    assert encode(scene, "fine").model == "extinction"
    encode_folder(scene, tmp_path / "named.rle", "fine")
    encode_folder(scene, tmp_path / "default.rle")
    assert read_encoded(tmp_path / "named.rle").classification == "post"
    assert read_encoded(tmp_path / "default.rle").classification == "pre"
