"""Turntable camera: looks at the center of a volume from an azimuth and an elevation."""

import numpy as np
from numpy.typing import ArrayLike

from ..scene import Camera, RleSplatError
from ..scene.checks import refuse_array
from ..volume.volume import PATIENT, Volume

TURN_STEPS = 72  # directions from which a turning camera is checked


def turntable(
    volume: Volume, azimuth: float = 0.0, elevation: float = 0.0, fit: float = 1.25, perspective: bool = False,
    fov: float = 40.0, scene_scale: float = 1.0,
) -> tuple[Camera, np.ndarray]:  # fmt: skip
    """Make a camera that looks at the center of a volume.

    Parameters
    ----------
    volume : Volume
        The scan, whose middle is looked at.
    azimuth, elevation : float
        Degrees. 0 and 0 look along +Y with +Z up. Azimuth 90 is from a patient's left (+X), elevation 90 from above.
    fit : float
        Height of the view as a multiple of the largest n * spacing.
    perspective : bool
        In perspective, the plane through the center of the box of voxel centers fills that height.
    fov : float
        Vertical field of view in degrees, for perspective.
    scene_scale : float
        World units per unit of the volume.

    Returns
    -------
    camera : Camera
        Orthographic, unless ``perspective`` is set.
    volume_matrix : (4, 4) ndarray of float64
        Matrix of the volume object. For a volume in patient space the identity: the world is LPS, and azimuth 0 shows
        the face. For any other it undoes the rotation of the volume's affine, so that the world's axes are the voxel
        axes, and keeps the spacing.

    Raises
    ------
    RleSplatError
        If a number is out of range or the volume's affine is singular.
    """
    if not (np.isfinite(fit) and fit > 0.0):
        raise RleSplatError(f"fit must be a finite number above zero, not {fit}.")
    if not 0.0 < fov < 180.0:
        raise RleSplatError(f"fov must be between 0 and 180 degrees, not {fov}.")
    if not (np.isfinite(azimuth) and np.isfinite(elevation)):
        raise RleSplatError(f"azimuth and elevation must be finite numbers of degrees, not {azimuth} and {elevation}.")
    refuse_array(volume)
    counts, spacing = np.array(volume.shape_xyz), volume.spacing
    if not (spacing > 0.0).all():
        raise RleSplatError("The volume's affine is singular: voxels have no length along one axis; correct the file.")
    scale = np.diag((scene_scale, scene_scale, scene_scale, 1.0))
    volume_matrix = np.eye(4)
    if volume.space != PATIENT:
        # Chosen so that volume_matrix @ scale @ affine = scale @ diag(spacing), whatever the affine's translation.
        volume_matrix = scale @ np.diag((*spacing, 1.0)) @ np.linalg.inv(scale @ volume.affine)

    right, up, forward = turntable_axes(azimuth, elevation)
    aim = turntable_aim(volume, volume_matrix, scene_scale)
    view_height = fit * float((counts * spacing).max()) * scene_scale
    extent = float(np.linalg.norm((counts + 1) * spacing)) * scene_scale

    if perspective:
        distance = 0.5 * view_height / np.tan(0.5 * np.radians(fov))
        # The lens that sees ``fov`` over a sensor height of 24 mm.
        lens = 12.0 / np.tan(0.5 * np.radians(fov))
        nearest = max(distance - extent, 1e-4 * distance)
    else:
        distance, lens, nearest = extent + view_height, 50.0, 0.1 * view_height
    matrix_world = np.eye(4)
    matrix_world[:3, :3] = np.stack((right, up, -forward), axis=1)
    matrix_world[:3, 3] = aim - distance * forward
    camera = Camera(
        matrix_world=matrix_world, type="PERSP" if perspective else "ORTHO", lens=lens, sensor_fit="VERTICAL",
        sensor_width=36.0, sensor_height=24.0, ortho_scale=view_height, clip_start=0.5 * nearest,
        clip_end=distance + 2.0 * extent,
    )  # fmt: skip
    return camera, volume_matrix


def turntable_axes(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes of a camera that turns about +Z.

    Parameters
    ----------
    azimuth, elevation : float
        Degrees. 0 and 0 look along +Y with +Z up. Azimuth 90 is from a patient's left (+X), elevation 90 from above.

    Returns
    -------
    right, up, forward : (3,) ndarray of float64
        Unit vectors.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    right = np.array((np.cos(a), np.sin(a), 0.0))
    forward = np.array((-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)))
    return right, np.cross(right, forward), forward


def turning_extent(corners, elevation: float) -> np.ndarray:
    """What a camera sees of points during a full turn about +Z.

    Parameters
    ----------
    corners : (n, 3) ndarray of float64
        Relative to the point that the camera looks at.
    elevation : float
        Of the camera, in degrees.

    Returns
    -------
    (m, 3) ndarray of float64
        Places right, above and nearer than that point, each side taken positive; one turn in TURN_STEPS steps.
    """
    seen = []
    for azimuth in np.arange(TURN_STEPS) * (360.0 / TURN_STEPS):
        right, up, forward = turntable_axes(azimuth, elevation)
        places = corners @ np.stack((right, up, -forward), axis=1)
        seen.append(np.concatenate((np.abs(places[:, :2]), places[:, 2:]), axis=1))
    return np.concatenate(seen)


def distance_to_see(extent, slopes) -> float:
    """The shortest distance from which a perspective camera sees points.

    Parameters
    ----------
    extent : (m, 3) ndarray of float64
        As ``turning_extent`` returns it.
    slopes : (2,) array_like
        Half width and half height of the view at distance 1.

    Returns
    -------
    float
        From the point that the camera looks at. A point at (x, y, z) is seen from x / slope + z on.
    """
    return float((extent[:, :2] / np.asarray(slopes, np.float64) + extent[:, 2:]).max())


def turntable_aim(volume: Volume, volume_matrix: ArrayLike, scene_scale: float = 1.0) -> np.ndarray:
    """Find the point that ``turntable`` looks at.

    Parameters
    ----------
    volume : Volume
        The scan.
    volume_matrix : (4, 4) array_like
        As ``turntable`` returns it.
    scene_scale : float
        World units per unit of the volume, as for ``turntable``.

    Returns
    -------
    (3,) ndarray of float64
        The center of the box of voxel centers, in world units.
    """
    if volume.space != PATIENT:
        return 0.5 * (np.array(volume.shape_xyz) - 1) * volume.spacing * scene_scale
    middle = volume.affine @ (*(0.5 * (np.array(volume.shape_xyz) - 1)), 1.0)
    return (np.asarray(volume_matrix) @ (*(middle[:3] * scene_scale), 1.0))[:3]
