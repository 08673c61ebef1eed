"""The table of formats: steps, memory said beforehand, options; patient space and its letters."""

import numpy as np
import pytest

from rle_splat.read.formats import format_of, read_steps, read_volume
from rle_splat.read.layout import CHUNK_BYTES
from rle_splat.runtime.steps import Progress
from rle_splat.scene import RleSplatError
from rle_splat.view.turntable import turntable
from rle_splat.volume.orientation import axis_letters, lps_from_ras, oblique_degrees, orientation_text
from rle_splat.volume.volume import PATIENT, Volume
from tests.read.phantoms import rotation

SHAPE = (200, 150, 120)


def test_reading_is_steps_that_say_the_memory_first_and_can_be_left(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(4 * 200 * 150 * 120))
    steps = read_steps(path, shape=SHAPE, dtype="uint32", byte_order="big", spacing=(1, 1, 1))
    first = next(steps)
    assert isinstance(first, Progress) and "200 x 150 x 120 voxels of uint32, 13.7 MiB" in first.message
    count = sum(1 for _ in steps)
    assert count >= 4 * 200 * 150 * 120 // CHUNK_BYTES
    begun = read_steps(path, shape=SHAPE, dtype="uint32", byte_order="big", spacing=(1, 1, 1))
    next(begun), next(begun)
    begun.close()
    path.unlink()


def test_too_little_memory_is_said_before_any_is_taken(tmp_path, monkeypatch):
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(4 * 200 * 150 * 120))
    monkeypatch.setattr("rle_splat.runtime.memory.available_bytes", lambda: 1 << 20)
    with pytest.raises(RleSplatError, match=r"13\.7 MiB of memory and 1\.0 MiB are free"):
        read_volume(path, shape=SHAPE, dtype="uint32", byte_order="big", spacing=(1, 1, 1))


def test_meaning_is_given_to_every_format(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(24))
    volume = read_volume(path, shape=(2, 3, 4), dtype="uint8", slope=2.0, value_unit="HU", modality="CT")
    assert (volume.slope, volume.intercept, volume.value_unit, volume.modality) == (2.0, 0.0, "HU", "CT")
    with pytest.raises(RleSplatError, match="slope must be finite and not zero"):
        read_volume(path, shape=(2, 3, 4), dtype="uint8", slope=0.0)


def test_content_decides_before_the_suffix(tmp_path):
    path = tmp_path / "smoke.raw"
    path.write_bytes(b" BDV\0\0\0\0")
    assert format_of(path).name == "OpenVDB"
    assert format_of(tmp_path / "gone.raw").name == "raw"


@pytest.mark.parametrize("affine, letters", [
    (np.eye(4), "LPS"),
    (np.diag((-1, -1, 2, 1)), "RAS"),
    (np.eye(4)[:, [2, 0, 1, 3]], "SLP"),
    (rotation(30, 0) @ np.diag((1, -3, 0.5, 1)), "LAS"),
])  # fmt: skip
def test_letters(affine, letters):
    assert "".join(axis_letters(affine)) == letters


def test_obliqueness_is_the_angle_of_the_rotation():
    assert oblique_degrees(np.diag((-2, 1, 1, 1))) == 0.0
    assert oblique_degrees(rotation(12.3, 2) @ np.diag((1, 2, 3, 1))) == pytest.approx(12.3, abs=1e-12)
    assert orientation_text(rotation(12.3, 2)) == "voxel axes L, P, S; 12.3 degrees oblique"
    assert orientation_text(np.eye(4)) == "voxel axes L, P, S"


def test_ras_points_become_lps_points():
    np.testing.assert_array_equal(lps_from_ras(np.eye(4)) @ (1, 2, 3, 1), (-1, -2, 3, 1))


@pytest.mark.parametrize("affine", [
    np.diag((-2.0, -2.0, 3.0, 1.0)), rotation(20, 0) @ np.diag((1.0, 1.0, -4.0, 1.0)),
    np.array([[1, 0.3, 0, -50], [0, 2, 0.5, 20], [0, 0, 3, 7], [0, 0, 0, 1.0]]),
])  # fmt: skip
def test_the_turntable_of_a_patient_looks_at_the_face_through_the_full_affine(affine):
    """Azimuth 0 looks along +y (to the back) with the patient's left at the right, at the center of the box."""
    volume = Volume(np.zeros((5, 4, 3), np.uint8), affine, space=PATIENT)
    camera, matrix = turntable(volume, scene_scale=0.001)
    np.testing.assert_array_equal(matrix, np.eye(4))
    np.testing.assert_allclose(camera.matrix_world[:3, :3].T, [(1, 0, 0), (0, 0, 1), (0, -1, 0)], atol=1e-15)
    middle = 0.001 * (affine @ (1.0, 1.5, 2.0, 1.0))[:3]
    np.testing.assert_allclose(camera.matrix_world[[0, 2], 3], middle[[0, 2]], atol=1e-12)
    assert camera.matrix_world[1, 3] < middle[1]


def test_an_unknown_space_is_refused():
    with pytest.raises(RleSplatError, match="space of a volume"):
        Volume(np.zeros((1, 1, 1), np.uint8), np.eye(4), space="LPS")
