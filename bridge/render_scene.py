"""From Blender's evaluated scene to the renderer's plain data, and the stages kept between its pictures.

Everything is read before the first step of the work, so that what the user does meanwhile changes nothing.
"""

from __future__ import annotations

import numpy as np

from ..rle_splat.accuracy.planner.tolerance import LEFT_OUT, tolerance_steps
from ..rle_splat.pipeline.previews import progressive_steps
from ..rle_splat.pipeline.render import render_steps
from ..rle_splat.pipeline.stage_cache import StageCache
from ..rle_splat.scene import RleSplatError, Scene
from . import settings, transfer, volumes
from .camera import frame_crop, read_camera
from .channels import read_channels
from .clip_objects import clip_objects, read_clips
from .effects import overrides_of
from .labels import read_labels
from .lights import read_lights
from .meshes import read_triangles
from .mist import read_mist
from .motion import read_motion
from .presence import is_kept_up
from .world import read_world

KEPT = StageCache()  # keyed by content, so it may outlive files and undo

# What a picture to a maximum error is made without, as the truths have none of it, and why.


def forget_stages() -> None:
    """Let go of everything kept between pictures."""
    KEPT.clear()


def read_scene(
    volume_object, depsgraph, *, with_meshes: bool, with_shadows: bool = True, in_region: bool = False,
    moving: bool = True, camera=None, warn=None,
):
    """Everything a picture of ``volume_object`` depends on at the depsgraph's time: (Scene, Quality).

    ``with_meshes``: stop each ray at the first mesh surface.  ``with_shadows``: if the scene wants them.
    ``in_region``: only what a cropped render region keeps of the frame.
    ``moving``: blur what moves while the shutter is open, if the scene wants it and no maximum error is set.
    ``camera``: a camera object in place of the active one.  ``warn``: called with a sentence for what is odd.
    Raises RleSplatError for every mistake the user can mend.
    """
    scene = depsgraph.scene_eval
    if not is_kept_up(volume_object, depsgraph):
        raise RleSplatError(
            f"{volume_object.name!r} is disabled in viewports or left out of this view layer, so Blender does not know "
            "where it is now; enable it in the Outliner."
        )
    view, width, height = read_camera(depsgraph, camera)
    volume = volumes.load_volume(volume_object, warn)
    transfer_function = transfer.read_transfer(volume_object, depsgraph)
    lighting = scene.rle_splat.lighting
    lights = read_lights(depsgraph) if lighting == "SCENE" else ()
    has_truth = settings.tolerance_of(scene) is not None
    motion, still_because = (), LEFT_OUT if has_truth else ""
    if moving and not has_truth:
        motion, still_because = read_motion(depsgraph, volume_object, camera)
    triangles = read_triangles(depsgraph, clip_objects(depsgraph.scene)) if with_meshes else None
    plain = Scene(
        volume=volume,
        transfer_function=transfer_function,
        camera=view,
        width=width,
        height=height,
        volume_matrix=np.array(volume_object.evaluated_get(depsgraph).matrix_world, dtype=np.float64),
        scene_scale=settings.scene_scale_of(scene, volume.unit),
        lights=lights,
        headlight=lighting == "HEADLIGHT" or (lighting == "SCENE" and not lights),
        triangles=triangles if triangles is not None and len(triangles) else None,
        crop=frame_crop(scene.render) if in_region else None,
        clips=read_clips(depsgraph),
        channels=read_channels(volume_object, depsgraph),
        labels=read_labels(volume_object, depsgraph, volume, transfer_function),
        mode=scene.rle_splat.mode,
        mist=read_mist(depsgraph),
        motion=motion,
        effects=overrides_of(scene),
        reasons_off={"motion blur": still_because} if still_because else {},
        volume_shadows=with_shadows and bool(lights) and scene.rle_splat.use_shadows,
        # A headlight stands for all the light of a scene that has none.
        world=read_world(scene, warn) if lights and scene.rle_splat.use_world else None,
        ambient_occlusion=scene.rle_splat.ambient_occlusion if with_shadows else 0.0,
    )
    return plain, settings.quality_of(scene)


def is_rendered(volume_object, depsgraph) -> bool:
    """Whether a render of this depsgraph shows the object: it and its collections are not hidden from renders."""
    for instance in depsgraph.object_instances:
        if not instance.is_instance and instance.object.original == volume_object:
            return not instance.object.hide_render
    return False


def steps(
    plain: Scene, quality, *, tolerance: float | None = None, refuse_empty_view: bool = True, previews: bool = False
):
    """The work as a generator of Progress that returns a Rendering.

    ``tolerance``: the largest error, levels, by a plan in place of the quality's; see ``tolerance.py``.
    ``previews``: it also yields a Preview now and then, when the picture takes long; see ``progressive.py``.  A picture
    to a tolerance has none.
    """
    if tolerance is not None:
        return tolerance_steps(
            plain, tolerance, quality, KEPT, refuse_empty_view=refuse_empty_view, leave_out_shadows=True)
    make = progressive_steps if previews else render_steps
    return make(plain, quality, KEPT, refuse_empty_view=refuse_empty_view)
