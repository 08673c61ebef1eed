"""Labels of a post-classified scan: the functions that classify it, and where each of them does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..classify.classification import opacity_distance
from ..classify.label_cells import KINDS, NO_KIND, SLOPE_OF_ONE, LabelCells, cell_steps
from ..classify.label_edges import beside_any
from ..classify.lookup_table import LookupTable, extinction_of, lookup_table
from ..classify.reference import pack
from ..classify.relevant import Reach
from ..classify.shown_nearby import mean_extinction
from ..classify.transfer_function import TransferFunction
from ..classify.visible import VisibleVoxels
from ..runtime.jit import read_only
from ..runtime.steps import map_steps
from ..runtime.work_sizes import MIXED_AT_ONCE
from ..scene import Labels
from ..shade.sample_light import ONE
from ..shade.surface_normals import Surfaces
from ..shade.surface_points import place_steps, shown_ranges
from ..volume.blocks import cut_chunks
from ..volume.counts import counts_values

BOUNDARY = -1  # in place of a function's number
FLAT = 0.02  # of the largest density, in two voxels: less is no boundary that light shows
CLEAR = TransferFunction(opacity=((0.0, 0.0),), color=((0.0, 0.0, 0.0, 0.0),))  # of a hidden label
SOLID = TransferFunction(opacity=((0.0, 1.0),), color=((0.0, 0.0, 0.0, 0.0),))


@dataclass(frozen=True, eq=False)
class LabelFunctions:
    """The transfer functions of labels, those that look alike once.

    Attributes
    ----------
    functions : tuple of TransferFunction or None
        Number 0 is the scene's own; None hides.
    known : (k,) ndarray of integers
        Ascending labels that have a function, of those that a voxel can have.
    numbers : (k,) ndarray of uint16
        Function number of each of them.
    """

    labels: Labels
    functions: tuple
    known: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, labels: Labels, own: TransferFunction) -> LabelFunctions:
        """Of the labels of a scene whose own transfer function is ``own``."""
        kind = labels.volume.voxels.dtype
        possible = np.iinfo(kind)
        known = sorted(label for label in labels.functions if possible.min <= label <= possible.max)
        functions, order = {own.classification_key: own}, {own.classification_key: 0}
        numbers = []
        for label in known:
            function = labels.functions[label]
            key = None if function is None else function.classification_key
            functions.setdefault(key, function)
            numbers.append(order.setdefault(key, len(order)))
        return cls(labels, tuple(functions.values()), np.array(known, kind), np.array(numbers, np.uint16))

    @property
    def hides(self) -> bool:
        """Whether any label is hidden."""
        return None in self.functions

    @cached_property
    def key(self) -> tuple:
        """All that decides which function a point belongs to."""
        return self.labels.volume.key, tuple(self.known), tuple(self.numbers), tuple(self.outside), self.labels.smooth

    @property
    def outside(self) -> np.ndarray:
        """(functions,) bool: the scene's own function, and that which hides."""
        return np.array([number == 0 or function is None for number, function in enumerate(self.functions)])

    @cached_property
    def functions_key(self) -> tuple:
        """What each function classifies by."""
        return tuple(function and function.classification_key for function in self.functions)

    def numbers_of(self, first: int, last: int) -> np.ndarray:
        """(planes, ny, nx) uint16: function numbers of planes [first, last)."""
        labels = np.asarray(self.labels.volume.voxels[first:last])
        if not len(self.known):
            return np.zeros(labels.shape, np.uint16)
        if counts_values(labels.dtype):
            table = np.zeros(1 << 8 * labels.itemsize, np.uint16)
            table[self.known] = self.numbers  # those below zero count from its end, here as below
            return table[labels]
        at = np.minimum(np.searchsorted(self.known, labels), len(self.known) - 1)
        return np.where(self.known[at] == labels, self.numbers[at], np.uint16(0))

    def cell_steps(self):
        """Generator of fractions done: the LabelCells."""
        shape = self.labels.volume.shape_xyz
        return cell_steps(self.numbers_of, self.outside, shape, self.labels.smooth)

    def reach(self, volume) -> Reach:
        """Of what the functions of labels show, all together."""
        found = [Reach.of(volume, function).ends for function in self.functions[1:] if function is not None]
        return Reach(np.concatenate([np.empty((0, 2), volume.voxels.dtype), *found]))

    def mask_steps(self, cells: LabelCells, bits: np.ndarray):
        """Generator of fractions done: takes from ``bits``, as of ``relevant_steps``, what is further than two voxels
        from all labels with a function: these end within a voxel of theirs, slabs that they end in within another."""
        nx, ny, nz = cells.shape_xyz
        shows = np.array([number > 0 and function is not None for number, function in enumerate(self.functions)])
        planes = cells.numbers.reshape(nz, ny, nx)
        for first, last in cut_chunks(nz, ny * nx, MIXED_AT_ONCE):
            yield first / nz
            low = max(first - 2, 0)
            shown = shows[planes[low : last + 2] & NO_KIND]
            near = beside_any(beside_any(shown))[first - low : last - low]
            own = np.zeros((len(near) * ny, bits.shape[1]), np.uint64)
            pack(near.reshape(-1, nx), own)
            bits[first * ny : last * ny] &= own
        return bits


@dataclass(frozen=True, eq=False)
class ScalarLabels:
    """Labels of kept voxels.

    Attributes
    ----------
    tables : tuple of LookupTable
        One for each function.
    """

    functions: LabelFunctions
    cells: LabelCells
    tables: tuple[LookupTable, ...]

    @classmethod
    def of(cls, functions: LabelFunctions, cells: LabelCells, own, volume, ends, length: float) -> ScalarLabels:
        """``own``: LookupTable of the scene's own function; ``ends``: smallest and largest stored value of ``volume``;
        ``length``: world length of its unit."""
        shown = (CLEAR if function is None else function for function in functions.functions[1:])
        tables = (lookup_table(volume, one, ends, opacity_distance(volume, one, length)) for one in shown)
        return cls(functions, cells, (own, *tables))

    @property
    def key(self) -> tuple:
        return self.functions.key, self.functions.functions_key

    def extinction(self, voxels: VisibleVoxels, kind, infinite) -> np.ndarray:
        """(m,) float32 of voxels, each by its own function, 1 / world length; see ``extinction_of``."""
        numbers, found = self.cells.of_rows(voxels.row_start, voxels.column), np.empty(len(voxels), np.float32)
        for number in np.flatnonzero(np.bincount(numbers)):
            own = numbers == number
            found[own] = extinction_of(self.tables[number], voxels.stored[own], kind, infinite)
        return found

    def mean_extinction(self, voxels: VisibleVoxels, nearby: np.ndarray) -> np.ndarray:
        """(m,) float32 as ``shown_nearby.mean_extinction``, of the function at each voxel that shows most."""
        numbers, at, records = self.cells.look_up(voxels.row_start, voxels.column)
        found, kinds = np.zeros(len(voxels), np.float32), self.cells.kinds[records]
        for number, table in enumerate(self.tables):
            mine = numbers == number
            mine[at] |= (kinds == number).any(axis=1)
            found[mine] = np.maximum(found[mine], mean_extinction(table, nearby[:, mine]))
        return found

    def place_steps(self, surfaces: Surfaces, voxels: VisibleVoxels, volume, matrix, faces, extinction, *,
                    with_points: bool, threads: int):  # fmt: skip
        """As ``surface_points.place_steps``, with the normals of labels at their boundaries.

        There they are those of a density, in which each function has its mean extinction: so they do not turn where
        two organs meet that are equally dense.  Elsewhere a voxel is turned to where its own function shows less.
        ``extinction``: (m,), of the voxels.
        """
        numbers, at, records = self.cells.look_up(voxels.row_start, voxels.column)
        count, kinds = len(self.tables), self.cells.kinds[records]
        sizes = np.bincount(numbers, minlength=count)
        dense = np.bincount(numbers, extinction, count) / np.maximum(sizes, 1)
        shares = np.where(kinds == NO_KIND, 0.0, dense[np.minimum(kinds, count - 1)] / max(dense.max(), 1e-30))
        slopes = sum(shares[:, k, None] * self.cells.slopes[records, k] for k in range(KINDS)) / SLOPE_OF_ONE
        steep = np.linalg.norm(slopes, axis=1) > FLAT
        at, slopes = at[steep], np.sign(volume.slope) * slopes[steep] @ np.linalg.inv(volume.affine[:3, :3])
        slopes /= np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-30)
        vectors = np.array(surfaces.vectors)
        vectors[at] = np.rint(slopes * ONE)
        first = self._first_alike()
        alike = first[numbers]
        alike[at] = BOUNDARY
        sizes = np.bincount(first, sizes)
        groups = [int(group) for group in np.argsort(-sizes, kind="stable") if sizes[group] > 0]
        codes, offsets = (np.empty((len(voxels), 3), np.int16) if asked else None for asked in (True, with_points))
        for n, group in enumerate([*groups, BOUNDARY]):  # the largest is placed everywhere
            function, mine, own = SOLID if group == BOUNDARY else self.functions.functions[group], slice(None), voxels
            if n > 0:
                mine = np.flatnonzero(alike == group)
                own = replace(voxels, row_start=np.searchsorted(mine, voxels.row_start), column=voxels.column[mine],
                              stored=voxels.stored[mine], bits=None)  # fmt: skip
            turned = Surfaces(read_only(vectors[mine]), read_only(surfaces.steepness[mine]))
            steps = place_steps(turned, own, volume, function, matrix, faces, with_points=with_points, threads=threads)
            found = yield from map_steps(steps, lambda done, n=n: (n + done) / (len(groups) + 1))
            for to, one in zip((codes, offsets), found):
                if to is not None:
                    to[mine] = one
        return codes, offsets

    def _first_alike(self) -> np.ndarray:
        """(functions,) int16: of each function the first one that shows the same values."""
        first, known = {}, []
        for number, function in enumerate(self.functions.functions):
            key = shown_ranges((function or self.functions.functions[0]).opacity).tobytes()
            known.append(first.setdefault(key, number if function is not None else 0))
        return np.array(known, np.int16)
