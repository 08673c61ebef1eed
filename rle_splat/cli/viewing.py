"""The camera, placement and lights from the options, and the scene made from them."""

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..classify.transfer_function import TransferFunction
from ..scene import MODES, Camera, Clip, Light, Mist, Pose, RleSplatError, Scene, as_matrix, from_mapping, read_json
from ..view.turntable import turntable, turntable_aim
from ..volume.checks import check_values
from .appearance import choose_transfer_function, read_transfer_function
from .options import effects_from, read_input

LARGEST_SIDE = 65536  # pixels, the limit of Scene
# The turntable's arguments, by their names in the parsed arguments, with their defaults.
TURNTABLE_DEFAULTS = {"azimuth": 0.0, "elevation": 0.0, "fit": 1.25, "perspective": False, "fov": 40.0}


def check_scene_options(args) -> None:
    """Check the options of view, lights and effects, before any volume is read.

    Parameters
    ----------
    args : argparse.Namespace
        With the options of ``add_scene_options`` and ``size``.

    Raises
    ------
    RleSplatError
        If options contradict each other, or a value is out of range.
    """
    effects_from(args)
    read_clips(args)
    given = [name for name in TURNTABLE_DEFAULTS if getattr(args, name) is not None]
    if args.camera is not None and given:
        raise RleSplatError(f"--camera and --{given[0]} contradict each other; give one of the two.")
    if args.fov is not None and not args.perspective:
        raise RleSplatError("--fov has no effect on an orthographic view; add --perspective, or remove --fov.")
    if not (np.isfinite(args.scene_scale) and args.scene_scale > 0.0):
        raise RleSplatError(f"--scene-scale is {args.scene_scale:g}; give a finite number above zero.")
    if not all(1 <= side <= LARGEST_SIDE for side in args.size):
        sides = " ".join(map(str, args.size))
        raise RleSplatError(f"--size is {sides}; give whole numbers of pixels from 1 to {LARGEST_SIDE}.")
    if args.no_shading and getattr(args, "smoothness", None) is not None:
        raise RleSplatError("--no-shading and --smoothness contradict each other; give one of the two.")
    if args.no_shading and (args.lights is not None or args.headlight):
        other = "--lights" if args.lights is not None else "--headlight"
        raise RleSplatError(f"--no-shading and {other} contradict each other; give one of the two.")


def read_placement(args):
    """Read the files of --camera and --volume-matrix.

    Parameters
    ----------
    args : argparse.Namespace
        With ``volume_matrix`` and ``camera``, a file, None, or for a frame of --camera-path a Camera.

    Returns
    -------
    camera : Camera or None
        None without --camera.
    matrix : ndarray, shape (4, 4), float64
        The volume's own space to the world; the identity without --volume-matrix.
    """
    camera = args.camera if args.camera is None or isinstance(args.camera, Camera) else Camera.from_json(args.camera)
    if args.volume_matrix is None:
        return camera, as_matrix(np.eye(4), "the identity")
    return camera, as_matrix(read_json(args.volume_matrix, "the volume matrix file"), "The volume's matrix")


def place(args, volume, camera, matrix):
    """The camera and the volume's matrix for a volume.

    Without a camera file the turntable camera is used.  It is centered on the box where ``matrix`` puts it; its axes
    are the patient's (LPS) for a volume in patient space, else the volume's axes, both before ``matrix``.

    Parameters
    ----------
    args : argparse.Namespace
        With the turntable options, ``size`` and ``scene_scale``.
    camera, matrix
        The results of ``read_placement``.

    Returns
    -------
    camera : Camera
    matrix : ndarray, shape (4, 4), float64
        The volume's own space to the world.
    """
    if camera is not None:
        return camera, matrix
    given = {name: getattr(args, name) for name in TURNTABLE_DEFAULTS}
    view = {name: TURNTABLE_DEFAULTS[name] if value is None else value for name, value in given.items()}
    camera, unrotated = turntable(volume, **view, scene_scale=args.scene_scale)
    middle = turntable_aim(volume, unrotated, args.scene_scale)
    shift = np.eye(4)
    shift[:3, 3] = (matrix @ (*middle, 1.0))[:3] - middle
    return replace(camera, matrix_world=shift @ camera.matrix_world), matrix @ unrotated


def read_lights(args) -> tuple[tuple, bool]:
    """The lights from the options.

    Parameters
    ----------
    args : argparse.Namespace
        With ``lights``, ``headlight``, ``no_shading`` and ``camera``.

    Returns
    -------
    lights : tuple of Light
        Those of --lights.
    headlight : bool
    """
    if args.no_shading:
        return (), False
    lights = () if args.lights is None else Light.list_from_json(args.lights)
    if args.headlight is not None:
        return lights, args.headlight
    return lights, args.lights is None and args.camera is None


def read_clips(args) -> tuple:
    """The planes and boxes of --clip; none for a command without it."""
    path = getattr(args, "clip", None)
    return () if path is None else Clip.list_from_json(path)


def read_mist(args) -> Mist | None:
    """The mist of --mist; None for a command without it."""
    path = getattr(args, "mist", None)
    return None if path is None else Mist.from_json(path)


def make_scene(args, volume, function, camera, matrix, lights, headlight) -> Scene:
    """Make the scene.

    Parameters
    ----------
    args : argparse.Namespace
        With ``size``, ``scene_scale``, ``effect``, and ``clip``, ``mode`` and ``mist`` if the command has them.
    volume : Volume or StoredVolume
    function : TransferFunction
    camera, matrix
        The results of ``place``.
    lights, headlight
        Those of ``read_lights``.
    """
    width, height = args.size
    return Scene(
        volume=volume, transfer_function=function, camera=camera, width=width, height=height, volume_matrix=matrix,
        scene_scale=args.scene_scale, lights=lights, headlight=headlight, effects=effects_from(args),
        clips=read_clips(args),
        mode=getattr(args, "mode", MODES[0]), mist=read_mist(args),
    )  # fmt: skip


def read_scene_files(args) -> tuple:
    """What the options name beside the volume: placement, transfer function, lights; read before the volume."""
    return read_placement(args), read_transfer_function(args), read_lights(args)


@dataclass(frozen=True)
class Like:
    """What all frames have from the first: transfer function, the reason for it, camera and the volume's matrix."""

    function: TransferFunction
    reason: str
    camera: Camera
    matrix: np.ndarray


def read_scene(args, line, files: tuple, like: Like | None = None, **more):
    """Read the volume of a command, and make the scene.

    Parameters
    ----------
    files : tuple
        The result of ``read_scene_files``.
    like : Like, optional
        What the scene has from another.
    **more
        See ``options.read_input``.

    Returns
    -------
    scene : Scene
    read_ms : float
        Milliseconds for reading.
    described : dict
        The name of the transfer function and the reason for it, for the report.
    """
    placement, given_function, lights = files
    began = perf_counter()
    volume = read_input(args, line, **more)
    read_ms = 1e3 * (perf_counter() - began)
    check_values(volume)
    if like is None:
        like = Like(*choose_transfer_function(args, volume, given_function), *place(args, volume, *placement))
    scene = make_scene(args, volume, like.function, like.camera, like.matrix, *lights)
    return scene, read_ms, {"name": like.function.name, "reason": like.reason}


def read_motion(path) -> list[dict]:
    """Read the file of --motion: a list of poses, each a dict with one or both matrices of a Pose."""
    entries = [] if path is None else read_json(path, "the motion file")
    if not isinstance(entries, list):
        raise RleSplatError(f"The motion file {path} does not hold a list; give a list of poses.")
    return entries


def moving(scene: Scene, poses: list[dict]) -> Scene:
    """Add the poses of an open shutter to a scene.

    Parameters
    ----------
    poses : list of dict
        The result of ``read_motion``; a missing matrix is that of the scene.
    """
    own = {"camera_matrix": scene.camera.matrix_world, "volume_matrix": scene.volume_matrix}
    what = "A pose of the motion file"
    motion = [from_mapping(Pose, {**own, **pose} if isinstance(pose, dict) else pose, what) for pose in poses]
    return replace(scene, motion=tuple(motion))
