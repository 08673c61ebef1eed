"""Boxes from near to far: which overlap, and which of two that do not hides the other.

A box is the (8, 3) world coordinates of the corners of a volume, of any shape that an affine matrix makes of a cube,
corner number 4 z + 2 y + x.
"""

import numpy as np

from ..scene import Camera
from .projection import world_to_camera

EDGES = (1, 2, 4)  # corners at the ends of the three edges from corner 0


def box_of(index_to_world: np.ndarray, shape_xyz, beyond: float = 1.0) -> np.ndarray:
    """(8, 3) float64 corners of all that a volume shows.

    Parameters
    ----------
    index_to_world : (4, 4) ndarray of float64
    shape_xyz : (nx, ny, nz)
        Number of voxels.
    beyond : float
        Voxels by which footprints reach beyond the outermost voxel centers.
    """
    far = np.array([[corner & 1, corner >> 1 & 1, corner >> 2] for corner in range(8)], np.float64)
    index = far * (np.asarray(shape_xyz, np.float64) - 1.0 + 2.0 * beyond) - beyond
    return index @ index_to_world[:3, :3].T + index_to_world[:3, 3]


def near_to_far(boxes: list[np.ndarray], camera: Camera) -> list[list[int]]:
    """Groups of boxes, from near to far.

    Parameters
    ----------
    boxes : list of (8, 3) ndarray

    Returns
    -------
    list of list of int
        Numbers of boxes. Those of a group overlap, or hide each other in a circle; no box of a group is hidden by one
        of a later group.
    """
    groups = [[n] for n in range(len(boxes))]
    hides = {(a, b): _hides(boxes[a], boxes[b], camera) for a in range(len(boxes)) for b in range(len(boxes)) if a != b}
    found = []
    while groups:
        free = [one for one in groups if not any(_any(hides, other, one) for other in groups if other is not one)]
        if free:
            found.append(free[0])
            groups.remove(free[0])
        else:
            groups = _join(groups, hides)
    return found


def _any(hides: dict, group: list[int], other: list[int]) -> bool:
    """Whether any box of a group may hide one of another."""
    return any(hides[a, b] for a in group for b in other)


def _join(groups: list[list[int]], hides: dict) -> list[list[int]]:
    """The groups with one circle of groups joined: each hides the next, and the last the first."""
    path = [groups[0]]
    while True:
        before = next(one for one in groups if one is not path[-1] and _any(hides, one, path[-1]))
        if any(one is before for one in path):
            break
        path.append(before)
    at = next(n for n, one in enumerate(path) if one is before)
    circle = path[at:]
    rest = [one for one in groups if not any(one is other for other in circle)]
    return [*rest, sorted(n for one in circle for n in one)]


def _hides(box: np.ndarray, other: np.ndarray, camera: Camera) -> bool:
    """Whether a part of a box may lie in front of a part of another."""
    to_camera = world_to_camera(camera)
    ahead = -to_camera[2, :3]
    eye = None if camera.type == "ORTHO" else np.linalg.inv(to_camera)[:3, 3]
    for axis in _axes(box, other):
        low, high = box @ axis, other @ axis
        if low.max() > high.min():
            low, high, axis = -low, -high, -axis
        if low.max() > high.min():
            continue  # not separated along this axis
        # The box is on the lower side of a plane between; it is seen first from that side.
        towards = float(ahead @ axis) if eye is None else 0.5 * float(low.max() + high.min()) - float(eye @ axis)
        if towards <= 0.0:
            return False
    return True


def _axes(box: np.ndarray, other: np.ndarray) -> list[np.ndarray]:
    """Directions along one of which two boxes are separated if they do not overlap: of faces, and of pairs of edges."""
    edges = [[one[end] - one[0] for end in EDGES] for one in (box, other)]
    pairs = [(a, b) for mine in edges for n, a in enumerate(mine) for b in mine[n + 1 :]]
    pairs += [(a, b) for a in edges[0] for b in edges[1]]
    crossed = [np.cross(a, b) for a, b in pairs]
    return [axis / np.linalg.norm(axis) for axis in crossed if np.linalg.norm(axis) > 1e-12 * np.abs(box).max()]
