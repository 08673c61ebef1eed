"""The record of a render's problems over all its frames, shown in the panel, on the console and in the report.

A frame that succeeds does not clear the problem of an earlier frame.
"""

from .. import messages
from ..pictures import pictures


class RenderLog:
    """The record of one scene in the render in progress.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene; messages of an earlier render are cleared.

    Attributes
    ----------
    pictures : list of compositor.CompositedPicture
        The pictures of the current frame.
    drawn : list of bpy.types.Image
        Their images that are finished.
    hidden : list of str
        Why view layers do not show the volume.
    report : dict
        The report of the last picture.
    plans : dict
        (name of a volume object, Quality, tolerance or None) -> (Quality with the plan of its first frame, which all
        frames of a quality preset have; ``plan`` of the last frame's report, with which a tolerance's next one begins).
    stopped_at : int or None
        The frame after which the animation was ended.
    """

    def __init__(self, scene):
        self.is_in_force = scene.rle_splat.use_composite
        self.stopped_at = None
        self.report, self.plans = {}, {}
        self.is_in_frame = self._stops = False  # in a frame: between Blender's render_pre and render_post
        self._layers: list[str] = []  # view layers of the current frame that have begun
        self._frames: list[int] = []
        self._failed: list[int] = []
        self._first = ""  # the first problem
        self._notes: dict[str, list[int]] = {}  # a remark that is no failure -> its frames
        self._told: set[str] = set()
        if self.is_in_force:
            settings = scene.rle_splat
            settings.render_problem = settings.failed_frames = settings.message = ""
            settings.last_report = settings.last_report_json = ""

    @property
    def wants_stop(self) -> bool:
        """Whether the last frame failed and the user has chosen to stop then."""
        return bool(self._failed) and self._failed[-1] == self._frames[-1] and self._stops

    @property
    def is_first_layer(self) -> bool:
        """Whether the current view layer is the first of its frame."""
        return len(self._layers) == 1

    def begin_frame(self, scene) -> None:
        """Begin a frame."""
        self._stops = scene.rle_splat.on_failed_frame == "STOP"
        self.is_in_frame = True
        self._frames.append(scene.frame_current)
        self._layers = []
        self.pictures, self.drawn, self.hidden = [], [], []

    def begin_layer(self, layer: str) -> bool:
        """Begin a view layer; False if it had begun in this frame already, or no frame is rendered."""
        if not self.is_in_frame or layer in self._layers:
            return False
        self._layers.append(layer)
        return True

    def fail(self, scene, sentence: str) -> None:
        """Record that the current frame does not show the volume because of an error."""
        frame = self._frames[-1]
        self._first = self._first or sentence
        if frame not in self._failed:
            self._failed.append(frame)
        self._tell(sentence)
        self._show(scene)

    def note(self, scene, sentence: str) -> None:
        """Record that the current frame does not show the volume, which may be intended."""
        frames = self._notes.setdefault(sentence, [])
        if self._frames[-1] not in frames:
            frames.append(self._frames[-1])
        self._tell(sentence)
        self._show(scene)

    def end_frame(self, scene) -> None:
        """End the current frame; add a remark if none of its view layers shows the volume."""
        self.is_in_frame = False
        if not (self.is_in_force and self._layers):
            return
        if self.pictures and not self.drawn:
            layers = sorted(set().union(*(one.layers for one in self.pictures)))
            why = " and ".join(self.hidden) or f"view layer {', '.join(map(repr, layers))} was not rendered"
            owner = scene.rle_splat.composite_object
            named = "The volume" if owner is None else repr(owner.name)
            self.note(scene, f"{named} is not in the picture: {why}.")
        self._keep_report(scene)

    def end(self, scene, stopped_at) -> None:
        """End the render, finished or canceled; ``stopped_at``: the frame after which it was stopped, or None."""
        if not (self.is_in_force and self._frames):
            return
        stopped = "" if stopped_at is None else f" The render was stopped after frame {stopped_at}."
        self._show(scene, stopped)
        self._keep_report(scene)
        if scene.rle_splat.render_problem and len(self._frames) > 1:
            messages.tell(scene.rle_splat.render_problem)

    def _tell(self, sentence: str) -> None:
        if sentence not in self._told:
            self._told.add(sentence)
            messages.tell(f"Frame {self._frames[-1]}: {sentence}")

    def _summary(self) -> str:
        """The first problem, or else all remarks, with frame numbers if there was more than one frame."""
        if self._failed:
            if len(self._frames) == 1:
                return self._first
            count = f"{len(self._failed)} of {len(self._frames)} frames"
            return f"{count} could not be drawn: {messages.as_ranges(self._failed)}. {self._first}"
        if len(self._frames) == 1:
            return " ".join(self._notes)
        return " ".join(f"Frame {messages.as_ranges(frames)}: {note}" for note, frames in self._notes.items())

    def _show(self, scene, stopped: str = "") -> None:
        settings = scene.rle_splat
        settings.render_problem = settings.message = self._summary() + stopped
        settings.failed_frames = messages.as_ranges(self._failed)

    def _keep_report(self, scene) -> None:
        remarks = [line for line in (scene.rle_splat.render_problem,) if line]
        remarks += [line for line in self.report.get("remarks", ()) if line not in remarks]
        pictures.note_report(
            scene.rle_splat,
            {**self.report, "remarks": remarks, "failed_frames": self._failed, "first_problem": self._first},
        )
