"""The final warp: each pixel of the picture looks its ray up in the intermediate image of its base plane."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled
from ..scene import Quality
from ..splat.intermediate_image import IntermediateImage
from ..view.eye import IndexView
from .filters import is_prefiltered, table_of, taps_of
from .resample import resample, shown_in
from .resample_numpy import clear, resample_numpy
from .spline_prefilter import MARGIN, spline_coefficients, spline_coefficients_numpy

TAPS = 2  # sheet pixels on either side of a ray that the widest filter reads


def warp_reach(quality: Quality) -> int:
    """Sheet pixels on either side of a ray that its pixel depends on."""
    return TAPS + (MARGIN if is_prefiltered(quality.warp_filter) else 0)


def warp(images: list[IntermediateImage], view: IndexView, region, quality: Quality, most_color: float):
    """Warp one intermediate image per principal axis and direction into one picture.

    ``region``: (left, top, right, bottom), the pixels of the view that are wanted; the images hold what they read.

    Every pixel belongs to one of them, by the 45-degree rule on its own ray; a pixel that belongs to none sees
    nothing.  ``most_color``: the largest unassociated colour in the medium; after a filter with negative lobes
    transmittance is clamped to [0, 1] and colour to [0, most_color * alpha].

    Returns rgba (H, W, 4) float32 premultiplied and depth (H, W) float32, world units, NO_DEPTH where the
    transmittance stays above one half, of the region's size.
    """
    left, top, right, bottom = region
    rgba = np.empty((bottom - top, right - left, 4), np.float32)
    depth = np.empty((bottom - top, right - left), np.float32)
    name = quality.warp_filter
    with_kernels, prefiltered = compiled(quality.backend), is_prefiltered(name)
    # Further than this from all that an image holds the filter finds nothing, and no pixel needs to look.
    reach = TAPS + 1 + MARGIN * prefiltered
    parts = [(image, image.filled_part(reach)) for image in images]
    parts = [(image, part) for image, part in parts if part is not None]
    if not parts:
        clear(rgba, depth)
        return rgba, depth
    planes = [image.base_plane for image, _ in parts]
    # Picture pixel from sheet pixel, both homogeneous, both by their numbers in the whole sheet and picture.
    from_sheets = [plane.homography / np.abs(plane.homography).max() / (*plane.density, 1.0) for plane in planes]
    # The other way round, and rays from pixels: inverted all at once, for the call takes as long as ten of them.
    *to_sheets, directions = np.linalg.inv([*from_sheets, np.eye(3) if view.is_parallel else view.projection[:, :3]])
    if view.is_parallel:
        directions = np.zeros((3, 3))
    for number, (image, (rows, columns)) in enumerate(parts):
        plane, (pixels, half, filled) = planes[number], image.arrays
        part_origin = plane.origin[0] + columns.start, plane.origin[1] + rows.start
        window = shown_in(
            from_sheets[number], (rows.stop - rows.start, columns.stop - columns.start), part_origin, depth.shape,
            (left, top),
        )
        origin = plane.origin
        if prefiltered:
            pixels, half = _coefficients(pixels[rows, columns], quality), half[rows, columns]
            filled, origin = np.ascontiguousarray(filled[:, rows]) - np.int32(columns.start), part_origin
        arguments = (
            pixels, half, origin, to_sheets[number], directions, plane.axis, plane.sign, taps_of(name), table_of(name),
            np.float32(most_color), _depth_map(plane), (left, top), number == 0, rgba, depth,
        )
        if with_kernels:
            resample(window, filled, reach, *arguments, quality.threads)
        else:
            resample_numpy(*arguments)
    return rgba, depth


def _coefficients(pixels, quality: Quality):
    """Spline coefficients of colour and alpha."""
    coefficients = np.empty(pixels.shape, np.float32)
    if compiled(quality.backend):
        spline_coefficients(pixels, coefficients, quality.threads)
    else:
        spline_coefficients_numpy(pixels, coefficients)
    return coefficients


def _depth_map(plane) -> np.ndarray:
    """(2, 3) float64: rows taking sheet pixel (u, v, 1), numbered in the whole sheet, to planar depth at axis
    position 0 and per voxel along the viewing direction."""
    at_zero, per_voxel = plane.depth_map
    return np.array((at_zero, [plane.sign * each for each in per_voxel])) / (*plane.density, 1.0)
