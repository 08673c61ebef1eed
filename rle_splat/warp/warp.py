"""The warp: each pixel of the picture reads the intermediate image of its base plane at its ray."""

from __future__ import annotations

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled
from ..scene import NO_DEPTH, Quality
from ..splat.intermediate_image import IntermediateImage
from ..view.eye import IndexView
from . import reference
from .filters import FILTERS
from .reference import CLEAR, MARGIN
from .resample import resample, shown_in
from .spline_prefilter import spline_coefficients

PIXELS_AT_ONCE = 300_000  # of the picture, between two steps: 3 ms of a draft, at most 10
TAPS = 2  # sheet pixels on either side of a ray that the widest filter reads


def warp_reach(quality: Quality) -> int:
    """Sheet pixels on either side of a ray on which its pixel depends."""
    return TAPS + (MARGIN if FILTERS[quality.warp_filter].is_prefiltered else 0)


def warp_steps(images: list[IntermediateImage], view: IndexView, region, quality: Quality, most_color: float):
    """Generator: warp the intermediate images, one per principal axis and direction, to one picture.

    Yields fractions done, and returns the picture.

    A pixel belongs to the image of the principal axis of its ray. A pixel that belongs to no image is transparent.

    Parameters
    ----------
    images : list of IntermediateImage
        They contain all sheet pixels that ``region`` reads.
    region : (left, top, right, bottom)
        Pixels of the view to fill.
    most_color : float
        Largest unassociated color in the medium. Filters with negative lobes are clamped: transmittance to [0, 1] and
        color to [0, most_color * alpha].

    Returns
    -------
    rgba : (H, W, 4) ndarray of float32
        Premultiplied, scene-linear; the size is that of ``region``.
    depth : (H, W) ndarray of float32
        World units; NO_DEPTH where the transmittance stays above one half.
    """
    left, top, right, bottom = region
    with_kernels, (prefiltered, *taps) = compiled(), FILTERS[quality.warp_filter]
    # Pixels farther than this from everything that an image holds are transparent and are skipped.
    reach = TAPS + 1 + MARGIN * prefiltered
    parts = [(image, image.find_filled_part(reach)) for image in images]
    parts = [(image, part) for image, part in parts if part is not None]
    size = bottom - top, right - left
    if not parts:
        return np.zeros((*size, 4), np.float32), np.full(size, NO_DEPTH, np.float32)
    rgba, depth = np.empty((*size, 4), np.float32), np.empty(size, np.float32)
    planes = [image.base_plane for image, _ in parts]
    # Homogeneous sheet pixel to picture pixel, with pixel numbers of the whole sheet and picture.
    from_sheets = [plane.homography / np.abs(plane.homography).max() / (*plane.density, 1.0) for plane in planes]
    # Inverses, and rays of pixels. One call for all, because the call itself costs as much as ten matrices.
    *to_sheets, directions = np.linalg.inv([*from_sheets, np.eye(3) if view.is_parallel else view.projection[:, :3]])
    if view.is_parallel:
        directions = np.zeros((3, 3))
    rows_at_once = max(PIXELS_AT_ONCE // max(right - left, 1), 1)
    for number, (image, (rows, columns)) in enumerate(parts):
        plane, (pixels, half, filled) = planes[number], image.arrays
        part_origin = plane.origin[0] + columns.start, plane.origin[1] + rows.start
        origin = plane.origin
        if prefiltered:
            half = np.where(pixels[rows, columns, 3] < 1.0, half[rows, columns], CLEAR)
            pixels = _coefficients(pixels, rows, columns, quality)
            filled, origin = np.ascontiguousarray(filled[:, rows]) - np.int32(columns.start), part_origin
        held = rows.stop - rows.start, columns.stop - columns.start
        for first in range(0, len(depth), rows_at_once):
            yield (number + first / len(depth)) / len(parts)
            some = slice(first, first + rows_at_once)
            at = left, top + first
            arguments = (
                pixels, half, origin, to_sheets[number], directions, plane.axis, plane.sign, *taps,
                np.float32(most_color), _depth_map(plane), at, number == 0, rgba[some], depth[some],
            )  # fmt: skip
            if with_kernels:
                window = shown_in(from_sheets[number], held, part_origin, depth[some].shape, at)
                resample(window, filled, reach, *arguments, quality.threads)
            else:
                reference.resample(*arguments)
    return rgba, depth


def _coefficients(pixels, rows: slice, columns: slice, quality: Quality):
    """Spline coefficients of color and alpha, of a part of an image."""
    coefficients = empty((rows.stop - rows.start, columns.stop - columns.start, 4), np.float32)
    if compiled():
        spline_coefficients(pixels, rows, columns, coefficients, quality.threads)
    else:
        reference.find_coefficients(pixels, rows, columns, coefficients)
    return coefficients


def _depth_map(plane) -> np.ndarray:
    """(2, 3) float64: sheet pixel (u, v, 1), numbered in the whole sheet, to planar depth.

    The first row gives the depth at axis position 0, the second its change per voxel along the viewing direction.
    """
    at_zero, per_voxel = plane.depth_map
    return np.array((at_zero, [plane.sign * each for each in per_voxel])) / (*plane.density, 1.0)
