"""Light on a refined volume: it falls on the voxels of the scan, and is interpolated between them (algorithm.md 1.14).

A voxel's normal says how bright it is; its light and its highlight are interpolated like the scalar, and the colour of
a fine voxel is its own colour times that light, and that highlight.  So the light costs what it costs without
refinement, and no normals of the finer grid exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..jit import compiled, kernel, parallel_call, read_only
from ..parallel import share_out
from ..volume.gradient import CHUNK
from .classification import LOOKS, RED, ClassifiedVolume
from .placing import Places, find_targets
from .refined import RefinedVolume
from .shading import DENSITY, LANES, Lighting, light_records, normals
from .visible import VisibleVoxels, row_offsets

LIGHT = 3  # floats of a voxel's light, and of its highlight
_ZERO = np.float32(0.0)


@dataclass(frozen=True, eq=False)
class LitVoxels:
    """The voxels of a scan between which visible fine voxels lie, in rows as VisibleVoxels are, and their
    ``normals`` (m, 3) float32."""

    voxels: VisibleVoxels
    normals: np.ndarray

    @property
    def nbytes(self) -> int:
        return self.voxels.nbytes + self.normals.nbytes


@dataclass(frozen=True, eq=False)
class RefinedLight:
    """What falls on LitVoxels; ``refinement``: how much finer the grid is that it is interpolated on."""

    lit: LitVoxels
    falling: Lighting
    refinement: int
    backend: str = "auto"
    threads: int = 0

    @cached_property
    def of_voxels(self) -> np.ndarray:
        """(m, 6) float32: light and highlight of each lit voxel; (m, 3) where nothing is specular."""
        light = self._shaded(1.0)
        if not self.falling.material[2] > 0.0:
            return read_only(np.ascontiguousarray(light[:, :LIGHT]))
        # White matter shows the light and the highlight, black matter the highlight alone.
        highlight = self._shaded(0.0)
        light[:, :LIGHT] -= highlight[:, :LIGHT]
        return read_only(np.hstack((light[:, :LIGHT], highlight[:, :LIGHT])))

    def _shaded(self, color: float) -> np.ndarray:
        """(m, 4) float32 records of the lit voxels as matter of one grey and of density 1."""
        look = np.full((1, LOOKS), color, np.float32)
        matter = ClassifiedVolume(self.lit.voxels, look, True, 1.0, 1.0)
        everywhere = Places.in_order(self.lit.voxels, 0, self.lit.voxels.shape_xyz[2])
        records = np.empty((len(self.lit.voxels), 4), np.float32)
        light_records(
            matter, self.lit.normals, self.falling, None, everywhere, records, backend=self.backend,
            threads=self.threads,
        )
        return records

    def records(self, classified: ClassifiedVolume, model: str, places: Places, records) -> float:
        """As ``shading.light_records``, for the fine voxels of ``classified``."""
        most = np.zeros(max(len(places.data_starts), 1), np.float32)
        look_of = classified.look_of if classified.look_of is None else read_only(classified.look_of)
        seen = (look_of, read_only(classified.looks), DENSITY[model])
        lit = self.lit.voxels
        light = (lit.shape_xyz[0], lit.shape_xyz[1], read_only(lit.row_start), read_only(lit.column), self.of_voxels)
        if compiled(self.backend):
            with parallel_call(self.threads):
                _write_records(places.arguments, *seen, self.refinement, light, records, most)
        else:
            self._write_numpy(places, *seen, records, most)
        return float(most.max())

    def _write_numpy(self, places, look_of, looks, density_column, records, most):
        """Twin of ``_write_records``, in chunks of voxels."""
        targets = places.targets_numpy()
        first, last = places.span
        for begin in range(first, last, CHUNK):
            part = slice(begin, min(begin + CHUNK, last))
            seen = looks[part] if look_of is None else looks[look_of[part]]
            light = self._interpolated_numpy(places.voxels, part)
            colors = seen[:, RED:] * light[:, :LIGHT]
            if light.shape[1] > LIGHT:
                colors = colors + light[:, LIGHT:]
            made = np.empty((len(seen), 4), np.float32)
            made[:, 3] = seen[:, density_column]
            made[:, :3] = made[:, 3:] * colors
            records[targets[part.start - first : part.stop - first]] = made
            most[0] = max(most[0], colors.max(initial=0.0))

    def _interpolated_numpy(self, voxels, part) -> np.ndarray:
        """(k, 3 or 6) float32 light at the fine voxels ``part``, a slice."""
        s, lit = self.refinement, self.lit.voxels
        nx, ny, _ = lit.shape_xyz
        row = np.searchsorted(voxels.row_start, np.arange(part.start, part.stop), side="right") - 1
        fine = (voxels.column[part].astype(np.int64), row % voxels.shape_xyz[1], row // voxels.shape_xyz[1])
        number = np.repeat(np.arange(len(lit.row_start) - 1), np.diff(lit.row_start)) * nx + lit.column
        found = np.zeros((len(row), self.of_voxels.shape[1]))
        for corner in np.ndindex(2, 2, 2):
            weight, at = 1.0, []
            for place, far in zip(fine, corner):
                share = (place % s) / s
                weight = weight * (share if far else 1.0 - share)
                at.append(place // s + far)
            use = np.flatnonzero(weight > 0.0)
            x, y, z = (place[use] for place in at)
            found[use] += weight[use, None] * self.of_voxels[np.searchsorted(number, (z * ny + y) * nx + x)]
        return found.astype(np.float32)


def lit_voxels(
    voxels: VisibleVoxels, volume: RefinedVolume, index_to_world, *, backend: str = "auto", threads: int = 0
) -> LitVoxels:
    """The voxels of ``volume.source`` next to visible fine voxels, with normals in world space.

    ``index_to_world``: (4, 4) float64, of the voxels of ``volume.source``.
    """
    shape = nx, ny, nz = volume.source.shape_xyz
    s, (_, fine_y, fine_z) = volume.refinement, voxels.shape_xyz
    if compiled(backend):
        counts = np.zeros(nz * ny, np.int64)
        marked = (read_only(voxels.row_start), read_only(voxels.column), s, nx, ny, fine_y, fine_z)
        with parallel_call(threads):
            _count_marked(*marked, counts)
            row_start = row_offsets(counts)
            column = np.empty(row_start[-1], np.uint16 if nx <= 65536 else np.int32)
            _fill_marked(*marked, row_start, column)
    else:
        row_start, column = _marked_numpy(voxels, shape, s)
    stored = np.zeros(len(column), np.uint8)  # no value of their own: all of them are alike
    lit = VisibleVoxels(shape, row_start, np.zeros(nz * ny, np.int32), column, stored, 0)
    return LitVoxels(lit, normals(lit, volume.source, index_to_world, backend=backend, threads=threads))


def _marked_numpy(voxels: VisibleVoxels, shape_xyz, s: int):
    """Twin of ``_count_marked`` and ``_fill_marked``: row_start, column."""
    nx, ny, nz = shape_xyz
    row = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
    fine = (row // voxels.shape_xyz[1], row % voxels.shape_xyz[1], voxels.column.astype(np.int64))
    marks = np.zeros((nz, ny, nx), bool)
    for corner in np.ndindex(2, 2, 2):
        marks[tuple(-(-place // s) if far else place // s for place, far in zip(fine, corner))] = True
    place = np.flatnonzero(marks)
    return row_offsets(np.bincount(place // nx, minlength=nz * ny)), (place % nx).astype(
        np.uint16 if nx <= 65536 else np.int32
    )


# --- kernels --------------------------------------------------------------------------------------------------


@kernel
def _count_marked(row_start, column, refinement, n_x, n_y, fine_y, fine_z, counts):
    """How many voxels of each row of a scan are next to a fine voxel in the lists; ``counts`` (nz * n_y,) int64."""
    share_out(_mark, counts.size, (row_start, column, refinement, n_x, n_y, fine_y, fine_z, counts, None))


@kernel
def _fill_marked(row_start, column, refinement, n_x, n_y, fine_y, fine_z, marked_start, marked_column):
    """Writes which they are; ``marked_start`` (nz * n_y + 1,)."""
    arguments = (row_start, column, refinement, n_x, n_y, fine_y, fine_z, marked_start, marked_column)
    share_out(_mark, marked_start.size - 1, arguments)


@kernel(inner=True)
def _mark(begin, end, row_start, column, s, n_x, n_y, fine_y, fine_z, starts, marked_column):
    """Rows [begin, end) of the scan: their counts into ``starts``, or, where there is ``marked_column``, the columns
    of those that are marked from ``starts`` on."""
    marks = np.zeros(n_x + 1, np.uint8)
    for row in range(begin, end):
        if marked_column is not None and starts[row] == starts[row + 1]:
            continue
        z, y = row // n_y, row % n_y
        for at_z in range(max((z - 1) * s + 1, 0), min((z + 1) * s, fine_z)):
            for at_y in range(max((y - 1) * s + 1, 0), min((y + 1) * s, fine_y)):
                fine = at_z * fine_y + at_y
                for i in range(row_start[fine], row_start[fine + 1]):
                    x = np.uint32(column[i])
                    marks[x // np.uint32(s)] = 1
                    marks[(x + np.uint32(s - 1)) // np.uint32(s)] = 1
        count = 0
        for x in range(n_x):
            if marks[x]:
                if marked_column is not None:
                    marked_column[starts[row] + count] = x
                count += 1
                marks[x] = 0
        if marked_column is None:
            starts[row] = count


@kernel
def _write_records(places, look_of, looks, density_column, refinement, light, records, most):
    """``places``, ``look_of``, ``looks``: as in ``shading``.  ``light``: nx and ny of the scan, row_start and column of
    its lit voxels, and (m, 3 or 6) their light and highlight."""
    arguments = (places, look_of, looks, density_column, refinement, light, records, most)
    share_out(_write_planes, places[5].shape[0], arguments)


@kernel(inner=True)
def _write_planes(begin, end, places, look_of, looks, density_column, s, light, records, most):
    n_y, first_plane, row_start, column, across, data_starts = places
    n_x, channels = light[0], light[4].shape[1]
    cursors = np.empty(data_starts.shape[1], np.int64)
    targets = np.empty(LANES, np.uint64)
    line = np.zeros((n_x + 1) * channels, np.float32)  # light along one fine row, at the scan's columns
    made = np.zeros(2 * LIGHT, np.float32)
    share = (np.arange(s) / s).astype(np.float32)
    for plane in range(begin, end):
        for key in range(cursors.size):
            cursors[key] = data_starts[plane, key]
        z = first_plane + plane
        brightest = _ZERO
        for row in range(z * n_y, (z + 1) * n_y):
            at, last = row_start[row], row_start[row + 1]
            if at == last:
                continue
            low, high = np.int64(column[at]) // s, np.int64(column[last - 1]) // s + 1
            _light_line(light, z, row - z * n_y, s, share, low, high, line)
            while at < last:
                stop = min(at + LANES, last)
                find_targets(across, z * n_y, row, row_start, column, at, stop - at, cursors, targets)
                for i in range(at, stop):
                    x = np.uint32(column[i])
                    cell = x // np.uint32(s)
                    phase = x - cell * np.uint32(s)
                    here = np.intp(cell) * channels
                    for c in range(channels):
                        made[c] = line[here + c] + (line[here + channels + c] - line[here + c]) * share[phase]
                    look = i if look_of is None else np.int64(look_of[i])
                    density = looks[look, density_column]
                    to = targets[i - at]
                    for c in range(LIGHT):
                        color = looks[look, RED + c] * made[c] + made[LIGHT + c]
                        records[to, c] = density * color
                        brightest = max(brightest, color)
                    records[to, LIGHT] = density
                at = stop
        most[plane] = brightest


@kernel(inner=True)
def _light_line(light, z, y, s, share, low, high, line):
    """Light along fine row (z, y), at the columns [low, high] of the scan, interpolated along y and z."""
    _, n_y, row_start, column, values = light
    channels = values.shape[1]
    for i in range(low * channels, (high + 1) * channels):
        line[i] = _ZERO
    for far_z in range(2):
        wz = share[z % s] if far_z else np.float32(1.0) - share[z % s]
        for far_y in range(2):
            weight = wz * (share[y % s] if far_y else np.float32(1.0) - share[y % s])
            if weight == _ZERO:
                continue
            row = (z // s + far_z) * n_y + y // s + far_y
            for i in range(row_start[row], row_start[row + 1]):
                x = np.int64(column[i])
                if low <= x <= high:
                    for c in range(channels):
                        line[x * channels + c] += weight * values[i, c]
