"""Totsuka and Levoy's frequency domain rendering: an X-ray is the inverse transform of a slice of the spectrum.

T. Totsuka and M. Levoy, Frequency domain volume rendering, SIGGRAPH 1993: the paper's [8].  The work of a frame
grows with the picture and not with the volume.  But there is no occlusion: the picture shows absorption only, in
parallel projection.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..runtime.jit import parallel_call, read_only
from ..scene import NO_DEPTH, Quality, Rendering
from .medium import ShadedScene, check_plain_view, pixel_frame
from .spectrum import TAPS, Spectrum, fast_size, look_up, transform
from .system import ReadySystem

TITLE = "Frequency domain rendering"
BANDS = 2  # frequencies up to this many times the pixels' Nyquist frequency; higher ones are cut off
MARGIN = 4  # pixels around the projected volume, for the ringing of the cut


def prepare(medium: ShadedScene, quality: Quality, bands: int = BANDS) -> ReadySystem:
    """Transform the extinction; a frame is a slice of its spectrum.

    The picture is alpha = 1 - exp(-optical depth) in the medium's mean color.  ``bands``: see BANDS.
    """
    check_plain_view(medium, TITLE)
    extinction = medium.classified.extinction.astype(np.float64)
    mean = extinction @ medium.colors / max(extinction.sum(), np.finfo(np.float64).tiny)
    spectrum = transform(medium.field[1:-1, 1:-1, 1:-1, 3])
    memory = {"spectrum": spectrum.nbytes}
    return ReadySystem(partial(draw, medium, quality, spectrum, mean, bands), memory, {"taps": TAPS, "bands": bands})


def draw(medium: ShadedScene, quality: Quality, spectrum: Spectrum, mean_color, bands: int = BANDS) -> Rendering:
    """Draw one frame."""
    alpha = -np.expm1(-np.maximum(optical_depth(medium, quality, spectrum, bands), 0.0))
    rgba = np.concatenate((alpha[..., None] * mean_color, alpha[..., None]), axis=2).astype(np.float32)
    return Rendering(rgba, np.full(alpha.shape, NO_DEPTH, np.float32), {})


def optical_depth(medium: ShadedScene, quality: Quality, spectrum: Spectrum, bands: int = BANDS) -> np.ndarray:
    """(H, W) float64: the optical depth of each pixel's ray through the trilinear medium (projection-slice theorem).

    With pixel = P x + o the transform of the picture at (a, b) cycles per pixel is that of the medium at
    a P_0 + b P_1 cycles per voxel.  That is the transform of its samples times that of the tents, sinc^2 each.
    """
    view = medium.view
    frame, offset = pixel_frame(view)
    along = np.linalg.inv(frame)[:, 2]
    # World length per unit of planar depth, times the voxels per (pixel, pixel, depth).
    scale = np.linalg.norm(view.to_world @ along) * abs(np.linalg.det(frame))
    middle = frame[:2] @ spectrum.center + offset[:2]
    shape = np.array(medium.classified.shape_xyz)
    reach = np.abs(frame[:2]) @ (0.5 * shape + 1.5) + MARGIN
    columns, rows = (fast_size(int(np.ceil(2.0 * r))) for r in reach)
    across = np.arange(bands * columns // 2) / columns
    down = np.arange(-(bands * rows // 2), bands * rows // 2) / rows
    slice_ = np.empty((len(down), len(across)), np.complex64)
    with parallel_call(quality.threads):
        look_up(read_only(spectrum.values), spectrum.size, frame[:2].copy(), across, down, slice_)
    found = scale * slice_ * _tents(frame, across, down)
    found[:, 1:] *= 2.0  # for the other, conjugate half; only the real part of the sum is used below
    first = np.round(middle).astype(int) - (columns // 2, rows // 2)
    shift = first + 0.5 - middle
    found *= np.exp(2j * np.pi * across * shift[0]) * np.exp(2j * np.pi * down * shift[1])[:, None]
    folded = _fold(_fold(found, rows, 0, bands * rows // 2), columns, 1, 0)
    return _place(np.fft.ifft2(folded).real, first, (view.height, view.width))


def _tents(frame, across, down) -> np.ndarray:
    """(B, A) float64: the transform of the trilinear kernel at the frequencies of the slice."""
    product = np.ones((len(down), len(across)))
    for axis in range(3):
        product *= np.sinc(across * frame[0, axis] + down[:, None] * frame[1, axis]) ** 2
    return product


def _fold(values, period: int, axis: int, zero_at: int) -> np.ndarray:
    """Add the frequencies beyond ``period`` to their aliases; ``zero_at``: the index of frequency 0 along ``axis``."""
    shape = list(values.shape)
    shape[axis] = period
    folded = np.zeros(shape, np.complex128)
    positions = (np.arange(values.shape[axis]) - zero_at) % period
    np.add.at(np.moveaxis(folded, axis, 0), positions, np.moveaxis(values, axis, 0))
    return folded


def _place(values: np.ndarray, first, shape) -> np.ndarray:
    """The part of an array (h, w) inside a picture of ``shape``, for a corner at column and row ``first``."""
    picture = np.zeros(shape)
    column, row = first
    top, left = max(row, 0), max(column, 0)
    bottom, right = min(row + values.shape[0], shape[0]), min(column + values.shape[1], shape[1])
    if top < bottom and left < right:
        picture[top:bottom, left:right] = values[top - row : bottom - row, left - column : right - column]
    return picture
