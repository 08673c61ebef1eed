"""Labels and channels: voxels of one grid classified by several transfer functions (algorithm.md 4.2).

A voxel's label selects its transfer function, or hides the voxel. Channels are added: extinctions add up, and colors
are averaged by extinction, which is the sum of associated colors. Label numbers are never interpolated: each voxel is
classified by its own label, or, beside an edge, by the functions that share it (``label_edges.py``). Samples between
voxels interpolate classified voxels, as in the paper's pipeline.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..runtime.jit import read_only, run_either
from ..runtime.work_sizes import MIXED_AT_ONCE
from ..volume.blocks import cut_chunks
from ..volume.counts import counts_values
from . import mixture_kernels as kernels
from . import reference
from .classification import (
    ALPHA_CAP,
    EXTINCTION,
    OPACITY,
    PROPERTIES,
    RED,
    ClassifiedVolume,
    opacity_distance,
    optical_depth,
)
from .label_edges import EdgeShares, edge_shares, nearest_seen
from .limits import LEAST_DISTANCE
from .mixture_kernels import NO_LABELS
from .reference import WORD, mix, pack
from .visible import VisibleVoxels

if TYPE_CHECKING:
    from ..scene import Channel, Labels
    from ..volume.volume import Volume
    from .transfer_function import TransferFunction


@dataclass(frozen=True, eq=False)
class _Part:
    """One channel.

    Attributes
    ----------
    functions : tuple of TransferFunction or None
        Function 0 is the default; None hides.
    labels : (nz, ny, nx) ndarray of integers or None
        Label of each voxel; None where function 0 is used everywhere.
    known : (k,) ndarray of integers or None
        Ascending labels that have functions 1 to k.
    is_smooth : bool
        Whether voxels beside edges of labels are shared.
    """

    volume: Volume
    functions: tuple
    labels: np.ndarray | None = None
    known: np.ndarray | None = None
    is_smooth: bool = False

    @cached_property
    def has_tables(self) -> bool:
        """Whether values and labels have at most 16 bits, so that lookup tables by bit pattern are possible."""
        return counts_values(self.volume.voxels.dtype) and (self.labels is None or counts_values(self.labels.dtype))

    @cached_property
    def stored(self) -> np.ndarray:
        """(voxels,) stored values; their bit patterns if there are tables."""
        return _patterns(self.volume.voxels) if self.has_tables else self.volume.voxels.reshape(-1)

    @cached_property
    def label_patterns(self) -> np.ndarray | None:
        """(voxels,) bit patterns of the labels; None without labels."""
        return None if self.labels is None else _patterns(self.labels)

    @cached_property
    def number_table(self) -> np.ndarray:
        """Function number by bit pattern of the label, uint16."""
        if self.labels is None:
            return np.zeros(1, np.uint16)
        values = _patterns_of(self.labels.dtype).view(self.labels.dtype)
        return self._numbers(values).astype(np.uint16)

    @cached_property
    def size(self) -> int:
        """Table entries per function."""
        return 1 << (8 * self.volume.voxels.dtype.itemsize)

    @cached_property
    def alphas(self) -> np.ndarray:
        """(entries,) float64 opacity."""
        return np.concatenate([self._alpha(f, self._every_value) for f in self.functions])

    @cached_property
    def colors(self) -> np.ndarray:
        """(entries, 3) float64 color."""
        return np.concatenate([self._color(f, self._every_value) for f in self.functions])

    @cached_property
    def _every_value(self) -> np.ndarray:
        """All stored values, by bit pattern."""
        return _patterns_of(self.volume.voxels.dtype).view(self.volume.voxels.dtype)

    def _alpha(self, function, stored) -> np.ndarray:
        """(n,) float64 opacity of stored values; 0 for NaN and for a hidden label."""
        if function is None:
            return np.zeros(len(stored))
        return np.nan_to_num(np.asarray(function.alpha_at(self.volume.physical(stored)), np.float64))

    def _color(self, function, stored) -> np.ndarray:
        """(n, 3) float64 color of stored values; 0 for NaN and for a hidden label."""
        if function is None:
            return np.zeros((len(stored), 3))
        return np.nan_to_num(np.asarray(function.color_at(self.volume.physical(stored)), np.float64))

    def _numbers(self, labels) -> np.ndarray:
        """(n,) function number of each of ``labels``."""
        number = np.searchsorted(self.known, labels)
        return np.where(self.known[np.minimum(number, len(self.known) - 1)] == labels, number + 1, 0)

    def tables(self, volume, length: float, distance: float) -> tuple[np.ndarray, ...]:
        """Lookup tables of ``add_channel``; ``length``: world length of one of the volume's units."""
        own = np.repeat(self._distances(volume, length), self.size)
        return self.alphas, optical_depth(self.alphas) / own, self.colors, own == distance

    def look_up(self, indices, volume, length: float, distance: float) -> tuple[np.ndarray, ...]:
        """As ``tables``, evaluated for the voxels at ``indices``, indices into the flat volume."""
        numbers = 0 if self.labels is None else self._numbers(self.labels.reshape(-1)[indices])
        stored = self.stored[indices]
        return self._evaluate(stored, np.broadcast_to(numbers, stored.shape), volume, length, distance)

    def _evaluate(self, stored, numbers, volume, length: float, distance: float) -> tuple[np.ndarray, ...]:
        """As ``tables``, evaluated for ``stored`` values (n,) and function ``numbers`` (n,)."""
        alpha, color = np.zeros(len(stored)), np.zeros((len(stored), 3))
        for number in np.unique(numbers):
            function, chosen = self.functions[number], numbers == number
            if function is not None:
                alpha[chosen] = self._alpha(function, stored[chosen])
                color[chosen] = self._color(function, stored[chosen])
        own = self._distances(volume, length)[numbers]
        return alpha, optical_depth(alpha) / own, color, own == distance

    def hides(self, flat: slice) -> np.ndarray:
        """Which voxels of a range of the flat volume are hidden."""
        return self._hidden[self._numbers_of(self.labels.reshape(-1)[flat])]

    @cached_property
    def _hidden(self) -> np.ndarray:
        """(functions,) bool: which hide."""
        return np.array([function is None for function in self.functions])

    def _numbers_of(self, labels) -> np.ndarray:
        """Function numbers of labels, uint16; by the table where there can be one."""
        if counts_values(labels.dtype):
            return self.number_table[labels.view(f"u{labels.dtype.itemsize}")]
        return self._numbers(labels).astype(np.uint16)

    def edges(self, first: int, last: int, threads: int) -> EdgeShares:
        """The shares of voxels beside edges of labels in planes [first, last)."""
        begin = max(first - 1, 0)
        numbers = self._numbers_of(self.labels[begin : last + 1])
        return edge_shares(numbers, self._hidden, first - begin, last - begin, threads=threads)

    def blend(self, edges: EdgeShares, offset: int, tables, volume, length: float, distance: float) -> tuple:
        """As ``look_up``, for the voxels beside edges: opacities and associated colors averaged by share.

        ``offset``: index into the flat volume of the planes' first voxel. Opacities are those of the smallest spacing,
        about the length of a ray in a voxel: in an opaque label that covers half of a voxel, half of the light stays.
        """
        stored = self.stored[edges.source + offset]
        if tables is None:
            _, extinction, color, _ = self._evaluate(stored, edges.number, volume, length, distance)
        else:
            _, extinction, color, _ = (table[self._entries(stored, edges.number)] for table in tables)
        step = max(length * float(volume.spacing.min()), LEAST_DISTANCE)
        matter = edges.share * -np.expm1(-extinction * step)
        count = len(edges.at)
        alpha = edges.summed(matter)
        colors = np.stack([edges.summed(matter * color[:, c]) for c in range(3)], axis=1)
        colors = np.divide(colors, alpha[:, None], out=np.zeros_like(colors), where=alpha[:, None] > 0.0)
        extinction = optical_depth(alpha) / step
        return -np.expm1(-extinction * distance), extinction, colors, np.ones(count, bool)

    def find_visible_beside(self, edges: EdgeShares, offset: int) -> np.ndarray:
        """Which voxels beside edges are visible; ``offset`` as in ``blend``."""
        stored = self.stored[edges.source + offset]
        if self.has_tables:
            alpha = self.alphas[self._entries(stored, edges.number)]
        else:
            alpha = self._evaluate(stored, edges.number, self.volume, 1.0, 1.0)[0]
        return edges.summed(alpha > 0.0) > 0.0

    def _entries(self, stored, numbers) -> np.ndarray:
        """Table entries of bit patterns (n,) for function ``numbers`` (n,)."""
        return stored + self.size * numbers.astype(np.intp)

    def _distances(self, volume, length: float) -> np.ndarray:
        """(functions,) world length to which opacities refer; see ``classification.opacity_distance``."""
        return np.array([np.inf if f is None else opacity_distance(volume, f, length) for f in self.functions])


def _patterns(voxels) -> np.ndarray:
    """(n,) bit patterns of an integer volume, flat."""
    return read_only(np.ascontiguousarray(voxels).reshape(-1).view(f"u{voxels.dtype.itemsize}"))


def _patterns_of(dtype) -> np.ndarray:
    """All bit patterns of an integer type, ascending."""
    return np.arange(1 << (8 * dtype.itemsize), dtype=f"u{dtype.itemsize}")


@dataclass(frozen=True, eq=False)
class Mixture:
    """A volume with labels and further channels.

    Parameters
    ----------
    tf : TransferFunction
        Transfer function of ``volume``.
    channels : tuple of Channel
    """

    volume: Volume
    tf: TransferFunction
    labels: Labels | None = None
    channels: Sequence[Channel] = ()

    @cached_property
    def _parts(self) -> tuple[_Part, ...]:
        """The channels: the volume itself first."""
        own = _Part(self.volume, (self.tf,))
        if self.labels is not None and self.labels.functions:
            known = np.array(sorted(self.labels.functions))
            functions = (self.tf, *(self.labels.functions[int(label)] for label in known))
            own = _Part(self.volume, functions, self.labels.volume.voxels, known, self.labels.smooth)
        return (own, *(_Part(channel.volume, (channel.transfer_function,)) for channel in self.channels))

    @cached_property
    def key(self) -> str:
        """Hash of everything on which the classified voxels depend, except the first volume's voxels."""
        functions = [(part.volume.key, [f and f.key for f in part.functions]) for part in self._parts]
        labels = self.labels and (self.labels.volume.key, sorted(self.labels.functions), self.labels.smooth)
        return hashlib.blake2b(repr((functions, labels)).encode(), digest_size=16).hexdigest()

    def mark_steps(self, *, threads: int = 0):
        """Generator of fractions done: mark the visible voxels.

        Returns
        -------
        (nz * ny, words) ndarray of uint64
            As of ``visible.mark_steps``.
        """
        nx, ny, nz = self.volume.shape_xyz
        bits = np.zeros((nz * ny, -(-nx // WORD)), np.uint64)
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            yield first / nz
            pack(self._find_visible(first, last, threads), bits[first * ny : last * ny])
        return bits

    def classify(self, voxels: VisibleVoxels, length: float, *, threads: int = 0) -> ClassifiedVolume:
        """Optical properties of visible voxels; ``length``: world length of one of the volume's units."""
        distance = opacity_distance(self.volume, self.tf, length)
        tables = [part.tables(self.volume, length, distance) if part.has_tables else None for part in self._parts]
        properties = np.empty((len(voxels), PROPERTIES), np.float32)
        nx, ny, nz = self.volume.shape_xyz
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            row_start = voxels.row_start[first * ny : last * ny + 1]
            begin, end = row_start[[0, -1]]
            indices = np.repeat(np.arange(first * ny, last * ny, dtype=np.int64) * nx, np.diff(row_start))
            indices += voxels.column[begin:end]
            mixed = np.zeros((end - begin, PROPERTIES))
            for part, table in zip(self._parts, tables):
                if table is None:
                    mix(mixed, *part.look_up(indices, self.volume, length, distance), distance)
                else:
                    labels = NO_LABELS if part.labels is None else part.label_patterns
                    own = indices, part.stored, labels, part.number_table, *table, part.size, distance, mixed
                    run_either(threads, kernels.add_channel, reference.add_channel, *own)
                if part.is_smooth:
                    edges, offset = part.edges(first, last, threads), first * ny * nx
                    blended = part.blend(edges, offset, table, self.volume, length, distance)
                    rows = np.searchsorted(indices, edges.at + offset)
                    own = np.flatnonzero(np.append(indices, -1)[rows] == edges.at + offset)  # those that are visible
                    rows = rows[own]
                    mixed[rows] = 0.0
                    mixed[rows] = mix(mixed[rows], *(each[own] for each in blended), distance)
            properties[begin:end, EXTINCTION], properties[begin:end, OPACITY] = mixed[:, 0], mixed[:, 1]
            properties[begin:end, RED:] = mixed[:, 2:]
        return ClassifiedVolume(voxels, properties, False, length, distance)

    def reveal_steps(self, *, threads: int = 0):
        """Generator of fractions done: the volume for labels that only hide, whose hidden values must show nowhere.

        Returns
        -------
        Volume
            A hidden voxel with a neighbor that ``factor_steps`` shows, be it in part, has the value of a visible one
            near it: between them values are interpolated.
        """
        own, voxels = self._parts[0], self.volume.voxels.copy()
        nx, ny, nz = self.volume.shape_xyz
        flat = self.volume.voxels.reshape(-1)
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            yield first / nz
            begin, end = max(first - 1, 0), min(last + 1, nz)
            edges, offset = own.edges(begin, end, threads), begin * ny * nx
            seen = ~own.hides(slice(offset, end * ny * nx))
            sources = np.arange(len(seen))
            at = edges.at[edges.voxel]
            seen[at], sources[at] = True, edges.source
            rows, found = nearest_seen(seen.reshape(-1, ny, nx), first - begin, last - begin)
            sources[rows] = sources[found]
            changed = np.flatnonzero(sources != np.arange(len(sources)))
            changed = changed[(changed >= (first - begin) * ny * nx) & (changed < (last - begin) * ny * nx)]
            voxels.reshape(-1)[offset + changed] = flat[offset + sources[changed]]
        return replace(self.volume, voxels=voxels)

    def mask_steps(self, stored):
        """Generator of fractions done: the volume with one ``stored`` value in place of all hidden ones.

        Returns
        -------
        Volume
        """
        own, voxels = self._parts[0], self.volume.voxels.copy()
        nx, ny, nz = self.volume.shape_xyz
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            yield first / nz
            flat = slice(first * ny * nx, last * ny * nx)
            voxels.reshape(-1)[flat][own.hides(flat)] = stored
        return replace(self.volume, voxels=voxels)

    def factor_steps(self, voxels: VisibleVoxels, depth, *, threads: int = 0):
        """Generator of fractions done: what labels that only hide leave of the extinction of post-classified voxels.

        Parameters
        ----------
        voxels : VisibleVoxels
            Voxels of the volume of ``reveal_steps``.
        depth : (m,) ndarray of float32
            Their optical depth over the smallest spacing.
        threads : int
            0 for one per core.

        Returns
        -------
        (m,) ndarray of float32
            0 where a label hides, 1 where none does and no edge is near. A voxel of share s and optical depth t has the
            opacity s (1 - exp(-t)), as in ``blend``.
        """
        own, factor = self._parts[0], np.empty(len(voxels), np.float32)
        nx, ny, nz = self.volume.shape_xyz
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            yield first / nz
            row_start = voxels.row_start[first * ny : last * ny + 1]
            begin, end = row_start[[0, -1]]
            rows = np.repeat(np.arange((last - first) * ny) * nx, np.diff(row_start)) + voxels.column[begin:end]
            share = (~own.hides(slice(first * ny * nx, last * ny * nx))).astype(np.float64)
            edges = own.edges(first, last, threads)
            share[edges.at] = edges.summed(edges.share)
            share, deep = share[rows], depth[begin:end].astype(np.float64)
            thinned = -np.log1p(np.maximum(share * np.expm1(-deep), -ALPHA_CAP))
            factor[begin:end] = np.divide(thinned, deep, out=share.copy(), where=(deep > 0.0) & (share < 1.0))
        return factor

    def _find_visible(self, first: int, last: int, threads: int) -> np.ndarray:
        """(rows, nx) bool: which voxels of planes [first, last) are visible in any channel."""
        nx, ny, _ = self.volume.shape_xyz
        flat = slice(first * ny * nx, last * ny * nx)
        seen = np.zeros((last - first) * ny * nx, bool)
        for part in self._parts:
            if part.has_tables:
                labels = None if part.labels is None else part.label_patterns[flat]
                own = part.stored[flat], labels, part.number_table, part.alphas > 0.0, part.size, seen
                run_either(threads, kernels.mark_seen, reference.mark_seen, *own)
            else:
                seen |= part.look_up(flat, self.volume, 1.0, 1.0)[0] > 0.0
            if part.is_smooth:  # the first one, so that nothing else is marked yet
                edges = part.edges(first, last, threads)
                seen[edges.at] = part.find_visible_beside(edges, flat.start)
        return seen.reshape(-1, nx)
