"""The settings of a scene on which the files of an animation depend: changed for one render, then put back."""

import os

import bpy

from ...rle_splat.scene import RleSplatError
from .. import versions
from ..held import Held
from ..paths import free_name
from ..scene import world_nodes
from ..scene.camera import image_size
from ..translations import filled
from ..volumes.source_paths import check_is_no_scan

MOVIE, PNG, EXR = "MP4", "PNG", "EXR"
EXTENSIONS = {MOVIE: ".mp4", PNG: ".png", EXR: ".exr"}
DIGITS = "_####"  # Blender puts the number of the frame here
OF_SCENE = ("frame_start", "frame_end", "frame_step")
OF_RENDER = ("filepath", "use_file_extension", "use_overwrite", "use_placeholder", "film_transparent")
WITHIN_RENDER = ("image_settings", "ffmpeg")
OF_VIEW = {"view_transform": "Standard", "look": "None", "exposure": 0.0, "gamma": 1.0, "use_curve_mapping": False}


class KeptOutput:
    """Remembers the output settings of a scene, its camera, world, frames and the cameras of its markers."""

    def __init__(self, scene):
        self._scene = Held(scene)
        self._values = [(path, name, getattr(owner, name)) for path, owner, name in _settings(scene)]
        self._camera, self._world = _held(scene.camera), _held(scene.world)
        self._backdrop = None
        self._markers = [(marker.name, marker.frame, _held(marker.camera)) for marker in scene.timeline_markers]

    def adopt_camera(self, camera) -> None:
        """Have ``restore`` set this camera."""
        self._camera = Held(camera)

    def show_before(self, color: float) -> None:
        """Have renders show the volume before black (0) or white (1), with the colors as they are.

        The light of the world stays: what the camera sees of it is replaced alone.
        """
        scene = self._scene.get()
        scene.render.film_transparent = False
        for name, value in OF_VIEW.items():
            setattr(scene.view_settings, name, value)
        self._backdrop = Held(world_nodes.seen_as(scene.world, color))
        scene.world = self._backdrop.get()

    def restore(self) -> None:
        """Put everything back; nothing is done if the scene was removed."""
        scene = self._scene.find()
        if scene is None:
            return
        for path, name, value in self._values:
            owner = _owner(scene, path)
            if getattr(owner, name) != value:
                setattr(owner, name, value)
        scene.camera, backdrop = _found(self._camera), _found(self._backdrop)
        if backdrop is not None:
            scene.world = _found(self._world)
            bpy.data.worlds.remove(backdrop)
        for marker, (name, frame, camera) in zip(scene.timeline_markers, self._markers):
            if (marker.name, marker.frame) == (name, frame):
                marker.camera = _found(camera)


def _held(datablock) -> Held | None:
    return None if datablock is None else Held(datablock)


def _found(held: Held | None):
    return None if held is None else held.find()


def _owner(scene, path: str):
    for name in filter(None, path.split(".")):
        scene = getattr(scene, name)
    return scene


def _settings(scene) -> list:
    """(path, owner, name) of each setting; in the order in which Blender can set them again."""
    found = [("", scene, name) for name in OF_SCENE]
    found += [("render", scene.render, name) for name in OF_RENDER]
    found += [("view_settings", scene.view_settings, name) for name in OF_VIEW]
    for group in WITHIN_RENDER:
        owner = getattr(scene.render, group)
        names = [entry.identifier for entry in owner.bl_rna.properties if not entry.is_readonly]
        found += [(f"render.{group}", owner, name) for name in names if name != "rna_type"]
    return found


def look_through(scene, camera, frames: range) -> None:
    """Have an animation of a scene render some frames through one camera, whatever its markers say."""
    scene.camera = camera
    scene.frame_start, scene.frame_end, scene.frame_step = frames[0], frames[-1], 1
    for marker in scene.timeline_markers:
        marker.camera = None


def free_path(name: str, suffix: str, is_free) -> str:
    """A path for a new file beside the .blend, numbered if there is one; the name alone before the first save."""
    if not bpy.data.filepath:
        return name + suffix
    return free_name(os.path.join(os.path.dirname(bpy.data.filepath), name), suffix, is_free)


def final_path(output: str, path: str) -> str:
    """The path that Blender is given for an animation: with ``####`` for the frame's number, unless it is a movie."""
    stem, extension = os.path.splitext(path)
    if extension.lower() not in EXTENSIONS.values():
        stem = path
    if output == MOVIE:
        return stem.removesuffix(DIGITS) + EXTENSIONS[output]
    return stem + ("" if "#" in os.path.basename(stem) else DIGITS) + EXTENSIONS[output]


def check_frames(scene, frames, were_typed: bool) -> None:
    """Refuse to write an animation over files that nobody meant.

    Parameters
    ----------
    scene : bpy.types.Scene
        A scene whose animation ``write_to`` has directed to files.
    were_typed : bool
        Whether a user typed the name in a dialog, which shows no names of numbered pictures.

    Raises
    ------
    RleSplatError
        If a file is one that a volume is read from, or a picture is there already.
    """
    is_movie = scene.render.is_movie_format
    for path in [scene.render.filepath] if is_movie else [scene.render.frame_path(frame=frame) for frame in frames]:
        check_is_no_scan(path)
        if were_typed and not is_movie and os.path.exists(path):
            raise RleSplatError(
                filled("{path} is there already; give another name, or delete the old pictures.", path=path)
            )


def write_to(scene, output: str, path: str) -> str:
    """Have an animation written to files; returns Blender's path, of pictures with ``####`` for the frame.

    Parameters
    ----------
    output : {"MP4", "PNG", "EXR"}
        An MP4 file, or one picture for each frame.
    path : str
        Absolute path. An extension of one of these kinds is replaced.

    Raises
    ------
    RleSplatError
        If the folder cannot be made, this Blender cannot write movies, or the picture's size is odd.
    """
    if not path:
        raise RleSplatError("The animation has no file name; give a file path.")
    final = final_path(output, path)
    if not os.path.basename(path):
        raise RleSplatError("The path of the animation names a folder; add a file name.")
    try:
        os.makedirs(os.path.dirname(final), exist_ok=True)
    except OSError as problem:
        raise RleSplatError(
            f"The folder {os.path.dirname(final)} cannot be made: {problem.strerror}; choose another one."
        ) from None
    if output == MOVIE:
        problem = why_no_movie(scene.render)
        if problem:
            raise RleSplatError(problem)
        versions.use_movie(scene.render)
    else:
        versions.use_pictures(scene.render, {PNG: "PNG", EXR: "OPEN_EXR"}[output])
    render = scene.render
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    render.filepath = final
    return final


def why_no_movie(render) -> str:
    """Why the codec of the movie refuses the size of a scene's pictures; "" where it does not."""
    width, height = image_size(render)
    if width % 2 == 0 and height % 2 == 0:
        return ""
    return filled(
        "An MP4 file needs an even width and height, and the picture is {width} x {height} pixels; change the "
        "resolution in the output properties, or write pictures.", width=width, height=height)  # fmt: skip
