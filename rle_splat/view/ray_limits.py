"""Ray limits: where the rays of sheet pixels begin and end, for clip distances and for meshes in the volume."""

from __future__ import annotations

import numpy as np

from ..axes import AXES
from .base_plane import BasePlane
from .eye import IndexView

# Depths of neighbouring pixels closer than this part of their mean lie on one surface.
SAME_SURFACE = 0.02


def box_depths(view: IndexView, shape_xyz, radius: float = 1.0) -> tuple[float, float]:
    """Least and largest planar depth of the volume's box, footprints of its face voxels included; world units.

    ``radius``: of the footprint, voxels.
    """
    corners = np.array(np.meshgrid(*((-radius, n - 1.0 + radius) for n in shape_xyz), indexing="ij")).reshape(3, -1)
    depths = view.depth[:3] @ corners + view.depth[3]
    return float(depths.min()), float(depths.max())


def ray_limits(
    plane: BasePlane, nearest: float, furthest: float, layer: np.ndarray | None = None, first_pixel=(0, 0)
) -> np.ndarray:
    """(2, H, W) float32: where each sheet pixel's ray begins and ends, voxels along the viewing direction.

    ``nearest`` and ``furthest``: planar depths, world units.  ``layer``: (rows, columns) planar depth at which each
    pixel's ray meets a mesh, inf for none, of the picture's pixels from ``first_pixel`` (column, row) on; it must
    hold ``pixels_read(plane)``.
    """
    x, y = (a.astype(np.float64) for a in plane.points())
    at_zero, per_voxel = plane.depth_along(x[None, :], y[:, None])
    per_voxel = plane.sign * per_voxel
    end = np.full(at_zero.shape, furthest)
    if layer is not None:
        end = np.minimum(end, _sampled(layer, first_pixel, *_picture_positions(plane)))
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = np.stack(((nearest - at_zero) / per_voxel, (end - at_zero) / per_voxel))
    sideways = ~(per_voxel > 0.0)  # never visible: such a ray runs across or against the camera's axis
    limits[0][sideways], limits[1][sideways] = -np.inf, np.inf
    most = np.finfo(np.float32).max
    return np.clip(limits, -most, most).astype(np.float32)


def within_box(plane: BasePlane, shape_xyz, limits: np.ndarray | None = None) -> np.ndarray:
    """(2, H, W) float32: where each sheet pixel's ray enters and leaves the box of the voxel centres and, given
    ``limits`` as of ``ray_limits``, which are written to, where it is within those as well."""
    ends = np.sort((0.0, plane.sign * (shape_xyz[plane.axis] - 1.0)))
    if limits is None:
        limits = np.empty((2, plane.height, plane.width), np.float32)
        limits[0], limits[1] = ends
    np.clip(limits, *ends, out=limits)
    columns, rows = box_limits(plane, shape_xyz)
    for sides in (columns[:, None, :], rows[:, :, None]):
        np.maximum(limits[0], sides[0], out=limits[0])
        np.minimum(limits[1], sides[1], out=limits[1])
    return limits


def pixels_read(plane: BasePlane) -> tuple[int, int, int, int]:
    """(left, top, right, bottom): the part of the picture from which ``ray_limits`` reads a layer for this plane."""
    column, row = _picture_positions(plane)
    return int(column.min()), int(row.min()), int(column.max()) + 2, int(row.max()) + 2


def _picture_positions(plane: BasePlane) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (H, W) of each sheet pixel among the centres of the picture's pixels, cut off at its sides."""
    x, y = plane.points()
    h = plane.homography
    a, b, c = (h[i, 0] * x[None, :] + h[i, 1] * y[:, None] + h[i, 2] for i in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        column = np.clip(np.nan_to_num(a / c) - 0.5, 0.0, plane.view.width - 1.0)
        row = np.clip(np.nan_to_num(b / c) - 0.5, 0.0, plane.view.height - 1.0)
    return column, row


def _sampled(layer: np.ndarray, first_pixel, column, row) -> np.ndarray:
    """The layer at positions in the picture: linear on one surface, the nearest pixel's value elsewhere."""
    height, width = layer.shape
    left, top = first_pixel
    whole_column, whole_row = column.astype(np.intp), row.astype(np.intp)
    c0, r0 = whole_column - left, whole_row - top
    c1, r1 = np.minimum(c0 + 1, width - 1), np.minimum(r0 + 1, height - 1)
    corners = layer[r0, c0], layer[r0, c1], layer[r1, c0], layer[r1, c1]
    least = np.minimum(np.minimum(corners[0], corners[1]), np.minimum(corners[2], corners[3]))
    most = np.maximum(np.maximum(corners[0], corners[1]), np.maximum(corners[2], corners[3]))
    with np.errstate(invalid="ignore"):
        smooth = np.isfinite(most) & (most - least <= SAME_SURFACE * np.abs(most))
        fc, fr = column - whole_column, row - whole_row
        linear = (1 - fr) * ((1 - fc) * corners[0] + fc * corners[1]) + fr * ((1 - fc) * corners[2] + fc * corners[3])
    nearest = layer[np.rint(row).astype(np.intp) - top, np.rint(column).astype(np.intp) - left]
    return np.where(smooth, linear, nearest)


def box_limits(plane: BasePlane, shape_xyz) -> tuple[np.ndarray, np.ndarray]:
    """(2, W) and (2, H) float32: where the rays of each column and of each row of sheet pixels enter and leave the
    box of the voxel centres sideways, voxels along the viewing direction.

    A ray through column u and row v is inside between the later of both entries and the earlier of both exits: a
    slice's place sideways depends on its column along the scanlines, and on its row across them, alone.
    """
    found = []
    points = plane.points()
    for place, slope, axis in zip(points, plane.slopes(*points), AXES[plane.axis]):
        place, slope = np.broadcast_arrays(place, np.float64(slope))
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack(((0.0 - place) / slope, (shape_xyz[axis] - 1.0 - place) / slope)) + plane.reference
        ends = np.sort(plane.sign * ends, axis=0)
        straight = slope == 0.0
        inside = (place >= 0.0) & (place <= shape_xyz[axis] - 1.0)
        ends[0] = np.where(straight, np.where(inside, -np.inf, np.inf), ends[0])
        ends[1] = np.where(straight, np.where(inside, np.inf, -np.inf), ends[1])
        most = np.finfo(np.float32).max
        found.append(np.clip(ends, -most, most).astype(np.float32))
    return tuple(found)
