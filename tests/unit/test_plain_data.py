"""Plain data: it prints as one short line, without its arrays, and refuses values of another type."""

import numpy as np
import pytest

from rle_splat import (
    Camera,
    Labels,
    Light,
    Rendering,
    RleSplatError,
    Scene,
    Volume,
    encode,
    preset,
    render,
    write_picture,
)


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
    assert repr(Rendering(np.zeros((3, 4, 4)), np.zeros((3, 4)), {})) == "<Rendering of 4 x 3 pixels>"


def test_a_list_of_lights_is_taken_as_a_tuple():
    light = Light()
    assert scene_with(lights=[light]).lights == (light,)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Volume([[[1]]], np.eye(4)), "not a list"),
        (lambda: Labels(np.zeros((2, 2, 2), int)), "not a ndarray"),
        (lambda: render(None, 2), "not 2"),
        (lambda: write_picture("out.png", None, background="white"), "three finite numbers"),
        (lambda: scene_with(labels=Volume(np.zeros((3, 4, 5), np.uint8), np.eye(4))), "a Labels object, not a Volume"),
        (lambda: scene_with(lights=Light()), "a tuple of Light objects"),
        (lambda: Scene(np.zeros((3, 3, 3)), preset("ct-bone"), Camera()), "The volume is an array; make a Volume"),
        (lambda: Scene(None, "ct-bone", Camera()), "not the name 'ct-bone'; fit_preset"),
        (lambda: Scene(None, (preset("ct-bone"), None), Camera()), "transfer_function must be one object, not a tuple"),
        (lambda: Scene(None, preset("ct-bone"), (Camera(), np.eye(4))), "camera must be one object, not a tuple"),
        (lambda: scene_with(channels=("pet",)), "a tuple of Channel objects"),
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
    ],
)
def test_a_value_of_another_type_gets_one_sentence(make, words):
    with pytest.raises(RleSplatError, match=words) as raised:
        make()
    assert str(raised.value).count(". ") == 0
