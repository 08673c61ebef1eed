"""Depth of field: pictures through several points of the lens, which agree in the plane of focus.

A thin lens blurs a point at depth z to a disk, the picture of its aperture (algorithm.md 4.2).  Each point of the
aperture sees the scene as a pinhole there would whose sensor is shifted so that the plane of focus stays in place; the
mean over the aperture is the lens's picture.  An orthographic camera has a lens too, as in Cycles: each of its points
sees along parallel rays that slant.
"""

import math
from dataclasses import replace

import numpy as np

from ..scene import Camera, Quality, Scene
from ..scene.changed import change
from ..view.eye import index_view
from ..view.projection import find_fitted_side
from .kind import Kind

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
SHARP = 0.5  # pixels: a blur that is no wider is none
SPACING = 1.5  # pixels between the points of a blurred point; the warp's filter and the medium close such gaps
MOST_POINTS = 64
FEWEST_POINTS = 4


def lens_points(count: int, blades: int = 0, rotation: float = 0.0, ratio: float = 1.0, times=None) -> np.ndarray:
    """Points spread evenly over an aperture of radius 1, with its mean and second moments.

    The points lie on the spiral of golden angles (Vogel 1979).

    Parameters
    ----------
    count : int
        Number of points.
    blades : int
        Corners of the aperture; below three it is a disk.
    rotation : float
        Angle of the first corner, radians.
    ratio : float
        Height over width of the aperture.
    times : (count,) ndarray of float64, optional
        The time of each point; points are made uncorrelated with it.

    Returns
    -------
    (count, 2) ndarray of float64
        To the right and up.
    """
    number = np.arange(count)
    radius, angle = np.sqrt((number + 0.5) / count), GOLDEN_ANGLE * number
    moment = 0.25
    if blades >= 3:
        # A sector of the disk onto the triangle between two corners, area for area.
        half = math.pi / blades
        sector = np.floor(angle / (2.0 * half))
        within = np.arctan((angle / half - 2.0 * sector - 1.0) * math.tan(half))
        radius = radius * math.cos(half) / np.cos(within)
        angle = (2.0 * sector + 1.0) * half + within + rotation
        moment = (2.0 + math.cos(2.0 * half)) / 12.0
    points = radius[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    points -= points.mean(axis=0)
    if times is not None:
        late = times - times.mean()
        points -= np.outer(late, late @ points / (late @ late))
    # A few points on a spiral are wider one way than the other: that is evened out.
    sizes, ways = np.linalg.eigh(points.T @ points / count)
    points = points @ (ways * np.sqrt(moment / sizes)) @ ways.T
    return points / (ratio, 1.0)


def through_lens(camera: Camera, point: np.ndarray) -> Camera:
    """The sharp camera at a point of the aperture, focused as the lens.

    Parameters
    ----------
    camera : Camera
        With its lens.
    point : (2,) ndarray of float64
        In aperture radii to the right and up.

    Returns
    -------
    Camera
        A pinhole whose sensor is shifted; of an orthographic camera one with slanted parallel rays, as in Cycles, which
        meet the plane of focus where the unslanted ones do.
    """
    offset = camera.aperture_radius * np.asarray(point, dtype=np.float64)
    if camera.type == "ORTHO":
        return change(camera, slant=tuple(-offset / camera.focus_distance), aperture_radius=0.0)
    placed = np.array(camera.matrix_world)
    sides = placed[:3, :2] / np.linalg.norm(placed[:3, :2], axis=0)
    placed[:3, 3] += sides @ offset
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    shift = offset / (camera.focus_distance * sensor / camera.lens)
    return replace(
        camera, matrix_world=placed, shift_x=camera.shift_x - shift[0], shift_y=camera.shift_y - shift[1],
        aperture_radius=0.0,
    )  # fmt: skip


def see_through_lens(scene: Scene, point: np.ndarray) -> Scene:
    """The sharp scene that a point of its camera's lens sees; ``point``: see ``through_lens``."""
    return change(scene, camera=through_lens(scene.camera, point))


def blur_pixels(camera: Camera, width: int, height: int, depth: float) -> float:
    """The diameter of the disk that a point is blurred to.

    Parameters
    ----------
    width, height : int
        Pixels of the picture.
    depth : float
        Planar depth of the point, world units.

    Returns
    -------
    float
        Pixels: by the formula of the thin lens, or for parallel rays that of a cone with its tip in focus.
    """
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    across = camera.ortho_scale if camera.type == "ORTHO" else depth * sensor / camera.lens
    spread = 2.0 * camera.aperture_radius * max(1.0, 1.0 / camera.aperture_ratio)
    blur = spread * abs(depth - camera.focus_distance) / camera.focus_distance
    return find_fitted_side(camera, width, height) / across * blur


def widest_blur(scene: Scene) -> float:
    """The widest blur of any point in the volume's box, a diameter in pixels; 0 without a lens."""
    camera = scene.camera
    if camera.aperture_radius == 0.0:
        return 0.0
    view = index_view(camera, scene.index_to_world, scene.width, scene.height)
    nearest, furthest = view.box_depths(scene.volume.shape_xyz)
    nearest, furthest = (min(max(d, camera.clip_start), camera.clip_end) for d in (nearest, furthest))
    return max(blur_pixels(camera, scene.width, scene.height, depth) for depth in (nearest, furthest))


def lens_pictures(scene: Scene) -> int:
    """The number of lens points that a picture needs; 1 for a sharp one."""
    blur = widest_blur(scene)
    if blur <= SHARP:
        return 1
    return int(np.clip(math.ceil(0.25 * math.pi * (blur / SPACING) ** 2), FEWEST_POINTS, MOST_POINTS))


def _judge(scene: Scene, _: Quality) -> tuple[bool, str]:
    if scene.camera.aperture_radius == 0.0:
        return False, "the camera has no depth of field"
    blur = widest_blur(scene)
    if blur <= SHARP:
        return False, f"nothing is blurred by more than {SHARP:g} pixels"
    return True, f"blurs up to {blur:.1f} pixels: {lens_pictures(scene)} pictures through the lens"


DEPTH_OF_FIELD = Kind(
    "Blur what is out of focus, as the camera's lens does", _judge,
    lambda scene: change(scene, camera=change(scene.camera, aperture_radius=0.0)),
)  # fmt: skip
