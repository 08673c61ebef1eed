"""DICOM folders in Blender: the only series is taken, of several one is chosen, and names stay in the files."""

from importlib import import_module

import bpy
import numpy as np
import pytest


def active():
    return bpy.context.view_layer.objects.active


@pytest.fixture
def phantoms(addon):
    """Our writer of DICOM files; it needs the libraries of the installed extension."""
    pytest.importorskip("pydicom")
    return import_module("tests.read.dicom_phantoms")


@pytest.fixture
def study(tmp_path, phantoms):
    """A folder with two series of 5 and 7 slices."""
    steps = {"first": 5, "second": 7}
    for name, count in steps.items():
        where = phantoms.geometry(name, (1, 0, 0), (0, 1, 0), [2.0 * i for i in range(count)])
        phantoms.write_classic(tmp_path / "study" / name, where)
    return tmp_path / "study"


def test_a_folder_is_imported_and_its_object_has_no_name_of_a_patient(study, phantoms, bridge):
    assert bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first")) == {"FINISHED"}
    owner = active()
    volume = bridge("volumes.volumes").load_volume(owner)
    assert volume.shape_xyz[2] == 5 and owner.rle_splat.space == "patient"
    kept = " ".join(str(getattr(owner.rle_splat, name)) for name in ("facts", "remarks", "filepath")) + owner.name
    assert "DOE" not in kept.upper() and phantoms.NUMBER not in kept


def test_any_file_of_a_series_stands_for_it(study, bridge):
    path = sorted((study / "second").iterdir())[3]
    assert bpy.ops.rle_splat.import_volume(filepath=str(path)) == {"FINISHED"}
    assert bridge("volumes.volumes").load_volume(active()).shape_xyz[2] == 7


def test_several_series_are_listed_in_one_sentence_and_one_is_chosen(study, refused, bridge):
    refused(bpy.ops.rle_splat.import_volume, "There are 2 series; set series to the number of one: 1 is CT HEAD",
            filepath=str(study))  # fmt: skip
    refused(bpy.ops.rle_splat.import_dicom_series, "5 slices", directory=str(study))
    refused(bpy.ops.rle_splat.import_volume, "series 3", filepath=str(study), series=3)
    counts = {}
    for number in (1, 2):
        assert bpy.ops.rle_splat.import_dicom_series(directory=str(study), series=number) == {"FINISHED"}
        assert active().rle_splat.series == number
        counts[number] = bridge("volumes.volumes").load_volume(active()).shape_xyz[2]
    assert sorted(counts.values()) == [5, 7]


def test_the_chosen_series_is_read_again_after_a_reload(study, tmp_path, bridge):
    bpy.ops.rle_splat.import_dicom_series(directory=str(study), series=2)
    expected = np.array(bridge("volumes.volumes").load_volume(active()).voxels)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    warnings = []
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(active(), warnings.append).voxels, expected)
    assert not warnings
    content = (tmp_path / "saved.blend").read_bytes()
    assert b"DOE^" not in content


def test_relocate_takes_a_folder(study, bridge):
    bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first"))
    (study / "first").rename(study / "moved")
    bridge("volumes.volumes").forget_all()
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(study / "moved")) == {"FINISHED"}
    assert bridge("volumes.volumes").load_volume(active()).shape_xyz[2] == 5


def test_relocate_finds_the_series_among_others(study, bridge, tmp_path, capfd):
    """By the hash of its identifier, which is all that the .blend holds of it."""
    for name, count in (("first", 5), ("second", 7)):
        bpy.ops.rle_splat.import_dicom_series(directory=str(study / name))
        assert bpy.ops.rle_splat.relocate_volume(filepath=str(study)) == {"FINISHED"}
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
        assert bridge("volumes.volumes").load_volume(active()).shape_xyz[2] == count
    assert "does not hold the series" not in "".join(capfd.readouterr())


def test_relocate_to_other_series_lists_them_and_changes_nothing(study, refused, phantoms, tmp_path, capfd):
    bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first"))
    before, key = active().rle_splat.filepath, active().rle_splat.series_key
    for name in ("third", "fourth"):
        where = phantoms.geometry(name, (1, 0, 0), (0, 1, 0), [2.0 * i for i in range(5)])
        phantoms.write_classic(tmp_path / "others" / name, where)
    refused(bpy.ops.rle_splat.relocate_volume, "There are 2 series", filepath=str(tmp_path / "others"))
    assert active().rle_splat.filepath == before and active().rle_splat.series_key == key
    capfd.readouterr()
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(tmp_path / "others"), series=1) == {"FINISHED"}
    assert "others does not hold the series that was imported; another one was read" in "".join(capfd.readouterr())
    assert active().rle_splat.series == 1 and active().rle_splat.series_key not in ("", key)


def test_changes_beside_a_file_and_deep_in_a_folder_are_noticed(study, bridge, phantoms):
    (study / "second").rename(study.parent / "second")
    changed = sorted((study / "first").iterdir())[2]
    for path in (study, sorted((study / "first").iterdir())[0]):
        bpy.ops.rle_splat.import_volume(filepath=str(path))
        (study / "first" / "scene.blend").write_bytes(b"")
        bridge("volumes.file_changes").forget()  # as a second later
        assert bridge("volumes.volumes").is_at_hand(active()), "a scene beside a scan is none of its files"
        content = phantoms.read(changed)
        content.PixelData = bytes(reversed(content.PixelData))
        with open(changed, "r+b") as stream:  # in place: the folder's own time stays
            content.save_as(stream)
        bridge("volumes.file_changes").forget()
        warnings = []
        bridge("volumes.volumes").load_volume(active(), warnings.append)
        assert len(warnings) == 1 and "changed" in warnings[0]


def test_what_the_chooser_shows(study, bridge, core):
    series, reading = bridge("volumes.series"), bridge("volumes.import_source")
    with pytest.raises(core("read.dicom.grouping").SeveralSeries) as caught:
        core("runtime.steps").drain(bridge("volumes.volumes").file_steps(str(study), {}))
    several = caught.value
    thumbnails = core("runtime.steps").drain(reading.thumbnail_steps(several))
    assert [picture.dtype for picture in thumbnails] == [np.uint8, np.uint8]
    series.offer(several, thumbnails, "import_volume", {"filepath": str(study), "use_dialog": False})
    offer = series.offered()
    lines = dict(series.facts(offer.rows[0], offer.descriptions[0]))
    assert lines["Modality"].startswith("CT") and lines["Slices"] in ("5", "7") and "mm" in lines["Spacing"]
    assert tuple(offer.icons["1"].image_size) == (36, 33)
    np.testing.assert_allclose(  # without a window Blender makes no icon of it
        np.array(offer.icons["2"].image_pixels_float[:]).reshape(33, 36, 4)[::-1, :, 0], thumbnails[1] / 255, atol=0.01
    )
    assert bpy.ops.rle_splat.choose_series(row=1) == {"FINISHED"}
    assert active().rle_splat.series == 2 and series.offered() is None


def test_a_folder_without_images_is_refused(tmp_path, refused):
    (tmp_path / "notes.txt").write_text("no image")
    sentence = f"{tmp_path.name} holds no medical images, only 1 other file; choose"
    refused(bpy.ops.rle_splat.import_dicom_series, sentence, directory=str(tmp_path))
    refused(bpy.ops.rle_splat.import_dicom_series, "no folder", directory="")


@pytest.mark.parametrize(
    "name, options", [("import_dicom_series", {"directory": "first"}), ("choose_series", {"row": 0})]
)
def test_an_import_is_undone(study, bridge, core, name, options):
    bpy.ops.ed.undo_push(message="start")
    if name == "choose_series":
        with pytest.raises(core("read.dicom.grouping").SeveralSeries) as caught:
            core("runtime.steps").drain(bridge("volumes.volumes").file_steps(str(study), {}))
        bridge("volumes.series").offer(caught.value, [None, None], "import_volume", {"filepath": str(study)})
    else:
        options = {"directory": str(study / "first")}
    assert getattr(bpy.ops.rle_splat, name)("EXEC_DEFAULT", True, **options) == {"FINISHED"}
    assert active() is not None
    bpy.ops.ed.undo()
    assert not any(one.rle_splat.is_volume for one in bpy.data.objects)


def test_a_series_is_chosen_for_a_channel(study, bridge, core, refused):
    """Of several in a folder: the list is shown, and the chosen one is added without asking for a file again."""
    bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first"))
    owner = active()
    refused(bpy.ops.rle_splat.import_channel, "There are 2 series", filepath=str(study))
    with pytest.raises(core("read.dicom.grouping").SeveralSeries) as caught:
        core("runtime.steps").drain(bridge("volumes.volumes").file_steps(str(study), {}))
    bridge("volumes.series").offer(
        caught.value, [None, None], "import_channel", {"filepath": str(study), "use_dialog": False}
    )
    assert bpy.ops.rle_splat.choose_series(row=0) == {"FINISHED"}
    assert len(owner.rle_splat.channels) == 1 and active() == owner


def test_a_slice_that_is_written_again_is_noticed(study, bridge, phantoms):
    volumes = bridge("volumes.volumes")
    bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first"))
    path = sorted((study / "first").iterdir())[2]
    content = phantoms.read(path)
    content.PixelData = bytes(len(content.PixelData))
    with open(path, "r+b") as stream:  # in place: the folder's own time stays
        content.save_as(stream)
    bridge("volumes.file_changes").forget()  # as a second later
    warnings = []
    volumes.load_volume(active(), warnings.append)
    assert len(warnings) == 1 and "changed" in warnings[0]


def test_all_files_of_a_series_are_one_volume(study, refused):
    """As when they are dropped together; of files of two series in one folder the list is shown."""
    names = [{"name": path.name} for path in sorted((study / "second").iterdir())]
    bpy.ops.rle_splat.import_volume(directory=str(study / "second"), files=names)
    assert len([one for one in bpy.data.objects if one.rle_splat.is_volume]) == 1
    for path in (study / "first").iterdir():
        path.rename(study / "second" / f"first_{path.name}")
    names = [{"name": path.name} for path in sorted((study / "second").iterdir())]
    refused(bpy.ops.rle_splat.import_volume, "There are 2 series", directory=str(study / "second"), files=names)


def test_a_second_series_that_came_later_is_told_in_a_sentence(study, bridge, core):
    bpy.ops.rle_splat.import_dicom_series(directory=str(study / "first"))
    (study / "second").rename(study / "first" / "more")
    bridge("volumes.volumes").forget_all()
    assert bridge("volumes.volumes").load_volume(active()).shape_xyz[2] == 5, "it is found by its hash"
    active().rle_splat.series_key = ""  # as in a scene of an earlier version
    with pytest.raises(core("scene").RleSplatError, match=r"There are 2 series at .*first; click Relocate"):
        bridge("volumes.volumes").load_volume(active())
