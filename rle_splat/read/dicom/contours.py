"""Closed contours in parallel planes -> voxels of a grid. Pure functions; coordinates are voxel indices."""

import numpy as np

ON_SLICE = 0.05  # slices; a plane this close to a slice is the slice's own
ON_EDGE = 1e-3  # pixels; a center this close to an edge is on it
HALF = 0.5  # slices; beyond the outermost planes, a plane counts for slices up to this far away
PAIRS = 1 << 20  # of pixels and edges, whose distances are computed at a time
MOST_STEPS = 2.0  # a gap of up to this many times the usual distance of a region's planes is filled


def wind(polygon: np.ndarray, columns: range, rows: range) -> np.ndarray:
    """Winding numbers of a closed polygon about pixel centers, (rows, columns) of int64.

    Parameters
    ----------
    polygon : (n, 2) ndarray of float64
        Corners (x, y); the last one is joined to the first.
    columns, rows : range
        Whole x and y of the pixel centers. A center on an edge belongs to one side, the same for all polygons.
    """
    ends = np.roll(polygon, -1, axis=0)
    first, last = (np.clip(np.ceil(y).astype(np.int64), rows.start, rows.stop) for y in (polygon[:, 1], ends[:, 1]))
    counts = np.abs(last - first)
    edge = np.repeat(np.arange(len(polygon)), counts)
    row = np.minimum(first, last)[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    (x0, y0), (x1, y1) = polygon[edge].T, ends[edge].T
    at = np.ceil(x0 + (row - y0) * (x1 - x0) / (y1 - y0)).astype(np.int64)
    turns = np.zeros((len(rows), len(columns) + 1), np.int64)
    np.add.at(turns, (row - rows.start, np.clip(at - columns.start, 0, len(columns))), np.sign(last - first)[edge])
    return np.cumsum(turns, axis=1)[:, :-1]


def fill(polygons, shape: tuple[int, int]) -> tuple[np.ndarray, int]:
    """Even-odd filling of the polygons of one plane: a contour within another is a hole, one within a hole an island.

    Pixels whose center is on an edge are filled: contours that were made of masks run through the outermost centers.

    Parameters
    ----------
    polygons : sequence of (n, 2) ndarray
    shape : (rows, columns)

    Returns
    -------
    mask : (rows, columns) ndarray of bool
    crossing : int
        How many polygons cross themselves or one that is larger, by a pixel or more.
    """
    depth, edges, crossing = np.zeros(shape, np.int64), np.zeros(shape, bool), 0
    for polygon in sorted(polygons, key=_area, reverse=True):
        low = np.clip(np.floor(polygon.min(axis=0)), 0, shape[::-1]).astype(int)
        high = np.clip(np.floor(polygon.max(axis=0)) + 1, low, shape[::-1]).astype(int)
        columns, rows = (range(a, b) for a, b in zip(low, high))
        turns = wind(polygon, columns, rows)
        inside = turns % 2 == 1
        here = depth[rows.start : rows.stop, columns.start : columns.stop]
        covered = here[inside]
        if covered.size and (np.ptp(covered) > 0 or np.ptp(turns) > 1):
            crossing += 1
        here += inside
        _mark_edges(polygon, edges)
    return (depth % 2 == 1) | edges, crossing


def _mark_edges(polygon: np.ndarray, edges: np.ndarray) -> None:
    """Set the pixels whose centers are on an edge, where it meets rows; a level edge meets all between its ends."""
    ends = np.roll(polygon, -1, axis=0)
    low, high = np.minimum(polygon, ends), np.maximum(polygon, ends)
    first = np.clip(np.ceil(low[:, 1] - ON_EDGE), 0, edges.shape[0]).astype(np.int64)
    counts = np.clip(np.floor(high[:, 1] + ON_EDGE) + 1, first, edges.shape[0]).astype(np.int64) - first
    edge = np.repeat(np.arange(len(polygon)), counts)
    row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    (x0, y0), (x1, y1) = polygon[edge].T, ends[edge].T
    level = np.abs(y1 - y0) <= ON_EDGE
    x = x0 + np.clip((row - y0) / np.where(level, 1.0, y1 - y0), 0.0, 1.0) * (x1 - x0)
    near = np.rint(x).astype(np.int64)
    on = ~level & (np.abs(x - near) <= ON_EDGE) & (near >= 0) & (near < edges.shape[1])
    edges[row[on], near[on]] = True
    for i, r in zip(edge[level].tolist(), row[level].tolist()):
        left, right = np.clip((np.ceil(low[i, 0] - ON_EDGE), np.floor(high[i, 0] + ON_EDGE) + 1), 0, edges.shape[1])
        edges[r, int(left) : int(right)] = True


def _area(polygon: np.ndarray) -> float:
    """Area of a polygon, by the shoelace formula."""
    x, y = (polygon - polygon[0]).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def fill_slices(polygons, places, shape: tuple[int, int, int], spacing):
    """Generator: the slices of a grid that a region of parallel contours fills.

    A slice between two planes takes the shape between their shapes: the linear interpolation of their signed distances
    (Raya and Udupa, Shape-based interpolation of multidimensional objects, 1990).

    Parameters
    ----------
    polygons : list of (n, 2) ndarray
    places : (m,) ndarray
        Place along z of the plane of each polygon, in slices.
    shape : (slices, rows, columns)
    spacing : (sx, sy)
        Of the pixels, in one unit.

    Yields
    ------
    k : int
    mask : (rows, columns) ndarray of bool
    crossing : int
        See ``fill``; each plane is counted once.
    between : bool
        Whether the slice lies between two planes and was interpolated.
    """
    planes = np.cumsum(np.concatenate([[0], np.diff(np.sort(places)) > ON_SLICE]))
    order = np.argsort(places, kind="stable")
    members = [order[planes == plane] for plane in range(planes[-1] + 1)]
    where = np.array([places[member].mean() for member in members])
    masks = {}
    for k, below, above in _slices_of(where, shape[0]):
        masks = {plane: mask for plane, mask in masks.items() if plane >= below}
        crossing = 0
        for plane in {below, above} - set(masks):
            masks[plane], found = fill([polygons[i] for i in members[plane]], shape[1:])
            crossing += found
        mask = masks[below]
        if above != below:
            share = (k - where[below]) / (where[above] - where[below])
            borders = [[polygons[i] for i in members[plane]] for plane in (below, above)]
            mask = interpolate_shapes((mask, masks[above]), borders, share, spacing)
        yield k, mask, crossing, above != below


def _slices_of(where: np.ndarray, slices: int):
    """Generator: (slice, plane below, plane above) for the slices that planes fill; one plane twice: it alone."""
    usual = float(np.median(np.diff(where))) if len(where) > 1 else 0.0
    longest = max(1.0, MOST_STEPS * usual) + ON_SLICE
    first, last = max(0, int(np.ceil(where[0] - HALF))), min(slices - 1, int(np.floor(where[-1] + HALF)))
    for k in range(first, last + 1):
        nearest = int(np.abs(where - k).argmin())
        above = int(np.searchsorted(where, k))
        off = abs(where[nearest] - k)
        if off > ON_SLICE and 0 < above < len(where) and where[above] - where[above - 1] <= longest:
            yield k, above - 1, above
        elif off <= HALF:
            yield k, nearest, nearest


def interpolate_shapes(ends, polygons, share: float, spacing) -> np.ndarray:
    """The shape between two shapes.

    Parameters
    ----------
    ends : two (rows, columns) ndarray of bool
        The pixels of the two shapes.
    polygons : two sequences of (n, 2) ndarray
        Their borders.
    share : float
        How much of the way from the first to the second.
    spacing : (sx, sy)

    Returns
    -------
    (rows, columns) ndarray of bool
        Pixels in both shapes or in none are decided; in the others the signed distances are compared.
    """
    result = ends[0] & ends[1]
    row, column = np.nonzero(ends[0] ^ ends[1])
    points = np.stack([column, row], axis=1) * spacing
    first, second = (_distances(points, [polygon * spacing for polygon in of_end]) for of_end in polygons)
    signed = (1.0 - share) * first - share * second  # of pixels outside the first shape and inside the second
    result[row, column] = np.where(ends[0][row, column], -signed, signed) < 0.0
    return result


def _distances(points: np.ndarray, polygons) -> np.ndarray:
    """Distance of points (n, 2) from the nearest edge of polygons."""
    begin = np.concatenate(polygons)
    along = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in polygons]) - begin
    length = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
    found = []
    for part in np.array_split(points, 1 + len(points) * len(begin) // PAIRS):
        off = part[:, None] - begin
        at = np.clip((off * along).sum(axis=2) / length, 0.0, 1.0)
        found.append(np.linalg.norm(off - at[..., None] * along, axis=2).min(axis=1, initial=np.inf))
    return np.concatenate(found)
