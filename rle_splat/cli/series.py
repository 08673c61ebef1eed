"""The frames of one command, made one after the other: those that are there already are kept."""

from dataclasses import dataclass, replace
from pathlib import Path

from .frames import is_in_time
from .made import delete_abandoned, hash_scene, is_made, outputs_of, report_kept
from .render import Checked, PreparedScene, RenderJob, prepare, render_prepared, see_anew
from .viewing import Like


@dataclass
class FrameSeries:
    """What the frames of a command have in common.

    Attributes
    ----------
    args : argparse.Namespace
        Of the command.
    line : ProgressLine
    """

    args: object
    checked: Checked
    line: object

    def __post_init__(self):
        from ..pipeline.stage_cache import StageCache

        self._in_time = is_in_time(self.args)
        # Frames in time have nothing in common that could be kept.
        self._cache = None if self._in_time else StageCache()
        self._held, self._plan = None, None
        self._like: Like | None = None
        self._first: PreparedScene | None = None

    def make(self, own, start: float) -> dict:
        """Make a frame, or keep the picture that is there; return its report.

        Parameters
        ----------
        own : argparse.Namespace
            The options of the frame.
        start : float
            When it was begun, by ``perf_counter``.
        """
        prepared, scene_hash = self.ready(own)
        if not self.args.again and is_made(outputs_of(own), scene_hash):
            return report_kept(own)
        delete_abandoned(outputs_of(own))
        report = render_prepared(own, prepared, self.line, self.job(start, scene_hash))
        self._plan = report["plan"]
        return report

    def ready(self, own) -> tuple[PreparedScene, str]:
        """Read a frame, and return it with the hash of everything that its pictures depend on."""
        if self._held is None and self._in_time and self.args.like not in (None, own.number):
            # The options of the frame that all others are like
            self._settle(self._prepare(type(own)(**{**vars(own), "frame": self.args.like})))
        prepared = self._prepare(own)
        if self._held is None:
            self._settle(prepared)  # and keep the quality as it is, so that its report says why
        else:
            prepared = replace(prepared, quality=self._held)
        return prepared, hash_scene(
            prepared.scene, self._held, own.tolerance, own.probes, own.background, own.shadow_pass is not None,
            [Path(path).suffix.lower() for path in outputs_of(own)],
        )  # fmt: skip

    def job(self, start: float, scene_hash: str) -> RenderJob:
        """How a frame is made."""
        return RenderJob(start, self._plan, self._cache, scene_hash, refuse_empty_view=self.args.camera_path is None)

    def _prepare(self, own) -> PreparedScene:
        if self._first is not None:
            return see_anew(own, self.checked, self._first)
        prepared, like = prepare(own, self.checked, self.line, self._like)
        if self._in_time:
            self._like = like
        else:
            self._first = prepared
        return prepared

    def _settle(self, prepared: PreparedScene) -> None:
        """Keep the plan of the frame that all others are like."""
        from ..pipeline.preset_plan import hold_plan_of

        self._held = hold_plan_of(prepared.scene, prepared.quality, self._cache)
