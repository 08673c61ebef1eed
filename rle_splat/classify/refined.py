"""Refined classification: the scalar is interpolated to a finer grid and classified there (algorithm.md, 1.10 (ii)).

The finer grid never exists as a whole. It is computed some planes at a time, and only in blocks that the transfer
function shows. ``FineVoxels`` takes the place of an array of voxels, ``RefinedVolume`` that of a Volume.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..runtime.steps import drain
from ..volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z, Blocks, block_steps, slabs
from ..volume.counts import counts_values
from .points import LARGEST
from .sizes import FINE_VOXELS_AT_ONCE

MOST_CODE = 65535


@dataclass(frozen=True, eq=False)
class RefinedVolume:
    """A volume on a finer grid, with voxels interpolated between those of ``source``.

    Parameters
    ----------
    source : Volume
    tf : TransferFunction
    refinement : int
        Fine cells along each side of a cell of ``source``.

    Notes
    -----
    Interpolation is trilinear, as in the truth T2. Fine voxel ``refinement * i`` equals voxel i, so an axis has
    ``refinement * (n - 1) + 1`` fine voxels, which fill the box of the voxel centers. Voxels of 8 and 16 bits become
    16-bit codes over the range in which ``tf`` varies; other types stay floating-point. A fine voxel next to a NaN is
    NaN. An infinite voxel counts as the nearest point of the transfer function.
    """

    source: object
    tf: object
    refinement: int

    holds_values: ClassVar[bool] = True

    @cached_property
    def voxels(self) -> FineVoxels:
        """The fine voxels, computed on demand."""
        return FineVoxels.between(self.source, self.tf, self.refinement)

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Number of fine voxels along x, y, z."""
        return tuple(self.refinement * (n - 1) + 1 for n in self.source.shape_xyz)

    @property
    def affine(self) -> np.ndarray:
        """(4, 4) float64, fine voxel index (x, y, z, 1) to the volume's own space."""
        return self.source.affine @ np.diag((*(3 * [1.0 / self.refinement]), 1.0))

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: spacing of the voxels of ``source``, to which an opacity may refer."""
        return self.source.spacing

    @property
    def slope(self) -> float:
        """See Volume."""
        return self.source.slope

    @property
    def intercept(self) -> float:
        """See Volume."""
        return self.source.intercept

    @property
    def remarks(self) -> tuple:
        """See Volume."""
        return self.source.remarks

    @property
    def key(self) -> str:
        """Hash of everything on which the fine voxels depend."""
        made = (self.source.key, self.refinement, self.voxels.dtype.str, self.voxels.base, self.voxels.step)
        return hashlib.blake2b(repr((*made, self.voxels.ends)).encode(), digest_size=16).hexdigest()

    @property
    def voxels_at_once(self) -> int:
        """Fine voxels of ``planes`` that are made together."""
        return FINE_VOXELS_AT_ONCE

    def planes(self, first: int, last: int, relevant, hidden, **machine) -> np.ndarray:
        """See ``FineVoxels.planes``."""
        return self.voxels.planes(first, last, relevant, hidden, **machine)

    def physical(self, stored) -> np.ndarray:
        """Convert fine voxels, as stored in ``voxels``, to physical values, float64."""
        return self.source.physical(self.voxels.stored(stored))


@dataclass(frozen=True, eq=False)
class FineVoxels:
    """The voxels of a RefinedVolume, computed on demand.

    Attributes
    ----------
    coarse : (nz, ny, nx) ndarray
        Stored values of the source.
    refinement : int
    dtype : numpy.dtype
        uint16 for codes, where a stored value is ``base + step * code``, clamped; else a floating-point type that holds
        stored values, with ``base`` 0 and ``step`` 1.
    base, step : float
    ends : (low, high)
        Stored values that replace -inf and inf.
    """

    coarse: np.ndarray
    refinement: int
    dtype: np.dtype
    base: float
    step: float
    ends: tuple[float, float]

    @classmethod
    def between(cls, volume, tf, refinement: int) -> FineVoxels:
        """The FineVoxels of a volume and a transfer function."""
        own = volume.voxels.dtype
        first, last = _stored_ends(volume, (tf.opacity, tf.color))
        if not counts_values(own):
            single = own == np.float32
            return cls(volume.voxels, refinement, np.dtype("f4" if single else "f8"), 0.0, 1.0, (first, last))
        limits = np.iinfo(own)
        low, high = _varying_range(volume, (tf.opacity, tf.color))
        # One more stored value on either side, which looks like everything beyond it.
        low, high = (float(np.clip(end, limits.min, limits.max)) for end in (np.floor(low) - 1, np.ceil(high) + 1))
        # A power of two codes per stored value, so that the voxels themselves are exact: otherwise a step of the
        # transfer function exactly at the value of a region could lose the region.
        codes_per_value = 2.0 ** math.floor(math.log2(MOST_CODE / max(high - low, 1.0)))
        return cls(volume.voxels, refinement, np.dtype("u2"), low, 1.0 / codes_per_value, (first, last))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of fine voxels along z, y, x."""
        return tuple(self.refinement * (n - 1) + 1 for n in self.coarse.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of the source's voxels; fine voxels are not stored."""
        return self.coarse.nbytes

    @property
    def _coding(self):
        """(base, codes per stored value) for kernels; None if voxels are not coded."""
        return (self.base, 1.0 / self.step) if self.dtype.kind == "u" else None

    def stored(self, fine) -> np.ndarray:
        """Convert fine voxels to stored values, float64."""
        return self.base + self.step * np.asarray(fine, dtype=np.float64)

    def planes(self, first: int, last: int, relevant, hidden, *, backend: str = "auto", threads: int = 0) -> np.ndarray:
        """Compute some planes of fine voxels.

        Parameters
        ----------
        first, last : int
            Half-open range of planes; ``first`` is a multiple of BLOCK_Z.
        relevant : (blocks along z, y, x) ndarray of uint8
            Blocks of these planes. Where it is 0, only the last voxel of a row of the block is set, to ``hidden``.
        hidden : (blocks along z, y, x) ndarray
            A hidden value for each block.
        backend : {"auto", "numba", "numpy"}
        threads : int
            0 for one per core.

        Returns
        -------
        (last - first, ny, nx) ndarray
        """
        _, n_y, n_x = self.shape
        if not compiled(backend):
            return np.stack([self._plane_numpy(z) for z in range(first, last)])
        made = np.empty((last - first, n_y, n_x), self.dtype)
        with parallel_call(threads):
            _interpolate(
                read_only(self.coarse), self.refinement, first, n_y, read_only(relevant), read_only(hidden), self.ends,
                self._coding, made.reshape(-1, n_x),
            )
        return made

    def block_steps(self, *, backend: str = "auto", threads: int = 0):
        """Generator: yield the fraction done, return the Blocks of the fine voxels."""
        shape = tuple(-(-n // size) for n, size in zip(self.shape, (BLOCK_Z, BLOCK_Y, BLOCK_X)))
        low, high = np.empty((2, *shape), self.dtype)
        for first, last in slabs(shape[0], math.prod(shape[1:]), FINE_VOXELS_AT_ONCE // (BLOCK_Z * BLOCK_Y * BLOCK_X)):
            yield first / shape[0]
            arguments = (self.coarse, self.refinement, first, *self.shape, self.ends, self._coding)
            if compiled(backend):
                with parallel_call(threads):
                    _extremes(read_only(self.coarse), *arguments[1:], low[first:last], high[first:last])
            else:
                self._extremes_numpy(first, last, low, high)
        return Blocks(low, high, 0)

    # Reference implementations.

    def _loaded_numpy(self, stored) -> np.ndarray:
        """Reference implementation of ``_loaded``."""
        values = np.asarray(stored, dtype=np.float64)
        values = np.where(values == np.inf, self.ends[1], np.where(values == -np.inf, self.ends[0], values))
        return np.clip(values, -LARGEST, LARGEST)

    def _coded_numpy(self, values) -> np.ndarray:
        """Reference implementation of ``_coded``."""
        if self._coding is None:
            return values.astype(self.dtype)
        base, per_value = self._coding
        return np.clip(np.rint((values - base) * per_value), 0, MOST_CODE).astype(self.dtype)

    def _plane_numpy(self, z: int) -> np.ndarray:
        """Reference implementation of ``_interpolate``, for one plane."""
        s, (_, n_y, n_x) = self.refinement, self.shape

        def neighbors(n):
            at = np.arange(n)
            return at // s, -(-at // s), (at % s) / s

        (y0, y1, wy), (x0, x1, wx) = neighbors(n_y), neighbors(n_x)
        z0, z1, wz = z // s, -(-z // s), (z % s) / s
        lines = []
        for plane in (self._loaded_numpy(self.coarse[z0]), self._loaded_numpy(self.coarse[z1])):
            lines.append(plane[y0] + (plane[y1] - plane[y0]) * wy[:, None])
        line = lines[0] + (lines[1] - lines[0]) * wz
        return self._coded_numpy(line[:, x0] + (line[:, x1] - line[:, x0]) * wx)

    def _extremes_numpy(self, first: int, last: int, low, high):
        """Reference implementation of ``_extremes``."""
        s = self.refinement
        spans = [
            [(b * size // s, -(-min((b + 1) * size - 1, n - 1) // s) + 1) for b in range(-(-n // size))]
            for n, size in zip(self.shape, (BLOCK_Z, BLOCK_Y, BLOCK_X))
        ]
        for k in range(first, last):
            values = self._loaded_numpy(self.coarse[slice(*spans[0][k])])
            for reduce, filling, out in ((np.fmin, np.inf, low), (np.fmax, -np.inf, high)):
                across = np.where(np.isnan(values), filling, values)
                across = reduce.reduce(across, axis=0)
                across = np.stack([reduce.reduce(across[slice(*span)], axis=0) for span in spans[1]])
                across = np.stack([reduce.reduce(across[:, slice(*span)], axis=1) for span in spans[2]], axis=1)
                out[k] = self._coded_numpy(across)


def fine_block_steps(volume: RefinedVolume, *, backend: str = "auto", threads: int = 0):
    """As ``blocks.block_steps``, of a refined volume; its NaN are those of the volume that it is made from."""
    machine = dict(backend=backend, threads=threads)
    blocks = yield from volume.voxels.block_steps(**machine)
    if volume.voxels.dtype.kind == "u":
        return blocks
    return Blocks(blocks.low, blocks.high, drain(block_steps(volume.source, **machine)).nan_voxels)


def _stored_of(volume, physical: float) -> float:
    """Stored value of a physical value, clamped to finite numbers."""
    return float(np.clip((np.float64(physical) - volume.intercept) / volume.slope, -LARGEST, LARGEST))


def _stored_ends(volume, functions) -> tuple[float, float]:
    """Stored values, ascending, of the first and last point of transfer function curves."""
    values = [point[0] for points in functions for point in points]
    first, last = sorted(_stored_of(volume, end) for end in (min(values), max(values)))
    return first, last


def _varying_range(volume, functions) -> tuple[float, float]:
    """Stored values (low, high) outside which all curves are constant; (middle, middle) if they are constant."""
    ends = []
    for points in functions:
        table = np.array(sorted(points, key=lambda point: point[0]), dtype=np.float64)
        changes = np.flatnonzero((table[1:, 1:] != table[:-1, 1:]).any(axis=1))
        if len(changes):
            ends += [table[changes[0], 0], table[changes[-1] + 1, 0]]
    if not ends:
        return (sum(_stored_ends(volume, functions)) / 2.0,) * 2
    low, high = sorted(_stored_of(volume, end) for end in (min(ends), max(ends)))
    return low, high


# --- kernels --------------------------------------------------------------------------------------------------


@kernel(exact=True, inline="always")
def _loaded(stored, ends):
    """A stored value as float64; infinities are replaced by ``ends``, and large values clamped against overflow."""
    value = np.float64(stored)
    if value == np.inf:
        return ends[1]
    if value == -np.inf:
        return ends[0]
    if value > LARGEST:
        return LARGEST
    if value < -LARGEST:
        return -LARGEST
    return value


@kernel(exact=True, inline="always")
def _coded(value, coding):
    """Convert an interpolated value to what a fine voxel holds."""
    if coding is None:
        return value
    return min(max(np.rint((value - coding[0]) * coding[1]), 0.0), 65535.0)


@kernel
def _interpolate(voxels, refinement, first_plane, n_y, relevant, hidden, ends, coding, rows):
    """Interpolate fine planes from ``first_plane`` on: ``voxels`` (nz, ny, nx) -> ``rows`` (planes * n_y, fine nx).

    ``relevant``, ``hidden``: see ``FineVoxels.planes``; ``ends``, ``coding``: see FineVoxels.
    """
    arguments = (voxels, refinement, first_plane, n_y, relevant, hidden, ends, coding, rows)
    share_out(_interpolate_rows, rows.shape[0], arguments)


@kernel(exact=True, inner=True)
def _interpolate_rows(begin, end, voxels, s, first_plane, n_y, relevant, hidden, ends, coding, rows):
    """``_interpolate`` for rows [begin, end)."""
    width = rows.shape[1]
    line = np.empty(voxels.shape[2], np.float64)  # interpolated along y and z, next along x
    share = np.arange(s) / s
    for row in range(begin, end):
        plane, y = row // n_y, row % n_y
        z = first_plane + plane
        z0, z1, wz = z // s, (z + s - 1) // s, share[z % s]
        y0, y1, wy = y // s, (y + s - 1) // s, share[y % s]
        for b in range(relevant.shape[2]):
            first, stop = b * BLOCK_X, min((b + 1) * BLOCK_X, width)
            if relevant[plane // BLOCK_Z, y // BLOCK_Y, b] == 0:
                rows[row, stop - 1] = hidden[plane // BLOCK_Z, y // BLOCK_Y, b]
                continue
            c = first // s
            for x in range(c, (stop + s - 2) // s + 1):
                near, far = _loaded(voxels[z0, y0, x], ends), _loaded(voxels[z1, y0, x], ends)
                near += (_loaded(voxels[z0, y1, x], ends) - near) * wy
                far += (_loaded(voxels[z1, y1, x], ends) - far) * wy
                line[x] = near + (far - near) * wz
            phase = first - c * s
            for x in range(first, stop):
                value = line[c]
                if phase > 0:
                    value += (line[c + 1] - value) * share[phase]
                rows[row, x] = _coded(value, coding)
                phase += 1
                if phase == s:
                    phase = 0
                    c += 1


@kernel
def _extremes(voxels, refinement, first_block, fine_z, fine_y, fine_x, ends, coding, low, high):
    """Bounds of the fine voxels of each block: the extremes of the voxels around it.

    The fine grid has ``fine_z`` x ``fine_y`` x ``fine_x`` voxels. Writes ``low`` and ``high`` (blocks along z from
    ``first_block`` on, y, x).
    """
    arguments = (voxels, refinement, first_block, fine_z, fine_y, fine_x, ends, coding, low, high)
    share_out(_rows_of_blocks, low.shape[0] * low.shape[1], arguments)


@kernel(exact=True, inner=True)
def _rows_of_blocks(begin, end, voxels, s, first_block, fine_z, fine_y, fine_x, ends, coding, low, high):
    """``_extremes`` for rows of blocks [begin, end), numbered along y, then z."""
    n_x = voxels.shape[2]
    smallest, largest = np.empty(n_x, np.float64), np.empty(n_x, np.float64)
    for row in range(begin, end):
        k, j = row // low.shape[1], row % low.shape[1]
        z, y = (first_block + k) * BLOCK_Z, j * BLOCK_Y
        smallest[:], largest[:] = np.inf, -np.inf
        for at_z in range(z // s, (min(z + BLOCK_Z, fine_z) + s - 2) // s + 1):
            for at_y in range(y // s, (min(y + BLOCK_Y, fine_y) + s - 2) // s + 1):
                for x in range(n_x):
                    value = _loaded(voxels[at_z, at_y, x], ends)
                    smallest[x] = value if value < smallest[x] else smallest[x]  # never for NaN
                    largest[x] = value if value > largest[x] else largest[x]
        for b in range(low.shape[2]):
            lowest, highest = np.inf, -np.inf
            for x in range(b * BLOCK_X // s, (min((b + 1) * BLOCK_X, fine_x) + s - 2) // s + 1):
                lowest = min(smallest[x], lowest)
                highest = max(largest[x], highest)
            low[k, j, b] = _coded(lowest, coding)
            high[k, j, b] = _coded(highest, coding)
