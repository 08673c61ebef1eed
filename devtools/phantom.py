"""A CT head in Hounsfield units, out of numbers alone (runs in an environment with numpy).

It stands in for the sample where that cannot be fetched, and gives tests something whose left and right are
known.  Axes as in patient space: +x right, +y anterior, +z superior, millimeters, origin in the middle of the
skull.  The head leans on nothing that is symmetric: the left ventricle is larger, a tooth is missing on the
right, and a steel bead lies outside the LEFT temple.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

# Hounsfield units as radiology textbooks give them.
AIR, FAT, CSF, WHITE_MATTER, GRAY_MATTER, SOFT_TISSUE, LENS = -1000, -90, 8, 28, 38, 50, 90
SPONGY_BONE, CORTICAL_BONE, ENAMEL, STEEL = 450, 1150, 2300, 3050

SPACING_MM = 1.25
EXTENT_MM = ((-95.0, 95.0), (-115.0, 120.0), (-135.0, 110.0))  # x, y, z
BEAD_MM = (-86.0, 10.0, 12.0)  # outside the left temple
BEAD_RADIUS_MM = 4.0


class _Canvas:
    """Voxels that shapes are painted on, one over the other, with edges one voxel soft (partial volume)."""

    def __init__(self, extent, spacing: float):
        axes = [np.arange(low, high + 0.5 * spacing, spacing, dtype=np.float32) for low, high in extent]
        self.spacing = spacing
        self.x = axes[0][None, None, :]
        self.y = axes[1][None, :, None]
        self.z = axes[2][:, None, None]
        self.values = np.full([axis.size for axis in reversed(axes)], AIR, dtype=np.float32)

    def paint(self, distance_mm, value: float, where=None) -> None:
        """Paint ``value`` where ``distance_mm`` (signed, inside positive) is positive and ``where`` (0..1) allows."""
        cover = np.clip(0.5 + distance_mm / self.spacing, 0.0, 1.0)
        if where is not None:
            cover = cover * where
        self.values += (value - self.values) * cover

    def ellipsoid(self, center, semi_axes):
        """Signed distance to an ellipsoid, mm, inside positive; exact for spheres, close near the surface otherwise."""
        cx, cy, cz = center
        a, b, c = semi_axes
        dx, dy, dz = self.x - cx, self.y - cy, self.z - cz
        level = np.sqrt((dx / a) ** 2 + (dy / b) ** 2 + (dz / c) ** 2)
        slope = np.sqrt((dx / a**2) ** 2 + (dy / b**2) ** 2 + (dz / c**2) ** 2)
        return level * (1.0 - level) / np.maximum(slope, 1e-6)

    def arch(self, radius_x, radius_y, center_y, low_z, high_z, thickness):
        """Signed distance to the front half of an upright elliptic band: a jaw, a row of teeth."""
        dx, dy = self.x / radius_x, (self.y - center_y) / radius_y
        ring = 0.5 * thickness - np.abs(np.sqrt(dx**2 + dy**2) - 1.0) * min(radius_x, radius_y)
        band = np.minimum(self.z - low_z, high_z - self.z)
        return np.minimum(np.minimum(ring, self.y - center_y + 0.5 * thickness), band)


def head_phantom(spacing_mm: float = SPACING_MM) -> np.ndarray:
    """(nz, ny, nx) int16, Hounsfield units; voxel (0, 0, 0) is centered on the low corner of EXTENT_MM."""
    canvas = _Canvas(EXTENT_MM, spacing_mm)
    x, y, z = canvas.x, canvas.y, canvas.z

    head = np.maximum(canvas.ellipsoid((0, 0, 0), (78, 97, 92)), canvas.ellipsoid((0, 30, -62), (58, 62, 62)))
    neck = np.minimum(58.0 - np.sqrt(x**2 + (1.05 * (y + 18.0)) ** 2), -30.0 - z)
    nose = canvas.ellipsoid((0, 100, -38), (11, 14, 20))
    skin = np.maximum(np.maximum(head, neck), nose)
    canvas.paint(skin, FAT)
    canvas.paint(skin - 3.0, SOFT_TISSUE)
    canvas.paint(np.maximum(canvas.ellipsoid((-80, -8, -32), (9, 16, 28)),
                            canvas.ellipsoid((80, -8, -32), (9, 16, 28))), SOFT_TISSUE)  # fmt: skip

    # skull: two tables of compact bone with spongy bone between them; cheek bones and spine
    vault = canvas.ellipsoid((0, -2, 2), (71, 90, 84))
    cheeks = np.maximum(canvas.ellipsoid((-40, 66, -42), (17, 14, 9)), canvas.ellipsoid((40, 66, -42), (17, 14, 9)))
    maxilla = canvas.ellipsoid((0, 66, -58), (30, 24, 20))
    canvas.paint(np.maximum(np.maximum(vault, cheeks), maxilla), CORTICAL_BONE)
    canvas.paint(vault - 2.0, SPONGY_BONE)
    canvas.paint(vault - 5.0, CORTICAL_BONE)
    for level in range(-132, -84, 16):
        vertebra = canvas.ellipsoid((0, -22, level), (17, 14, 7))
        canvas.paint(np.maximum(vertebra, canvas.ellipsoid((0, -48, level - 4), (5, 16, 4))), CORTICAL_BONE)
        canvas.paint(vertebra - 2.5, SPONGY_BONE)

    # brain: folded surface in its fluid, white matter inside, ventricles (the left one larger)
    canvas.paint(vault - 7.0, CSF)
    folds = 1.6 * (np.sin(0.33 * x + 2.0 * np.sin(0.11 * z)) * np.cos(0.29 * y + 1.7 * np.sin(0.13 * x))
                   + np.sin(0.31 * z + 1.5 * np.sin(0.12 * y)))  # fmt: skip
    cleft = np.minimum(np.abs(x) - 1.5, 30.0 + 0.0 * x)
    brain = np.minimum(vault - 10.0 + folds, np.where(z > -5.0, cleft, 30.0))
    canvas.paint(brain, GRAY_MATTER)
    canvas.paint(brain - 7.0 + folds, WHITE_MATTER)
    canvas.paint(canvas.ellipsoid((-13, 2, 10), (8, 34, 11)), CSF)
    canvas.paint(canvas.ellipsoid((12, 4, 10), (5, 27, 8)), CSF)
    canvas.paint(canvas.ellipsoid((0, -14, -78), (7, 7, 40)), CSF)  # foramen and spinal canal

    # face: orbits, eyes with lenses, sinuses, airway
    for side in (-1, 1):
        canvas.paint(canvas.ellipsoid((side * 31, 76, -22), (18, 24, 16)), FAT)
        canvas.paint(canvas.ellipsoid((side * 31, 82, -22), (12, 12, 12)), CSF + 6)
        canvas.paint(canvas.ellipsoid((side * 31, 92, -22), (4.5, 2.5, 4.5)), LENS)
        canvas.paint(canvas.ellipsoid((side * 24, 66, -48), (11, 13, 11)), AIR)
    canvas.paint(canvas.ellipsoid((0, 82, 4), (16, 5, 9)), AIR)
    canvas.paint(canvas.ellipsoid((0, 62, -40), (7, 30, 15)), AIR)
    canvas.paint(np.minimum(canvas.ellipsoid((0, 22, -95), (11, 9, 60)), -48.0 - z), AIR)

    # jaw and teeth: a row above, a row below, gaps between the teeth, one missing on the right
    canvas.paint(canvas.arch(40, 62, 28, -112, -96, 11), CORTICAL_BONE)
    canvas.paint(canvas.arch(40, 62, 28, -109, -99, 5), SPONGY_BONE)
    angle = np.arctan2(y - 28.0, x)
    gaps = (np.cos(angle * 28.0) > -0.75) & ((angle < 0.55) | (angle > 0.67))
    for low, high in ((-83.0, -74.0), (-95.0, -85.0)):
        canvas.paint(canvas.arch(37, 58, 28, low, high, 7.5), ENAMEL, gaps)

    canvas.paint(BEAD_RADIUS_MM - np.sqrt(sum((p - q) ** 2 for p, q in zip((x, y, z), BEAD_MM, strict=True))), STEEL)
    return np.clip(np.rint(canvas.values), -1024, 3071).astype(np.int16)


def main(arguments) -> int:
    """Write the phantom's voxels to the file named: int16, little-endian, x fastest."""
    voxels = head_phantom()
    Path(arguments[0]).write_bytes(voxels.astype("<i2").tobytes())
    print(*voxels.shape[::-1])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
