"""The scene's active camera and render settings as plain data.

Blender's own rules are kept: the scale of the camera object and of its parents does not count (each column of
the matrix is normalised), the image is the resolution times the percentage rounded down, and of a camera that
is bound to a marker the evaluated scene knows.
"""

from __future__ import annotations

import numpy as np

from ..rle_splat.scene import Camera, RleSplatError
from .decimals import typed, typed_tuple

METRES_PER_MM = 1e-3  # a lens's millimetres are thousandths of a world unit, whatever the scene's unit
LEAST_FSTOP, LEAST_FOCUS = 1e-5, 1e-5  # Blender's own least
_PANORAMIC = {"PANO": "panoramic", "CUSTOM": "custom (OSL)"}


def image_size(render) -> tuple[int, int]:
    """Width and height in pixels of the full frame that ``render`` (RenderSettings) makes."""
    percentage = render.resolution_percentage
    return (
        max(1, render.resolution_x * percentage // 100),
        max(1, render.resolution_y * percentage // 100),
    )


def camera_object(depsgraph):
    """The evaluated active camera, or a RleSplatError that says what to do."""
    original = depsgraph.scene_eval.camera or depsgraph.scene.camera
    if original is None:
        raise RleSplatError("The scene has no active camera; add a camera and make it active with Ctrl+Numpad 0.")
    if original.type != "CAMERA":
        raise RleSplatError(
            f"The scene is seen through {original.name!r}, which is not a camera; make a camera the active one."
        )
    return original.evaluated_get(depsgraph)


def marked_camera(scene):
    """The camera that the timeline's markers make active at the scene's frame; None where no marker does.

    Blender's own switch comes only after ``frame_change_post``, and takes the first marker where none has passed.
    """
    markers = sorted((one for one in scene.timeline_markers if one.camera is not None), key=lambda one: one.frame)
    passed = [one for one in markers if one.frame <= scene.frame_current]
    return passed[-1].camera if passed else markers[0].camera if markers else None


def read_camera(depsgraph, camera=None) -> tuple[Camera, int, int]:
    """The active camera, or the camera object given, at the depsgraph's time, and the frame's width and height in
    pixels.

    Raises RleSplatError without an active camera, for a panoramic or custom one, and with stereoscopy.
    """
    evaluated = camera_object(depsgraph) if camera is None else camera.evaluated_get(depsgraph)
    data = evaluated.data
    if data.type not in ("PERSP", "ORTHO"):
        kind = _PANORAMIC.get(data.type, data.type.lower())
        raise RleSplatError(
            f"The camera {evaluated.name!r} is {kind}; set its type to Perspective or Orthographic to splat a volume."
        )
    render = depsgraph.scene_eval.render
    if render.use_multiview:
        raise RleSplatError("Stereoscopy cannot be splatted; turn it off in the output properties.")
    width, height = image_size(render)
    camera = Camera(
        matrix_world=without_scale(evaluated.matrix_world),
        type=data.type,
        lens=typed(data.lens),
        sensor_width=typed(data.sensor_width),
        sensor_height=typed(data.sensor_height),
        sensor_fit=data.sensor_fit,
        ortho_scale=typed(data.ortho_scale),
        shift_x=typed(data.shift_x),
        shift_y=typed(data.shift_y),
        clip_start=typed(data.clip_start),
        clip_end=typed(data.clip_end),
        pixel_aspect=typed_tuple((render.pixel_aspect_x, render.pixel_aspect_y)),
        **_lens(evaluated, depsgraph),
    )
    return camera, width, height


def _lens(evaluated, depsgraph) -> dict:
    """What of the camera's depth of field a plain Camera holds: the f-number's aperture, as Cycles reckons it."""
    dof = evaluated.data.dof
    if not dof.use_dof:
        return {}
    fstop = max(typed(dof.aperture_fstop), LEAST_FSTOP)
    # An orthographic camera has no focal length: its aperture is that of a lens of one unit (measured in Cycles 5.0).
    length = 1.0 if evaluated.data.type == "ORTHO" else typed(evaluated.data.lens) * METRES_PER_MM
    return {
        "aperture_radius": length / (2.0 * fstop),
        "focus_distance": max(_focus_distance(evaluated, dof, depsgraph), LEAST_FOCUS),
        "aperture_blades": dof.aperture_blades if dof.aperture_blades >= 3 else 0,
        "aperture_rotation": typed(dof.aperture_rotation),
        "aperture_ratio": typed(dof.aperture_ratio),
    }


def _focus_distance(evaluated, dof, depsgraph) -> float:
    """Planar distance of what is in focus: an object, or a bone of it, before the number beside it."""
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
    """(4, 4) float64: the matrix with columns 0 to 2 of unit length, as Blender looks through a scaled camera."""
    matrix = np.array(matrix_world, dtype=np.float64)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not (np.isfinite(matrix).all() and (lengths > 0.0).all()):
        raise RleSplatError("The camera's matrix is singular; give the camera and its parents a scale above zero.")
    matrix[:3, :3] /= lengths
    return matrix


def frame_crop(render) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom, in pixels of the full frame, row 0 on top, of what a cropped render region keeps;
    None without one.

    Blender rounds the region's corners down to whole pixels counted from the bottom left.
    """
    if not (render.use_border and render.use_crop_to_border):
        return None
    width, height = image_size(render)
    left, right = int(render.border_min_x * width), int(render.border_max_x * width)
    bottom, top = int(render.border_min_y * height), int(render.border_max_y * height)
    return left, height - top, right, height - bottom
