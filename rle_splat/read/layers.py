"""Several values for each voxel: picking one, and the layers of a segmentation merged into one label map."""

import math
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..volume.volume import NamedLabel
from .streaming import allocate, fill_steps, grid_text, open_stream, skip_steps, storable_steps, voxel_steps


def _plane_steps(path, shape, dtype, part, count: int, doing: str, use):
    """Generator of Progress: read interleaved voxels slice by slice and pass each slice (ny, nx, count) to ``use``.

    ``use(z, slice)`` takes the slice, whose memory is used again for the next one.
    """
    nx, ny, nz = shape
    scratch = np.empty((ny, nx, count), dtype=dtype)
    before = part.skip if part.packing else 0
    with open_stream(part.path, part.offset + (part.skip - before), part.packing) as source:
        yield from skip_steps(path, source, before, doing)
        for z in range(nz):
            for _ in fill_steps(path, source, scratch, doing):
                yield Progress(z / nz, doing)
            use(z, scratch)
        if part.packing:
            source.readinto(memoryview(bytearray(1)))  # at its end a packed stream compares its checksum


def layer_steps(path, shape, dtype, parts, count: int, layer: int):
    """Generator of Progress: one of ``count`` values that lie side by side for each voxel.

    Returns
    -------
    (nz, ny, nx) ndarray
        In native byte order; one of STORED_TYPES.
    """
    doing = f"reading {Path(path).name} ({grid_text(shape, dtype)})"
    voxels = allocate(path, shape, dtype, parts[0].held // count)

    def take(z, values):
        voxels[z] = values[..., layer]

    yield from _plane_steps(path, shape, dtype, parts[0], count, doing, take)
    return (yield from storable_steps(voxels, doing))


def merge_layer_steps(path, shape, dtype, parts, axes, segments):
    """Generator of Progress: the layers of a segmentation as one label map.

    Parameters
    ----------
    path, shape, dtype, parts
        See ``streaming.voxel_steps``.
    axes
        With ``frames``, the number of layers, and ``frames_first``, whether they lie side by side for each voxel.
    segments : sequence of Segment
        Segment i becomes label i + 1. Where segments overlap, the last one counts.

    Returns
    -------
    voxels : (nz, ny, nx) ndarray of uint8 or uint16
    labels : tuple of NamedLabel
    remarks : tuple of str
        A sentence on overlaps, if there are any.
    """
    doing = f"reading {Path(path).name} ({axes.frames} layers of {grid_text(shape, dtype)})"
    kind = np.dtype(np.uint8 if len(segments) < 256 else np.uint16)
    merged = allocate(path, shape, kind, sum(part.held for part in parts) * kind.itemsize)
    merged[...] = 0
    overlaps = 0

    def put(z, values, layer):
        nonlocal overlaps
        for number, segment in enumerate(segments, start=1):
            if segment.layer == layer:
                there = values == segment.value
                overlaps += int(np.count_nonzero(merged[z][there]))
                merged[z][there] = number

    if axes.frames_first:

        def put_all(z, values):
            for layer in range(axes.frames):
                put(z, values[..., layer], layer)

        yield from _plane_steps(path, shape, dtype, parts[0], axes.frames, doing, put_all)
    else:
        size = math.prod(shape) * dtype.itemsize
        for layer in range(axes.frames):
            found = yield from voxel_steps(path, shape, dtype, parts, layer * size, axes.frames * size // len(parts))
            for z, values in enumerate(found):
                put(z, values, layer)
                yield Progress((layer + 1) / axes.frames, doing)
    labels = tuple(NamedLabel(number, one.name, one.color) for number, one in enumerate(segments, start=1))
    remark = f"Segments overlap in {overlaps} voxels, which show the last of them in the file's order."
    return merged, labels, (remark,) if overlaps else ()
