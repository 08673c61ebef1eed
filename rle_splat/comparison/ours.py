"""Systems that our own renderer draws: the paper's method, the same visiting every voxel, and shear-warp by settings.

Zhang, Sun and Sun, Accelerate volume splatting by using run length encoding, ICCS 2003.
P. Lacroute and M. Levoy, Fast volume rendering using a shear-warp factorization of the viewing transformation,
SIGGRAPH 1994: the paper's [7].
"""

import numpy as np

from ..encode.encode import encode
from ..encode.tables import (
    RunLengthVolume,
    data_pointers_from_scanlines,
    pointers_from_counts,
    run_type,
    scanline_pointers_from_counts,
)
from ..pipeline.render import render
from ..scene import Quality
from .medium import ShadedScene
from .system import ReadySystem

TERMINATION = 0.05  # of shear-warp programs: rays end at an opacity of 95 %


def encode_axes(medium: ShadedScene, quality: Quality) -> dict[int, RunLengthVolume]:
    """Encode the run-length tables of the principal axes that the view needs."""
    return {
        axis: encode(medium.classified, medium.colors, axis, quality.model, threads=quality.threads)
        for axis in medium.principal_axes
    }


def prepare(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The renderer at ``quality``, from tables made in advance."""
    return prepare_tables(medium, quality, encode_axes(medium, quality))


def prepare_tables(medium: ShadedScene, quality: Quality, axes: dict[int, RunLengthVolume], **notes) -> ReadySystem:
    """The renderer at ``quality`` from given tables, ``axes``: principal axis -> RunLengthVolume."""
    scene = medium.stored(axes)
    memory: dict = {}
    for encoded in axes.values():
        for table, size in encoded.table_bytes.items():
            memory[table] = memory.get(table, 0) + size
    return ReadySystem(lambda: render(scene, quality), memory, notes)


def prepare_paper(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The paper's pipeline to the letter: opacities added in slice-plane sheets, one sheet pixel per voxel."""
    return prepare(medium, Quality.paper(threads=quality.threads))


def prepare_shear_warp(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The renderer with settings by which it does the same as the shear-warp program; only the threads count."""
    settings = Quality(
        classification="pre", depth_rule="slice", sheet_density=0.0, kernel="tent", warp_filter="bilinear",
        termination=TERMINATION, model="opacity", length_correction=True, name="shear-warp", threads=quality.threads,
    )  # fmt: skip
    return prepare(medium, settings)


# --- the baseline of the paper's Table 2 ------------------------------------------------------------------------------


def prepare_unaccelerated(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The renderer at ``quality``, visiting every voxel.

    It runs the same compiled loops, on the same threads, with the same termination.  Its tables hold each scanline as
    one run of "non-transparent" voxels, so that no run is skipped.  That is the only difference.
    """
    axes = {axis: every_voxel(tables) for axis, tables in encode_axes(medium, quality).items()}
    return prepare_tables(medium, quality, axes)


def every_voxel(encoded: RunLengthVolume) -> RunLengthVolume:
    """The same volume with all voxels stored: for each scanline a transparent run of length 0 and one of all voxels."""
    voxels = decode(encoded).reshape(-1, 4)
    shape = (encoded.n_slices, encoded.n_scanlines)
    scanline_pointers, _ = scanline_pointers_from_counts(np.full(shape, 2, np.int64))
    scanline_data_pointers, n_voxels = pointers_from_counts(np.full(shape, encoded.width, np.int64))
    runs = np.tile(np.array((0, encoded.width), run_type(encoded.shape_xyz)), shape[0] * shape[1])
    return RunLengthVolume(
        encoded.axis, encoded.shape_xyz, scanline_pointers,
        data_pointers_from_scanlines(scanline_data_pointers, n_voxels), runs, scanline_data_pointers, encoded.model,
        voxels, None, encoded.most_color,
    )  # fmt: skip


def decode(encoded: RunLengthVolume) -> np.ndarray:
    """Decode to a dense grid.

    Returns
    -------
    (n_slices, n_scanlines, width, 4) ndarray of float32
        Voxel records; zero where transparent.
    """
    shape = encoded.n_slices, encoded.n_scanlines, encoded.width
    pointers, runs = encoded.scanline_pointers.reshape(-1).astype(np.int64), encoded.runs
    lines = np.flatnonzero(pointers >= 0)
    lines = lines[np.argsort(pointers[lines])]  # in the order of their runs
    starts = pointers[lines]
    in_line = np.arange(len(runs)) - np.repeat(starts, np.diff(np.append(starts, len(runs))))
    visible = np.zeros((len(pointers), encoded.width), dtype=bool)
    visible[lines] = np.repeat(in_line % 2 == 1, runs).reshape(-1, encoded.width)
    counts = np.count_nonzero(visible, axis=1)
    before = np.cumsum(counts) - counts
    records = np.repeat(encoded.scanline_data_pointers.reshape(-1) - before, counts) + np.arange(counts.sum())
    dense = np.zeros((*visible.shape, 4), dtype=np.float32)
    dense[visible] = encoded.decoded()[records]
    return dense.reshape(*shape, 4)
