"""Where names beside a picture stand, and the place that the line of each leads to.

Places are (x, y) in the plane of the picture, y upward, in any unit.
"""

import numpy as np

FEWEST = 3  # squares of the picture in which a segment has to be seen for its line to lead there
MOST_SHARE = 0.75  # of a line's way to its place; beyond it, a name's height hardly moves the line
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


def split(places: dict) -> tuple[list, list]:
    """The numbers of ``find_places`` that have their names on the left of a picture and on its right, from the top."""
    across = sorted(places, key=lambda number: places[number][0])
    half = (len(across) + 1) // 2
    left, right = (sorted(some, key=lambda number: -places[number][1]) for some in (across[:half], across[half:]))
    return left, right


def spread(column: list, places: dict, x: float, low: float, high: float, tall: dict, taken) -> dict:
    """Heights of the names of a column, in the order of their places, so that lines do not cross.

    Parameters
    ----------
    column : list of int
        From the top, as of ``split``; the column has room for all.
    places : dict of int to (2,) ndarray
        As ``find_places`` returns them.
    x : float
        Where lines begin.
    low, high : float
        The range of heights.
    tall : dict of int to float
        Height of each name, with the space to the next; also the least distance from what stands at ``taken``.
    taken : sequence of (x, y)

    Returns
    -------
    dict of int to float
        Each as near to the height of its place as the others leave it.
    """

    def passed(number, height, toward):
        """The height at which neither name nor line meets what is taken, ``toward`` 1 above it or -1 below."""
        to_x, to_y = places[number]
        for other_x, other_y in sorted(taken, key=lambda other: -toward * other[1]):
            share = min(max((other_x - x) / (to_x - x), 0.0), MOST_SHARE) if to_x != x else 0.0
            if abs((1.0 - share) * height + share * to_y - other_y) < tall[number]:
                height = (other_y + toward * tall[number] - share * to_y) / (1.0 - share)
        return height

    heights, most = [], high
    for number in column:
        most -= 0.5 * tall[number]
        heights.append(passed(number, min(places[number][1], most), -1.0))
        most = heights[-1] - 0.5 * tall[number]
    least = low
    for n, number in reversed([*enumerate(column)]):
        least += 0.5 * tall[number]
        if least > heights[n]:
            heights[n] = passed(number, least, 1.0)
        least = heights[n] + 0.5 * tall[number]
    return dict(zip(column, heights, strict=True))
