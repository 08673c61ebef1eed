"""Renders the volume for every rendered frame; the compositor then puts it over the render.

Blender calls ``frame_change_post`` for each view layer of every rendered frame, stills included, with the evaluated
scene of that layer and before the compositor reads any image.  This handler renders the volume into the pictures of
that view layer.  In a window it runs on the render thread.  So it only writes pixels of images that the Composite
operator has created, it creates and removes no datablock, and ``use_lock_interface``, set by that operator, keeps the
interface from drawing the images meanwhile.  A render without it says so.

Problems are recorded for the whole render or animation, see ``render_log.py``.
"""

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.pipeline.preset_plan import hold_plan
from ...rle_splat.pipeline.report import EMPTY_REMARKS
from ...rle_splat.pipeline.several import MOST_SPANS, several_steps
from ...rle_splat.runtime.steps import drain
from ...rle_splat.scene import RleSplatError
from .. import messages, presence
from ..data.settings import tolerance_of
from ..live import slices
from ..loop import work
from ..pictures import images, pictures
from ..scene import placements, render_scene
from ..scene.camera import frame_crop, image_size
from ..translations import filled, translate
from . import compositor, mesh_shadows
from .render_log import RenderLog

LAST_FRAME = 1048574  # Blender's largest frame number
UNLOCKED = ("Lock Interface is off, so Blender may draw a picture of the volume while a render writes it, and crash; "
            "switch it on in the Render menu.")  # fmt: skip

# The scenes that are being rendered, by session id.  The first is the one whose render was started, the others are in
# its scene strips.  It is empty when nothing is rendered: exporters change frames with a render depsgraph too.
_logs: dict[int, RenderLog] = {}


@persistent
def _on_render_init(scene, *_arguments):
    work.drop(work.BACKDROP)
    started = next(iter(_logs.values()), None)
    if started is not None and not started.is_in_frame:
        _logs.clear()  # a render that Blender aborted before its first frame sends no event at its end
    if scene.session_uid not in _logs:
        _logs[scene.session_uid] = RenderLog(scene)
    if not scene.rle_splat.use_composite:
        mesh_shadows.show(scene)
        if _is_unlocked() and slices.slice_objects(scene):
            messages.complain(scene.rle_splat, UNLOCKED)
    elif not bpy.app.is_job_running("RENDER"):  # on the main thread: a script's links send no event
        compositor.settle(scene)


def _is_unlocked() -> bool:
    """Whether a window may draw images while a render, on a thread of its own, writes them: as its scene has it."""
    started = next((one for one in bpy.data.scenes if one.session_uid == next(iter(_logs))), None)
    return started is not None and bpy.app.is_job_running("RENDER") and not started.render.use_lock_interface


@persistent
def _on_render_pre(scene, *_arguments):
    if scene.session_uid in _logs:
        _logs[scene.session_uid].begin_frame(scene)


@persistent
def _on_frame_change_post(scene, depsgraph=None):
    if depsgraph is None or depsgraph.mode != "RENDER":
        return
    log = _logs.get(scene.session_uid)
    # Motion blur visits subframes of a view layer after the frame itself and then returns to it.
    if log is not None and log.is_in_force and log.begin_layer(depsgraph.view_layer.name):
        splat_over_render(scene, depsgraph)


@persistent
def _on_render_post(scene, *_arguments):
    if scene.session_uid in _logs:
        _logs[scene.session_uid].end_frame(scene)


@persistent
def _on_render_write(scene, *_arguments):
    """End an animation after a failed frame if the user has chosen that.

    Blender ignores exceptions in handlers and has no call that cancels a render.  Its loop over an animation counts by
    the scene's frame number and resets it at the end.  The file of the frame is already written here.
    """
    if not _logs or next(iter(_logs)) != scene.session_uid:
        return
    goes_on = scene.frame_current + scene.frame_step <= scene.frame_end
    if goes_on and any(log.wants_stop for log in _logs.values()):
        _logs[scene.session_uid].stopped_at = scene.frame_current
        scene.frame_current = LAST_FRAME


@persistent
def _on_render_end(scene, *_arguments):
    if not _logs or next(iter(_logs)) != scene.session_uid:
        return  # the scene of a strip has ended; it is rendered again in the next frame
    started = _logs[scene.session_uid]
    if scene.frame_current == LAST_FRAME and started.stopped_at is not None:
        scene.frame_current, started.stopped_at = started.stopped_at, None  # a still has no loop that resets it
    for uid, log in _logs.items():
        owner = next((one for one in bpy.data.scenes if one.session_uid == uid), None)
        if owner is not None:
            log.end(owner, started.stopped_at)
    _logs.clear()


@persistent
def _on_save_pre(*_arguments):
    """Save blank pictures in the file; in this session the images stay as they are.

    A render without this extension then lacks the volume, instead of showing it as it was in another frame.
    """
    made = dict.fromkeys(image for scene in bpy.data.scenes for image in compositor.images_of(scene))
    own = [image for image in made if image.is_editable]
    blank = _packed_blank() if own else b""
    for image in own:
        if image.is_dirty:
            image.pack()  # otherwise Blender asks about unsaved images when it is closed
        image.pack(data=blank, data_len=len(blank))


def _packed_blank() -> bytes:
    """The file content of a transparent image of one pixel."""
    image = images.ensure_image(None, "Blank", 1, 1)
    images.clear(image)
    image.pack()
    content = bytes(image.packed_file.data)
    bpy.data.images.remove(image)
    return content


HANDLERS = (
    ("render_init", _on_render_init),
    ("render_pre", _on_render_pre),
    ("render_post", _on_render_post),
    ("render_write", _on_render_write),
    ("render_complete", _on_render_end),
    ("render_cancel", _on_render_end),
    ("frame_change_post", _on_frame_change_post),
    ("save_pre", _on_save_pre),
)


def splat_over_render(scene, depsgraph) -> None:
    """Render the pictures that the compositor puts over a view layer; on failure a placeholder and a message."""
    log, layer = _logs[scene.session_uid], depsgraph.view_layer.name
    found = compositor.pictures(scene)
    mine = [one for one in found if one.is_of(layer)]
    if log.is_first_layer:
        log.pictures = found
        if _is_unlocked():
            log.note(scene, UNLOCKED)
        problem = compositor.problem(scene)
        if problem is not None:
            log.fail(scene, problem)
        for image in compositor.images_of(scene):
            if image not in [one.image for one in mine]:
                images.clear(image)  # shows an earlier frame; it is drawn with its own view layer, if that is rendered
    for picture in mine:
        if picture.image not in log.drawn:
            _draw(scene, depsgraph, picture.image, log)


def _draw(scene, depsgraph, image, log: RenderLog) -> None:
    settings, layer = scene.rle_splat, depsgraph.view_layer
    try:
        placed = placements.shown(depsgraph)
        if not placed:
            log.hidden.append(_why_empty(settings, depsgraph))
            mesh_shadows.show(scene)
            images.clear(image)
            return
        rendering, scenes, quality = _render(scene, depsgraph, placed, log)
        pictures.show(image, rendering)
        themselves = [(placed[n].owner, plain) for n, plain in scenes.items() if placed[n].instancer is None]
        effects = [*rendering.report["effects"], _shadows_on_meshes(themselves, depsgraph, quality, log)]
        log.report = {**rendering.report, "effects": effects, "view_layer": layer.name}
        if not rendering.rgba[..., 3].any():
            for remark in rendering.report["remarks"]:
                if remark in EMPTY_REMARKS:
                    log.note(scene, remark)
    except Exception as problem:  # one sentence for the whole render instead of a traceback for every frame
        log.fail(scene, messages.sentence_of(problem))
        mesh_shadows.show(scene)
        _show_placeholder(image, depsgraph.scene_eval.render)
    log.drawn.append(image)


def _why_empty(settings, depsgraph) -> str:
    """Why a view layer does not show the volume that renders include; RleSplatError if it was deleted."""
    owner = settings.composite_object
    if owner is None or presence.is_deleted(owner):
        name = settings.deleted_volume if owner is None else owner.name
        raise RleSplatError(
            f"{messages.the_volume(name)} was deleted and renders show no other one; import one, or turn Show in "
            "Renders off."
        )
    return placements.why_hidden(placements.Placement(owner), depsgraph) or "it is no volume"


class _VolumeError(Exception):
    """A volume of a picture cannot be rendered: its number, and why."""


def _render(scene, depsgraph, placed: list, log: RenderLog) -> tuple:
    """One picture of all volumes of a view layer that can be drawn; the log names those that cannot.

    Returns
    -------
    rendering : Rendering
    scenes : dict of int to Scene
        Number in ``placed`` -> the scene of a volume that was drawn.
    quality : Quality

    Raises
    ------
    Exception
        Why the first volume cannot be drawn, where none can.
    """
    with_meshes = scene.rle_splat.meshes_occlude and depsgraph.view_layer.use_solid
    scenes, problems, quality = render_scene.read_scenes(
        placed, depsgraph, with_meshes=with_meshes, warn=lambda sentence: log.note(scene, sentence)
    )
    rendering = None
    while scenes and rendering is None:
        try:
            rendering = drain(_picture_steps(placed, scenes, quality, tolerance_of(depsgraph.scene_eval), log))
        except _VolumeError as failed:
            n, problems[n] = failed.args
            del scenes[n]
    if rendering is None:
        raise problems[min(problems)]
    for n, problem in sorted(problems.items()):
        log.fail(scene, filled(
            "{volume} is left out of the picture: {reason}", volume=repr(placed[n].stands_for.name),
            reason=translate(messages.sentence_of(problem))))  # fmt: skip
    return rendering, scenes, quality


def _picture_steps(placed: list, scenes: dict, quality, tolerance: float | None, log: RenderLog):
    """Generator of Progress: one picture of some volumes; _VolumeError names one that cannot be rendered."""
    numbers = list(scenes)

    def make(plain, at):
        """The picture of volume number ``at`` of these, or of a span of it, by the plan of its first picture."""
        n = numbers[at]
        drawn_as = placed[n].owner.name, n, quality, tolerance
        planned, earlier = log.plans.get(drawn_as, (quality, None))
        try:
            rendering = yield from render_scene.steps(
                plain, planned, tolerance=tolerance, earlier=earlier, refuse_empty_view=False
            )
        except Exception as problem:
            raise _VolumeError(n, problem) from problem
        plan = rendering.report["plan"]
        log.plans[drawn_as] = hold_plan(quality, plan) if planned is quality else planned, plan
        return rendering

    found = list(scenes.values())
    if len(found) == 1:
        return make(found[0], 0)
    return several_steps(found, make, 1 if tolerance is not None else MOST_SPANS)


def _shadows_on_meshes(volumes: list, depsgraph, quality, log: RenderLog) -> dict:
    """Set what casts the shadows of ``volumes``, (object, Scene) each, on meshes; return the effect for the report."""
    try:
        return mesh_shadows.update(volumes, depsgraph, quality)
    except RleSplatError as problem:  # the volume is drawn all the same
        log.note(depsgraph.scene, f"The volume casts no shadow on meshes: {problem}")
        return mesh_shadows.row(False, str(problem))


def _show_placeholder(image, render) -> None:
    left, top, right, bottom = frame_crop(render) or (0, 0, *image_size(render))
    width, height = max(1, right - left), max(1, bottom - top)
    images.write_color(images.ensure_image(image, image.name, width, height), images.placeholder(width, height))
