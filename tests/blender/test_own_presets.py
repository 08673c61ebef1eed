"""Presets of the user: saved, listed, applied, replaced and deleted; files of other programs become such presets."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.test_panels import draw_all

MRML = """<MRML>
<VolumeProperty name="Red" shade="1" scalarOpacity="4 10 0 200 0.5" colorTransfer="4 0 1 0 0"/>
<VolumeProperty name="Blue/Green" shade="0" scalarOpacity="4 10 0 200 0.5" gradientOpacity="4 0 0.5 255 1"
 colorTransfer="8 0 0 0 1 9 0 1 0"/>
</MRML>"""


@pytest.fixture
def own(bridge, tmp_path, monkeypatch):
    """The module of own presets, with an empty folder of scripts that does not exist yet."""
    place = tmp_path / "scripts"

    def user_resource(kind, path="", create=False):
        assert kind == "SCRIPTS"
        if create:
            (place / path).mkdir(parents=True, exist_ok=True)
        return str(place / path)

    monkeypatch.setattr(bpy.utils, "user_resource", user_resource)
    module = bridge("look.own_presets")
    module.look_again()
    yield module
    monkeypatch.undo()
    module.look_again()


@pytest.fixture
def mrml(tmp_path):
    path = tmp_path / "presets.xml"
    path.write_text(MRML)
    return path


def names(own):
    return [one.name for one in own.listed()]


def test_the_folder_is_that_of_blenders_presets(bridge, addon):
    place = bridge("look.own_presets").folder()
    assert place.parts[-2:] == ("presets", "rle_splat") and "scripts" in place.parts
    assert Path(addon.__file__).parent not in place.parents


def test_what_is_saved_is_applied_again(volume_object, own, bridge, core):
    transfer = bridge("look.transfer")
    bpy.ops.rle_splat.apply_preset(preset="mr-head")
    saved = transfer.read_transfer(volume_object)
    assert not own.folder().exists()
    assert bpy.ops.rle_splat.save_user_preset(name=" My Head ") == {"FINISHED"}
    assert names(own) == ["My Head"]
    stored = core("classify.transfer_function").TransferFunction.from_json(own.folder() / "My Head.json")
    assert stored.name == "My Head" and stored.key == saved.key, "the file is that of Save to File"
    bpy.ops.rle_splat.apply_preset(preset="faint")
    assert transfer.read_transfer(volume_object).key != saved.key
    assert bpy.ops.rle_splat.apply_user_preset(name="My Head") == {"FINISHED"}
    again = transfer.read_transfer(volume_object)
    assert again.key == saved.key and volume_object.rle_splat.transfer_name == "My Head"


@pytest.mark.parametrize("name, words", [
    ("", "needs a name"), ("   ", "needs a name"), ("a/b", "may not have any of"), ("..", "period"), ("x" * 81, "80"),
    ("con", "Windows has a device of this name"), ("Nul.bone", "add a word"), ("com¹", "add a word"),
])  # fmt: skip
def test_names_that_no_file_can_have_are_refused(volume_object, own, refused, name, words):
    refused(bpy.ops.rle_splat.save_user_preset, words, name=name)
    assert not own.folder().exists()


def test_a_preset_is_replaced_only_if_asked_to(volume_object, own, refused):
    bpy.ops.rle_splat.save_user_preset(name="Mine")
    before = own.listed()
    bpy.ops.rle_splat.apply_preset(preset="faint")
    for name in ("Mine", "mine"):  # one file on some systems
        refused(bpy.ops.rle_splat.save_user_preset, "already", name=name)
    assert own.listed() == before
    assert bpy.ops.rle_splat.save_user_preset(name="mine", overwrite=True) == {"FINISHED"}
    assert names(own) == ["Mine"] and own.listed() != before, "its stamp changes with its content"


def test_deleting(volume_object, own, refused):
    bpy.ops.rle_splat.save_user_preset(name="Mine")
    assert bpy.ops.rle_splat.delete_user_preset(name="Mine") == {"FINISHED"}
    assert names(own) == [] and not list(own.folder().iterdir())
    refused(bpy.ops.rle_splat.delete_user_preset, "no user preset 'Mine'", name="Mine")
    refused(bpy.ops.rle_splat.apply_user_preset, "no user preset 'Mine'", name="Mine")


def test_a_name_is_no_way_out_of_the_folder(volume_object, own, refused, tmp_path):
    (tmp_path / "scripts" / "presets").mkdir(parents=True)
    victim = tmp_path / "scripts" / "presets" / "victim.json"
    victim.write_text("{}")
    refused(bpy.ops.rle_splat.delete_user_preset, "no user preset", name="../victim")
    assert victim.exists()


def test_a_damaged_preset_is_refused_in_a_sentence(volume_object, own, refused):
    bpy.ops.rle_splat.save_user_preset(name="Mine")
    (own.folder() / "Mine.json").write_text('{"opacity": []}')
    refused(bpy.ops.rle_splat.apply_user_preset, "color", name="Mine")


def test_a_preset_for_another_unit_is_moved_to_the_values(volume_object, own, bridge, core):
    preset = core("classify.presets").preset("ct-bone")
    own.save("bone", preset)
    assert bpy.ops.rle_splat.apply_user_preset(name="bone") == {"FINISHED"}
    low, high = bridge("look.transfer").read_transfer(volume_object).span
    owner = volume_object.rle_splat
    assert owner.value_low <= low < high <= owner.value_high, "Hounsfield units on values without a unit"


def test_names_of_other_programs_are_made_usable(own):
    names_of = {"Blue/Green": "Blue-Green", "...": "Preset", "AUX": "Preset AUX", "com1.red": "Preset com1.red"}
    assert {name: own.usable_name(name) for name in names_of} == names_of


def test_all_presets_of_a_file_become_own_presets(volume_object, own, mrml, refused, core):
    assert bpy.ops.rle_splat.import_presets(filepath=str(mrml)) == {"FINISHED"}
    assert names(own) == ["Blue-Green", "Red"]
    refused(bpy.ops.rle_splat.import_presets, "already", filepath=str(mrml))
    assert bpy.ops.rle_splat.import_presets(filepath=str(mrml), overwrite=True) == {"FINISHED"}
    (red,) = [one.function for one in core("classify.transfer_files").read_transfer_functions(mrml)
              if one.function.name == "Red"]  # fmt: skip
    assert own.read("Red") == red
    assert red.opacity_unit_distance == 1.0 and own.read("Blue-Green").shade is None


def test_one_transfer_function_of_a_file_is_applied_by_name(volume_object, own, mrml, refused, bridge):
    refused(bpy.ops.rle_splat.load_transfer_function, "name one of them with Name: Red, Blue/Green", filepath=str(mrml))
    assert bpy.ops.rle_splat.load_transfer_function(filepath=str(mrml), name="Red") == {"FINISHED"}
    function = bridge("look.transfer").read_transfer(volume_object)
    assert function.name == "Red" and function.opacity == ((10.0, 0.0), (200.0, 0.5))
    assert function.opacity_unit_distance == 1.0 and function.shade.shininess == 40.0
    assert names(own) == []


def test_a_color_map_is_spread_over_the_values(volume_object, own, bridge, tmp_path):
    path = tmp_path / "warm.json"
    path.write_text(json.dumps({"R": [0, 255], "G": [0, 128], "B": [0, 0], "A": [0, 128], "I": [0, 255]}))
    assert bpy.ops.rle_splat.load_transfer_function(filepath=str(path)) == {"FINISHED"}
    function = bridge("look.transfer").read_transfer(volume_object)
    owner = volume_object.rle_splat
    assert function.name == "warm" and owner.value_low <= function.span[0] < function.span[1] <= owner.value_high
    np.testing.assert_allclose(function.alpha_at(function.span[1]), 128 / 255, atol=1e-6)


def test_the_menu_and_the_groups_list_own_presets(volume_object, own, bridge):
    bpy.ops.rle_splat.save_user_preset(name="Mine")
    groups = bridge("look.preset_entries").groups(volume_object.rle_splat)
    assert [group.label for group in groups] == ["For Any Scan", "Own", "Others"], "no modality is known"
    assert [group.is_open for group in groups] == [True, True, False] and len(groups[0].entries) < 12
    assert [entry.name for entry in groups[1].entries] == ["Mine"]


@pytest.mark.parametrize("facts, unit, heading, first, other", [
    ("a\nModality: CT", "HU", "For CT", "ct-bone", "mr-head"),
    ("a\nModality: MR", "", "For MR", "mr-head", "ct-bone"),
    ("FLAIR.nrrd", "", "For MR", "mr-brain", "ct-bone"),
    ("flair.nii\nModality: PT", "SUVbw", "For PET", "pet-hot", "mr-brain"),
])  # fmt: skip
def test_presets_that_suit_the_modality_come_first(volume_object, own, bridge, facts, unit, heading, first, other):
    properties = volume_object.rle_splat
    properties.facts, properties.value_unit = f"File: {facts}", unit
    suits, others = bridge("look.preset_entries").groups(properties)
    assert suits.label == heading and suits.is_open and not others.is_open
    assert first in [entry.name for entry in suits.entries] and other in [entry.name for entry in others.entries]
    assert {"AUTO", "faint"} <= {entry.name for entry in suits.entries}, "those for any modality suit"


def test_a_patient_is_offered_no_plants_or_machines(volume_object, bridge):
    properties = volume_object.rle_splat
    properties.value_unit = "HU"
    of_things = {"ct-botanical", "ct-industrial"}
    for space, offered in (("patient", set()), ("voxel", of_things)):
        properties.space = space
        found = {entry.name for group in bridge("look.preset_entries").groups(properties) for entry in group.entries}
        assert found & of_things == offered, space


def test_a_patients_segment_is_offered_none_of_them(volume_object, bridge, monkeypatch, tmp_path):
    path = tmp_path / "labels.raw"
    np.ones_like(bridge("volumes.volumes").load_volume(volume_object).voxels, np.uint8).tofile(path)
    volume_object.rle_splat.label_file = str(path)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    for space, offered in (("patient", set()), ("voxel", {"ct-botanical", "ct-industrial"})):
        volume_object.rle_splat.space = space
        log = draw_all(monkeypatch)
        values = {value for kind, value in log if kind == "value"}
        assert "ct-bone" in values and values & {"ct-botanical", "ct-industrial"} == offered


def test_names_of_presets_for_a_modality_fit_under_three_pictures_in_a_row(volume_object, bridge):
    volume_object.rle_splat.value_unit = "HU"
    first = bridge("look.preset_entries").groups(volume_object.rle_splat)[0]
    assert first.label == "For CT" and len(first.entries) > 10
    labels = {entry.name: entry.label for entry in first.entries}
    assert all(len(label) <= 11 for label in labels.values()), labels
    assert labels["ct-angiography"] == "Angio" and labels["ct-soft-tissue"] == "Soft Tissue"
