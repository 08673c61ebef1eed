"""What operators share that read volume files: at once in scripts, in steps in a window, and a choice among series."""

import bpy

from ..bridge.loop.jobs import READ_BUDGET, StepwiseOperator
from ..bridge.volumes import series
from ..bridge.volumes.import_source import thumbnail_steps
from ..rle_splat.read.dicom.grouping import SeveralSeries
from ..rle_splat.scene import RleSplatError


class TakesVoxels(StepwiseOperator):
    """Mix-in for operators that take memory for the voxels of a volume."""

    out_of_memory = (
        "There is not enough memory for this volume; close other programs, or write a coarser file with rle-splat "
        "convert --level 1."
    )


class LoadsFirst(TakesVoxels):
    """Mix-in for quick operators that need voxels: where they are not in memory, a window first reads them in steps."""

    time_budget = READ_BUDGET

    def invoke(self, context, _event):
        try:
            is_loading = context.window is not None and self.loading(context) is not None
        except RleSplatError:
            is_loading = False  # ``execute`` reports it
        return self.begin(context) if is_loading else self.execute(context)

    def prepare(self, _context):
        yield from ()

    def _succeed(self, context, _result):
        self._finish(context)
        return self.execute(context)


class ReadsFiles(TakesVoxels):
    """Mix-in for operators that read volume files, most of them after a dialog.

    A subclass defines ``options_again()``: a dict of the properties with which the operator ``operator_again`` reads
    the same place again, without a dialog.
    """

    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would read the file again

    is_new = False  # Blender pushes the undo step, for UNDO is among ``bl_options``
    time_budget = READ_BUDGET
    operator_again = "import_volume"  # name of an operator

    def loading(self, context):
        return None  # the voxels of other volumes are not needed

    def with_thumbnails(self, steps):
        """Generator: the steps; in a window a SeveralSeries that they raise gets ``thumbnails`` for the chooser."""
        try:
            return (yield from steps)
        except SeveralSeries as several:
            if self.is_in_window:
                several.thumbnails = yield from thumbnail_steps(several)
            raise

    def refused(self, context, problem) -> None:
        if not isinstance(problem, SeveralSeries):
            super().refused(context, problem)
        elif problem.thumbnails is None:
            self.report({"ERROR"}, series.sentence(problem))
        else:
            series.offer(problem, problem.thumbnails, self.operator_again, self.options_again())
            bpy.ops.rle_splat.choose_series("INVOKE_DEFAULT")
