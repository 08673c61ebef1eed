"""Accuracy: measure what it costs in time for the scene's camera, choose a plan, and make a map of the errors."""

import bpy
from bpy.props import IntProperty

from ..bridge import accuracy, render_scene, volumes
from ..bridge.held import Held
from ..bridge.jobs import StepwiseOperator
from ..bridge.settings import quality_of
from ..rle_splat.accuracy.planner.error_map import error_map_steps
from ..rle_splat.accuracy.planner.measure_plans import sweep_steps
from ..rle_splat.accuracy.planner.plans import sensible_plans
from ..rle_splat.scene import RleSplatError
from .refusal import refuse
from .through_camera import evaluated, has_volume_and_camera

PROBES, REPEATS = 400, 3


class _Measurement(StepwiseOperator):
    """Reads the volume, alone and sharp in time, as the active camera sees it: the truths have no meshes."""

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def read(self, context):
        """(Scene, Quality); holds Blender's scene and volume for ``commit``."""
        volume_object = volumes.volume_object(context)
        self._scene, self._volume = Held(context.scene), Held(volume_object)
        self._camera_name = context.scene.camera.name
        return render_scene.read_scene(
            volume_object, evaluated(context, volume_object), with_meshes=False, with_shadows=False, moving=False,
            warn=lambda sentence: self.report({"WARNING"}, sentence))


class RLE_SPLAT_OT_measure_accuracy(_Measurement, bpy.types.Operator):
    bl_idname = "rle_splat.measure_accuracy"
    bl_label = "Measure Accuracy"
    bl_description = (
        "Time the sensible plans for this volume and camera, and measure their errors against the truth. The volume is "
        "measured alone: without meshes, shadows and motion blur")

    probes: IntProperty(
        name="Probes", description="Pixels whose true value is integrated", default=PROBES, min=1, soft_max=5000)
    repeats: IntProperty(
        name="Repeats", description="Frames of which the median time counts", default=REPEATS, min=1, soft_max=20)

    def prepare(self, context):
        plain, quality = self.read(context)
        plans = sensible_plans(quality)
        return sweep_steps(
            plain, plans, quality, probes=self.probes, repeats=self.repeats, cache=render_scene.KEPT)

    def commit(self, context, sweep):
        report = sweep.report
        accuracy.note_sweep(
            self._scene.get().rle_splat, report, f"{self._volume.name} seen by {self._camera_name}")
        chosen = sweep.plan(report["chosen"])
        self.report({"INFO"}, f"{len(report['plans'])} plans measured; {chosen['name']}: {chosen['frame_ms']:.0f} ms, "
                              f"RMSE {chosen['error']['rmse']:.2g} levels against {chosen['truth']}.")


class RLE_SPLAT_OT_choose_plan(bpy.types.Operator):
    bl_idname = "rle_splat.choose_plan"
    bl_label = "Choose Plan"
    bl_description = "Set the quality to this measured plan"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Row", description="Of the measured plans", default=0, min=0)

    @classmethod
    def poll(cls, context):
        if not context.scene.rle_splat.accuracy_rows:
            cls.poll_message_set("Measure the accuracy first")
            return False
        return True

    def execute(self, context):
        rows = context.scene.rle_splat.accuracy_rows
        try:
            if self.index >= len(rows):
                raise RleSplatError(f"There are {len(rows)} measured plans; choose one from 0 to {len(rows) - 1}.")
            accuracy.choose(context.scene, rows[self.index])
            quality_of(context.scene)
        except RleSplatError as problem:
            return refuse(self, problem)
        return {"FINISHED"}


class RLE_SPLAT_OT_error_map(_Measurement, bpy.types.Operator):
    bl_idname = "rle_splat.error_map"
    bl_label = "Error Map"
    bl_description = (
        "Make an image of how far the picture is from the truth, in levels, at the current quality. The volume is "
        "measured alone: without meshes, shadows and motion blur")

    step: IntProperty(
        name="Every", description="Of so many pixels across and down the middle one is held against the truth; 1 takes "
        "every pixel, and a minute or two for a large picture", default=4, min=1, soft_max=16)

    def prepare(self, context):
        plain, quality = self.read(context)
        return error_map_steps(plain, quality, step=self.step, cache=render_scene.KEPT)

    def commit(self, context, result):
        scene = self._scene.get()
        image = accuracy.keep_error_map(scene, self._volume.get(), *result)
        self.report({"INFO"}, f"{image.name}: {scene.rle_splat.error_note}")


CLASSES = (RLE_SPLAT_OT_measure_accuracy, RLE_SPLAT_OT_choose_plan, RLE_SPLAT_OT_error_map)
