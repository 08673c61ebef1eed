"""How rough a transfer function makes a volume: how much pictures change from one ray to the next.

Sheets and the warp err where the medium changes within a voxel: at walls, at thin vessels, under narrow transfer
functions.  A few hundred short rays through the visible parts measure that, from the volume and the transfer function
alone, so that a quality preset can choose its plan without looking through a camera.
"""

import numpy as np

from .classification import opacity_distance, optical_depth
from .points import LARGEST, pieces, positive_intervals

LEVELS = 255.0
SITES = 256  # short rays
FEWEST = 24  # of them; with fewer the result would depend on chance
CELLS, DRAWS = 4096, 12  # cells of voxels that are drawn at a time to find visible ones, and how often at most
REACH, STEP = 1.5, 0.25  # voxels from the middle of a short ray to its ends, and between samples
BESIDE = 0.5  # voxels: distance of the two rays beside each
ENTRIES = 4096  # of the table of extinction over values
SMALLEST_SPAN = 1e-290  # of values that a table is made of, so that its steps are no subnormal numbers


def roughness(volume, transfer_function) -> float | None:
    """Measure by how much pictures of a medium change within a voxel across the view.

    Deterministic: cells and directions are drawn by a generator with a fixed seed.  Neither the camera nor the volume's
    place in the world matters.  The mean of the fourth power says more about the errors of the worst pixels in a
    thousand than the root mean square: on the scenes of `dev.py bench plans --calibrate` the logarithms of these errors
    scatter by 0.64 around it in place of 0.77 (the usual plan of ``standard``).

    Parameters
    ----------
    volume : Volume
    transfer_function : TransferFunction

    Returns
    -------
    float or None
        The fourth root of the mean fourth power, over short rays through visible cells of voxels, of the difference of
        a ray's color and opacity from the mean of two rays half a voxel beside it, in levels of 1/255; the largest
        channel counts.  None where too few visible cells were found.
    """
    if min(volume.shape_xyz) < 2:
        return None
    random = np.random.default_rng(0)
    cells, least, largest = _visible_cells(volume, transfer_function, random)
    if len(cells) < FEWEST:
        return None
    if not SMALLEST_SPAN < largest - least < LARGEST:
        return 0.0 if least == largest else None
    medium = _FunctionTables(volume, transfer_function, least, largest)
    spacing = volume.spacing[::-1]
    ahead = random.standard_normal((len(cells), 3)) / spacing
    ahead /= np.abs(ahead).max(axis=1, keepdims=True)  # one voxel along the principal axis
    aside = np.cross(ahead * spacing, random.standard_normal((len(cells), 3)))
    aside *= BESIDE * spacing.min() / (np.linalg.norm(aside, axis=1, keepdims=True) * spacing)
    middle = cells + random.random((len(cells), 3))
    along = np.arange(-REACH, REACH + 0.5 * STEP, STEP)[:, None, None]
    beside = np.array((-1.0, 0.0, 1.0))[:, None, None]
    positions = (middle + beside * aside)[:, None] + along * ahead
    lengths = STEP * np.linalg.norm(ahead * spacing, axis=1)
    left, here, right = medium.composite(_interpolate(volume, transfer_function, positions), lengths)
    off = np.abs(0.5 * (left + right) - here).max(axis=1)
    return LEVELS * float(np.mean(off**4)) ** 0.25


class _FunctionTables:
    """A transfer function as tables of even steps over the values from ``low`` to ``high``, low < high.

    ``rates`` (n, 4): extinction times color, and extinction, per unit length.  ``sums``: their integrals.
    """

    def __init__(self, volume, function, low: float, high: float):
        self.low, self.rate = low, (ENTRIES - 1) / (high - low)
        values = np.linspace(low, high, ENTRIES)
        extinction = optical_depth(function.alpha_at(values)) / opacity_distance(volume, function, 1.0)
        self.rates = np.column_stack((extinction[:, None] * function.color_at(values), extinction))
        self.sums = np.zeros_like(self.rates)
        np.cumsum(0.5 * (self.rates[1:] + self.rates[:-1]), axis=0, out=self.sums[1:])

    def composite(self, samples, lengths) -> np.ndarray:
        """Premultiplied color and opacity (rays, n, 4) of ``samples`` (rays, m, n) of the scalar, linear in between.

        ``lengths`` (n,): between two samples, in the volume's unit.
        """
        at = np.clip((samples - self.low) * self.rate, 0.0, ENTRIES - 1.0)  # positions in the tables
        gaps = np.diff(at, axis=1)[..., None]
        steep = np.abs(gaps) > 0.5
        means = np.diff(_table_at(self.sums, at), axis=1) / np.where(steep, gaps, 1.0)
        means = np.where(steep, means, _table_at(self.rates, 0.5 * (at[:, 1:] + at[:, :-1])))
        thick = means * lengths[:, None]
        depth = np.cumsum(thick[..., 3], axis=1)
        own = thick[..., 3]
        share = np.exp(own - depth) * -np.expm1(-own) / np.maximum(own, 1e-30)
        color = (thick[..., :3] * share[..., None]).sum(axis=1)
        return np.concatenate((color, -np.expm1(-depth[:, -1])[..., None]), axis=-1)


def _table_at(table, at) -> np.ndarray:
    """(..., 4): a table (n, 4) at positions (...), linear in between."""
    entry = np.minimum(at.astype(np.int64), ENTRIES - 2)
    return table[entry] + (at - entry)[..., None] * (table[entry + 1] - table[entry])


def _visible_cells(volume, function, random) -> tuple[np.ndarray, float, float]:
    """Draw at most SITES cells of voxels that are not transparent.

    Returns z, y, x of their first corners, (n, 3) int64, and the smallest and largest physical value of all cells that
    were drawn.
    """
    most, shown = np.array(volume.voxels.shape) - 1, positive_intervals(pieces(function.opacity))
    found, count, least, largest = [], 0, np.inf, -np.inf
    for _ in range(DRAWS):
        cells = (random.random((CELLS, 3)) * most).astype(np.int64)
        values = _corners(volume, cells).reshape(8, -1)
        ends = np.stack((values.min(axis=0), values.max(axis=0)))
        low, high = np.sort(_finite(volume.physical(ends), function), axis=0)  # NaN goes to the end
        visible = (~np.isnan(high)) & ((high >= shown[:, :1]) & (low < shown[:, 1:])).any(axis=0)
        found.append(cells[visible])
        least, largest = min(least, low[visible].min(initial=least)), max(largest, high[visible].max(initial=largest))
        count += len(found[-1])
        if count >= SITES:
            break
    return np.concatenate(found)[:SITES], least, largest


def _corners(volume, cells) -> np.ndarray:
    """Stored values (2, 2, 2, ...) of the corners of cells (..., 3)."""
    _, ny, nx = volume.voxels.shape
    first = (cells[..., 0] * ny + cells[..., 1]) * nx + cells[..., 2]
    offsets = np.array([(z * ny + y) * nx + x for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    offsets = offsets.reshape(2, 2, 2, *(1,) * first.ndim)
    return np.asarray(volume.voxels).reshape(-1)[first + offsets]


def _finite(values, function) -> np.ndarray:
    """Physical values, infinite ones as the outermost point of the transfer function, whose look they have."""
    points = [point[0] for point in (*function.opacity, *function.color)]
    values = np.where(np.isinf(values), np.clip(values, min(points), max(points)), values)
    return np.clip(values, -LARGEST, LARGEST)


def _interpolate(volume, function, positions) -> np.ndarray:
    """The physical scalar (...) at positions (..., 3) in voxels, z, y, x; that of the nearest face outside."""
    positions = np.clip(positions, 0.0, np.array(volume.voxels.shape) - 1.0)
    cells = np.minimum(positions.astype(np.int64), np.array(volume.voxels.shape) - 2)
    values = np.nan_to_num(_finite(volume.physical(_corners(volume, cells)), function))
    for axis in range(3):
        share = positions[..., axis] - cells[..., axis]
        values = values[0] + share * (values[1] - values[0])
    return values
