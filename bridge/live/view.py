"""The view of a viewport as a Camera, from the two matrices that Blender draws it with.

A window matrix holds lens, shift and aspect of any view: perspective, orthographic, and through a camera with zoom and
offset.  Rows are from the top here, as in the renderer; Blender counts them from the bottom.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...rle_splat.scene import Camera, RleSplatError

SENSOR = 36.0  # mm; lens and sensor only count by their ratio
FLAT = 1e-12  # a view matrix whose axes span less than this is degenerate
BAND = 64  # rows of depths at a time, which stay in the processor's cache
AROUND = 16  # pixels read beside those that are shown: the depth layers of a pixel depend on its neighbors


@dataclass(frozen=True)
class Matrices:
    """What a viewport is drawn with; compared by value.

    Attributes
    ----------
    view, window : tuple of 16 floats
        World to view space, and view space to clip space, row by row.
    width, height : int
        Pixels of the region.
    clip : (start, end) or None
        Clip distances of a perspective view in world units. None takes them from the window matrix, whose single
        precision leaves few digits of a distant end.
    """

    view: tuple
    window: tuple
    width: int
    height: int
    clip: tuple | None = None


@dataclass(frozen=True, eq=False)
class ViewportView:
    """A viewport's view for the renderer.

    Attributes
    ----------
    width, height : int
        Pixels of the picture.
    window : (4, 4) ndarray of float64
        View space to clip space.
    set_back : float
        World units by which the camera of an orthographic view stands behind the view's own origin, because the view
        also shows what is behind it. 0 for perspective.
    """

    camera: Camera
    width: int
    height: int
    window: np.ndarray
    set_back: float


def view_of(matrices: Matrices, nearest: float = np.inf) -> ViewportView:
    """The camera that sees what a viewport sees.

    Parameters
    ----------
    nearest : float
        Smallest depth ahead of the view's origin of what is to be shown, world units; only used for orthographic views
        that begin behind their origin.

    Raises
    ------
    RleSplatError
        For matrices that are not finite, flat or no projection, and a region without pixels.
    """
    width, height = matrices.width, matrices.height
    view, window = (np.array(rows, np.float64).reshape(4, 4) for rows in (matrices.view, matrices.window))
    _check(view, window, width, height)
    to_world = np.linalg.inv(view)
    to_world[3] = 0.0, 0.0, 0.0, 1.0
    parallel = window[3, 3] != 0.0
    across = float(window[0, 0])
    right = -window[0, 3] if parallel else window[0, 2]  # the principal point, in half widths from the middle
    begin, end = _clip_distances(window, parallel)
    if matrices.clip is not None and not parallel:
        begin, end = matrices.clip
    set_back = 0.0
    if parallel and begin <= 0.0:
        reach = end - begin
        begin = max(begin, min(nearest, end) - 0.01 * reach)
        set_back = max(0.01 * reach - begin, 0.0)
    begin, end = begin + set_back, end + set_back
    to_world[:3, 3] += set_back * to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])
    camera = Camera(
        matrix_world=to_world, type="ORTHO" if parallel else "PERSP", sensor_fit="HORIZONTAL", sensor_width=SENSOR,
        lens=0.5 * SENSOR * across, ortho_scale=2.0 / across, shift_x=float(0.5 * right), clip_start=begin,
        clip_end=end, **_of_size(window, width, height),
    )  # fmt: skip
    return ViewportView(camera, width, height, window, set_back)


def _of_size(window: np.ndarray, width: int, height: int) -> dict:
    """What of a Camera depends on the size of its picture, by name."""
    tall = width * float(window[0, 0]) / (height * float(window[1, 1]))  # height of a pixel in widths of a pixel
    above = -window[1, 3] if window[3, 3] != 0.0 else window[1, 2]  # the principal point, in half heights
    return {"pixel_aspect": (1.0, tall), "shift_y": float(0.5 * above * height * tall / width)}


def resized(view: ViewportView, width: int, height: int) -> ViewportView:
    """The same view in another size, from the same place."""
    camera = replace(view.camera, **_of_size(view.window, width, height))
    return replace(view, camera=camera, width=width, height=height)


def _check(view: np.ndarray, window: np.ndarray, width: int, height: int) -> None:
    if width < 1 or height < 1:
        raise RleSplatError(f"The viewport has {width} x {height} pixels; enlarge it to see the volume.")
    if not (np.isfinite(view).all() and np.isfinite(window).all()):
        raise RleSplatError("The view's matrix is not finite; reset the view with Home.")
    axes = view[:3, :3]
    if abs(np.linalg.det(axes)) <= FLAT * np.prod(np.linalg.norm(axes, axis=0)) or not axes.any():
        raise RleSplatError("The view's matrix is flat; reset the view with Home.")
    scale = window[2, 2] if window[3, 3] != 0.0 else window[2, 3]
    if not (window[0, 0] > 0.0 and window[1, 1] > 0.0 and scale < 0.0):
        raise RleSplatError("The view's projection is flat; reset the view with Home.")


def _clip_distances(window: np.ndarray, parallel: bool) -> tuple[float, float]:
    """Depths ahead of the view's origin at which clip space begins and ends."""
    slope, offset = window[2, 2], window[2, 3]
    with np.errstate(divide="ignore"):
        near = (offset + 1.0) / slope if parallel else offset / (slope - 1.0)
        far = (offset - 1.0) / slope if parallel else offset / (slope + 1.0)
    return float(near), float(far) if np.isfinite(far) and far > near else 1e6 * max(abs(float(near)), 1.0)


def pixels_of(view: ViewportView, corners: np.ndarray) -> tuple[int, int, int, int] | None:
    """The part of a view's picture that holds some points and everything between them.

    Parameters
    ----------
    corners : (n, 3) array_like
        World coordinates of the corners of a convex body.

    Returns
    -------
    (left, top, right, bottom) or None
        Half-open; the whole picture where a corner is beside or behind the eye. None where no pixel shows the body.
    """
    placed = np.column_stack((corners, np.ones(len(corners)))) @ np.linalg.inv(view.camera.matrix_world).T
    clip = placed @ _of_camera(view).T
    whole = 0, 0, view.width, view.height
    if (clip[:, 3] <= 0.0).all():
        return None
    if (clip[:, 3] <= 1e-6 * np.abs(clip[:, 3]).max()).any():
        return whole
    columns = 0.5 * view.width * (1.0 + clip[:, 0] / clip[:, 3])
    rows = 0.5 * view.height * (1.0 - clip[:, 1] / clip[:, 3])
    left, top = max(int(np.floor(columns.min())) - 2, 0), max(int(np.floor(rows.min())) - 2, 0)
    right = min(int(np.ceil(columns.max())) + 2, view.width)
    bottom = min(int(np.ceil(rows.max())) + 2, view.height)
    return (left, top, right, bottom) if left < right and top < bottom else None


def _of_camera(view: ViewportView) -> np.ndarray:
    """(4, 4) camera space to clip space: the window matrix from where the camera really stands."""
    moved = np.eye(4)
    moved[2, 3] = view.set_back
    return view.window @ moved


def with_margin(pixels, width: int, height: int, margin: int = AROUND) -> tuple[int, int, int, int]:
    """Pixels (left, top, right, bottom) with a margin, within the picture."""
    left, top, right, bottom = pixels
    return max(left - margin, 0), max(top - margin, 0), min(right + margin, width), min(bottom + margin, height)


def eye_of(view_matrix, is_perspective: bool) -> np.ndarray:
    """(4,) float64: where a view is seen from in the world, homogeneous; the last number is 0 for parallel rays.

    Parameters
    ----------
    view_matrix : (4, 4) array_like
        World to view space; the view looks along its own -Z.
    is_perspective : bool
        Or orthographic.
    """
    return np.linalg.inv(np.array(view_matrix, np.float64))[:, 3 if is_perspective else 2]


def ray_ends(view: ViewportView, buffer: np.ndarray, part) -> np.ndarray:
    """The depths at which a viewport's framebuffer ends rays.

    Parameters
    ----------
    view : ViewportView
        Of the region's own size.
    buffer : (rows, columns) ndarray of float32
        The framebuffer's depth, 0 to 1, the lowest row first, of a part of the region.
    part : (left, top, right, bottom)
        That part, row 0 at the top.

    Returns
    -------
    (height, width) ndarray of float32
        Planar depth from the view's camera in world units, of the whole picture; inf where nothing was drawn, and
        outside the part.
    """
    left, top, right, bottom = part
    found = np.full((view.height, view.width), np.inf, np.float32)
    upward = found[top:bottom, left:right][::-1]
    slope, offset = view.window[2, 2], view.window[2, 3]
    for first in range(0, len(buffer), BAND):
        band = slice(first, first + BAND)
        is_drawn = buffer[band] < 1.0
        depth = buffer[band][is_drawn].astype(np.float64)
        # In perspective the reciprocal of the depth is affine in the buffer's number, in other views the depth itself.
        if view.window[3, 3]:
            depth *= -2.0 / slope
            depth += (offset + 1.0) / slope + view.set_back
        else:
            depth *= 2.0 / offset
            depth += (slope - 1.0) / offset
            with np.errstate(divide="ignore"):
                np.reciprocal(depth, out=depth)
        upward[band][is_drawn] = depth
    return found


def furthest_of_blocks(depths: np.ndarray, side: int) -> np.ndarray:
    """Of each block of ``side`` x ``side`` pixels the furthest depth, also of the pixels around it.

    So lines of up to ``side`` + 1 pixels, such as those of boxes, end no ray of a draft, whose sheets would show
    dashes.

    Parameters
    ----------
    depths : (H, W) ndarray of float32

    Returns
    -------
    (ceil(H / side), ceil(W / side)) ndarray of float32
    """
    (height, width), count = depths.shape, -(-depths.shape[1] // side)
    found = np.empty((-(-height // side), count), np.float32)
    for first in range(0, len(found), BAND // side):
        band = found[first : first + BAND // side]
        begin, end = first * side - 1, (first + len(band)) * side + 1
        beyond = (max(-begin, 0), max(end - height, 0)), (1, 1 + count * side - width)
        part = np.pad(depths[max(begin, 0) : end], beyond, mode="edge")
        down = part[: len(band) * side : side].copy()
        for n in range(1, side + 2):
            np.maximum(down, part[n : n + len(band) * side : side], out=down)
        band[:] = down[:, : count * side : side]
        for n in range(1, side + 2):
            np.maximum(band, down[:, n : n + count * side : side], out=band)
    return found


def differ(depths: np.ndarray, others: np.ndarray, share: float) -> bool:
    """Whether more than ``share`` of the pixels of two depth pictures differ by more than a thousandth."""
    if depths.shape != others.shape:
        return True
    if np.array_equal(depths, others):  # as in most redraws, and in a tenth of the time
        return False
    with np.errstate(invalid="ignore"):
        alike = (depths == others) | (np.abs(depths - others) <= 1e-3 * np.minimum(np.abs(depths), np.abs(others)))
    return np.count_nonzero(~alike) > share * depths.size
