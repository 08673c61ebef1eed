"""Labels and channels: voxels of one grid classified by several transfer functions (algorithm.md 4.2).

A voxel's label chooses its function, or hides it; every channel adds its extinction, and its colour by its share of
the extinction, which is the sum of associated colours.  Labels are never interpolated: each voxel has its own, and what
is between two voxels is between two classified ones, as the paper's pipeline has it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..volume.blocks import Blocks, slabs
from ..volume.counts import counts_values
from .classification import EXTINCTION, LOOKS, OPACITY, RED, ClassifiedVolume, opacity_distance, optical_depth
from .visible import Visibility, VisibleVoxels, row_offsets

VOXELS_AT_ONCE = 1 << 20


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
    def alphas(self) -> tuple[Callable | None, ...]:
        return tuple(None if f is None else _looked_up(self.volume, f.alpha_at) for f in self.functions)

    @cached_property
    def colors(self) -> tuple[Callable | None, ...]:
        return tuple(None if f is None else _looked_up(self.volume, f.color_at) for f in self.functions)

    def numbers(self, places) -> np.ndarray | None:
        """(n,) which function the voxels at ``places``, an index of the flat volume, have; None for the first."""
        if self.labels is None:
            return None
        label = self.labels.reshape(-1)[places]
        number = np.searchsorted(self.known, label)
        return np.where(self.known[np.minimum(number, len(self.known) - 1)] == label, number + 1, 0)

    def at(self, places, looks, numbers, channels=()) -> np.ndarray:
        """(n, *channels) float64 of the voxels at ``places``, which have the functions ``numbers``, by their ``alphas``
        or ``colors``."""
        stored = self.volume.voxels.reshape(-1)[places]
        if numbers is None:
            return looks[0](stored)
        found = np.zeros((len(stored), *channels))
        for number, look in enumerate(looks):
            chosen = numbers == number
            if look is not None and chosen.any():
                found[chosen] = look(stored[chosen])
        return found

    def distances(self, volume, length: float, numbers) -> np.ndarray:
        """World length that opacities refer to, one or by voxel; see ``classification.opacity_distance``."""
        each = [np.inf if f is None else opacity_distance(volume, f, length) for f in self.functions]
        return np.float64(each[0]) if numbers is None else np.array(each)[numbers]


def _looked_up(volume, function: Callable) -> Callable:
    """``function`` of physical values as one of stored values; by a table where there are few."""
    if not counts_values(volume.voxels.dtype):
        return lambda stored: np.nan_to_num(np.asarray(function(volume.physical(stored)), np.float64))
    table = np.asarray(function(Visibility(volume, None).pattern_values), np.float64)
    pattern = f"u{volume.voxels.dtype.itemsize}"
    return lambda stored: table[stored.view(pattern)]


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

    def count_steps(self):
        """Generator: yields the fraction done; returns (visible voxels, connected pieces) per row, (nz * ny,) each."""
        nx, ny, nz = self.volume.shape_xyz
        counts, row_pieces = np.zeros(nz * ny, np.int64), np.zeros(nz * ny, np.int32)
        for first, last in slabs(nz, ny * nx):
            yield first / nz
            seen, rows = self._seen(first, last), slice(first * ny, last * ny)
            counts[rows] = seen.sum(axis=1)
            row_pieces[rows] = (seen[:, 1:] & ~seen[:, :-1]).sum(axis=1) + seen[:, 0]
        return counts, row_pieces

    def fill_steps(self, blocks: Blocks, counted):
        """Generator: yields the fraction done; returns the VisibleVoxels of what ``count_steps`` returned."""
        nx, ny, nz = self.volume.shape_xyz
        counts, row_pieces = counted
        row_start = row_offsets(counts)
        column = np.empty(row_start[-1], np.uint16 if nx <= 65536 else np.int32)
        for first, last in slabs(nz, ny * nx):
            yield first / nz
            part = slice(row_start[first * ny], row_start[last * ny])
            column[part] = np.nonzero(self._seen(first, last))[1]
        stored = np.zeros(len(column), np.uint8)  # no value of the volume's own: the looks say it all
        return VisibleVoxels((nx, ny, nz), row_start, row_pieces, column, stored, blocks.nan_voxels)

    def classified(self, voxels: VisibleVoxels, length: float) -> ClassifiedVolume:
        """The looks of visible voxels; ``length``: world length of one of the volume's units."""
        looks = np.empty((len(voxels), LOOKS), np.float32)
        rows = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
        places = rows * self.volume.shape_xyz[0] + voxels.column
        for begin in range(0, len(voxels), VOXELS_AT_ONCE):
            part = slice(begin, begin + VOXELS_AT_ONCE)
            self._write_looks(places[part], length, looks[part])
        return ClassifiedVolume(voxels, looks, False, length, opacity_distance(self.volume, self.tf, length))

    def _seen(self, first: int, last: int) -> np.ndarray:
        """(rows, nx) bool: which voxels of planes [first, last) any channel shows."""
        nx, ny, _ = self.volume.shape_xyz
        places = slice(first * ny * nx, last * ny * nx)
        seen = np.zeros((last - first) * ny * nx, bool)
        for part in self._parts:
            seen |= part.at(places, part.alphas, part.numbers(places)) > 0.0
        return seen.reshape(-1, nx)

    def _write_looks(self, places, length: float, looks) -> None:
        distance = opacity_distance(self.volume, self.tf, length)
        total, opacity, mixed = 0.0, 0.0, []
        for part in self._parts:
            numbers = part.numbers(places)
            alpha = part.at(places, part.alphas, numbers)
            own = part.distances(self.volume, length, numbers)
            sigma = optical_depth(alpha) / own
            # What one function shows alone, per the distance of the first, keeps its opacity to the bit.
            alone = (total == 0.0) & (own == distance)
            added = np.where(alone, alpha, -np.expm1(-(total + sigma) * distance))
            opacity = np.where(sigma == 0.0, opacity, added)
            total = total + sigma
            mixed.append((sigma, part.at(places, part.colors, numbers, (3,))))
        looks[:, EXTINCTION], looks[:, OPACITY] = total, opacity
        looks[:, RED:] = sum((sigma / total)[:, None] * color for sigma, color in mixed)
