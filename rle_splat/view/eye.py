"""The homogeneous eye: one formula for orthographic, perspective, shifted, sheared and mirrored views.

The view is expressed in voxel-index space, the only space in which voxel scanlines are parallel to the axes
(algorithm.md 1.4).
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..scene import Camera, RleSplatError
from ..volume.triples import cross, dot
from .projection import depth_row, world_to_pixel

# A matrix whose smallest singular value is below this fraction of its largest flattens the volume.
FLAT = 1e-12


@dataclass(frozen=True, eq=False)
class IndexView:
    """A camera in voxel-index space.

    Attributes
    ----------
    projection : (3, 4) ndarray of float64
        Voxel index (x, y, z, 1) to homogeneous pixel; row 0 at the top.
    depth : (4,) ndarray of float64
        Voxel index (x, y, z, 1) to planar distance ahead of the camera, world units.
    eye : (4,) ndarray of float64
        Homogeneous eye; its last component is 0 for parallel rays, else 1. The ray through a point x has the direction
        ``eye[3] * x - eye[:3]``.
    to_world : (3, 3) ndarray of float64
        Index differences to world differences.
    width, height : int
        Size of the picture in pixels.
    """

    projection: np.ndarray
    depth: np.ndarray
    eye: np.ndarray
    to_world: np.ndarray
    width: int
    height: int

    @property
    def is_parallel(self) -> bool:
        """Whether all rays are parallel (orthographic camera)."""
        return self.eye[3] == 0.0

    def ray_directions(self, columns, rows) -> np.ndarray:
        """(..., 3) float64 index-space directions, of any length, of the rays through pixel positions."""
        columns, rows = np.broadcast_arrays(np.asarray(columns, float), np.asarray(rows, float))
        if self.is_parallel:
            return np.broadcast_to(-self.eye[:3], (*columns.shape, 3))
        # Elementwise, because the bits of a matrix product depend on its size.
        inverse = np.linalg.inv(self.projection[:, :3])
        return np.stack([row[0] * columns + row[1] * rows + row[2] for row in inverse], axis=-1)

    def box_depths(self, shape_xyz, radius: float = 1.0) -> tuple[float, float]:
        """Smallest and largest planar depth of a volume's box, with the footprints of its outermost voxels.

        Parameters
        ----------
        shape_xyz : (nx, ny, nz)
        radius : float
            Radius of the footprint, voxels.

        Returns
        -------
        (float, float)
            World units.
        """
        *along, nearest = self.depth.tolist()
        furthest = nearest
        for step, count in zip(along, shape_xyz):
            ends = -radius * step, (count - 1.0 + radius) * step
            nearest, furthest = nearest + min(ends), furthest + max(ends)
        return nearest, furthest


def index_view(camera: Camera, index_to_world: np.ndarray, width: int, height: int) -> IndexView:
    """Express a camera in voxel-index space.

    Parameters
    ----------
    index_to_world : (4, 4) ndarray of float64
    width, height : int
        Size of the picture in pixels.

    Raises
    ------
    RleSplatError
        If the volume's matrix is singular, or camera and volume differ so much in size that float64 cannot hold both.
    """
    return _index_view(camera, index_to_world.tobytes(), width, height)


@lru_cache(maxsize=8)
def _index_view(camera: Camera, index_to_world: bytes, width: int, height: int) -> IndexView:
    """As ``index_view``; kept for the latest views, each of which is asked for several times a frame."""
    index_to_world = np.frombuffer(index_to_world).reshape(4, 4)
    linear = index_to_world[:3, :3]
    singular = np.linalg.svd(linear, compute_uv=False)
    if not singular[2] > FLAT * singular[0]:
        raise RleSplatError(
            "The volume's matrix is singular and flattens the volume; give it a scale other than zero on every axis."
        )
    projection = world_to_pixel(camera, width, height) @ index_to_world
    depth = depth_row(camera) @ index_to_world
    # Null vector by signed 3x3 minors: no inverse, and no division by a small w. Only their ratios matter, so scaling
    # by a power of two, which changes no bits, keeps the products in the range of float64.
    rows = projection.tolist()
    exponent = math.frexp(max(abs(part) for row in rows for part in row))[1]
    a, b, c, d = zip(*([math.ldexp(part, -exponent) for part in row] for row in rows))
    first, last = cross(a, b), cross(c, d)
    minors = dot(b, last), -dot(a, last), dot(first, d), -dot(first, c)
    if not (all(map(math.isfinite, minors)) and any(minors[:3] if camera.type == "ORTHO" else minors[3:])):
        raise RleSplatError(
            "Camera and volume differ too much in size, or are too far apart, for the arithmetic; bring them closer."
        )
    if camera.type == "ORTHO":
        largest = max(map(abs, minors[:3]))
        eye = np.array([*(minor / largest for minor in minors[:3]), 0.0])
        if dot(depth[:3], eye[:3]) > 0.0:
            eye = -eye
    else:
        eye = np.array([minor / minors[3] for minor in minors])
    return IndexView(projection, depth, eye, np.array(linear), width, height)
