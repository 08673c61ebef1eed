"""The media of both truths, in voxel-index space.  Index order is (x, y, z) throughout.

A medium has its box (``low``, ``high``).  For cells of the grid, given by their low corners, ``cells(cell)`` returns
the values at the eight corners, and ``occupied(corners)`` whether anything in the cell absorbs.  Inside one cell all
interpolated values are cubics along a ray (``cubics``).  ``split`` cuts such a piece where the medium has kinks, and
``fields`` returns source and extinction on it.
"""

from __future__ import annotations

import numpy as np

from .transfer import Segments, extinction, extinction_and_color, optical_depth


def cubics(corners: np.ndarray, entry: np.ndarray, travel: np.ndarray) -> np.ndarray:
    """Trilinear interpolation along pieces of rays, as cubics.

    Parameters
    ----------
    corners : (P, 8, channels)
        Values at the corners of a unit cell, x fastest.
    entry, travel : (P, 3)
        The piece is at ``entry + t * travel`` in the cell.

    Returns
    -------
    (P, channels, 4) float64
        Coefficients of 1, t, t^2, t^3.
    """
    count, _, channels = corners.shape
    degrees = [np.moveaxis(corners, -1, 1).reshape(count, channels, 2, 2, 2)]  # over z, y, x
    for axis in range(3):
        start, rate = (v[:, axis].reshape((-1,) + (1,) * (3 - axis)) for v in (entry, travel))
        slopes = [d[..., 1] - d[..., 0] for d in degrees]
        constant = [d[..., 0] + s * start for d, s in zip(degrees, slopes)]
        degrees = [*constant, 0.0 * constant[0]]
        for power, s in enumerate(slopes):
            degrees[power + 1] = degrees[power + 1] + s * rate
    return np.stack(degrees, axis=-1)


def polynomial(coefficients: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Evaluate cubics of coefficients (..., 4) at ``t``, which broadcasts with their leading axes."""
    c = coefficients
    return ((c[..., 3] * t + c[..., 2]) * t + c[..., 1]) * t + c[..., 0]


class _Field:
    """What both media share: the fields at single points."""

    is_lit = False  # whether light is added to cubics of which anything is seen, by ``light_up``

    def at(self, positions) -> np.ndarray:
        """(N, 4) source (extinction * RGB) and extinction at (N, 3) index positions inside the box."""
        positions = np.asarray(positions, dtype=np.float64)
        cell = np.clip(np.floor(positions), self.low, self.high - 1.0).astype(np.int64)
        poly = cubics(self.cells(cell), positions - cell, np.zeros_like(positions))
        which, _, _, segment = self.split(poly)
        found = np.zeros((len(positions), 4))
        found[which] = self.fields(poly[which], segment, np.zeros((len(which), 1)))[..., 0]
        return found


def corner_indices(cell: np.ndarray, shape) -> tuple[tuple, np.ndarray]:
    """The corners of cells as index arrays (z, y, x) that broadcast to (P, 2, 2, 2), clipped to the grid; and which
    corners are in the grid."""
    indices, inside = [], True
    for axis, spread in ((2, (-1, 2, 1, 1)), (1, (-1, 1, 2, 1)), (0, (-1, 1, 1, 2))):
        both = cell[:, axis, None] + np.arange(2)
        most = shape[2 - axis] - 1
        indices.append(np.clip(both, 0, most).reshape(spread))
        inside = inside & ((both >= 0) & (both <= most)).reshape(spread)
    return tuple(indices), inside


class ClassifiedField(_Field):
    """T1: extinction and associated color interpolated trilinearly, zero outside the grid.

    The medium fills [-1, n] along each axis: from the outermost voxels it ramps down to zero within one voxel.

    Parameters
    ----------
    extinction : (nz, ny, nx)
        In 1/world length.
    color : (nz, ny, nx, 3)
        Unassociated, shaded or not.
    """

    def __init__(self, extinction, color):
        extinction, color = np.asarray(extinction, dtype=np.float64), np.asarray(color)
        self._set_fields(extinction.shape, lambda indices: extinction[indices], lambda indices, _: color[indices])

    @classmethod
    def of_scalars(cls, voxels, physical, transfer_function, world_distance: float, color=None) -> ClassifiedField:
        """Make one from stored scalars, which are classified at the corners of the cells that rays cross.

        Parameters
        ----------
        voxels : (nz, ny, nx)
        physical : callable
            From stored values to physical ones.
        transfer_function : TransferFunction
        world_distance : float
            World length of the opacity unit distance.
        color : optional
            As above, or an object that gives (..., 3) values for index arrays (z, y, x); by default the transfer
            function's colors.
        """

        def extinction_at(indices):
            return extinction(transfer_function, physical(voxels[indices]), world_distance)

        def color_at(indices, visible):
            if color is not None:
                return color[indices]
            found = np.zeros((*visible.shape, 3))
            values = physical(voxels[indices][visible])
            found[visible] = extinction_and_color(transfer_function, values, world_distance)[1]
            return found

        medium = cls.__new__(cls)
        medium._set_fields(voxels.shape, extinction_at, color_at)
        return medium

    def _set_fields(self, shape, extinction_at, color_at):
        self._shape, self._extinction_at, self._color_at = shape, extinction_at, color_at
        self.low, self.high = np.full(3, -1.0), np.array(shape[::-1], dtype=np.float64)

    def cells(self, cell: np.ndarray) -> np.ndarray:
        """(P, 3) integer low corners -> (P, 8, 4): extinction * RGB, extinction at the corners, x fastest."""
        indices, inside = corner_indices(cell, self._shape)
        extinction = np.where(inside, self._extinction_at(indices), 0.0)
        found = np.zeros((*extinction.shape, 4))
        found[..., 3] = extinction
        seen = np.flatnonzero((extinction > 0.0).any(axis=(1, 2, 3)))
        here = tuple(index[seen] for index in indices)
        color = np.where((extinction[seen] > 0.0)[..., None], self._color_at(here, extinction[seen] > 0.0), 0.0)
        found[seen, ..., :3] = color * extinction[seen][..., None]
        return found.reshape(-1, 8, 4)

    @staticmethod
    def occupied(corners: np.ndarray) -> np.ndarray:
        """(P,) bool: whether anything in the cell absorbs."""
        return (corners[..., 3] > 0.0).any(axis=1)

    @staticmethod
    def split(poly: np.ndarray):
        """All pieces as they are: the cubics have no kinks inside a cell.  See ``ScalarField.split``."""
        count = len(poly)
        return np.arange(count), np.zeros(count), np.ones(count), np.zeros(count, dtype=np.int64)

    @staticmethod
    def fields(poly: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(P, 4, N) extinction * RGB and extinction, of cubics (P, 4, 4) at ``t`` (P, N)."""
        return polynomial(poly[:, :, None, :], t[:, None, :])


class ScalarField(_Field):
    """T2: the scalar interpolated trilinearly and then classified, inside the box of voxel centers [0, n - 1].

    A cell with a NaN corner is transparent; an infinite value counts as the transfer function's nearest point.  Further
    channels are added: their extinctions, and source.

    Parameters
    ----------
    values : (nz, ny, nx)
    transfer_function : TransferFunction
    world_distance : float
        World length of the opacity unit distance.
    physical : callable, optional
        From ``values`` to physical ones; the values themselves by default.
    further : sequence of tuple
        These four of each further channel.
    """

    def __init__(self, values, transfer_function, world_distance: float, physical=None, further=()):
        self._parts = []
        for own, function, distance, to_physical in ((values, transfer_function, world_distance, physical), *further):
            own = own if to_physical else np.asarray(own)
            to_physical = to_physical or (lambda stored: np.asarray(stored, dtype=np.float64))
            self._parts.append((own, to_physical, Segments(function), distance))
        self._shape = self._parts[0][0].shape
        self.low = np.zeros(3)
        self.high = np.array(self._shape[::-1], dtype=np.float64) - 1.0

    def cells(self, cell: np.ndarray) -> np.ndarray:
        """(P, 3) integer low corners -> (P, 8, channels): the scalars at the corners, x fastest."""
        indices, _ = corner_indices(cell, self._shape)
        found = []
        for stored, physical, segments, _ in self._parts:
            values = physical(stored[indices])
            if np.isinf(values).any():
                values = np.where(np.isinf(values), np.clip(values, *segments.ends), values)
            found.append(values.reshape(-1, 8))
        return np.stack(found, axis=-1)

    def occupied(self, corners: np.ndarray) -> np.ndarray:
        """(P,) bool: whether a transfer function is above zero anywhere in the cell's range of its values."""
        found = np.zeros(len(corners), bool)
        for number, (_, _, segments, _) in enumerate(self._parts):
            scalar = corners[..., number]
            found |= segments.show_between(scalar.min(axis=1), scalar.max(axis=1))
        return found

    def split(self, poly: np.ndarray):
        """Cut the scalars' cubics at the transfer functions' points and leave out transparent pieces.

        Returns (Q,) arrays: the index of the cubic, t at the begin and the end; and (Q, channels) the segments of the
        transfer functions.
        """
        whole = np.arange(len(poly))
        which, cuts = [whole, whole], [np.zeros(len(poly)), np.ones(len(poly))]
        for number, (_, _, segments, _) in enumerate(self._parts):
            crossing, t = _crossings(poly[:, number], segments.knots)
            which.append(crossing)
            cuts.append(t)
        which, cuts = np.concatenate(which), np.concatenate(cuts)
        order = np.lexsort((cuts, which))
        which, cuts = which[order], cuts[order]
        pair = np.flatnonzero((which[1:] == which[:-1]) & (cuts[1:] > cuts[:-1]))
        which, begin, end = which[pair], cuts[pair], cuts[pair + 1]
        seen, found = np.zeros(len(which), bool), []
        for number, (_, _, segments, _) in enumerate(self._parts):
            value = polynomial(poly[which, number], 0.5 * (begin + end))
            found.append(segments.of(value))
            seen |= segments.visible[found[-1]] & ~np.isnan(value)
        segment = np.stack(found, axis=-1)
        return which[seen], begin[seen], end[seen], segment[seen]

    def fields(self, poly: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(P, 4, N) extinction * RGB and extinction, of cubics (P, C, 4) at ``t`` (P, N)."""
        total = 0.0
        for number, (_, _, segments, distance) in enumerate(self._parts):
            alpha, color = segments.evaluate(segment[:, number], polynomial(poly[:, number, None, :], t))
            sigma = optical_depth(alpha) / distance
            own = np.concatenate((color * sigma[:, None], sigma[:, None]), axis=1)
            total = total + (own if len(self._parts) == 1 else np.nan_to_num(own))
        return total


def _crossings(cubic: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Crossings of cubics (P, 4) and values ``knots`` (K,) inside (0, 1): index of the cubic (Q,), and t (Q,)."""
    # Between its turning points a cubic is monotone and crosses a value at most once.
    a, b, c = 3.0 * cubic[:, 3], 2.0 * cubic[:, 2], cubic[:, 1]
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    q = -0.5 * (b + np.copysign(root, b))
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.stack((q / a, c / q), axis=1)
    ends = np.zeros((len(cubic), 4))
    ends[:, 1:3] = np.sort(np.clip(np.nan_to_num(turns, nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0), axis=1)
    ends[:, 3] = 1.0
    below = np.searchsorted(knots, polynomial(cubic[:, None, :], ends))  # how many knots lie below each end
    first, last = np.minimum(below[:, :-1], below[:, 1:]), np.maximum(below[:, :-1], below[:, 1:])
    count = (last - first).ravel()
    branch = np.repeat(np.arange(count.size), count)
    knot = first.ravel()[branch] + np.arange(len(branch)) - (np.cumsum(count) - count)[branch]
    which, part = branch // 3, branch % 3
    return which, _monotone_root(cubic[which] - np.array((1.0, 0.0, 0.0, 0.0)) * knots[knot][:, None],
                                 ends[which, part], ends[which, part + 1])  # fmt: skip


def _monotone_root(cubic: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(Q,) root of each cubic (Q, 4) between ``low`` and ``high``, where it changes sign: Newton's method, with
    bisection where a step would leave the bracket."""
    rising = polynomial(cubic, high) > polynomial(cubic, low)
    found = 0.5 * (low + high)
    open_ = np.arange(len(cubic))
    slope = cubic[:, 1:] * np.array((1.0, 2.0, 3.0))
    for _ in range(100):
        t = found[open_]
        value = polynomial(cubic[open_], t)
        right = (value < 0.0) == rising[open_]
        low[open_], high[open_] = np.where(right, t, low[open_]), np.where(right, high[open_], t)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = t - value / ((slope[open_, 2] * t + slope[open_, 1]) * t + slope[open_, 0])
        kept = (step > low[open_]) & (step < high[open_])
        found[open_] = np.where(kept, step, 0.5 * (low[open_] + high[open_]))
        open_ = open_[np.abs(found[open_] - t) > 4e-16]
        if len(open_) == 0:
            break
    return found
