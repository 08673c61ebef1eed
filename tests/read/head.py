"""An asymmetric head: a skull around a brain, with a nose, an open mouth and a mark on the patient's left cheek."""

import numpy as np

SPACING = (2.0, 2.0, 3.0)  # mm along LPS
SHAPE = (56, 64, 44)
ORIGIN = (-55.0, -63.0, 20.0)
EDGE = 9.0  # mm; values change over this length, so that a picture depends little on how it is sampled


def _within(point, middle, radii) -> np.ndarray:
    """1 inside an ellipsoid, 0 outside, and between them a ramp of EDGE millimeters."""
    reach = np.sqrt(sum(((p - m) / r) ** 2 for p, m, r in zip(point, middle, radii)))
    return np.clip(0.5 + (1.0 - reach) * min(radii) / EDGE, 0.0, 1.0)


def head() -> tuple[np.ndarray, np.ndarray]:
    """(values (x, y, z) int16 in HU on axes along LPS, affine to LPS)."""
    affine = np.diag((*SPACING, 1.0))
    affine[:3, 3] = ORIGIN
    point = [ORIGIN[i] + SPACING[i] * np.indices(SHAPE)[i] for i in range(3)]
    values = np.full(SHAPE, -1000.0)
    for value, middle, radii in (
        (900.0, (0, 0, 85), (40, 50, 55)),
        (40.0, (0, 0, 85), (32, 40, 45)),  # the brain
        (1100.0, (0, -50, 87), (8, 12, 14)),  # the nose, in front
        (2500.0, (18, -44, 79), (8, 10, 8)),  # the patient's left
        (-1000.0, (0, -48, 57), (14, 14, 8)),  # the mouth, below
    ):
        inside = _within(point, middle, radii)
        values += (value - values) * inside
    return np.round(values).astype(np.int16), affine


def reordered(values, affine, flips=(1, 1, 1), order=(0, 1, 2)):
    """The same head with its voxels in another order: axes flipped, then permuted; and the affine to LPS."""
    flip = np.diag((*flips, 1.0)).astype(float)
    flip[:3, 3] = [n - 1 if sign < 0 else 0 for n, sign in zip(values.shape, flips)]
    stored = np.ascontiguousarray(values[tuple(slice(None, None, sign) for sign in flips)].transpose(order))
    return stored, (affine @ flip)[:, [*order, 3]]
