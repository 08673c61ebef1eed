"""Camera, placement and lights from the options, and the scene they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene import MODES, Camera, Clip, Light, Mist, Pose, RleSplatError, Scene, as_matrix, from_mapping, read_json
from ..view.turntable import turntable
from .options import effects_from

LARGEST_SIDE = 65536  # pixels, as Scene has it
# What the turntable takes, each by its name in the parsed arguments, with its default.
TURNTABLE_DEFAULTS = {"azimuth": 0.0, "elevation": 0.0, "fit": 1.25, "perspective": False, "fov": 40.0}


def check_scene_options(args) -> None:
    """Refuse contradictory or impossible options of view, lights and effects before anything is read."""
    effects_from(args)
    read_clips(args)
    given = [name for name in TURNTABLE_DEFAULTS if getattr(args, name) is not None]
    if args.camera is not None and given:
        raise RleSplatError(f"--camera and --{given[0]} contradict each other; give one of the two.")
    if args.fov is not None and not args.perspective:
        raise RleSplatError("--fov is the angle of a perspective view; add --perspective or leave it out.")
    if not (np.isfinite(args.scene_scale) and args.scene_scale > 0.0):
        raise RleSplatError("--scene-scale must be a finite number above zero.")
    if not all(1 <= side <= LARGEST_SIDE for side in args.size):
        raise RleSplatError(f"--size takes whole numbers of pixels from 1 to {LARGEST_SIDE}.")
    if args.no_shading and (args.lights is not None or args.headlight):
        other = "--lights" if args.lights is not None else "--headlight"
        raise RleSplatError(f"--no-shading and {other} contradict each other; give one of the two.")


def read_placement(args):
    """(Camera or None, (4, 4) matrix): what --camera and --volume-matrix hold; the identity without the latter."""
    camera = None if args.camera is None else Camera.from_json(args.camera)
    if args.volume_matrix is None:
        return camera, as_matrix(np.eye(4), "the identity")
    return camera, as_matrix(read_json(args.volume_matrix, "the volume matrix file"), "The volume's matrix")


def place(args, volume, camera, matrix):
    """(Camera, (4, 4) volume matrix) for the volume that has been read.

    The turntable stands about the volume where ``matrix`` puts it: the world's axes are the volume's before that
    matrix, and the aim follows the middle of the box.
    """
    if camera is not None:
        return camera, matrix
    given = {name: getattr(args, name) for name in TURNTABLE_DEFAULTS}
    view = {name: TURNTABLE_DEFAULTS[name] if value is None else value for name, value in given.items()}
    width, height = args.size
    camera, unrotated = turntable(volume, **view, width=width, height=height, scene_scale=args.scene_scale)
    middle = 0.5 * (np.array(volume.shape_xyz) - 1) * volume.spacing * args.scene_scale
    shift = np.eye(4)
    shift[:3, 3] = (matrix @ (*middle, 1.0))[:3] - middle
    return replace(camera, matrix_world=shift @ camera.matrix_world), matrix @ unrotated


def read_lights(args) -> tuple[tuple, bool]:
    """(lights, headlight): what --lights, --headlight and --no-shading ask for."""
    if args.no_shading:
        return (), False
    lights = () if args.lights is None else Light.list_from_json(args.lights)
    if args.headlight is not None:
        return lights, args.headlight
    return lights, args.lights is None and args.camera is None


def read_clips(args) -> tuple:
    """The planes and boxes of --clip, of commands that have it."""
    path = getattr(args, "clip", None)
    return () if path is None else Clip.list_from_json(path)


def read_mist(args) -> Mist | None:
    """What --mist holds, of commands that have it."""
    path = getattr(args, "mist", None)
    return None if path is None else Mist.from_json(path)


def make_scene(args, volume, function, camera, matrix, lights, headlight) -> Scene:
    """The Scene of the placement options and of what has been read."""
    width, height = args.size
    return Scene(
        volume=volume, transfer_function=function, camera=camera, width=width, height=height, volume_matrix=matrix,
        scene_scale=args.scene_scale, lights=lights, headlight=headlight, effects=effects_from(args),
        clips=read_clips(args),
        mode=getattr(args, "mode", MODES[0]), mist=read_mist(args),
    )


def read_motion(path) -> list[dict]:
    """What the file of --motion holds: a list of poses, each with one of a Pose's matrices or both."""
    entries = [] if path is None else read_json(path, "the motion file")
    if not isinstance(entries, list):
        raise RleSplatError(f"The motion file {path} must hold a list of poses.")
    return entries


def moving(scene: Scene, poses: list[dict]) -> Scene:
    """The scene with a shutter that is open during ``poses``; a matrix that one leaves out is the scene's own."""
    own = {"camera_matrix": scene.camera.matrix_world, "volume_matrix": scene.volume_matrix}
    what = "A pose of the motion file"
    motion = [from_mapping(Pose, {**own, **pose} if isinstance(pose, dict) else pose, what) for pose in poses]
    return replace(scene, motion=tuple(motion))
