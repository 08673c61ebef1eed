"""The emission-absorption integral along rays in float64 (algorithm.md 2.3, G13).

Each ray is cut at every voxel plane, where an interpolated field has its kinks; on each piece Gauss-Legendre
quadrature gives optical depth and emission, pieces are halved until two halves agree with their whole, and the
pieces are composed exactly.  No step size, no sheets, no early termination.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rays import Rays

NO_DEPTH = 1e10
TOLERANCE = 1e-10
_MOST_HALVINGS = 40
_RAYS_AT_ONCE = 512
_HALF = np.log(2.0)


def _quadrature(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Legendre on [0, 1]: nodes, weights, and the matrix whose row i integrates the interpolant to node i."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.arange(count)
    to_coefficients = np.linalg.inv(nodes[:, None] ** powers)
    return nodes, weights, (nodes[:, None] ** (powers + 1) / (powers + 1)) @ to_coefficients


_NODES, _WEIGHTS, _RUNNING = _quadrature(8)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Stretches of rays inside one cell each: ``ray`` (P,), planar depths ``start`` and ``end`` (P,),
    ``corners`` (P, 8, channels), ``entry`` and ``travel`` (P, 3) position and displacement inside the cell,
    ``length`` (P,) world length, ``tau`` (P,) and ``glow`` (P, 3) optical depth and emission."""

    ray: np.ndarray
    start: np.ndarray
    end: np.ndarray
    corners: np.ndarray
    entry: np.ndarray
    travel: np.ndarray
    length: np.ndarray

    def __getitem__(self, chosen) -> _Pieces:
        return _Pieces(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def half(self, second: bool) -> _Pieces:
        middle, travel = 0.5 * (self.start + self.end), 0.5 * self.travel
        start, end = (middle, self.end) if second else (self.start, middle)
        entry = self.entry + travel if second else self.entry
        return _Pieces(self.ray, start, end, self.corners, entry, travel, 0.5 * self.length)


def _joined(parts: list) -> _Pieces:
    return _Pieces(*(np.concatenate([getattr(p, name) for p in parts]) for name in _Pieces.__dataclass_fields__))


def _span(origin, step, low, high, near, far):
    """Planar depths between which each ray (R, 3) is inside the box; end < start where it misses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / step, (high - origin) / step
    beside = (step == 0.0) & ((origin < low) | (origin > high))
    entry = np.where(step == 0.0, -np.inf, np.minimum(a, b)).max(axis=1)
    exit_ = np.where(step == 0.0, np.inf, np.maximum(a, b)).min(axis=1)
    entry, exit_ = np.maximum(entry, near), np.minimum(exit_, far)
    return entry, np.where(beside.any(axis=1), -np.inf, exit_)


def _cut(medium, origin, step, speed, near, far) -> _Pieces:
    """Cut rays given in index space at all voxel planes; keeps only the pieces in cells that absorb."""
    entry, exit_ = _span(origin, step, medium.low, medium.high, near, far)
    hit = np.flatnonzero(exit_ > entry)
    cuts = [entry[hit, None], exit_[hit, None]]
    for axis in range(3):
        planes = np.arange(medium.low[axis], medium.high[axis] + 1.0)
        along = step[hit, axis, None]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = (planes - origin[hit, axis, None]) / along
        cuts.append(np.where(np.isfinite(at), at, entry[hit, None]))
    depth = np.sort(np.clip(np.concatenate(cuts, axis=1), entry[hit, None], exit_[hit, None]), axis=1)
    row, column = np.nonzero(np.diff(depth, axis=1) > 0.0)
    ray, start, end = hit[row], depth[row, column], depth[row, column + 1]
    position = origin[ray] + step[ray] * start[:, None]
    travel = step[ray] * (end - start)[:, None]
    cell = np.floor(position + 0.5 * travel).astype(np.int64)
    cell = np.clip(cell, medium.low.astype(np.int64), medium.high.astype(np.int64) - 1)
    corners = medium.cells(cell)
    pieces = _Pieces(ray, start, end, corners, position - cell, travel, speed[ray] * (end - start))
    return pieces[medium.occupied(corners)]


def _integrals(medium, pieces: _Pieces) -> np.ndarray:
    """(P, 4): emission of each piece seen from its own start, and its optical depth."""
    fields = medium.evaluate(pieces.corners, pieces.entry[:, None] + _NODES[:, None] * pieces.travel[:, None])
    fields = fields * pieces.length[:, None, None]
    seen = np.exp(-(fields[..., 3] @ _RUNNING.T)) * _WEIGHTS
    glow = (fields[..., :3] * seen[..., None]).sum(axis=1)
    return np.concatenate((glow, (fields[..., 3] @ _WEIGHTS)[:, None]), axis=1)


def _refined(medium, pieces: _Pieces, tolerance: float) -> tuple[_Pieces, np.ndarray]:
    """Halve pieces until the halves compose to their whole within the tolerance; pieces and their integrals."""
    done, values = [], []
    whole = _integrals(medium, pieces)
    for _ in range(_MOST_HALVINGS):
        left, right = pieces.half(False), pieces.half(True)
        first, second = _integrals(medium, left), _integrals(medium, right)
        composed = first + second
        composed[:, :3] = first[:, :3] + np.exp(-first[:, 3:]) * second[:, :3]
        # Optical depth matters only as far as it changes the transmittance.
        wrong = np.abs(composed - whole)
        wrong[:, 3] *= np.exp(-np.minimum(composed[:, 3], whole[:, 3]))
        rough = (wrong > tolerance).any(axis=1)
        done += [pieces[~rough]]
        values += [composed[~rough]]
        if not rough.any():
            return _joined(done), np.concatenate(values)
        pieces = _joined([left[rough], right[rough]])
        whole = np.concatenate((first[rough], second[rough]))
    return _joined(done + [pieces]), np.concatenate(values + [whole])


def _half_depth(medium, piece: _Pieces, missing: np.ndarray) -> np.ndarray:
    """(P,) planar depth inside each piece at which its optical depth reaches ``missing`` (P,), by bisection."""
    low, high = np.zeros(len(missing)), np.ones(len(missing))
    for _ in range(52):
        middle = 0.5 * (low + high)
        part = _Pieces(piece.ray, piece.start, piece.end, piece.corners, piece.entry,
                       piece.travel * middle[:, None], piece.length * middle)
        reached = _integrals(medium, part)[:, 3] >= missing
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return piece.start + 0.5 * (low + high) * (piece.end - piece.start)


def _compose(medium, pieces: _Pieces, values: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Compose pieces front to back: premultiplied rgba (count, 4) and the depth of half transmittance (count,)."""
    rgba, depth = np.zeros((count, 4)), np.full(count, NO_DEPTH)
    if len(pieces.ray) == 0:
        return rgba, depth
    order = np.lexsort((pieces.start, pieces.ray))
    pieces, values = pieces[order], values[order]
    first = np.searchsorted(pieces.ray, np.arange(count))
    place = np.arange(len(pieces.ray)) - first[pieces.ray]
    # One row a ray: a running sum along a row keeps its own precision, one over all rays would not.
    table = np.zeros((count, place.max() + 1))
    table[pieces.ray, place] = values[:, 3]
    reached = np.cumsum(table, axis=1)
    before = (reached - table)[pieces.ray, place]
    for channel in range(3):
        rgba[:, channel] = np.bincount(pieces.ray, np.exp(-before) * values[:, channel], minlength=count)
    rgba[:, 3] = -np.expm1(-reached[:, -1])
    halved = np.flatnonzero(reached[:, -1] >= _HALF)
    crossing = first[halved] + (reached[halved] < _HALF).sum(axis=1)
    depth[halved] = _half_depth(medium, pieces[crossing], _HALF - before[crossing])
    return rgba, depth


def integrate(medium, rays: Rays, index_to_world, near=-np.inf, far=np.inf, tolerance: float = TOLERANCE):
    """Premultiplied rgba (N, 4) and depth (N,), both float64, of a medium seen along world rays.

    ``near``, ``far``: planar depths, scalars or (N,), outside which nothing is integrated (clip distances, or a
    surface that stops each ray).  ``depth`` is the planar depth at which the transmittance falls to one half,
    1e10 where it never does.  ``tolerance``: largest disagreement allowed between a piece and its halves.
    """
    to_index = np.linalg.inv(np.asarray(index_to_world, dtype=np.float64))
    origin = rays.origin @ to_index[:3, :3].T + to_index[:3, 3]
    step = rays.step @ to_index[:3, :3].T
    count = len(origin)
    near, far = np.broadcast_to(near, count), np.broadcast_to(far, count)
    rgba, depth = np.zeros((count, 4)), np.full(count, NO_DEPTH)
    for begin in range(0, count, _RAYS_AT_ONCE):
        part = slice(begin, min(begin + _RAYS_AT_ONCE, count))
        pieces = _cut(medium, origin[part], step[part], rays.length_per_depth[part], near[part], far[part])
        pieces, values = _refined(medium, pieces, tolerance)
        rgba[part], depth[part] = _compose(medium, pieces, values, part.stop - part.start)
    return rgba, depth
