"""Operators of the Accuracy panel: measure time and error of several plans, choose a plan, make an error map."""

import bpy
from bpy.props import IntProperty

from ..bridge.data import accuracy
from ..bridge.data.settings import quality_of
from ..bridge.held import Held
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.scene import render_scene
from ..bridge.volumes import volumes
from ..rle_splat.accuracy.planner.error_map import error_map_steps
from ..rle_splat.accuracy.planner.measure_plans import sweep_steps
from ..rle_splat.accuracy.planner.plans import sensible_plans
from ..rle_splat.runtime.figures import figure_text
from ..rle_splat.scene import RleSplatError
from .refusal import needs, refuses
from .through_camera import evaluated, has_values_and_camera

PROBES, REPEATS = 400, 3


class _Measurement(StepwiseOperator):
    """Base class: reads the volume without meshes and motion blur, as the truths are defined; pre has no shadows."""

    poll = classmethod(has_values_and_camera)

    def read(self, context):
        """Return (Scene, Quality), and remember Blender's scene and volume for ``commit``."""
        volume_object = volumes.volume_object(context)
        self._scene, self._volume = Held(context.scene), Held(volume_object)
        self._camera_name = context.scene.camera.name
        shadows = quality_of(context.scene).classification == "post"
        return render_scene.read_scene(
            volume_object, evaluated(context, volume_object), with_meshes=False, with_shadows=shadows, moving=False,
            warn=lambda sentence: self.report({"WARNING"}, sentence))  # fmt: skip


class RLE_SPLAT_OT_measure_accuracy(_Measurement, bpy.types.Operator):
    bl_idname = "rle_splat.measure_accuracy"
    bl_label = "Measure Accuracy"
    bl_description = (
        "Measure the time and the error of several quality settings for this volume and camera. The volume is "
        "measured alone: without meshes and motion blur, and without shadows if Interpolate is Colors"
    )

    probes: IntProperty(
        name="Sample Pixels", description="Number of pixels that are compared with the exact result", default=PROBES,
        min=1, soft_max=5000)  # fmt: skip
    repeats: IntProperty(
        name="Repeats", description="Number of frames timed for each setting; the median counts", default=REPEATS,
        min=1, soft_max=20)  # fmt: skip

    def prepare(self, context):
        plain, quality = self.read(context)
        plans = sensible_plans(quality)
        return sweep_steps(plain, plans, quality, probes=self.probes, repeats=self.repeats, cache=render_scene.KEPT)

    def commit(self, context, sweep):
        report = sweep.report
        accuracy.note_sweep(self._scene.get().rle_splat, report, f"{self._volume.name} seen by {self._camera_name}")
        chosen = sweep.plan(report["chosen"])
        rmse = figure_text(chosen["error"]["rmse"])
        said = f"{chosen['name']}: {chosen['frame_ms']:.0f} ms, RMSE {rmse} in 8-bit steps."
        self.report({"INFO"}, f"{len(report['plans'])} settings measured. {said}")


class RLE_SPLAT_OT_choose_plan(bpy.types.Operator):
    bl_idname = "rle_splat.choose_plan"
    bl_label = "Choose Measured Settings"
    bl_description = "Use these measured settings as the scene's Quality"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Row", description="Row in the list of measured settings, from 0", default=0, min=0)

    @classmethod
    def poll(cls, context):
        return needs(cls, context.scene.rle_splat.accuracy_rows, "Measure the accuracy first")

    @refuses
    def execute(self, context):
        rows = context.scene.rle_splat.accuracy_rows
        if self.index >= len(rows):
            raise RleSplatError(f"There is no measured plan {self.index}; choose a row from 0 to {len(rows) - 1}.")
        accuracy.choose(context.scene, rows[self.index])
        quality_of(context.scene)
        return {"FINISHED"}


class RLE_SPLAT_OT_error_map(_Measurement, bpy.types.Operator):
    bl_idname = "rle_splat.error_map"
    bl_label = "Error Map"
    bl_description = (
        "Make an image of the picture's error at the current quality, in 8-bit steps. The volume is "
        "measured alone: without meshes and motion blur, and without shadows if Interpolate is Colors"
    )

    step: IntProperty(
        name="Step", description="Measure one pixel in each block of this many pixels across and down; 1 measures "
        "every pixel, which takes a minute or two for a large picture", default=4, min=1, soft_max=16)  # fmt: skip

    def prepare(self, context):
        plain, quality = self.read(context)
        return error_map_steps(plain, quality, step=self.step, cache=render_scene.KEPT)

    def commit(self, context, result):
        scene = self._scene.get()
        image = accuracy.keep_error_map(scene, self._volume.get(), *result)
        self.report({"INFO"}, f"{image.name}: {scene.rle_splat.error_note}")
