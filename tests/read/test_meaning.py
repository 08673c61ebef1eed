"""What is known of a file's values without being stated, and the first transfer function that follows."""

import numpy as np
import pytest

from rle_splat.classify.default import default_transfer_function
from rle_splat.classify.presets import PRESETS
from rle_splat.read.formats import read_volume, write_volume
from rle_splat.volume.volume import Volume

SHAPE = (60, 64, 68)  # z, y, x


def body(bone=True, air=-1000.0, water=40.0) -> np.ndarray:
    """HU of a body of water with fat around it on a table, with noise; some bone in it."""
    _z, y, x = np.mgrid[0:60, 0:64, 0:68]
    r = np.hypot((x - 34) / 26, (y - 30) / 18)
    values = np.full(SHAPE, air)
    values[r < 1] = water - 140  # fat
    values[r < 0.9] = water
    if bone:
        values[np.hypot(x - 34, y - 38) < 5] = 600
    values[:, 52:54] = -300  # the table's shell
    values[:, 54:60] = -900  # and its foam
    values += np.random.default_rng(3).normal(0.0, 10.0, SHAPE)
    return np.round(values).astype(np.int16)


def raw_of(tmp_path, values):
    path = tmp_path / "scan.raw"
    path.write_bytes(values.tobytes())
    return path, dict(shape=values.shape[::-1], dtype=values.dtype.name, byte_order="little", spacing=(1, 1, 1))


def test_a_raw_file_with_the_peaks_of_air_and_water_is_ct(tmp_path):
    path, options = raw_of(tmp_path, body())
    volume = read_volume(path, **options)
    assert (volume.modality, volume.value_unit) == ("CT", "HU")
    assert sum("Taken as a CT in HU" in remark for remark in volume.remarks) == 1
    assert "CT Bone" in default_transfer_function(volume)[1]


def test_a_scan_cut_off_within_a_chest_is_ct(tmp_path):
    """It has lungs, and next to no air."""
    path, options = raw_of(tmp_path, body(air=-850.0)[:, :52])
    assert read_volume(path, **options).value_unit == "HU"


@pytest.mark.parametrize("given", [dict(modality="MR"), dict(value_unit="mg")])
def test_what_is_given_counts_more(tmp_path, given):
    path, options = raw_of(tmp_path, body())
    volume = read_volume(path, **options, **given)
    assert {name: getattr(volume, name) for name in given} == given
    assert not any("Taken as a CT" in remark for remark in volume.remarks)


@pytest.mark.parametrize("values", [
    body() + 1024, body().astype(np.int16) // 16, np.arange(-1000, 260, dtype=np.int16).repeat(100).reshape(40, 50, 63),
    np.random.default_rng(0).normal(-400, 600, SHAPE).astype(np.int16), np.full(SHAPE, -1000, np.int16),
], ids=["offset", "scaled", "ramp", "noise", "air"])  # fmt: skip
def test_other_values_are_not_taken_for_ct(tmp_path, values):
    path, options = raw_of(tmp_path, values)
    assert read_volume(path, **options).modality is None


def test_a_nifti_of_hounsfield_units_is_ct_too(tmp_path):
    write_volume(Volume(body() + 1024, np.eye(4), intercept=-1024.0), tmp_path / "a.nii.gz")
    volume = read_volume(tmp_path / "a.nii.gz")
    assert (volume.modality, volume.value_unit, volume.intercept) == ("CT", "HU", -1024.0)


@pytest.mark.parametrize("bone", [True, False])
def test_the_first_transfer_function_leaves_the_table_out(bone):
    volume = Volume(body(bone), np.eye(4), value_unit="HU", modality="CT")
    function, _ = default_transfer_function(volume)
    assert function.alpha_at(volume.physical(volume.voxels[:, 52:])).max() == 0.0
    assert function.alpha_at(np.array([600.0 if bone else 60.0])).max() > 0.3


@pytest.mark.parametrize("modality, name, choice", [
    ("CT", "CT LUNG", "ct-lung"), ("CT", "CT CHEST", "ct-bone"), ("MR", "MR BRAIN", "mr-head"),
    ("MR", "MR TOF", "mr-angiography"), (None, "mrbrain", "mr-head"), (None, "ct_abdomen", "ct-bone"),
    (None, "sub-01_flair", "mr-head"), (None, "bonsai", None),
])  # fmt: skip
def test_modality_and_body_part_choose_the_preset(modality, name, choice):
    z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    ball = np.clip(1000 * (1.2 - np.sqrt(x * x + y * y + z * z)), 0, 1200).astype(np.int16)
    reason = default_transfer_function(Volume(ball, np.eye(4), modality=modality, name=name))[1]
    assert (reason.startswith(f"Preset {PRESETS[choice].label}: ")) if choice else "reset" not in reason


@pytest.mark.parametrize("modality", [None, "MR"])
def test_a_brain_is_shown_where_all_else_was_removed(modality):
    voxels = np.zeros((24, 24, 24), np.int16)
    voxels[4:20, 4:20, 4:20] = np.arange(200, 600, 100)[:, None, None].repeat(4, axis=0)
    for whole, choice in ((voxels, "mr-brain"), (np.pad(voxels[:20], [(4, 0), (0, 0), (0, 0)]), "mr-head")):
        reason = default_transfer_function(Volume(whole, np.eye(4), modality=modality, name="sub-01_flair"))[1]
        assert reason.startswith(f"Preset {PRESETS[choice].label}: ")
