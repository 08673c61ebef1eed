"""Names beside a picture: the place that the line of each leads to, and where the names stand.

Places are (x, y) in the plane of the picture, y upward, in any unit.
"""

import numpy as np

FEWEST = 3  # squares of the picture in which a segment has to be seen for its line to lead there
INWARD = 0.6  # of the way from the edge of what is seen to its innermost part, a place for the end of a line


def find_places(numbers: np.ndarray, places: np.ndarray, depths: np.ndarray, cell: float) -> dict:
    """The place of each segment that a line leads to: well inside of what is seen of it.

    Parameters
    ----------
    numbers : (n,) ndarray of int
        The segment of each voxel.
    places : (n, 2) ndarray of float64
        Where the picture shows the voxels.
    depths : (n,) ndarray of float64
        Their distances from the camera.
    cell : float
        Side of a square of the picture in which the nearest voxel hides the others.

    Returns
    -------
    dict of int to ndarray of shape (2,)
        Of a segment that others hide, a place amid all its voxels.
    """
    low = places.min(axis=0) - 1.5 * cell
    cells = ((places - low) / cell).astype(np.int64)
    far_to_near = np.argsort(-depths)
    seen = np.full(cells.max(axis=0) + 2, -1)  # with an empty border
    seen[tuple(cells[far_to_near].T)] = far_to_near  # the last one stays
    shown = np.where(seen >= 0, numbers.astype(np.int64)[seen], -1)
    found = {}
    for number in np.unique(numbers):
        inside = shown == number
        if np.count_nonzero(inside) >= FEWEST:
            own = low + cell * (_innermost(inside) + 0.5)
        else:
            own = places[numbers == number]
        found[int(number)] = own[((own - own.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    return found


def _innermost(inside: np.ndarray) -> np.ndarray:
    """The squares of a shape, (n, 2), that are at least as far from its edge as INWARD of the farthest."""
    left = [inside]
    while left[-1].any():
        one = left[-1].copy()
        one[1:-1, 1:-1] &= left[-1][:-2, 1:-1] & left[-1][2:, 1:-1] & left[-1][1:-1, :-2] & left[-1][1:-1, 2:]
        left.append(one)
    return np.argwhere(left[int(INWARD * (len(left) - 2))])


def arrange(places: dict, low: float, high: float, step: float, taken: tuple) -> tuple[dict, dict]:
    """Heights of names in a column on the left of a picture, and in one on its right.

    Parameters
    ----------
    places : dict of int to (2,) ndarray
        As ``find_places`` returns them.
    low, high : float
        The range of heights.
    step : float
        Least distance from name to name; both columns have room for all.
    taken : tuple of (sequence of float)
        In each column the heights at which something else stands.

    Returns
    -------
    tuple of (dict of int to float)
        In each column the names are in the order of their places, so lines do not cross.
    """
    across = sorted(places, key=lambda number: places[number][0])
    half = (len(across) + 1) // 2
    columns = (sorted(some, key=lambda number: -places[number][1]) for some in (across[:half], across[half:]))
    return tuple(
        dict(zip(column, _spread([places[number][1] for number in column], low, high, step, others), strict=True))
        for column, others in zip(columns, taken, strict=True)
    )


def _spread(wanted: list, low: float, high: float, step: float, taken) -> list:
    """Heights, falling, each as near to the one wanted as the others leave it."""
    heights = []
    for one in wanted:
        one = min(one, heights[-1] - step if heights else high)
        for other in sorted(taken, reverse=True):
            one = other - step if abs(one - other) < step else one
        heights.append(one)
    least = low
    for n in reversed(range(len(heights))):
        one = max(heights[n], least)
        if one > heights[n]:
            for other in sorted(taken):
                one = other + step if abs(one - other) < step else one
        heights[n], least = one, one + step
    return heights
