"""Corrections of what a file says of its grid: spacing, orientation and mirrored axes.  Voxels stay as they are."""

from dataclasses import replace

import numpy as np

from ..scene import RleSplatError, as_float
from .orientation import LETTERS, directions
from .volume import PATIENT, Volume

AXES = "xyz"


def place_volume(volume: Volume, spacing=None, orientation: str | None = None, flip: str | None = None) -> Volume:
    """A volume with another affine.

    Parameters
    ----------
    spacing : (3,) sequence of float, optional
        Distance between voxel centers along the voxel axes x, y, z, in the volume's unit. The first voxel stays.
    orientation : str, optional
        Three letters, the directions of a patient in which the voxel indices x, y, z grow, such as "LPS". The volume
        turns about the center of its box, and is in patient space from then on.
    flip : str, optional
        Voxel axes along which the volume is mirrored, such as "x" or "xz". The box stays.

    Raises
    ------
    RleSplatError
        If a spacing is not above zero, or orientation or flip name no axes.
    """
    affine, space = volume.affine.copy(), volume.space
    lengths = volume.spacing if spacing is None else _check_spacing(spacing)
    if spacing is not None:
        affine[:3, :3] = directions(affine) * lengths
    middle = 0.5 * (np.array(volume.shape_xyz) - 1.0)
    if orientation:
        center = affine[:3, :3] @ middle + affine[:3, 3]
        affine[:3, :3] = _axes_of(orientation) * lengths
        affine[:3, 3] = center - affine[:3, :3] @ middle
        space = PATIENT
    if flip:
        mirror = np.eye(4)
        for axis in _flip(flip):
            mirror[axis, axis], mirror[axis, 3] = -1.0, 2.0 * middle[axis]
        affine = affine @ mirror
    return replace(volume, affine=affine, space=space)


def _check_spacing(spacing) -> np.ndarray:
    try:
        lengths = np.array([as_float(length) for length in spacing])
    except TypeError:
        lengths = np.zeros(0)
    if lengths.shape != (3,) or not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        raise RleSplatError(f"The spacing must be three numbers above zero, not {spacing!r}.")
    return lengths


def _axes_of(orientation: str) -> np.ndarray:
    """(3, 3) float64: unit vectors of LPS as columns, one for each letter."""
    found = [
        (axis, 2.0 * ends.index(letter) - 1.0)
        for letter in str(orientation).upper() for axis, ends in enumerate(LETTERS) if letter in ends
    ]  # fmt: skip
    if len(str(orientation)) != 3 or sorted(axis for axis, _sign in found) != [0, 1, 2]:
        raise RleSplatError(
            f"The orientation must be three letters, one each of R or L, A or P and I or S, not {orientation!r}."
        )
    axes = np.zeros((3, 3))
    for column, (axis, sign) in enumerate(found):
        axes[axis, column] = sign
    return axes


def _flip(flip: str) -> list[int]:
    """Indices of the axes to mirror."""
    if not set(str(flip)) <= set(AXES) or len(set(str(flip))) < len(str(flip)):
        raise RleSplatError(f"The axes to flip must be some of x, y and z, each once, such as xz, not {flip!r}.")
    return [axis for axis, letter in enumerate(AXES) if letter in flip]
