"""The active camera and the render settings as plain data.

The rules are Blender's.  The scale of the camera object and of its parents is ignored: each column of the matrix is
normalized.  The image size is the resolution times the percentage, rounded down.  The evaluated scene knows a camera
that is bound to a timeline marker.
"""

import numpy as np

from ...rle_splat.scene import Camera, RleSplatError
from ..data.decimals import typed, typed_fields, typed_tuple

METERS_PER_MM = 1e-3  # Blender takes a lens's millimeters as 1/1000 world unit, whatever the scene's unit
LEAST_FSTOP, LEAST_FOCUS = 1e-5, 1e-5  # Blender's own limits
# Of a camera's data, under the names of Camera.
NUMBERS = "lens", "sensor_width", "sensor_height", "ortho_scale", "shift_x", "shift_y", "clip_start", "clip_end"
_PANORAMIC = {"PANO": "panoramic", "CUSTOM": "custom (OSL)"}


def image_size(render) -> tuple[int, int]:
    """Width and height of the full frame in pixels."""
    percentage = render.resolution_percentage
    return (
        max(1, render.resolution_x * percentage // 100),
        max(1, render.resolution_y * percentage // 100),
    )


def camera_object(depsgraph):
    """The evaluated active camera; RleSplatError if there is none, or another kind of object is active."""
    original = depsgraph.scene_eval.camera or depsgraph.scene.camera
    if original is None:
        raise RleSplatError("The scene has no active camera; add a camera and make it active with Ctrl+Numpad 0.")
    if original.type != "CAMERA":
        raise RleSplatError(
            f"The active camera of the scene is {original.name!r}, which is not a camera object; make a camera the "
            "active one."
        )
    return original.evaluated_get(depsgraph)


def marked_camera(scene):
    """The camera that timeline markers make active at the scene's current frame, or None.

    Blender switches the camera after ``frame_change_post``; before the first marker it uses the first marker's camera.
    """
    markers = sorted((one for one in scene.timeline_markers if one.camera is not None), key=lambda one: one.frame)
    passed = [one for one in markers if one.frame <= scene.frame_current]
    return passed[-1].camera if passed else markers[0].camera if markers else None


def read_camera(depsgraph, camera=None) -> tuple[Camera, int, int]:
    """The camera and the image size at the depsgraph's time.

    Returns
    -------
    camera : Camera
        The camera as plain data, lengths in world units.
    width, height : int
        Size of the full frame in pixels.

    Raises
    ------
    RleSplatError
        Without an active camera, for a panoramic or custom one, and with stereoscopy.
    """
    evaluated = camera_object(depsgraph) if camera is None else camera.evaluated_get(depsgraph)
    data = evaluated.data
    if data.type not in ("PERSP", "ORTHO"):
        kind = _PANORAMIC.get(data.type, data.type.lower())
        raise RleSplatError(
            f"The camera {evaluated.name!r} is {kind}, which RLE Splat cannot render; set its type to Perspective or "
            "Orthographic."
        )
    render = depsgraph.scene_eval.render
    if render.use_multiview:
        raise RleSplatError("RLE Splat cannot render stereoscopy; turn it off in the output properties.")
    width, height = image_size(render)
    camera = Camera(
        matrix_world=without_scale(evaluated.matrix_world),
        type=data.type,
        sensor_fit=data.sensor_fit,
        **typed_fields(data, NUMBERS),
        pixel_aspect=typed_tuple((render.pixel_aspect_x, render.pixel_aspect_y)),
        **_lens(evaluated, depsgraph),
    )
    return camera, width, height


def _lens(evaluated, depsgraph) -> dict:
    """Depth-of-field fields of Camera; the aperture radius is computed as in Cycles."""
    dof = evaluated.data.dof
    if not dof.use_dof:
        return {}
    fstop = max(typed(dof.aperture_fstop), LEAST_FSTOP)
    # An orthographic camera has no focal length; Cycles uses a lens of one world unit (measured in 5.0).
    length = 1.0 if evaluated.data.type == "ORTHO" else typed(evaluated.data.lens) * METERS_PER_MM
    return {
        "aperture_radius": length / (2.0 * fstop),
        "focus_distance": max(_focus_distance(evaluated, dof, depsgraph), LEAST_FOCUS),
        "aperture_blades": dof.aperture_blades if dof.aperture_blades >= 3 else 0,
        **typed_fields(dof, ("aperture_rotation", "aperture_ratio")),
    }


def _focus_distance(evaluated, dof, depsgraph) -> float:
    """Planar distance in focus, in world units: to the focus object or its bone if set, else the camera's number."""
    if dof.focus_object is None:
        return typed(dof.focus_distance)
    target = dof.focus_object.evaluated_get(depsgraph)
    place = np.array(target.matrix_world, dtype=np.float64)
    bone = target.pose.bones.get(dof.focus_subtarget) if target.pose and dof.focus_subtarget else None
    if bone is not None:
        place = place @ np.array(bone.matrix, dtype=np.float64)
    matrix = without_scale(evaluated.matrix_world)
    return abs(float(matrix[:3, 2] @ (place[:3, 3] - matrix[:3, 3])))


def without_scale(matrix_world) -> np.ndarray:
    """A matrix with its first three columns normalized, as Blender ignores a camera's scale.

    Parameters
    ----------
    matrix_world : array_like, shape (4, 4)
        Camera to world.

    Raises
    ------
    RleSplatError
        If a column is zero or not finite.
    """
    matrix = np.array(matrix_world, dtype=np.float64)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not (np.isfinite(matrix).all() and (lengths > 0.0).all()):
        raise RleSplatError("The scale of the camera or of a parent is zero or not finite; set it above zero.")
    matrix[:3, :3] /= lengths
    return matrix


def frame_crop(render) -> tuple[int, int, int, int] | None:
    """The part of the frame that a cropped render region keeps.

    Blender rounds the region's corners down to whole pixels, counted from the bottom left.

    Returns
    -------
    tuple of int or None
        Left, top, right and bottom in pixels of the full frame, row 0 on top; None without a cropped region.
    """
    if not (render.use_border and render.use_crop_to_border):
        return None
    width, height = image_size(render)
    left, right = int(render.border_min_x * width), int(render.border_max_x * width)
    bottom, top = int(render.border_min_y * height), int(render.border_max_y * height)
    return left, height - top, right, height - bottom
