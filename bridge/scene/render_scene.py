"""Reads Blender's evaluated scene as plain data and starts the renderer, with one stage cache for all pictures.

Everything is read before the first step of the work, so that edits during the work do not affect the picture.
"""

import numpy as np

from ...rle_splat.accuracy.planner.tolerance import LEFT_OUT, render_within_steps
from ...rle_splat.classify.transfer_function import TransferFunction
from ...rle_splat.pipeline.render import render_steps
from ...rle_splat.pipeline.stage_cache import StageCache
from ...rle_splat.scene import RleSplatError, Scene
from ..data import settings
from ..data.effects import overrides_of
from ..live.slices import outlines
from ..look import transfer
from ..pictures.drafts import drafted_steps
from ..presence import is_kept_up
from ..volumes import encoded, loading, volumes
from ..volumes.channels import read_channels
from ..volumes.labels import read_labels
from .camera import frame_crop, read_camera
from .clip_objects import clip_objects, read_clips
from .lights import BY_SCENE, read_lights
from .meshes import known_surfaces
from .motion import read_motion
from .world import read_mist, read_world

KEPT = StageCache()  # keyed by content, so it stays valid across files and undo


def forget_stages() -> None:
    """Clear the stage cache."""
    KEPT.clear()


def read_scene(
    volume_object, depsgraph, *, with_meshes: bool, with_shadows: bool = True, in_region: bool = False,
    moving: bool = True, camera=None, warn=None,
):  # fmt: skip
    """Read everything that a picture of a volume depends on, at the depsgraph's time.

    Parameters
    ----------
    with_shadows : bool
        Whether shadows and ambient occlusion are used, if they are on in the scene.
    in_region : bool
        Whether to render only the cropped render region, if there is one.
    moving : bool
        Whether motion blur is used, if it is on in the scene and no maximum error is set.
    camera : bpy.types.Object, optional
        A camera object to use instead of the active one.
    warn : callable, optional
        Called with one sentence for each warning.

    Raises
    ------
    RleSplatError
        For everything that the user can correct.
    """
    check_kept_up(volume_object, depsgraph)
    view = read_camera(depsgraph, camera)
    surfaces = read_occluders(depsgraph) if with_meshes else {}
    plain = _in_picture(
        volume_object, depsgraph, view, in_region, moving, camera, with_shadows=with_shadows, warn=warn, **surfaces
    )
    return plain, encoded.suited(settings.quality_of(depsgraph.scene_eval), plain.volume)


def read_scenes(placed, depsgraph, *, with_meshes: bool, warn=None):
    """Read everything that a rendered picture of several volumes depends on, as ``read_scene`` does.

    Returns
    -------
    scenes : dict of int to Scene
        Number in ``placed`` -> the scene of that volume, of the cropped render region if there is one.
    problems : dict of int to Exception
        Number in ``placed`` -> why that volume cannot be read.
    quality : Quality
        The knobs.
    """
    view = read_camera(depsgraph)
    surfaces = read_occluders(depsgraph) if with_meshes else {}
    scenes, problems = {}, {}
    for n, one in enumerate(placed):
        try:
            scenes[n] = _in_picture(
                one.owner, depsgraph, view, True, one.matrix is None, None, matrix=one.matrix, warn=warn, **surfaces
            )
        except Exception as problem:  # the others are shown all the same
            problems[n] = problem
    return scenes, problems, settings.quality_of(depsgraph.scene_eval)


def _in_picture(volume_object, depsgraph, view, in_region: bool, moving: bool, camera, **of_view) -> Scene:
    """``seen_by`` with the motion and the crop of a picture; arguments as of ``read_scene``."""
    has_truth = settings.tolerance_of(depsgraph.scene_eval) is not None
    motion, still_because = (), LEFT_OUT if has_truth else ""
    if moving and not has_truth:
        motion, still_because = read_motion(depsgraph, volume_object, camera)
    return seen_by(
        volume_object, depsgraph, view,
        crop=frame_crop(depsgraph.scene_eval.render) if in_region else None,
        motion=motion,
        antialias=depsgraph.scene_eval.rle_splat.antialias and not has_truth,
        reasons_off={"motion blur": still_because} if still_because else {},
        **of_view,
    )  # fmt: skip


def check_kept_up(volume_object, depsgraph) -> None:
    """Raise RleSplatError for an object that Blender does not evaluate."""
    if not is_kept_up(volume_object, depsgraph):
        raise RleSplatError(
            f"{volume_object.name!r} is disabled in viewports or excluded from this view layer, so Blender does not "
            "update its place; enable it in the Outliner."
        )


def read_occluders(depsgraph) -> dict:
    """The meshes that hide or tint the volume, as fields of Scene; ``triangles`` is None without any that hides it."""
    surfaces = known_surfaces(depsgraph, clip_objects(depsgraph.scene), outlines(depsgraph))
    return surfaces._replace(triangles=surfaces.triangles if len(surfaces.triangles) else None)._asdict()


def seen_by(
    volume_object, depsgraph, view: tuple, *, with_shadows: bool = True, warn=None, matrix=None, ahead: int = 0,
    **of_view,
) -> Scene:  # fmt: skip
    """Read what a picture of a volume depends on, as a given camera sees it.

    Parameters
    ----------
    view : (Camera, int, int)
        The camera as plain data, width and height of the frame in pixels.
    matrix : (4, 4) ndarray of float64, optional
        The matrix of an instance of the volume; left out, that of the object.
    ahead : int
        Frames of the timeline after the depsgraph's time, of the voxels and labels.
    **of_view
        Further fields of Scene: triangles, panes, crop, motion, antialias.

    Raises
    ------
    RleSplatError
        For everything that the user can correct.
    """
    scene = depsgraph.scene_eval
    camera, width, height = view
    loading.withdraw_unused(volume_object, depsgraph)
    volume = volumes.load_volume(volume_object, warn, depsgraph, ahead)
    if volume.holds_values:
        transfer_function = transfer.shown_transfer(volume_object, depsgraph)
    else:  # its own, also where the file was encoded again since the import
        transfer_function = TransferFunction.from_json(volume.transfer_function)
    shown_as = volume_object.evaluated_get(depsgraph).rle_splat
    lighting = shown_as.lighting
    own = np.array(volume_object.evaluated_get(depsgraph).matrix_world, dtype=np.float64)
    moved = None if matrix is None else matrix @ np.linalg.inv(own)
    lights, world = read_light(depsgraph, warn) if lighting in BY_SCENE else ((), None)
    return Scene(
        volume=volume,
        transfer_function=transfer_function,
        camera=camera,
        width=width,
        height=height,
        volume_matrix=own if matrix is None else matrix,
        scene_scale=settings.scene_scale_of(scene, volume.unit),
        lights=lights,
        headlight=lighting in ("HEADLIGHT", "BOTH") or (lighting == "SCENE" and not (lights or world)),
        clips=read_clips(depsgraph, volume_object, moved),
        channels=read_channels(volume_object, depsgraph, volume),
        labels=read_labels(volume_object, depsgraph, volume, transfer_function, ahead),
        mode=shown_as.mode,
        mist=read_mist(depsgraph),
        effects=overrides_of(scene),
        volume_shadows=with_shadows and bool(lights) and scene.rle_splat.use_shadows,
        world=None if world is None else world.radiance,
        environment=None if world is None else world.environment,
        ambient_occlusion=scene.rle_splat.ambient_occlusion if with_shadows else 0.0,
        indirect_light=scene.rle_splat.indirect_light if with_shadows else 0.0,
        **of_view,
    )


def read_light(depsgraph, warn=None) -> tuple:
    """The lights and the world of a scene, as they light volumes under Scene Lights.

    Returns
    -------
    lights : tuple of Light
        The light objects.
    world : WorldLight or None
        None also for a world of one color in a scene without light objects, which would show no shape.
    """
    scene = depsgraph.scene_eval
    lights = read_lights(depsgraph)
    world = read_world(scene, warn) if scene.rle_splat.use_world else None
    has_shape = lights or (world is not None and world.environment is not None)
    return lights, world if has_shape else None


def is_rendered(volume_object, depsgraph) -> bool:
    """Whether a render shows an object: neither it nor its collections are hidden from renders."""
    for instance in depsgraph.object_instances:
        if not instance.is_instance and instance.object.original == volume_object:
            return not instance.object.hide_render
    return False


def steps(
    plain: Scene, quality, *, tolerance: float | None = None, earlier: dict | None = None,
    refuse_empty_view: bool = True, drafts: bool = False,
):  # fmt: skip
    """Make a picture, as a generator.

    Parameters
    ----------
    tolerance : float, optional
        The largest allowed error in levels of 1/255; the planner then chooses the knobs.  With pre
        shadows are left out.
    earlier : dict, optional
        With a tolerance: the plan of the frame before, from its report.
    refuse_empty_view : bool
        Whether a view that shows nothing of the volume raises RleSplatError.
    drafts : bool
        Whether a slow picture yields a draft first; ignored with a tolerance.

    Yields
    ------
    Progress or Draft
        The steps.

    Returns
    -------
    Rendering
        The picture.
    """
    if tolerance is not None:
        return render_within_steps(
            plain, tolerance, quality, cache=KEPT, refuse_empty_view=refuse_empty_view, leave_out_shadows=True,
            earlier=earlier)  # fmt: skip
    make = drafted_steps if drafts else render_steps
    return make(plain, encoded.suited(quality, plain.volume), cache=KEPT, refuse_empty_view=refuse_empty_view)
