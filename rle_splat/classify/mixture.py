"""Labels and channels: voxels of one grid classified by several transfer functions (algorithm.md 4.2).

A voxel's label chooses its function, or hides it; every channel adds its extinction, and its colour by its share of
the extinction, which is the sum of associated colours.  Labels are never interpolated: each voxel has its own, and what
is between two voxels is between two classified ones, as the paper's pipeline has it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.jit import read_only
from ..volume.blocks import Blocks, slabs
from ..volume.counts import counts_values
from .classification import EXTINCTION, LOOKS, OPACITY, RED, ClassifiedVolume, opacity_distance, optical_depth
from .mixture_kernels import add_looks, count_seen, mark_seen, mix, put_columns
from .visible import VisibleVoxels, row_offsets

VOXELS_AT_ONCE = 1 << 20  # whose float64 looks stay near the cache


@dataclass(frozen=True, eq=False)
class _Part:
    """One channel: the ``volume``, the ``functions`` it has, None for what is hidden, and which of them a label has.

    ``labels``: the label volume's voxels, None where the first function is meant everywhere.  ``known``: (k,) labels in
    ascending order that have function number 1 to k.
    """

    volume: object
    functions: tuple
    labels: np.ndarray | None = None
    known: np.ndarray | None = None

    @cached_property
    def has_tables(self) -> bool:
        """Whether there are so few values, of the volume and of the labels, that each has an entry in a table."""
        return counts_values(self.volume.voxels.dtype) and (self.labels is None or counts_values(self.labels.dtype))

    @cached_property
    def stored(self) -> np.ndarray:
        """(voxels,) values as they are stored; their bit patterns where there are tables."""
        return _patterns(self.volume.voxels) if self.has_tables else self.volume.voxels.reshape(-1)

    @cached_property
    def label_patterns(self) -> np.ndarray | None:
        return None if self.labels is None else _patterns(self.labels)

    @cached_property
    def number_table(self) -> np.ndarray:
        """By a label's bit pattern, the number of its function."""
        if self.labels is None:
            return np.zeros(1, np.uint16)
        values = _patterns_of(self.labels.dtype).view(self.labels.dtype)
        return self._numbers(values).astype(np.uint16)

    @cached_property
    def size(self) -> int:
        """Entries of one function in the tables."""
        return 1 << (8 * self.volume.voxels.dtype.itemsize)

    @cached_property
    def alphas(self) -> np.ndarray:
        """By entry of the tables, float64."""
        return np.concatenate([self._alpha(f, self._every_value) for f in self.functions])

    @cached_property
    def colors(self) -> np.ndarray:
        """(entries, 3) float64."""
        return np.concatenate([self._color(f, self._every_value) for f in self.functions])

    @cached_property
    def _every_value(self) -> np.ndarray:
        return _patterns_of(self.volume.voxels.dtype).view(self.volume.voxels.dtype)

    def _alpha(self, function, stored) -> np.ndarray:
        if function is None:
            return np.zeros(len(stored))
        return np.nan_to_num(np.asarray(function.alpha_at(self.volume.physical(stored)), np.float64))

    def _color(self, function, stored) -> np.ndarray:
        if function is None:
            return np.zeros((len(stored), 3))
        return np.nan_to_num(np.asarray(function.color_at(self.volume.physical(stored)), np.float64))

    def _numbers(self, labels) -> np.ndarray:
        """(n,) which function each of some labels has."""
        number = np.searchsorted(self.known, labels)
        return np.where(self.known[np.minimum(number, len(self.known) - 1)] == labels, number + 1, 0)

    def tables(self, volume, length: float, distance: float) -> tuple[np.ndarray, ...]:
        """What ``add_looks`` looks up; ``length``: world length of one of the volume's units."""
        own = np.repeat(self._distances(volume, length), self.size)
        return self.alphas, optical_depth(self.alphas) / own, self.colors, own == distance

    def looked_up(self, places, volume, length: float, distance: float) -> tuple[np.ndarray, ...]:
        """The same of the voxels at ``places``, an index of the flat volume, by the functions themselves."""
        stored = self.stored[places]
        numbers = np.zeros(len(stored), np.intp)
        if self.labels is not None:
            numbers = self._numbers(self.labels.reshape(-1)[places])
        alpha, color = np.zeros(len(stored)), np.zeros((len(stored), 3))
        for number, function in enumerate(self.functions):
            chosen = numbers == number
            if function is not None and chosen.any():
                alpha[chosen] = self._alpha(function, stored[chosen])
                color[chosen] = self._color(function, stored[chosen])
        own = self._distances(volume, length)[numbers]
        return alpha, optical_depth(alpha) / own, color, own == distance

    def _distances(self, volume, length: float) -> np.ndarray:
        """World length that opacities refer to, of each function; see ``classification.opacity_distance``."""
        return np.array([np.inf if f is None else opacity_distance(volume, f, length) for f in self.functions])


def _patterns(voxels) -> np.ndarray:
    """(n,) bit patterns of a volume of whole numbers, flat."""
    return read_only(np.ascontiguousarray(voxels).reshape(-1).view(f"u{voxels.dtype.itemsize}"))


def _patterns_of(dtype) -> np.ndarray:
    return np.arange(1 << (8 * dtype.itemsize), dtype=f"u{dtype.itemsize}")


@dataclass(frozen=True, eq=False)
class Mixture:
    """A volume with its own transfer function ``tf``, ``labels`` and further ``channels``, of a Scene."""

    volume: object
    tf: object
    labels: object = None
    channels: tuple = ()

    @cached_property
    def _parts(self) -> tuple[_Part, ...]:
        own = _Part(self.volume, (self.tf,))
        if self.labels is not None and self.labels.functions:
            known = np.array(sorted(self.labels.functions))
            functions = (self.tf, *(self.labels.functions[int(label)] for label in known))
            own = _Part(self.volume, functions, self.labels.volume.voxels, known)
        return (own, *(_Part(channel.volume, (channel.transfer_function,)) for channel in self.channels))

    @cached_property
    def key(self) -> str:
        """A hash of everything that the classified voxels depend on beside the first volume's own voxels."""
        functions = [(part.volume.key, [f and f.key for f in part.functions]) for part in self._parts]
        labels = None if self.labels is None else (self.labels.volume.key, sorted(self.labels.functions))
        return hashlib.blake2b(repr((functions, labels)).encode(), digest_size=16).hexdigest()

    def count_steps(self, *, backend: str = "auto", threads: int = 0):
        """Generator: yields the fraction done; returns (visible voxels, connected pieces) per row, (nz * ny,) each."""
        nx, ny, nz = self.volume.shape_xyz
        counts, row_pieces = np.zeros(nz * ny, np.int64), np.zeros(nz * ny, np.int32)
        for first, last in slabs(nz, ny * nx, VOXELS_AT_ONCE):
            yield first / nz
            seen, rows = self._seen(first, last, backend, threads), slice(first * ny, last * ny)
            count_seen(seen, counts[rows], row_pieces[rows], backend, threads)
        return counts, row_pieces

    def fill_steps(self, blocks: Blocks, counted, *, backend: str = "auto", threads: int = 0):
        """Generator: yields the fraction done; returns the VisibleVoxels of what ``count_steps`` returned."""
        nx, ny, nz = self.volume.shape_xyz
        counts, row_pieces = counted
        row_start = row_offsets(counts)
        column = np.empty(row_start[-1], np.uint16 if nx <= 65536 else np.int32)
        for first, last in slabs(nz, ny * nx, VOXELS_AT_ONCE):
            yield first / nz
            seen = self._seen(first, last, backend, threads)
            put_columns(seen, row_start[first * ny : last * ny + 1], column, backend, threads)
        stored = np.zeros(len(column), np.uint8)  # no value of the volume's own: the looks say it all
        return VisibleVoxels((nx, ny, nz), row_start, row_pieces, column, stored, blocks.nan_voxels)

    def classified(
        self, voxels: VisibleVoxels, length: float, *, backend: str = "auto", threads: int = 0
    ) -> ClassifiedVolume:
        """The looks of visible voxels; ``length``: world length of one of the volume's units."""
        distance = opacity_distance(self.volume, self.tf, length)
        tables = [part.tables(self.volume, length, distance) if part.has_tables else None for part in self._parts]
        looks = np.empty((len(voxels), LOOKS), np.float32)
        nx, row_start = self.volume.shape_xyz[0], voxels.row_start
        for begin in range(0, len(voxels), VOXELS_AT_ONCE):
            end = min(begin + VOXELS_AT_ONCE, len(voxels))
            first, last = np.searchsorted(row_start, (begin, end - 1), side="right") - 1
            held = np.diff(np.clip(row_start[first : last + 2], begin, end))
            places = np.repeat(np.arange(first, last + 1) * nx, held) + voxels.column[begin:end]
            mixed = np.zeros((end - begin, LOOKS))
            for part, table in zip(self._parts, tables):
                if table is None:
                    mix(mixed, *part.looked_up(places, self.volume, length, distance), distance)
                else:
                    add_looks(
                        places, part.stored, part.label_patterns, part.number_table, table, part.size, distance, mixed,
                        backend, threads,
                    )
            looks[begin:end, EXTINCTION], looks[begin:end, OPACITY] = mixed[:, 0], mixed[:, 1]
            looks[begin:end, RED:] = mixed[:, 2:]
        return ClassifiedVolume(voxels, looks, False, length, distance)

    def _seen(self, first: int, last: int, backend: str, threads: int) -> np.ndarray:
        """(rows, nx) bool: which voxels of planes [first, last) any channel shows."""
        nx, ny, _ = self.volume.shape_xyz
        places = slice(first * ny * nx, last * ny * nx)
        seen = np.zeros((last - first) * ny * nx, bool)
        for part in self._parts:
            if part.has_tables:
                labels = None if part.labels is None else part.label_patterns[places]
                mark_seen(
                    part.stored[places], labels, part.number_table, part.alphas > 0.0, part.size, seen, backend, threads
                )
            else:
                seen |= part.looked_up(places, self.volume, 1.0, 1.0)[0] > 0.0
        return seen.reshape(-1, nx)
