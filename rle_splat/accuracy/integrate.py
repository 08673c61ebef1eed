"""The emission-absorption integral along rays in float64 (algorithm.md 2.3, G13).

Each ray is cut at all voxel planes, where an interpolated field has its kinks, and at the kinks of the medium.  On
each piece the interpolated quantities are cubics.  Gauss-Legendre quadrature gives its optical depth and emission.
Pieces are halved until both halves together agree with the whole, and are then composited exactly.  There is no step
size and there are no sheets.  Rays are integrated together, as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .medium import cubics
from .rays import WorldRays

NO_DEPTH = 1e10
TOLERANCE = 1e-10
# Pieces behind a smaller transmittance are left out; that changes a channel by at most this times its largest color.
FAINTEST = 1e-12
HIDDEN = 1.0  # the same of a lit medium, whose light takes long, in tolerances
_MOST_HALVINGS = 120
# Pieces of a larger optical depth are always halved: all nodes of the quadrature might lie where nothing is visible.
_DENSE = 8.0
_RAYS_AT_ONCE = 256
_HALF = np.log(2.0)
_ROUNDING = 64.0 * np.finfo(np.float64).eps


def _quadrature(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Legendre quadrature on [0, 1]: nodes, weights, and the matrix whose row i integrates up to node i."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.arange(count)
    to_coefficients = np.linalg.inv(nodes[:, None] ** powers)
    return nodes, weights, (nodes[:, None] ** (powers + 1) / (powers + 1)) @ to_coefficients


_NODES, _WEIGHTS, _RUNNING = _quadrature(8)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Smooth pieces of rays.

    ``ray``, ``cubic`` (P,) int: the ray, and the row of ``table`` (cells crossed, channels, 4), whose t runs from
    ``begin`` to ``end`` (P,).  ``segment`` (P,) or (P, channels): from the medium's ``split``.  ``near``, ``far`` (P,):
    planar depths.  ``length`` (P,): world length.  ``seen`` (P,): transmittance before the piece.  ``allowed`` (P,):
    its largest error.
    """

    table: np.ndarray
    ray: np.ndarray
    cubic: np.ndarray
    segment: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    near: np.ndarray
    far: np.ndarray
    length: np.ndarray
    seen: np.ndarray
    allowed: np.ndarray

    def __getitem__(self, chosen) -> _Pieces:
        names = list(self.__dataclass_fields__)[1:]
        return _Pieces(self.table, *(getattr(self, name)[chosen] for name in names))

    def cut(self, share) -> _Pieces:
        """The first ``share`` of each piece, a number or (P,)."""
        return replace(
            self, end=self.begin + share * (self.end - self.begin), far=self.near + share * (self.far - self.near),
            length=share * self.length,
        )  # fmt: skip

    def halves(self) -> tuple[_Pieces, _Pieces]:
        first = replace(self.cut(0.5), allowed=0.5 * self.allowed)
        return first, replace(first, begin=first.end, end=self.end, near=first.far, far=self.far)


def _join(parts: list[_Pieces]) -> _Pieces:
    names = list(_Pieces.__dataclass_fields__)[1:]
    return _Pieces(parts[0].table, *(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def span(origin, step, low, high, near, far):
    """Planar depths at which each ray (R, 3) enters and leaves the box; the second is smaller where it misses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / step, (high - origin) / step
    beside = (step == 0.0) & ((origin < low) | (origin > high))
    entry = np.where(step == 0.0, -np.inf, np.minimum(a, b)).max(axis=1)
    exit_ = np.where(step == 0.0, np.inf, np.maximum(a, b)).min(axis=1)
    entry, exit_ = np.maximum(entry, near), np.minimum(exit_, far)
    return entry, np.where(beside.any(axis=1), -np.inf, exit_)


def _cut(medium, origin, step, speed, near, far, clipping=None) -> _Pieces:
    """Cut rays, given in index space, at voxel planes, kinks of the medium and clip objects; keep the pieces
    that absorb."""
    entry, exit_ = span(origin, step, medium.low, medium.high, near, far)
    hit = np.flatnonzero(exit_ > entry)
    cuts = [entry[hit, None], exit_[hit, None]]
    for axis in range(3):
        planes = np.arange(medium.low[axis], medium.high[axis] + 1.0)
        along = step[hit, axis, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = (planes - origin[hit, axis, None]) / along
        cuts.append(np.where(np.isfinite(at), at, entry[hit, None]))
    if clipping is not None:
        at = clipping.crossings()[hit]
        cuts.append(np.where(np.isfinite(at), at, entry[hit, None]))
    depth = np.sort(np.clip(np.concatenate(cuts, axis=1), entry[hit, None], exit_[hit, None]), axis=1)
    row, column = np.nonzero(np.diff(depth, axis=1) > 0.0)
    ray, start, end = hit[row], depth[row, column], depth[row, column + 1]
    position = origin[ray] + step[ray] * start[:, None]
    travel = step[ray] * (end - start)[:, None]
    cell = np.floor(position + 0.5 * travel).astype(np.int64)
    cell = np.clip(cell, medium.low.astype(np.int64), medium.high.astype(np.int64) - 1)
    corners = medium.cells(cell)
    occupied = medium.occupied(corners)
    if clipping is not None:
        occupied = occupied & clipping.keeps(ray, 0.5 * (start + end))
    kept = np.flatnonzero(occupied)
    table = cubics(corners[kept], (position - cell)[kept], travel[kept])
    which, begin, stop, segment = medium.split(table)
    within = kept[which]
    start, whole = start[within], (end - start)[within]
    near, far = start + begin * whole, start + stop * whole
    return _Pieces(table, ray[within], which, segment, begin, stop, near, far, speed[ray[within]] * (far - near),
                   np.ones(len(which)), np.ones(len(which)))  # fmt: skip


def _integrals(medium, pieces: _Pieces) -> np.ndarray:
    """(P, 4): the emission of each piece, as seen from its start, and its optical depth."""
    t = pieces.begin[:, None] + (pieces.end - pieces.begin)[:, None] * _NODES
    fields = medium.fields(pieces.table[pieces.cubic], pieces.segment, t) * pieces.length[:, None, None]
    # No products of matrices: the threads of a library that computes them wait for more by turning round and round,
    # beside the next picture (measured, two cores and OpenBLAS: one of 3 milliseconds took 30).
    seen = np.exp(-np.einsum("pn,mn->pm", fields[:, 3], _RUNNING)) * _WEIGHTS
    glow = (fields[:, :3] * seen[:, None]).sum(axis=-1)
    return np.concatenate((glow, (fields[:, 3] * _WEIGHTS).sum(axis=-1, keepdims=True)), axis=1)


class _Order:
    """The order of pieces along their rays, for running sums: one row for each ray, because a running sum over all
    rays would lose precision."""

    def __init__(self, pieces: _Pieces, count: int):
        self.first = np.searchsorted(pieces.ray, np.arange(count))
        self._ray, self._number = pieces.ray, np.arange(len(pieces.ray)) - self.first[pieces.ray]
        self._shape = (count, int(self._number.max(initial=-1)) + 1)

    def running(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Optical depth after each piece of each ray (count, longest), and before each piece (P,); pieces in order."""
        table = np.zeros(self._shape)
        table[self._ray, self._number] = tau
        reached = np.cumsum(table, axis=1)
        return reached, (reached - table)[self._ray, self._number]


def _sort(pieces: _Pieces, *others):
    order = np.lexsort((pieces.near, pieces.ray))
    return pieces[order], *(other[order] for other in others)


def _refine(medium, pieces: _Pieces, count: int, tolerance: float) -> tuple[_Pieces, np.ndarray]:
    """Halve pieces until the differences of halves and wholes, as seen from the eye, add up to at most the tolerance on
    each ray; return the pieces in order and their integrals."""
    pieces, whole = _sort(pieces, _integrals(medium, pieces))
    before = _Order(pieces, count).running(whole[:, 3])[1]
    on_ray = np.bincount(pieces.ray, minlength=count)[pieces.ray]
    pieces = replace(pieces, seen=np.exp(-before), allowed=tolerance / on_ray)
    kept = pieces.seen >= (max(FAINTEST, HIDDEN * tolerance) if medium.is_lit else FAINTEST)
    pieces, whole = pieces[kept], whole[kept]
    if medium.is_lit:
        rows, cubic = np.unique(pieces.cubic, return_inverse=True)
        pieces = replace(pieces, table=medium.light_up(pieces.table[rows]), cubic=cubic)
        whole = _integrals(medium, pieces)
    # Rounding errors of the medium's own arithmetic, which halving does not reduce.
    noise = _ROUNDING * np.maximum(1.0, np.abs(whole).max(axis=0, initial=0.0))
    done, values = [], []
    for _ in range(_MOST_HALVINGS):
        left, right = pieces.halves()
        first, second = _integrals(medium, left), _integrals(medium, right)
        passed = np.exp(-first[:, 3])
        composed = first + second
        composed[:, :3] = first[:, :3] + passed[:, None] * second[:, :3]
        wrong = np.abs(composed - whole)
        # An error of the optical depth counts by its effect on the transmittance.
        wrong[:, 3] *= np.exp(-np.minimum(composed[:, 3], whole[:, 3]))
        rough = ((wrong - noise) * pieces.seen[:, None] > pieces.allowed[:, None]).any(axis=1)
        rough |= (composed[:, 3] > _DENSE) & (pieces.seen >= FAINTEST)
        done.append(pieces[~rough])
        values.append(composed[~rough])
        if not rough.any():
            break
        right = replace(right, seen=pieces.seen * passed)
        pieces = _join([left[rough], right[rough]])
        whole = np.concatenate((first[rough], second[rough]))
    else:
        done.append(pieces)
        values.append(whole)
    return _sort(_join(done), np.concatenate(values))


def _half_depth(medium, pieces: _Pieces, missing: np.ndarray) -> np.ndarray:
    """(P,) planar depth inside each piece at which its optical depth reaches ``missing`` (P,), by bisection."""
    low, high = np.zeros(len(missing)), np.ones(len(missing))
    for _ in range(52):
        middle = 0.5 * (low + high)
        reached = _integrals(medium, pieces.cut(middle))[:, 3] >= missing
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return pieces.near + 0.5 * (low + high) * (pieces.far - pieces.near)


def _compose(medium, pieces: _Pieces, values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Compose pieces front to back: premultiplied rgba (count, 4) and the depth of half transmittance (count,)."""
    rgba, depth = np.zeros((count, 4)), np.full(count, NO_DEPTH)
    order = _Order(pieces, count)
    reached, before = order.running(values[:, 3])
    for channel in range(3):
        rgba[:, channel] = np.bincount(pieces.ray, np.exp(-before) * values[:, channel], minlength=count)
    rgba[:, 3] = -np.expm1(-reached[:, -1])
    halved = np.flatnonzero(reached[:, -1] >= _HALF)
    if medium.is_lit:
        pieces = replace(pieces, table=medium.unlit(pieces.table))
    crossing = order.first[halved] + (reached[halved] < _HALF).sum(axis=1)
    depth[halved] = _half_depth(medium, pieces[crossing], _HALF - before[crossing])
    return rgba, depth


def integrate(medium, rays: WorldRays, index_to_world, near=-np.inf, far=np.inf, tolerance: float = TOLERANCE,
              clipping=None):  # fmt: skip
    """Integrate emission and absorption of a medium along world rays.

    Parameters
    ----------
    medium : ClassifiedMedium or ScalarMedium
    index_to_world : (4, 4) float64
    near, far : float or (N,) float
        Planar depths where the integration begins and ends: clip distances, or a surface that ends each ray.
    tolerance : float
        The largest estimated error of a channel.  The estimate is the sum over the ray's pieces of the differences of
        two halves and their whole; the result uses the halves.
    clipping : clips.Clipping, optional
        Of these rays; points that it does not keep are not integrated.

    Returns
    -------
    rgba : (N, 4) float64
        Premultiplied.
    depth : (N,) float64
        Planar depth at which the transmittance falls to one half; 1e10 where it does not.
    """
    to_index = np.linalg.inv(np.asarray(index_to_world, dtype=np.float64))
    origin = rays.origin @ to_index[:3, :3].T + to_index[:3, 3]
    step = rays.step @ to_index[:3, :3].T
    count = len(origin)
    near, far = np.broadcast_to(near, count), np.broadcast_to(far, count)
    rgba, depth = np.zeros((count, 4)), np.full(count, NO_DEPTH)
    for begin in range(0, count, _RAYS_AT_ONCE):
        part = slice(begin, min(begin + _RAYS_AT_ONCE, count))
        clipped = None if clipping is None else clipping[part]
        pieces = _cut(medium, origin[part], step[part], rays.length_per_depth[part], near[part], far[part], clipped)
        if len(pieces.ray):
            size = part.stop - part.start
            rgba[part], depth[part] = _compose(medium, *_refine(medium, pieces, size, tolerance), size)
    return rgba, depth
