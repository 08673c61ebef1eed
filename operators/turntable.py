"""Turntable: an animation of a camera that turns about the volume, or of the scene's own camera, as MP4 or pictures.

Blender renders it as any animation, so that meshes, lights and the compositor are as in every render, the window shows
its progress, and Esc ends it.  The scene's output settings are changed for the time of the render and then put back.
"""

import os
import textwrap

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..bridge.held import Held
from ..bridge.look import transfer
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.messages import sentence_of
from ..bridge.render import camera_path
from ..bridge.render.output_settings import (
    EXR,
    EXTENSIONS,
    MOVIE,
    PNG,
    KeptOutput,
    check_frames,
    final_path,
    free_path,
    look_through,
    why_no_movie,
    write_to,
)
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from ..rle_splat.scene import RleSplatError
from .refusal import has_volume, needs, refuse

TURN, OWN = "TURN", "CAMERA"
LETTERS = 38  # characters in a line of the dialog
TICK = 0.2  # seconds between looks at whether Blender still renders

_canceled: list = []  # not empty when the render in progress was canceled


def _note_cancel(*_arguments):
    _canceled.append(True)


class RLE_SPLAT_OT_turntable(ExportHelper, bpy.types.Operator):
    """Render an animation of a camera that turns about the volume, or of the active camera's own motion, as an MP4 file
    or as pictures. Output settings and camera of the scene stay as they are; with Render off, the new camera is
    active"""

    bl_idname = "rle_splat.turntable"
    bl_label = "Turntable"
    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would render again

    filename_ext = EXTENSIONS[MOVIE]
    filepath: StringProperty(
        name="File Path", description="The MP4 file, or what the names of the pictures begin with",
        subtype="FILE_PATH", options={"SKIP_SAVE"})  # fmt: skip
    path: EnumProperty(
        name="Camera Motion",
        description="How the camera moves",
        items=[
            (TURN, "Turn", "Turn about the volume; for a patient, about the axis from feet to head"),
            (OWN, "Active Camera", "Use the active camera as it is animated, and the scene's own frames"),
        ],
    )
    frames: IntProperty(
        name="Frames", description="Number of frames, from the scene's first frame on", default=120, min=1,
        soft_max=1000)  # fmt: skip
    angle: FloatProperty(
        name="Angle (°)", description="By how much the camera turns; 360 or more repeats without a jump",
        default=360.0, soft_min=-360.0, soft_max=360.0)  # fmt: skip
    azimuth: FloatProperty(
        name="Start Angle (°)", description="Direction of the first frame; 0 is in front of a patient",
        default=0.0, soft_min=-180.0, soft_max=180.0)  # fmt: skip
    elevation: FloatProperty(
        name="Elevation (°)", description="Height of the camera above the volume's middle, as an angle", default=10.0,
        min=-89.0, max=89.0)  # fmt: skip
    perspective: BoolProperty(
        name="Perspective", description="Use a perspective camera; else an orthographic one", default=True
    )
    background: EnumProperty(
        name="Background",
        description="What is seen behind the volume",
        options={"SKIP_SAVE"},
        items=[
            ("SCENE", "Scene", "The world of the scene, with its view transform"),
            ("BLACK", "Black", "Black, and colors as they are, without a view transform"),
            ("WHITE", "White", "White, as behind a PET, and colors as they are, without a view transform"),
        ],
    )
    output: EnumProperty(
        name="Output", description="One file, or numbered pictures",
        items=[(MOVIE, "MP4", "One file, with the codec H.264"),
               (PNG, "PNG", "One picture for each frame, as the screen shows it"),
               (EXR, "EXR", "One picture for each frame, scene-linear with 32 bits")])  # fmt: skip
    render: BoolProperty(
        name="Render", description="Render the animation; else only add the camera and make it active", default=True
    )

    _kept = None
    _timer = None
    _added: tuple = ()  # Held camera and Empty that this call has made

    @classmethod
    def poll(cls, context):
        is_busy = StepwiseOperator.is_running() or bpy.app.is_job_running("RENDER")
        return has_volume(cls, context) and needs(
            cls, not is_busy, "Other work is in progress; wait for it, or press Esc to cancel it"
        )

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        turns = self.path == TURN
        of_turn = ("frames", "angle", "azimuth", "elevation", "perspective") if turns else ()
        for name in ("path", *of_turn, "background", "output"):
            layout.prop(self, name)
        problem = why_no_movie(context.scene.render)
        for line in textwrap.wrap(problem, LETTERS):
            row = layout.row()
            row.alert = self.output == MOVIE
            row.label(text=line, translate=False)
        if turns:
            layout.prop(self, "render")

    def invoke(self, context, event):
        self._is_confirmed = True
        if self.output == MOVIE and why_no_movie(context.scene.render):
            self.output = PNG  # and the dialog says why
        is_chosen = self.properties.is_property_set("background")
        if not is_chosen and transfer.is_dark(volumes.volume_object(context).rle_splat):
            self.background = "WHITE"
        if not self.filepath:
            name = bpy.path.clean_name(f"{volumes.volume_object(context).name} Turntable", replace=" ")
            self.filepath = free_path(name, EXTENSIONS[self.output], lambda path: not os.path.exists(path))
        return ExportHelper.invoke(self, context, event)

    def check(self, _context):
        """Complete the name, so that the file browser marks it in red if the file is there."""
        before = self.filepath
        if os.path.basename(before):
            self.filepath = final_path(self.output, before)
        return self.filepath != before

    def execute(self, context):
        was_typed = getattr(self, "_is_confirmed", False)
        in_window = was_typed and context.window is not None and not bpy.app.background
        scene, renders = context.scene, self.render or self.path == OWN
        self._kept, self._scene = KeptOutput(scene), Held(scene)
        try:
            if renders:  # before anything is made
                self._written = write_to(scene, self.output, bpy.path.abspath(self.filepath))
                check_frames(scene, self._frames(scene), was_typed)
            camera, frames = self._path(context)
            if not renders:
                self._kept.adopt_camera(camera)
                self._finish(context)
                return {"FINISHED"}
            scene.camera = camera
            # Have renders include the scene's volumes, if they include none
            if not context.scene.rle_splat.use_composite:
                bpy.ops.rle_splat.show_in_renders()
            if self.path == TURN:
                look_through(scene, camera, frames)
            if self.background != "SCENE":
                self._kept.show_before(float(self.background == "WHITE"))
            return self._watch(context) if in_window else self._render_through(context)
        except (RleSplatError, RuntimeError) as problem:  # operators and Blender's render raise the latter
            self._clean_up(context)
            return refuse(self, _sentence(problem))
        except BaseException:
            self._clean_up(context)
            raise

    def _path(self, context) -> tuple:
        """(camera, frames) of the animation; RleSplatError without a camera or a scan."""
        scene, owner = context.scene, volumes.volume_object(context)
        volumes.load_volume(owner)
        if self.path == OWN:
            if scene.camera is None:
                raise RleSplatError("The scene has no active camera; add one and animate it, or choose Turn.")
            return scene.camera, self._frames(scene)
        frames, before = self._frames(scene), set(scene.objects)
        camera, pivot = camera_path.turning_camera(
            context, owner, is_perspective=self.perspective, elevation=self.elevation
        )
        self._added = tuple(Held(one) for one in (camera, pivot) if one not in before)
        camera_path.keyframe_turn(pivot, self.azimuth, self.angle, frames)
        context.view_layer.update()
        return camera, frames

    def _frames(self, scene) -> range:
        last = scene.frame_end if self.path == OWN else scene.frame_start + self.frames - 1
        return range(scene.frame_start, last + 1)

    def _render_through(self, context) -> set:
        """Render in this call, for scripts and background mode."""
        _canceled.clear()
        bpy.ops.render.render(animation=True)
        self._clean_up(context)
        return self._say()

    def _watch(self, context) -> set:
        """Start Blender's own render, and look from a timer whether it still runs."""
        _canceled.clear()
        bpy.app.handlers.render_cancel.append(_note_cancel)
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
        self._timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER" or bpy.app.is_job_running("RENDER"):
            return {"PASS_THROUGH"}  # Esc too, which ends Blender's render
        self._clean_up(context)
        return self._say()

    def cancel(self, context):
        """Blender calls this when a file is loaded or the window closes, and when the file browser is left."""
        self._finish(context)

    def _finish(self, context) -> None:
        """Release the timer and put the settings back; safe to call twice."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if _note_cancel in bpy.app.handlers.render_cancel:
            bpy.app.handlers.render_cancel.remove(_note_cancel)
        if self._kept is not None:
            self._kept.restore()
            self._kept = None

    def _clean_up(self, context) -> None:
        """Release the timer, put the settings back, and remove the camera and the Empty that were made to render."""
        self._finish(context)
        found = [one for one in (held.find() for held in self._added) if one is not None]
        cameras = [one.data for one in found if one.type == "CAMERA"]
        bpy.data.batch_remove(found)
        bpy.data.batch_remove([data for data in cameras if data.users == 0])

    def _say(self) -> set:
        """Report how it ended.  The window may show another scene by then, and that which was rendered may be gone."""
        scene = self._scene.find()
        if _canceled:
            self.report(
                {"WARNING"}, filled("The animation was canceled; what was rendered is at {file}.", file=self._written)
            )
        elif scene is not None and scene.rle_splat.failed_frames:
            self.report({"WARNING"}, scene.rle_splat.render_problem or scene.rle_splat.failed_frames)
        else:
            self.report({"INFO"}, filled("The animation is at {file}.", file=self._written))
        return {"FINISHED"}


def _sentence(problem: Exception) -> str:
    """What a user reads for an error of ours or of an operator of Blender."""
    if isinstance(problem, RleSplatError):
        return sentence_of(problem)
    lines = [line.removeprefix("Error: ").strip() for line in str(problem).splitlines()]
    return " ".join(filter(None, lines)) or "Blender could not render the animation, and does not say why."
