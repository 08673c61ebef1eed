"""Operators with long work, written as a generator of steps.

``execute`` runs the work at once, for scripts and background mode.  ``invoke`` in a window works in short slices from a
timer, shows progress and a draft, and stops on Esc.  Success, failure and Esc all end in ``_finish``.  After failure
and Esc everything is as it was before the draft.
"""

import time

import bpy
from bpy.app.translations import pgettext_iface

from ...rle_splat.runtime.steps import Progress, drain, rescale
from ...rle_splat.scene import Cancelled, RleSplatError
from ..pictures.canvas import redraw, redraw_sidebars
from ..pictures.drafts import Draft
from ..translations import filled, translate
from ..volumes import loading, volumes

TIME_BUDGET = 0.1  # seconds of work per tick of the timer; in between the window redraws and handles events
READ_BUDGET = 0.02  # the same while a file is read
TICK = 0.01  # seconds between ticks
LOADING = 0.5  # share of the progress bar for voxels that are not in memory yet
REDRAW = 0.2  # seconds between redraws of the progress bars in panels


class StepwiseOperator:
    """Mix-in for operators whose work is a generator of Progress.

    A subclass defines

    - ``prepare(context)``: read everything that the work depends on and return the generator.  A RleSplatError is
      reported to the user.
    - ``commit(context, result)``: write the result of the generator into the .blend.
    - ``show_draft(context, rendering)`` and ``put_back(context)``, if the generator may yield a Draft: show it, and
      undo everything that was shown.
    - ``loading(context)``: a generator that reads what ``prepare`` would wait for, or None. Only a window asks for it.
    - ``refused(context, problem)``, to do more about a RleSplatError than to report it.
    """

    bl_options = set()  # without REGISTER: Adjust Last Operation (F9) would repeat the work; for undo see ``is_new``

    is_confirmed = False  # whether ``invoke`` has shown a dialog, whose button calls ``execute``
    was_in_window = False  # whether the work was begun in a window, not by a script
    is_new = True  # whether ``commit`` changed more than pixels, so that it becomes an undo step
    time_budget = TIME_BUDGET
    out_of_memory = "There is not enough memory for this picture; make the image smaller."

    _running = False  # one job at a time for all operators, because they share the stage cache
    _progress = None  # the last Progress of the job that runs in a window, for panels
    _drawn = 0.0  # time of the last redraw of panels, on the performance counter
    _generator = None
    _timer = None
    _is_draft_shown = False

    @classmethod
    def is_running(cls) -> bool:
        """Whether a job is in progress in a window."""
        return StepwiseOperator._running

    @property
    def is_in_window(self) -> bool:
        """Whether the work is done in steps in a window."""
        return self._timer is not None

    @classmethod
    def progress(cls):
        """The last Progress of the job that runs in a window; None if none runs."""
        return StepwiseOperator._progress

    def execute(self, context):
        if self.is_confirmed:
            self.is_confirmed = False
            return self.begin(context)
        return self._guarded(context, self._run_through)

    def invoke(self, context, _event):
        return self.begin(context)

    def begin(self, context) -> set:
        """Start the work in a window; without one, do it at once."""
        if bpy.app.background or context.window is None:
            return self._guarded(context, self._run_through)
        if StepwiseOperator._running:
            self.report({"WARNING"}, "Other work is in progress; wait for it, or press Esc to cancel it.")
            return {"CANCELLED"}
        return self._guarded(context, self._start)

    def loading(self, context):
        """Steps that load what a picture of the operator's volume needs; None if it is in memory."""
        owner = volumes.volume_object(context)
        return None if owner is None else loading.missing_steps(owner)

    def refused(self, _context, problem) -> None:
        """Report why there is no result; everything is as it was before."""
        self.report({"ERROR"}, translate(str(problem)))

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            self._abandon(context)
            self.report({"INFO"}, "Canceled; nothing was changed.")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        return self._guarded(context, self._work_a_while)

    def cancel(self, context):
        """End the work without restoring the image; Blender calls this when a file is loaded or the window closes.

        The .blend may be unloading, so it is not changed: a draft stays.
        """
        self._finish(context)

    def _guarded(self, context, action):
        """Run ``action(context)``; every failure ends in ``_abandon`` and one sentence for the user."""
        try:
            return action(context)
        except RleSplatError as problem:
            self._abandon(context)
            self.refused(context, problem)
        except Cancelled:
            self._abandon(context)
            self.report({"INFO"}, "Canceled; nothing was changed.")
        except MemoryError:
            self._abandon(context)
            self.report({"ERROR"}, self.out_of_memory)
        except BaseException:
            self._abandon(context)
            raise
        return {"CANCELLED"}

    def _run_through(self, context):
        self._generator = self.prepare(context)
        return self._succeed(context, drain(self._generator))

    def _start(self, context):
        self.was_in_window = True
        steps = self.loading(context)
        self._generator = self.prepare(context) if steps is None else self._prepared_after(steps)
        StepwiseOperator._running = True
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        self._timer = window_manager.event_timer_add(TICK, window=context.window)
        window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _prepared_after(self, loading):
        """Generator: load voxels, then read everything else and do the work."""
        yield from rescale(loading, 0.0, LOADING)
        return (yield from self.prepare(bpy.context))

    def _work_a_while(self, context):
        stop = time.perf_counter() + self.time_budget
        progress = None
        while time.perf_counter() < stop:
            try:
                progress = next(self._generator)
            except StopIteration as finished:
                return self._succeed(context, finished.value)
            if isinstance(progress, Draft):
                self._show(context, progress)
                return {"RUNNING_MODAL"}  # let Blender draw it
        if progress is not None:
            last = StepwiseOperator._progress
            if last is not None and last.fraction > progress.fraction:  # a bar that runs back looks like a mistake
                progress = Progress(last.fraction, progress.message)
            StepwiseOperator._progress = progress
            context.window_manager.progress_update(progress.fraction)
            self._say(context, f"{translate(progress.message)} ({progress.fraction:.0%})")
            if time.perf_counter() - self._drawn > REDRAW:
                self._drawn = time.perf_counter()
                redraw_sidebars(context)
        return {"RUNNING_MODAL"}

    def _show(self, context, draft):
        self._is_draft_shown = True
        self.show_draft(context, draft.rendering)
        redraw(context)
        self._say(context, pgettext_iface("Refining"))

    def _say(self, context, doing: str):
        context.workspace.status_text_set(filled("RLE Splat: {work}, Esc cancels", work=doing))

    def _succeed(self, context, result):
        in_window = self.is_in_window
        self._finish(context)
        self.commit(context, result)
        redraw(context)
        if in_window and self.is_new:  # scripts push undo steps themselves
            bpy.ops.ed.undo_push(message=self.bl_label)
        return {"FINISHED"}

    def _abandon(self, context) -> None:
        """End the work without a result and restore the image; safe to call twice."""
        if self._is_draft_shown:
            self._is_draft_shown = False
            self.put_back(context)
            redraw(context)
        self._finish(context)

    def _finish(self, context) -> None:
        """Release timer, progress bar and generator; safe to call twice."""
        if self._generator is not None:
            self._generator.close()
            self._generator = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
            context.window_manager.progress_end()
            context.workspace.status_text_set(None)
            StepwiseOperator._running, StepwiseOperator._progress = False, None
            redraw_sidebars(context)
