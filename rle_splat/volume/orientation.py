"""Patient space: letters of directions, and affines from the conventions of other programs.

LPS: +x points to the patient's left, +y to the back (posterior), +z to the head (superior). It is the space of DICOM
and of Blender's world here. RAS, the space of NIfTI, points right, to the front and to the head.
"""

from itertools import permutations

import numpy as np

LETTERS = ("RL", "AP", "IS")  # of the two ends of the axes of LPS, the low end first
SECOND = np.sin(np.radians(22.5))  # share of a direction from which a side has a letter beside the first
LEAST_OBLIQUE = 0.05  # degrees; less is not worth a word
LPS_FROM_RAS = np.diag((-1.0, -1.0, 1.0, 1.0))


def lps_from_ras(affine) -> np.ndarray:
    """Convert a (4, 4) affine from voxel indices to RAS into one to LPS."""
    return LPS_FROM_RAS @ np.asarray(affine, dtype=np.float64)


def directions(affine) -> np.ndarray:
    """(3, 3) float64: unit vectors of the voxel axes as columns; zero for an axis without length."""
    axes = np.asarray(affine, dtype=np.float64)[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    return axes / np.where(lengths > 0.0, lengths, 1.0)


def nearest_axes(affine) -> tuple[tuple[int, int], ...]:
    """The axis of space that each voxel axis is nearest to.

    Parameters
    ----------
    affine : (4, 4) array_like
        Voxel indices to space.

    Returns
    -------
    tuple of (axis, sign)
        One pair for each voxel axis: an axis of space (0, 1, 2), each of them once, and the direction along it, 1 or
        -1. Of all assignments, the one with the largest sum of cosines.
    """
    cosines = directions(affine)
    best = max(permutations(range(3)), key=lambda order: sum(abs(cosines[axis, i]) for i, axis in enumerate(order)))
    return tuple((axis, -1 if cosines[axis, i] < 0.0 else 1) for i, axis in enumerate(best))


def axis_letters(affine) -> tuple[str, str, str]:
    """Letters of the directions in which the voxel indices x, y, z grow, such as ("L", "P", "S"); for LPS."""
    return tuple(LETTERS[axis][sign > 0] for axis, sign in nearest_axes(affine))


def letters_of(direction) -> str:
    """Letters of the sides to which a unit vector in LPS points, the nearest first, at most two."""
    order = np.argsort(-np.abs(direction), kind="stable")
    named = [axis for place, axis in enumerate(order[:2]) if place == 0 or abs(direction[axis]) > SECOND]
    return "".join(LETTERS[axis][int(direction[axis] > 0.0)] for axis in named)


def oblique_degrees(affine) -> float:
    """Largest angle between a voxel axis and the axis of space that it is nearest to, in degrees."""
    cosines = directions(affine)
    found = []
    for i, (axis, _) in enumerate(nearest_axes(affine)):
        across = np.delete(cosines[:, i], axis)
        found.append(np.arctan2(np.linalg.norm(across), abs(cosines[axis, i])))  # exact for small angles too
    return float(np.degrees(max(found)))


def orientation_text(affine) -> str:
    """Letters and obliqueness of an affine to LPS, such as "voxel axes L, P, S; 12.3 degrees oblique"."""
    degrees = oblique_degrees(affine)
    oblique = f"; {degrees:.1f} degrees oblique" if degrees >= LEAST_OBLIQUE else ""
    return f"voxel axes {', '.join(axis_letters(affine))}{oblique}"


def short_orientation_text(affine) -> str:
    """As ``orientation_text`` for a narrow panel, such as "L P S, 12.3° oblique"."""
    degrees = oblique_degrees(affine)
    return " ".join(axis_letters(affine)) + (f", {degrees:.1f}° oblique" if degrees >= LEAST_OBLIQUE else "")
