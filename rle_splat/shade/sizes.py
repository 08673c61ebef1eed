"""Memory that light takes, told before it is taken; nothing here loads a compiler."""

NORMAL = 12  # bytes of a voxel's normal
NORMAL_CODE = 6  # of its code
LIGHT = 4  # bytes of a voxel's light and highlight where light is white, which mostly it is
SHADOW, CASTING = 4, 10  # bytes of a voxel for each light that casts shadows, and while they are made


def shadow_bytes(lights: int, voxels: int) -> int:
    """Bytes of what ``lights`` leave to each voxel; none without lights that cast shadows."""
    return (SHADOW * lights + CASTING) * voxels if lights else 0
