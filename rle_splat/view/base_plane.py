"""The base plane: the plane of the intermediate image, parallel to the slices of one principal axis.

Slices are projected to it along the rays. Because the plane is parallel to the slices, a slice is scaled and moved but
never rotated. Voxel scanlines stay parallel to sheet scanlines, and splatting a row stays a one-dimensional convolution
(paper, section 2). One homography then warps the plane to the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

# Volume axes along a scanline, across scanlines and across slices, per principal axis; the encoder uses the same table.
from ..volume.axes import AXES
from .depth_rules import Sheets, place_sheets
from .eye import IndexView
from .footprints import FOOTPRINTS, VoxelKernel

# Sheet pixels beyond what is visible, so that the warp's filter never lacks a neighbor.
MARGIN = 3
# In strong perspective the densest corner may not ask for more than this multiple of the density at the middle. Sheets
# coarser than QUICK, which are meant to be fast, use the density at the middle.
DENSEST_CORNER, QUICK = 2.0, 0.5

# Windows of a plane begin at a multiple of this many pixels, so that pixels processed together in the whole plane are
# processed together in the window.
ALIGNED = 16
SHORT = 1e-6  # least length of a polygon's side, relative to its longest
SLANTED = 1e-9  # relative tolerance for rounding in the sides of polygons
OFFSET_BITS = 51  # of the 53 bits of a float64; the other two allow to add a plane's pixel numbers twice exactly


@dataclass(frozen=True, eq=False)
class BasePlane:
    """One intermediate image: its geometry, and which of its pixels are needed.

    A ``window`` is a base plane too, with fewer pixels. Results for its pixels have the same bits as in the whole
    plane, because coordinates are integers plus ``origin``, and subtracting integers from ``offset`` is exact.

    Attributes
    ----------
    axis : {0, 1, 2}
        Principal axis: x, y or z.
    sign : {1, -1}
        Viewing direction along the axis.
    reference : float
        Axis position of the base plane, in voxels.
    density : (float, float)
        Sheet pixels per voxel along X and Y.
    origin : (int, int)
        Sheet pixel (u, v), centered at integers, is the base-plane point X = (u + origin[0]) / density[0],
        Y = (v + origin[1]) / density[1], in voxels of the slice at ``reference``.
    width, height : int
        Size in sheet pixels.
    homography : (3, 3) ndarray of float64
        (X, Y, 1) to homogeneous pixel of the picture.
    scale, offset : (n, 2) ndarray of float64
        Per sheet i: u = scale[i, 0] * x + offset[i, 0] for the voxel coordinate x along the scanline; v likewise, with
        index 1, for the scanline number.
    seen : (2, height) ndarray of int64
        For each row, the first pixel that the picture reads and the one after the last. An empty row has end <= first.
    """

    axis: int
    sign: int
    reference: float
    density: tuple[float, float]
    origin: tuple[int, int]
    width: int
    height: int
    homography: np.ndarray
    sheets: Sheets
    scale: np.ndarray
    offset: np.ndarray
    view: IndexView
    seen: np.ndarray

    def window(self, crop: tuple[int, int, int, int], reach: int) -> BasePlane | None:
        """The part of the plane that the pixels of a crop read.

        Parameters
        ----------
        crop : (left, top, right, bottom)
            Pixels of the picture.
        reach : int
            Sheet pixels on either side of a ray that a pixel may read.

        Returns
        -------
        BasePlane or None
            None if the crop reads nothing.
        """
        left, top, right, bottom = crop
        size = np.array((self.width, self.height))
        u0, v0 = self.origin
        u1, v1 = self.origin + size - 1
        # Rays go through pixel centers, half a pixel inside: enough margin for rounding of this polygon.
        corners = np.array(((u0, v0), (u1, v0), (u1, v1), (u0, v1))) / self.density
        polygon = _clip_to_rectangle(self.homography.tolist(), corners.tolist(), left, top, right, bottom)
        if len(polygon) < 3:
            return None
        pixels = np.array([corner[:2] for corner in polygon]) * self.density - self.origin
        return self.part(np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)), reach)

    def part(self, first, last, reach: int) -> BasePlane:
        """Window with the pixels (u, v) from ``first`` to ``last`` inclusive, and ``reach`` more on either side."""
        first, last = (np.asarray(end).astype(np.int64) for end in (first, last))
        last = np.minimum(last + reach, (self.width - 1, self.height - 1))
        first = np.maximum((first - reach) // ALIGNED * ALIGNED, 0)
        width, height = (int(n) for n in last - first + 1)
        origin = tuple(int(n) for n in self.origin + first)
        seen = np.clip(self.seen[:, first[1] : first[1] + height] - first[0], 0, width)
        return replace(self, origin=origin, width=width, height=height, offset=self.offset - first, seen=seen)

    def section(self, number: int, count: int) -> BasePlane | None:
        """The plane with one of ``count`` parts of its sheets, front to back; None if it has fewer and none is left."""
        first, last = (n * len(self.sheets) // count for n in (number, number + 1))
        if first == last:
            return None
        sheets = self.sheets.part(first, last)
        some = slice(last - len(sheets), last)
        return replace(self, sheets=sheets, scale=self.scale[some], offset=self.offset[some])

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Base-plane coordinates X (width,) and Y (height,) of the sheet pixels, float64, read-only."""
        sides = zip((self.width, self.height), self.origin, self.density)
        found = tuple((np.arange(count) + first) / density for count, first, density in sides)
        for coordinates in found:
            coordinates.flags.writeable = False
        return found

    @cached_property
    def ray_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """``slopes`` of the rays of each column (width,) and of each row (height,) of sheet pixels, float64."""
        slopes = self.slopes(*self.points)
        if self.view.is_parallel:  # a single slope
            slopes = (np.broadcast_to(slope, at.shape) for slope, at in zip(slopes, self.points))
        return tuple(slopes)

    def slopes(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """Sideways movement per slice of the rays through base-plane points, in voxels (algorithm.md, 1.4 and 5)."""
        i, j, k = AXES[self.axis]
        eye = self.view.eye
        ahead = eye[3] * self.reference - eye[k]
        return (eye[3] * x - eye[i]) / ahead, (eye[3] * y - eye[j]) / ahead

    def ray_steps(self, x, y) -> np.ndarray:
        """(3, ...) float64 index-space movement x, y, z of the rays per slice along +axis."""
        i, j, k = AXES[self.axis]
        steps = np.empty((3, *np.broadcast_shapes(np.shape(x), np.shape(y))))
        steps[i], steps[j] = self.slopes(x, y)
        steps[k] = 1.0
        return steps

    @cached_property
    def depth_map(self) -> tuple[tuple, tuple]:
        """Two rows of three floats that map (X, Y, 1) to the depth of a ray, which is affine in X and Y.

        The first gives the planar depth at axis position 0, the second its change per voxel of axis position.
        """
        i, j, k = AXES[self.axis]
        row, eye = self.view.depth.tolist(), self.view.eye.tolist()
        ahead = eye[3] * self.reference - eye[k]
        along, across = row[i] / ahead, row[j] / ahead  # depth per slice and unit of slope
        per_voxel = along * eye[3], across * eye[3], row[k] - along * eye[i] - across * eye[j]
        at_reference = row[i], row[j], row[k] * self.reference + row[3]
        return tuple(there - self.reference * step for there, step in zip(at_reference, per_voxel)), per_voxel

    def depth_along(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """Planar depth at axis position 0, and its change per voxel of axis position, of the rays through (X, Y)."""
        # Elementwise, because the bits of a matrix product depend on its size.
        at_zero, per_voxel = (a * x + b * y + c for a, b, c in self.depth_map)
        return at_zero, per_voxel


def _clip_to_rectangle(homography: list, polygon: list, left, top, right, bottom) -> list:
    """The part of a convex base-plane polygon that is visible through a rectangle of the picture, given in its pixels.

    Sutherland and Hodgman's algorithm, in plain Python, because numpy's overhead per call is larger for four corners.

    Returns
    -------
    list of (X, Y, a, b, c)
        Corners, with their homogeneous pixel (a, b, c) = H (X, Y, 1).
    """
    (d, e, f), (g, h, i), (j, k, m) = homography
    polygon = [(x, y, d * x + e * y + f, g * x + h * y + i, j * x + k * y + m) for x, y in polygon]
    # Inside means left <= a/c <= right and top <= b/c <= bottom with c > 0.
    for sign, along, end in ((1.0, 2, left), (-1.0, 2, right), (1.0, 3, top), (-1.0, 3, bottom)):
        sides = [sign * (corner[along] - end * corner[4]) for corner in polygon]
        if all([side >= 0.0 for side in sides]):  # as with most sides of most views
            continue
        kept = []
        for corner, following, side, beyond in zip(polygon, polygon[1:] + polygon[:1], sides, sides[1:] + sides[:1]):
            if side >= 0.0:
                kept.append(corner)
            if (side >= 0.0) != (beyond >= 0.0):
                share = side / (side - beyond)
                kept.append(tuple([one + (two - one) * share for one, two in zip(corner, following)]))
        polygon = kept
    return polygon


def _sides(polygon: list) -> list:
    """Half-planes (a, b, c), a X + b Y + c >= 0, whose intersection is a convex counterclockwise polygon."""
    edges = [(x, y, u - x, v - y) for (x, y, *_), (u, v, *_) in zip(polygon, (*polygon[1:], polygon[0]))]
    longest = max(math.hypot(dx, dy) for *_, dx, dy in edges)
    # Corners that differ by rounding only give no direction.
    return [(-dy, dx, dy * x - dx * y) for x, y, dx, dy in edges if math.hypot(dx, dy) > SHORT * longest]


def _find_slanted_sides(one: list, two: list) -> list:
    """Half-planes, as of ``_sides``, of the slanted sides of the convex hull of two axis-aligned rectangles.

    Each rectangle is given by its four corners, in the same order.
    """
    found = []
    for (x, y), (u, v) in zip(one, two):
        a, b, c = y - v, u - x, (v - y) * x - (u - x) * y
        distances = [a * x + b * y + c for x, y in (*one, *two)]
        least, most = min(distances), max(distances)
        slack = SLANTED * max(-least, most)
        if slack > 0.0 and (least >= -slack or most <= slack):
            found.append((a, b, c) if least >= -slack else (-a, -b, -c))
    return found


def _columns_within(sides: list, origin, width: int, height: int) -> np.ndarray:
    """(2, height) int64, see ``BasePlane.seen``.

    ``sides``: half-planes as of ``_sides``, in sheet pixels; ``origin``: number of the first pixel.
    """
    rows = np.arange(origin[1], origin[1] + height, dtype=np.float64)
    # Slope and column of the first row; of the right sides negated, so that the largest counts of both.  Columns are
    # counted from the origin.
    left, right = [(0.0, 0.0)], [(0.0, -float(width))]
    level = []
    for a, b, c in sides:
        if abs(a) <= SLANTED * abs(b):  # parallel to the rows: it keeps or removes whole rows
            level.append(b * rows + c < 0.0)
        elif a > 0.0:
            left.append((-b / a, -c / a - origin[0]))
        else:
            right.append((b / a, c / a + origin[0] - 1.0))
    most = max(len(left), len(right))
    ends = np.array([[*side, *side[:1] * (most - len(side))] for side in (left, right)])
    columns = np.maximum.reduce(ends[..., :1] * rows + ends[..., 1:], axis=1)
    np.ceil(columns, out=columns)
    first, end = columns
    np.negative(end, out=end)
    for outside in level:
        end[outside] = first[outside]
    np.minimum(first, width, out=first)
    np.maximum(end, 0.0, out=end)
    return columns.astype(np.int64)


def _on_plane(eye: list, axes, reference: float, position):
    """Scale of the slice at ``position`` on the base plane, and its move as a share of the eye's sideways position.

    ``position``: a float or an array of them (algorithm.md, 1.4 and 3).
    """
    k = axes[2]
    beyond = eye[3] * position - eye[k]
    return (eye[3] * reference - eye[k]) / beyond, (position - reference) / beyond


def _exactly_movable(offsets: np.ndarray, furthest: float) -> None:
    """Round offsets in pixels, in place, to a power of two so large that adding integers is exact.

    ``furthest``: the largest offset or integer.  The rounding error is below 2**-OFFSET_BITS of it, which is invisible.
    """
    unit = math.ldexp(1.0, math.frexp(furthest)[1] - OFFSET_BITS)
    offsets /= unit
    np.rint(offsets, out=offsets)
    offsets *= unit


def base_plane(
    view: IndexView, shape_xyz: tuple[int, int, int], axis: int, sign: int, rule: str, sheet_density: float,
    footprint: VoxelKernel = FOOTPRINTS["tent"], boxed: bool = False, reach: int | None = None,
) -> BasePlane | None:  # fmt: skip
    """Make the base plane of one principal axis and direction.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)
    axis : {0, 1, 2}
    sign : {1, -1}
    rule : str
        Depth rule.
    sheet_density : float
        Sheet pixels per image pixel; 0 for one sheet pixel per voxel at the reference.
    boxed : bool
        Whether the medium ends at the voxel centers; else the footprints of the outermost voxels extend beyond.
    reach : int or None
        Sheet pixels on either side of a ray that a pixel of the picture may read; None if the whole plane is needed.

    Returns
    -------
    BasePlane or None
        None if no visible ray belongs to this axis and direction.
    """
    axes = i, j, k = AXES[axis]
    eye = view.eye.tolist()
    counts = [float(shape_xyz[a]) for a in axes]
    eye_position = None if view.is_parallel else eye[k]
    sheets = place_sheets(int(counts[2]), sign, rule, eye_position, footprint, boxed)
    radius = 0.0 if boxed else footprint.radius
    if len(sheets) == 0:
        return None
    reference = float(sheets.position[0])
    if not view.is_parallel and sign * (reference - eye_position) < 1.0:
        reference = eye_position + sign
    # Extent of the volume with the footprints of its outermost voxels. It is monotone in depth, so the ends decide.
    ends = [_on_plane(eye, axes, reference, float(sheets.position[end])) for end in (0, -1)]
    low = [min(away * eye[n] - radius * scale for scale, away in ends) for n in (i, j)]
    far = [count - 1.0 + radius for count in counts]
    high = [max(away * eye[n] + last * scale for scale, away in ends) for n, last in zip((i, j), far)]
    homography = [[row[i], row[j], row[3] + reference * row[k]] for row in view.projection.tolist()]

    def window(pixel_margin, slope_margin):
        """Visible part of the plane as a polygon, a list of points; margins in pixels of the picture and in slopes."""
        least, most = low, high
        if not view.is_parallel:
            ahead = abs(reference - eye_position)
            reach = ahead * (1.0 + slope_margin)
            eye_at = eye[i], eye[j]
            least = [max(end, at - reach) for end, at in zip(low, eye_at)]
            most = [min(end, at + reach) for end, at in zip(high, eye_at)]
            if any(a >= b for a, b in zip(least, most)):
                return []
        polygon = [(least[0], least[1]), (most[0], least[1]), (most[0], most[1]), (least[0], most[1])]
        margin = pixel_margin
        return _clip_to_rectangle(homography, polygon, -margin, -margin, view.width + margin, view.height + margin)

    polygon = window(0.0, 0.0)
    if len(polygon) < 3:
        return None
    density = _density(homography, polygon, sheet_density)
    # A margin of one image pixel and MARGIN sheet pixels on every side.
    slack = 0.0 if view.is_parallel else MARGIN / max(min(density) * abs(reference - eye_position), 1e-300)
    polygon = window(1.0 + MARGIN / max(sheet_density, 0.5), slack)
    spans = [(min(along) * each, max(along) * each) for along, each in zip(zip(*polygon), density)]
    first = [math.floor(least) - MARGIN for least, _ in spans]
    last = [math.ceil(most) + MARGIN for _, most in spans]
    size = [end - begin + 1 for begin, end in zip(first, last)]
    sides = []
    if reach is not None:
        outline = _outline(eye, axes, sign, reference, sheets, counts, radius)
        for a, b, c in _sides(polygon) + outline:
            a, b = a / density[0], b / density[1]
            sides.append((a, b, c + (reach + MARGIN) * (abs(a) + abs(b))))
    seen = _columns_within(sides, first, *size)
    scale, away = _on_plane(eye, axes, reference, sheets.position)
    pixels_away = eye[i] * density[0], eye[j] * density[1]
    offsets = np.multiply.outer(away, pixels_away)
    furthest = max(abs(one * share) for one in pixels_away for _, share in ends)
    _exactly_movable(offsets, max(furthest, *map(abs, (*first, *last)), 1.0))
    offsets -= first
    return BasePlane(
        axis, sign, reference, tuple(density), tuple(first), *size, np.array(homography), sheets,
        np.multiply.outer(scale, density), offsets, view, seen,
    )  # fmt: skip


def _outline(eye: list, axes, sign: int, reference: float, sheets: Sheets, counts, radius: float) -> list:
    """Half-planes, as of ``_sides``, of the slanted sides of the volume's outline on the plane.

    The volume has ``counts`` voxels with footprints of ``radius``. The result is empty if the eye is so near that the
    outline is not bounded.
    """
    ends = float(sheets.begin[0]), float(max(sheets.end[-1], sheets.far[-1]))
    if eye[3] != 0.0 and ends[0] - sign * eye[axes[2]] < 1.0:
        return []
    rectangles = []
    for end in ends:
        scale, away = _on_plane(eye, axes, reference, sign * end)
        moves = away * eye[axes[0]], away * eye[axes[1]]
        left, top = (move - radius * scale for move in moves)
        right, bottom = (move + (count - 1.0 + radius) * scale for move, count in zip(moves, counts))
        rectangles.append([(left, top), (right, top), (right, bottom), (left, bottom)])
    return _find_slanted_sides(*rectangles)


def _density(homography: list, polygon: list, sheet_density: float) -> list:
    """Two: sheet pixels per voxel along X and Y that give ``sheet_density`` sheet pixels per image pixel.

    ``polygon``: of ``_clip_to_rectangle``.
    """
    if sheet_density == 0.0:
        return [1.0, 1.0]
    middle = [sum(along) / len(polygon) for along in zip(*polygon)]
    cap = DENSEST_CORNER if sheet_density >= QUICK else 1.0
    density = []
    for across, down, weight in list(zip(*homography))[:2]:
        # Image pixels per voxel along X, then Y, at each point; without bound where it is beside the eye.
        stretch = [
            math.hypot(across * c - a * weight, down * c - b * weight) / (c * c) if c * c > 0.0 else math.inf
            for *_, a, b, c in (*polygon, middle)
        ]
        density.append(sheet_density * min(max(stretch), cap * stretch[-1]))
    return density
