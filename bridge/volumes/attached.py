"""Objects attached to a volume: its children, which move with it and are resized with the scene scale."""

import numpy as np
from mathutils import Matrix

from .. import presence

SURFACE = "rle_splat_surface"  # custom property of a mesh of the volume's surface


def attach(one, owner, matrix: np.ndarray, basis=None) -> None:
    """Make an object a child of a volume, at a given place.

    Location, rotation and scale cannot shear.  The parent's inverse matrix holds what they leave of ``matrix``, so the
    place is exact for a sheared volume too.

    Parameters
    ----------
    matrix : ndarray or mathutils.Matrix, shape (4, 4)
        The object's own space to the world.
    basis : mathutils.Matrix, optional
        What the object's own location, rotation and scale are to be.  By default those of ``matrix``, as if the object
        had no parent.
    """
    wanted = Matrix(matrix)
    one.matrix_world = wanted  # where Blender does not evaluate the object, as in a disabled collection, this stays
    one.parent = owner
    if basis is not None:
        one.matrix_basis = basis
    one.matrix_parent_inverse = owner.matrix_world.inverted_safe() @ wanted @ one.matrix_basis.inverted_safe()


def is_attached(one, owner) -> bool:
    """Whether an object is a child of a volume object, of this one."""
    return one.parent is not None and one.parent == owner and owner.rle_splat.is_volume


def world_matrix(one, depsgraph) -> np.ndarray:
    """The placement of an object in the world at a depsgraph's time; of a child of a volume also where it is disabled.

    Returns
    -------
    ndarray, shape (4, 4), float64
        The object's own space to the world.
    """
    matrix = one.evaluated_get(depsgraph).matrix_world
    if is_attached(one, one.parent) and not presence.is_kept_up(one, depsgraph):
        matrix = one.parent.evaluated_get(depsgraph).matrix_world @ one.matrix_parent_inverse @ one.matrix_basis
    return np.array(matrix, dtype=np.float64)


def rescale_attached(owner, ratio: float) -> None:
    """Resize what is attached to a volume, about its origin, by the new scene scale over the old one."""
    for one in owner.children:
        if one.rle_splat.clip_only_parent or one.rle_splat.is_slice or SURFACE in one:
            one.matrix_parent_inverse = Matrix.Diagonal((ratio, ratio, ratio, 1.0)) @ one.matrix_parent_inverse


def volume_frame(volume, owner, scale: float) -> np.ndarray:
    """The placement of a volume in the world.

    Parameters
    ----------
    scale : float
        World units per length unit of the volume.

    Returns
    -------
    ndarray, shape (4, 4), float64
        Voxel indices (x, y, z, 1) to the world.
    """
    return np.array(owner.matrix_world, dtype=np.float64) @ np.diag((scale, scale, scale, 1.0)) @ volume.affine
