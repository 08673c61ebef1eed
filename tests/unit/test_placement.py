"""Corrections of a grid's place: spacing, orientation, mirrored axes."""

import numpy as np
import pytest

from rle_splat.read.formats import read_volume, write_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.orientation import axis_letters
from rle_splat.volume.placement import place_volume
from rle_splat.volume.volume import PATIENT, Volume

VOXELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
AFFINE = np.array([[0.0, -2.0, 0.0, 5.0], [1.0, 0.0, 0.0, 6.0], [0.0, 0.0, 3.0, 7.0], [0.0, 0.0, 0.0, 1.0]])


def corners(volume):
    """Extreme voxel centers of the box."""
    last = np.array(volume.shape_xyz) - 1
    found = [volume.affine @ (*(np.array([i, j, k]) * last), 1.0) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    return np.min(found, axis=0), np.max(found, axis=0)


def test_a_spacing_keeps_directions_and_the_first_voxel():
    found = place_volume(Volume(VOXELS, AFFINE), spacing=(2.0, 4.0, 0.5))
    np.testing.assert_allclose(found.spacing, (2.0, 4.0, 0.5))
    np.testing.assert_array_equal(found.affine[:3, 3], AFFINE[:3, 3])
    np.testing.assert_allclose(found.affine[:3, 0], (0.0, 2.0, 0.0))


@pytest.mark.parametrize("letters", ("LPS", "RAS", "SLA", "ipr"))
def test_an_orientation_names_where_indices_grow_and_keeps_center_and_spacing(letters):
    volume = Volume(VOXELS, AFFINE)
    found = place_volume(volume, orientation=letters)
    assert axis_letters(found.affine) == tuple(letters.upper()) and found.space == PATIENT
    np.testing.assert_allclose(found.spacing, volume.spacing)
    middle = (*(0.5 * (np.array(volume.shape_xyz) - 1.0)), 1.0)
    np.testing.assert_allclose(found.affine @ middle, volume.affine @ middle)


@pytest.mark.parametrize("axes", ("x", "yz", "xyz"))
def test_a_flip_mirrors_within_the_box_and_twice_is_none(axes):
    volume = Volume(VOXELS, AFFINE)
    found = place_volume(volume, flip=axes)
    np.testing.assert_allclose(corners(found), corners(volume))
    assert np.linalg.det(found.affine[:3, :3]) * (-1.0) ** len(axes) * np.linalg.det(AFFINE[:3, :3]) > 0.0
    assert not np.allclose(found.affine, AFFINE)
    np.testing.assert_allclose(place_volume(found, flip=axes).affine, AFFINE)


@pytest.mark.parametrize(
    ("given", "words"),
    (
        ({"spacing": (1.0, 0.0, 1.0)}, "above zero"),
        ({"spacing": (1.0, 1.0)}, "three numbers"),
        ({"orientation": "LPR"}, "three letters"),
        ({"orientation": "LP"}, "three letters"),
        ({"flip": "w"}, "x, y and z"),
        ({"flip": "xx"}, "each once"),
    ),
)
def test_nonsense_is_refused_in_one_sentence(given, words):
    with pytest.raises(RleSplatError, match=words):
        place_volume(Volume(VOXELS, AFFINE), **given)


def test_every_format_takes_the_corrections(tmp_path):
    write_volume(Volume(VOXELS, AFFINE, space=PATIENT), tmp_path / "scan.nii")
    found = read_volume(tmp_path / "scan.nii", spacing=(1.0, 2.0, 4.0), orientation="RAS", flip="z")
    np.testing.assert_allclose(found.spacing, (1.0, 2.0, 4.0))
    assert axis_letters(found.affine) == ("R", "A", "I")
    np.testing.assert_array_equal(found.voxels, VOXELS)
