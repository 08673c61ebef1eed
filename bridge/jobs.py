"""Long work as one generator of steps, driven to its end at once or a little at a time from a timer.

``execute`` runs it at once: scripts and background mode need that.  ``invoke`` in a window works in small bites from
a timer, shows progress, and previews if the scene wants them, and obeys Esc.  Success, failure and Esc all end in
``_finish``; after failure and Esc everything is as before the first preview.
"""

from __future__ import annotations

import time

import bpy

from ..rle_splat.pipeline.previews import Preview
from ..rle_splat.scene import Cancelled, RleSplatError
from .canvas import redraw

TIME_BUDGET = 0.1  # seconds of work in each tick of the timer; the window redraws and listens in between
TICK = 0.01  # seconds between ticks


class StepwiseOperator:
    """Mix-in for operators whose work is a generator of Progress(fraction, message).

    The operator brings ``prepare(context)``, which reads all that the work depends on and returns the generator (its
    RleSplatErrors go to the user's report), and ``commit(context, result)``, which puts the result into the .blend.
    Where ``wants_previews`` is true the generator may yield Previews too: the operator brings ``show_preview(context,
    preview)`` and ``put_back(context)``, which undoes all that it showed.
    """

    bl_options = set()  # not REGISTER: F9 would do all the work again; undo steps as ``is_new`` says

    wants_previews = False  # whether there is a window to show previews in, and the user likes them
    is_new = True  # whether ``commit`` made or changed more than pixels, which then is a step of undo

    _running = False  # one job at a time, whatever the operator: they share the stages kept between pictures
    _generator = None
    _timer = None
    _shown = ""  # what the user is looking at meanwhile, in words

    @classmethod
    def is_running(cls) -> bool:
        """Whether a job works in a window now."""
        return StepwiseOperator._running

    def execute(self, context):
        return self._guarded(context, self._run_through)

    def invoke(self, context, _event):
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if StepwiseOperator._running:
            self.report({"WARNING"}, "Another picture is being made; wait for it or press Esc there.")
            return {"CANCELLED"}
        return self._guarded(context, self._start)

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            self._abandon(context)
            self.report({"INFO"}, "Cancelled; nothing was changed.")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        return self._guarded(context, self._work_a_while)

    def cancel(self, context):
        """Blender calls this when a file is loaded or the window is closed in the middle of the work.

        The .blend may be on its way out, so it is left alone: a preview that was shown stays.
        """
        self._finish(context)

    def _guarded(self, context, action):
        """``action(context)``, with every way to fail ending in _abandon and one sentence."""
        try:
            return action(context)
        except RleSplatError as problem:
            self._abandon(context)
            self.report({"ERROR"}, str(problem))
        except Cancelled:
            self._abandon(context)
            self.report({"INFO"}, "Cancelled; nothing was changed.")
        except MemoryError:
            self._abandon(context)
            self.report({"ERROR"}, "There is not enough memory for this picture; make the image smaller.")
        except BaseException:
            self._abandon(context)
            raise
        return {"CANCELLED"}

    def _run_through(self, context):
        self._generator = self.prepare(context)
        while True:
            try:
                next(self._generator)
            except StopIteration as finished:
                return self._succeed(context, finished.value)

    def _start(self, context):
        self.wants_previews = context.scene.rle_splat.use_previews
        self._generator = self.prepare(context)
        StepwiseOperator._running = True
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        self._timer = window_manager.event_timer_add(TICK, window=context.window)
        window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _work_a_while(self, context):
        stop = time.perf_counter() + TIME_BUDGET
        progress = None
        while time.perf_counter() < stop:
            try:
                progress = next(self._generator)
            except StopIteration as finished:
                return self._succeed(context, finished.value)
            if isinstance(progress, Preview):
                self._show(context, progress)
                return {"RUNNING_MODAL"}  # so that it is drawn
        if progress is not None:
            context.window_manager.progress_update(progress.fraction)
            self._say(context, f"{progress.message} ({progress.fraction:.0%})")
        return {"RUNNING_MODAL"}

    def _show(self, context, preview):
        self._shown = f"{preview.describe()}; "
        self.show_preview(context, preview)
        redraw(context)
        self._say(context, "Refining")

    def _say(self, context, doing: str):
        context.workspace.status_text_set(f"RLE Splat: {self._shown}{doing}, Esc cancels")

    def _succeed(self, context, result):
        in_window = self._timer is not None
        self._finish(context)
        self.commit(context, result)
        redraw(context)
        if in_window and self.is_new:  # a script's steps of undo are its own affair
            bpy.ops.ed.undo_push(message=self.bl_label)
        return {"FINISHED"}

    def _abandon(self, context) -> None:
        """End the work without its result; may be called twice."""
        if self._shown:
            self._shown = ""
            self.put_back(context)
            redraw(context)
        self._finish(context)

    def _finish(self, context) -> None:
        """Let go of timer, progress bar and generator; may be called twice."""
        if self._generator is not None:
            self._generator.close()
            self._generator = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
            context.window_manager.progress_end()
            context.workspace.status_text_set(None)
            StepwiseOperator._running = False
