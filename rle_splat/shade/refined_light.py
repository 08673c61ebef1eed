"""Light on a refined volume: computed at the voxels of the scan and interpolated between them (algorithm.md, 1.14).

Light and highlight of a voxel follow from its normal and are interpolated like the scalar. The color of a fine voxel is
its own color times that light, plus that highlight. So light costs the same as without refinement, and no normals of
the finer grid are needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..classify.classification import PROPERTIES, RED, ClassifiedVolume
from ..classify.placing import RecordPositions, find_targets
from ..classify.refined import RefinedVolume
from ..classify.visible import VisibleVoxels, row_offsets
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..volume.gradient import CHUNK
from .chunk_light import LANES
from .lighting import Lighting
from .shading import DENSITY, normals, refuse_too_bright, shaded_colors

LIGHT = 3  # channels of a voxel's light, and of its highlight
_ZERO = np.float32(0.0)


@dataclass(frozen=True, eq=False)
class LitVoxels:
    """The voxels of a scan between which visible fine voxels lie, and their ``normals`` (m, 3) float32, world."""

    voxels: VisibleVoxels
    normals: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self.voxels.nbytes + self.normals.nbytes


@dataclass(frozen=True, eq=False)
class RefinedLight:
    """Light on LitVoxels, interpolated on a grid ``refinement`` times finer.

    Parameters
    ----------
    lit : LitVoxels
    falling : Lighting
    refinement : int
    backend : {"auto", "numba", "numpy"}
    threads : int
        0 for one per core.
    """

    lit: LitVoxels
    falling: Lighting
    refinement: int
    backend: str = "auto"
    threads: int = 0

    @cached_property
    def of_voxels(self) -> tuple[np.ndarray, np.ndarray | None]:
        """(m, 3) float32 light of each lit voxel, and its highlight (None if nothing is specular)."""
        light = self._shaded(1.0)
        if not self.falling.material[2] > 0.0:
            return read_only(light), None
        # White voxels show light plus highlight, black voxels the highlight alone.
        highlight = self._shaded(0.0)
        light -= highlight
        return read_only(light), read_only(highlight)

    def _shaded(self, color: float) -> np.ndarray:
        """(m, 3) float32 shaded colors of the lit voxels if all had the gray ``color``."""
        one_row = np.full((1, PROPERTIES), color, np.float32)
        medium = ClassifiedVolume(self.lit.voxels, one_row, True, 1.0, 1.0)
        colors = shaded_colors(medium, self.lit.normals, self.falling, backend=self.backend, threads=self.threads)
        return colors.copy()

    def records(self, classified: ClassifiedVolume, model: str, positions: RecordPositions, records) -> float:
        """As ``shading.light_records``, for the fine voxels of ``classified``."""
        most = np.zeros(max(len(positions.data_starts), 1), np.float32)
        row_of = classified.row_of if classified.row_of is None else read_only(classified.row_of)
        seen = (row_of, read_only(classified.properties), DENSITY[model])
        lit = self.lit.voxels
        if compiled(self.backend):
            fine_x = np.arange(classified.shape_xyz[0])
            steps = (
                self.refinement, read_only((fine_x // self.refinement).astype(np.int32)),
                read_only((fine_x % self.refinement / self.refinement).astype(np.float32)),
            )
            of_scan = (lit.shape_xyz[1], read_only(lit.row_start), read_only(lit.column))
            light = self.of_voxels  # before the parallel call, because it runs kernels too
            with parallel_call(self.threads):
                _write_records(positions.arguments, *seen, steps, of_scan, *light, records, most)
        else:
            self._write_numpy(positions, *seen, records, most)
        return refuse_too_bright(float(most.max()))

    def _write_numpy(self, positions, row_of, properties, density_column, records, most):
        """Reference implementation of ``_write_records``, in chunks of voxels."""
        targets = positions.targets_numpy()
        first, last = positions.span
        for begin in range(first, last, CHUNK):
            part = slice(begin, min(begin + CHUNK, last))
            seen = properties[part] if row_of is None else properties[row_of[part]]
            light, highlight = self._interpolated_numpy(positions.voxels, part)
            colors = seen[:, RED:] * light + highlight
            made = np.empty((len(seen), 4), np.float32)
            made[:, 3] = seen[:, density_column]
            made[:, :3] = made[:, 3:] * colors
            records[targets[part.start - first : part.stop - first]] = made
            most[0] = max(most[0], colors.max(initial=0.0))

    def _interpolated_numpy(self, voxels, part):
        """(k, 3) float32 light and highlight at the fine voxels ``part`` (a slice); a highlight of 0.0 for none."""
        s, lit = self.refinement, self.lit.voxels
        nx, ny, _ = lit.shape_xyz
        row = np.searchsorted(voxels.row_start, np.arange(part.start, part.stop), side="right") - 1
        fine = (voxels.column[part].astype(np.int64), row % voxels.shape_xyz[1], row // voxels.shape_xyz[1])
        number = np.repeat(np.arange(len(lit.row_start) - 1), np.diff(lit.row_start)) * nx + lit.column
        found = [0.0 if light is None else np.zeros((len(row), LIGHT), np.float32) for light in self.of_voxels]
        for corner in np.ndindex(2, 2, 2):
            weight, at = 1.0, []
            for index, far in zip(fine, corner):
                share = (index % s) / s
                weight = weight * (share if far else 1.0 - share)
                at.append(index // s + far)
            use = np.flatnonzero(weight > 0.0)
            x, y, z = (index[use] for index in at)
            lit_voxel = np.searchsorted(number, (z * ny + y) * nx + x)
            for mixed, light in zip(found, self.of_voxels):
                if light is not None:
                    mixed[use] += weight[use, None] * light[lit_voxel]
        return found


def lit_voxels(
    voxels: VisibleVoxels, volume: RefinedVolume, index_to_world, *, backend: str = "auto", threads: int = 0
) -> LitVoxels:
    """Find the voxels of the scan next to visible fine voxels, and their normals.

    Parameters
    ----------
    voxels : VisibleVoxels
        The visible fine voxels.
    volume : RefinedVolume
    index_to_world : (4, 4) ndarray of float64
        Of the voxels of ``volume.source``.
    backend : {"auto", "numba", "numpy"}
    threads : int
        0 for one per core.

    Returns
    -------
    LitVoxels
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
    stored = np.zeros(len(column), np.uint8)  # not used: one row of properties serves all
    lit = VisibleVoxels(shape, row_start, np.zeros(nz * ny, np.int32), column, stored, 0)
    return LitVoxels(lit, normals(lit, volume.source, index_to_world, backend=backend, threads=threads))


def _marked_numpy(voxels: VisibleVoxels, shape_xyz, s: int):
    """Reference implementation of ``_count_marked`` and ``_fill_marked``: row_start, column."""
    nx, ny, nz = shape_xyz
    row = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
    fine = (row // voxels.shape_xyz[1], row % voxels.shape_xyz[1], voxels.column.astype(np.int64))
    marks = np.zeros((nz, ny, nx), bool)
    for corner in np.ndindex(2, 2, 2):
        marks[tuple(-(-index // s) if far else index // s for index, far in zip(fine, corner))] = True
    index = np.flatnonzero(marks)
    return row_offsets(np.bincount(index // nx, minlength=nz * ny)), (index % nx).astype(
        np.uint16 if nx <= 65536 else np.int32
    )


# --- kernels --------------------------------------------------------------------------------------------------


@kernel
def _count_marked(row_start, column, refinement, n_x, n_y, fine_y, fine_z, counts):
    """Count the voxels of each row of a scan that are next to a listed fine voxel; ``counts`` (nz * n_y,) int64."""
    share_out(_mark, counts.size, (row_start, column, refinement, n_x, n_y, fine_y, fine_z, counts, None))


@kernel
def _fill_marked(row_start, column, refinement, n_x, n_y, fine_y, fine_z, marked_start, marked_column):
    """Write the columns of those voxels; ``marked_start`` (nz * n_y + 1,): first entry of each row."""
    arguments = (row_start, column, refinement, n_x, n_y, fine_y, fine_z, marked_start, marked_column)
    share_out(_mark, marked_start.size - 1, arguments)


@kernel(inner=True)
def _mark(begin, end, row_start, column, s, n_x, n_y, fine_y, fine_z, starts, marked_column):
    """For rows [begin, end) of the scan, write the counts of marked voxels into ``starts``.

    With ``marked_column``, write their columns there instead, from ``starts`` on.
    """
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
def _write_records(positions, row_of, properties, density_column, steps, lit, light, highlight, records, most):
    """Kernel of ``RefinedLight.records``.

    ``positions``, ``row_of``, ``properties``: as in ``shading._write_records``. ``steps``: refinement; for each fine
    column the column of the scan at or before it, int32, and its distance from there as a fraction, float32. ``lit``:
    ny of the scan, row_start and column of its lit voxels. ``light``, ``highlight``: (m, 3) float32; ``highlight`` is
    None if nothing is specular.
    """
    arguments = (positions, row_of, properties, density_column, steps, lit, light, highlight, records, most)
    share_out(_write_planes, positions[5].shape[0], arguments)


@kernel(inner=True)
def _write_planes(
    begin, end, positions, row_of, properties, density_column, steps, lit, light, highlight, records, most
):
    """``_write_records`` for planes [begin, end)."""
    n_y, first_plane, row_start, column, across, data_starts = positions
    s, before, shares = steps
    cursors = np.empty(data_starts.shape[1], np.int64)
    targets = np.empty(LANES, np.uint64)
    # Light along one fine row, at the columns of the scan.
    width = np.int64(before[before.size - 1]) + 2
    matt = np.zeros(LIGHT * width, np.float32)
    gloss = np.zeros(0 if highlight is None else LIGHT * width, np.float32)
    for plane in range(begin, end):
        for key in range(cursors.size):
            cursors[key] = data_starts[plane, key]
        z = first_plane + plane
        brightest = _ZERO
        for row in range(z * n_y, (z + 1) * n_y):
            at, last = row_start[row], row_start[row + 1]
            if at == last:
                continue
            low, high = np.int64(before[column[at]]), np.int64(before[column[last - 1]]) + 1
            _light_line(lit, light, z, row - z * n_y, s, low, high, matt)
            if highlight is not None:
                _light_line(lit, highlight, z, row - z * n_y, s, low, high, gloss)
            while at < last:
                stop = min(at + LANES, last)
                find_targets(across, z * n_y, row, row_start, column, at, stop - at, cursors, targets)
                for i in range(at, stop):
                    x = np.intp(column[i])
                    here, share = LIGHT * np.intp(before[x]), shares[x]
                    entry = i if row_of is None else np.intp(row_of[i])
                    red = properties[entry, RED] * _mixed(matt, here, share)
                    green = properties[entry, RED + 1] * _mixed(matt, here + 1, share)
                    blue = properties[entry, RED + 2] * _mixed(matt, here + 2, share)
                    if highlight is not None:
                        red += _mixed(gloss, here, share)
                        green += _mixed(gloss, here + 1, share)
                        blue += _mixed(gloss, here + 2, share)
                    density = properties[entry, density_column]
                    to = targets[i - at]
                    records[to, 0] = density * red
                    records[to, 1] = density * green
                    records[to, 2] = density * blue
                    records[to, 3] = density
                    brightest = max(brightest, max(red, max(green, blue)))
                at = stop
        most[plane] = brightest


@kernel(inline="always")
def _mixed(line, at, share):
    """Linear interpolation between a column of a line of light and the next."""
    return line[at] + (line[at + LIGHT] - line[at]) * share


@kernel(inner=True)
def _light_line(lit, light, z, y, s, low, high, line):
    """Light along fine row (z, y), at columns [low, high] of the scan, interpolated along y and z, to ``line``."""
    n_y, row_start, column = lit
    for i in range(LIGHT * low, LIGHT * (high + 1)):
        line[i] = _ZERO
    for far_z in range(2):
        wz = (z % s if far_z else s - z % s) / s
        for far_y in range(2):
            weight = np.float32(wz * ((y % s if far_y else s - y % s) / s))
            if weight == _ZERO:
                continue
            row = (z // s + far_z) * n_y + y // s + far_y
            for i in range(row_start[row], row_start[row + 1]):
                x = np.intp(column[i])
                if low <= x <= high:
                    for c in range(LIGHT):
                        line[LIGHT * x + c] += weight * light[i, c]
