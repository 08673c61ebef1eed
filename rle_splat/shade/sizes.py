"""Memory that light takes, told before it is taken; nothing here loads a compiler."""

NORMAL = 12  # bytes of a voxel's normal
NORMAL_CODE = 6  # of its code
LIGHT = 4  # bytes of a voxel's light and highlight where light is white, which mostly it is
# Bytes of a voxel of the scan next to those of a refined grid that are visible: which it is, its normal, light and
# highlight, and what finding these takes.
LIT = 3 + NORMAL + 2 * 12 + 16
SHADOW, CASTING = 4, 10  # bytes of a voxel for each light that casts shadows, and while they are made


def shadow_bytes(lights: int, voxels: int) -> int:
    """Bytes of what ``lights`` leave to each voxel; none without lights that cast shadows."""
    return (SHADOW * lights + CASTING) * voxels if lights else 0


def lit_voxels(count: int, pieces: int, refinement: int) -> int:
    """About how many voxels of a scan are next to ``count`` visible voxels of a refined grid.

    A piece of n of these spans n / refinement cells of the scan and reaches into one at either end, taken alike along
    every axis.
    """
    share = (1.0 + 2.0 * (refinement - 1) * pieces / max(count, 1)) / refinement
    return round(count * share**3)
