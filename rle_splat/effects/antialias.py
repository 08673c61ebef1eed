"""Anti-aliasing: pictures shifted by parts of a pixel, whose mean has no steps at edges."""

from dataclasses import replace

from ..scene import Scene
from ..scene.changed import change
from ..view.projection import find_fitted_side

# Pixels to the right and down, on a rotated grid: a nearly horizontal or vertical edge meets each at a way of its own.
SHIFTS = ((-0.125, -0.375), (0.375, -0.125), (-0.375, 0.125), (0.125, 0.375))


def antialias_pictures(scene: Scene) -> int:
    """How many pictures a scene takes for anti-aliasing."""
    return len(SHIFTS) if scene.antialias else 1


def shifted(scene: Scene, number: int) -> Scene:
    """The scene whose picture of this number is shifted: more pictures than SHIFTS take turns."""
    right, down = SHIFTS[number % len(SHIFTS)]
    camera, (wide, tall) = scene.camera, scene.camera.pixel_aspect
    fitted = find_fitted_side(camera, scene.width, scene.height)
    moved = replace(
        camera, shift_x=camera.shift_x + right / fitted, shift_y=camera.shift_y - down * (tall / wide) / fitted
    )
    return change(scene, camera=moved, antialias=False)
