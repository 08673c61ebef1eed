"""Westover's splatting: each voxel is visited, and its footprint from a table is splatted on the screen.

L. Westover, Interactive volume rendering, 1989, and Footprint evaluation for volume rendering, SIGGRAPH 1990: the
paper's [5] and [6].  Footprints are combined in two ways: each is composited by itself, or those of a sheet of voxels,
parallel to a face of the volume, are first added in a sheet buffer.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..runtime.jit import kernel, parallel_call, prange, read_only
from ..scene import Quality
from ..view.principal_axis import dominant_axis
from ..volume.axes import AXES
from .footprint import FootprintTable, composite_sample, first_pixel, footprint
from .medium import CHANNELS, ShadedScene, check_plain_view
from .system import ReadySystem, picture

TITLE = "Westover's splatting"
BANDS_PER_THREAD = 2  # bands of screen rows; few, because voxel rows at their borders are visited twice


def prepare(medium: ShadedScene, quality: Quality, sheets: bool = True, cull: bool = True) -> ReadySystem:
    """Splat every voxel of the dense grid in parallel projection.

    Parameters
    ----------
    quality : Quality
        Only its threads count.
    sheets : bool
        Add the footprints of a sheet before compositing it; otherwise composite every sample.
    cull : bool
        Leave out transparent voxels; otherwise their footprints of zeros are splatted too (with ``sheets``).
    """
    check_plain_view(medium, TITLE)
    table = footprint(medium.view)
    memory = {"voxels": medium.field.nbytes, "footprint_table": table.weights.nbytes}
    notes = {"footprint": table.shape[1:].tolist(), "subpixels": int(table.shape[0])}
    return ReadySystem(partial(draw, medium, quality, table, sheets, cull), memory, notes)


def front_to_back(medium: ShadedScene):
    """The voxels in the order of their depth.

    Returns
    -------
    voxels : (slices, scanlines, width, 4) float32
        A view of the field, nearest first along all axes.
    corner : (2,) float64
        The pixel position of the first voxel.
    steps : (3, 2) float64
        Pixels from one slice, scanline and voxel to the next.
    """
    direction = -medium.view.eye[:3]
    axis = int(dominant_axis(direction)[0])
    voxels = medium.field[1:-1, 1:-1, 1:-1]
    corner = np.zeros(3)
    step = np.eye(3)
    for a in range(3):
        if direction[a] < 0.0:
            voxels = np.flip(voxels, 2 - a)
            corner[a] = voxels.shape[2 - a] - 1.0
            step[a, a] = -1.0
    along, across, principal = AXES[axis]
    order = (principal, across, along)
    projection = medium.view.projection[:2]
    pixels = projection[:, :3] @ corner + projection[:, 3]
    steps = (step @ projection[:, :3].T)[list(order)]
    return voxels.transpose(*(2 - a for a in order), 3), pixels, np.ascontiguousarray(steps)


def draw(medium: ShadedScene, quality: Quality, table: FootprintTable, sheets: bool, cull: bool):
    """Draw one frame."""
    view = medium.view
    image = np.zeros((view.height, view.width, CHANNELS), np.float32)
    image[..., 3] = 1.0
    voxels, corner, steps = front_to_back(medium)
    with parallel_call(quality.threads) as workers:
        splat_voxels(
            workers, read_only(voxels), corner, steps, read_only(table.weights), table.shape, table.reach, sheets,
            cull, image,
        )  # fmt: skip
    return picture(image)


@kernel
def _splat_slice(voxels, slice_, corner, steps, weights, shape, reach, top, bottom, sheets, cull, target, box):
    """Splat one slice on the screen rows [top, bottom).

    ``target``: (rows of the band, W, 4), the sheet buffer, with ``sheets``, else the image; updated.  ``box``: (4,)
    int64, first and last touched row and column of the sheet buffer, updated.  The others as in ``splat_voxels``.
    """
    image_width = target.shape[1]
    subpixels, height, width = shape[0], shape[1], shape[2]
    for j in range(voxels.shape[1]):
        at_row = corner[1] + slice_ * steps[0, 1] + j * steps[1, 1]
        at_column = corner[0] + slice_ * steps[0, 0] + j * steps[1, 0]
        far_row = at_row + (voxels.shape[2] - 1) * steps[2, 1]
        if max(at_row, far_row) + reach[1] < top or min(at_row, far_row) - reach[1] > bottom:
            continue
        for i in range(voxels.shape[2]):
            sigma = voxels[slice_, j, i, 3]
            if cull and sigma == 0.0:
                continue
            row, sub_row = first_pixel(at_row + i * steps[2, 1], reach[1], subpixels)
            column, sub_column = first_pixel(at_column + i * steps[2, 0], reach[0], subpixels)
            first_row, last_row = max(row, top), min(row + height, bottom)
            first_column, last_column = max(column, 0), min(column + width, image_width)
            if first_row >= last_row or first_column >= last_column:
                continue
            red, green, blue = voxels[slice_, j, i, 0], voxels[slice_, j, i, 1], voxels[slice_, j, i, 2]
            base = (sub_row * subpixels + sub_column) * height * width
            for r in range(first_row, last_row):
                entry = base + (r - row) * width - column
                for c in range(first_column, last_column):
                    weight = weights[entry + c]
                    if sheets:
                        target[r - top, c, 0] += weight * red
                        target[r - top, c, 1] += weight * green
                        target[r - top, c, 2] += weight * blue
                        target[r - top, c, 3] += weight * sigma
                    elif weight > 0.0 and sigma > 0.0:
                        composite_sample(target, r, c, weight, red, green, blue, sigma)
            box[0], box[1] = min(box[0], first_row), max(box[1], last_row)
            box[2], box[3] = min(box[2], first_column), max(box[3], last_column)


@kernel
def _composite_sheet(sheet, image, top, box):
    """Composite the touched part ``box`` of the sheet buffer behind the image, and clear it."""
    for row in range(box[0], box[1]):
        for column in range(box[2], box[3]):
            tau = sheet[row - top, column, 3]
            if tau > 0.0:
                composite_sample(
                    image, row, column, np.float32(1.0), sheet[row - top, column, 0], sheet[row - top, column, 1],
                    sheet[row - top, column, 2], tau,
                )  # fmt: skip
            for channel in range(4):
                sheet[row - top, column, channel] = 0.0


@kernel(parallel=True)
def splat_voxels(workers, voxels, corner, steps, weights, shape, reach, sheets, cull, image):
    """Splat every voxel, front to back.

    ``voxels``: (slices, scanlines, width, 4) float32 records, nearest first.  ``corner`` (2,) and ``steps`` (3, 2),
    float64: pixel = corner + slice * steps[0] + scanline * steps[1] + voxel * steps[2], column before row.
    ``weights``, ``shape``, ``reach``: see ``FootprintTable``.  ``image``: (H, W, 4) float32 color and transmittance,
    updated.  Bands of screen rows are independent, so the result is the same for any number of threads.
    """
    rows = image.shape[0]
    bands = min(rows, BANDS_PER_THREAD * workers)
    for worker in prange(workers):
        for band in range(worker, bands, workers):
            top, bottom = rows * band // bands, rows * (band + 1) // bands
            sheet = np.zeros((bottom - top if sheets else 0, image.shape[1], 4), np.float32)
            box = np.zeros(4, np.int64)
            for k in range(voxels.shape[0]):
                box[0], box[1], box[2], box[3] = bottom, top, image.shape[1], 0
                _splat_slice(
                    voxels, k, corner, steps, weights, shape, reach, top, bottom, sheets, cull,
                    sheet if sheets else image, box,
                )  # fmt: skip
                if sheets:
                    _composite_sheet(sheet, image, top, box)
