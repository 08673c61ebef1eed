"""The final warp: each pixel of the picture looks its ray up in the intermediate image of its base plane."""

from __future__ import annotations

import numpy as np

from ..jit import compiled, parallel_call
from ..scene import NO_DEPTH, Quality
from ..splat.intermediate_image import IntermediateImage
from ..view.eye import IndexView
from .resample import resample
from .resample_numpy import resample_numpy
from .spline_prefilter import spline_coefficients, spline_coefficients_numpy


def warp(images: list[IntermediateImage], view: IndexView, quality: Quality, most_colour: float):
    """Warp one intermediate image per principal axis and direction into one picture.

    Every pixel belongs to one of them, by the 45-degree rule on its own ray; a pixel that belongs to none sees
    nothing.  ``most_colour``: the largest unassociated colour in the medium; after a filter with negative lobes
    transmittance is clamped to [0, 1] and colour to [0, most_colour * alpha].

    Returns rgba (H, W, 4) float32 premultiplied and depth (H, W) float32, world units, NO_DEPTH where the
    transmittance stays above one half.
    """
    rgba = np.zeros((view.height, view.width, 4), np.float32)
    depth = np.full((view.height, view.width), np.float32(NO_DEPTH), np.float32)
    cubic = quality.warp_filter == "cubic"
    with_kernels = compiled(quality.backend)
    square = view.projection[:, :3]
    directions = np.zeros((3, 3)) if view.is_parallel else np.linalg.inv(square)
    for image in images:
        plane = image.base_plane
        pixels = image.pixels.copy()
        # Alpha rather than transmittance, so that where there is nothing the filter works on exact zeros.
        np.subtract(1.0, pixels[..., 3], out=pixels[..., 3])
        to_plane = np.linalg.inv(plane.homography / np.abs(plane.homography).max())
        # Sheet pixel from picture pixel, both homogeneous.
        to_sheet = np.array((
            (plane.density[0], 0.0, -plane.origin[0]), (0.0, plane.density[1], -plane.origin[1]), (0.0, 0.0, 1.0)
        )) @ to_plane
        depth_map = _depth_map(plane)
        arguments = (
            pixels, image.half_depth, to_sheet, directions, plane.axis, plane.sign, cubic, np.float32(most_colour),
            depth_map, rgba, depth,
        )
        if with_kernels:
            with parallel_call(quality.threads):
                if cubic:
                    spline_coefficients(pixels)
                resample(*arguments)
        else:
            if cubic:
                spline_coefficients_numpy(pixels)
            resample_numpy(*arguments)
    return rgba, depth


def _depth_map(plane) -> np.ndarray:
    """(2, 3) float64: rows taking sheet pixel (u, v, 1) to planar depth at axis position 0 and per voxel along
    the viewing direction."""
    corners_u, corners_v = np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))
    x = (corners_u + plane.origin[0]) / plane.density[0]
    y = (corners_v + plane.origin[1]) / plane.density[1]
    at_zero, per_voxel = plane.depth_along(x, y)
    rows = []
    for values in (at_zero, plane.sign * per_voxel):  # both are affine in (u, v)
        rows.append((values[1] - values[0], values[2] - values[0], values[0]))
    return np.array(rows)
