"""What one viewport shows: a draft while anything changes, a refined picture when all is still.

Nothing of Blender is used here.  What a viewport is drawn with comes as a Request, and what must be looked up comes
from a DrawnSurface, so that tests can stand in for both.
"""

import time
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...rle_splat.runtime.steps import drain
from ..messages import sentence_of
from .frames import Contents, Ends, RegionPicture, Shot, picture_steps, shot_of
from .view import Matrices, ViewportView, differ, eye_of

# Seconds of work at a time, in a redraw with all that it looks at.  A step of a draft may take 10 ms, and a redraw is
# to take 30 at most.
BITE = 0.02
STILL, PER_REDRAW = 0.15, 1.5  # seconds, and intervals between changes, without a change before a view is refined
# For how long pictures of another view are shown while the next ones are made: seconds, or times as long as the last
# draft took, whichever is more; or slow drafts would alternate with nothing.
MOST_LAG, OF_LAST = 0.5, 2.0
RECHECK = 0.5  # seconds after which contents and depths are compared again although no event named a change
FOR_GOOD = "for good"  # of a failure that no input made, such as that of a driver
AGAIN = 60  # moves of a view without depth until it is asked for depth again: the machine may have been busy
CHANGED = 0.002  # share of pixels whose depth may differ in an unchanged view: the engine's own samples move
MOST_COARSENESS = 5  # of drafts; see ``picture_steps``
# Seconds of a draft above which the next one has every second pixel; a redraw then takes about 16 ms.  Only above
# SLOWER are there fewer voxels, too, because that is seen.  Below QUICK the next draft is finer: that is less than a
# draft takes that is coarser by one than a slow one, or two kinds of drafts would alternate.
SLOW, SLOWER, QUICK = 0.014, 0.03, 0.005
OF_FEWER_VOXELS = 0.5  # of QUICK, for drafts of fewer voxels: with twice as many along each side they take much longer


@dataclass(frozen=True)
class Habits:
    """What a user prefers of all viewports.

    Attributes
    ----------
    refines : bool
        Whether a view is refined when it is still; without, drafts are all that is shown.
    least_coarseness : int
        Of drafts; see ``picture_steps``.
    """

    refines: bool = True
    least_coarseness: int = 0


@dataclass(frozen=True)
class Request:
    """What a redraw of a viewport shows; compared by value.

    Attributes
    ----------
    volumes : tuple of str
        Keys of the visible volumes.
    drawn : tuple
        How the viewport draws its objects, because their depth depends on it.
    has_floor : bool
        Whether the viewport draws lines in the plane z = 0.
    """

    matrices: Matrices
    volumes: tuple = ()
    drawn: tuple = ()
    habits: Habits = Habits()
    has_floor: bool = False


class DrawnSurface(Protocol):
    """What a viewport looks up while it is redrawn."""

    def contents(self, request: Request, with_triangles: bool) -> dict[str, Contents | str | None]:
        """Contents by key; None where files are being read, and a sentence where a volume cannot be shown.
        ``with_triangles``: meshes end rays by them."""

    def hides(self) -> bool:
        """Whether meshes hide the volume."""

    def ends(self, view: ViewportView, part) -> np.ndarray | None:
        """Depths of ``view.ray_ends``; None where the viewport has none."""


class Viewport:
    """The pictures of one viewport, and the work on them.

    Parameters
    ----------
    now : callable
        Returns seconds.

    Attributes
    ----------
    pictures : list of RegionPicture
        To draw, the furthest first.
    version : int
        Grows with every new list of pictures.
    is_refined : bool
        Whether they are no drafts.
    waits : bool
        Whether files of volumes are being read; these volumes are shown as they were, or not yet.
    problem : str
        Why a volume or nothing is shown; "" without a problem.  It is gone once the inputs that made it change.
    counts : Counter
        How often something was done: "reads" of contents, "depths", "drafts", "refinements".
    """

    def __init__(self, cache, now=time.perf_counter):
        self.pictures: list[RegionPicture] = []
        self.version, self.problem, self.counts, self.is_refined = 0, "", Counter(), False
        self.waits = False
        self._cache, self._now = cache, now
        # (request, stamp) of a failure, with which nothing is tried again, and of the last redraw that was looked at.
        self._failed, self._tried = None, None
        self._request: Request | None = None
        self._stamp = None
        self._contents: dict[str, Contents] = {}  # of Request.volumes
        self._has_triangles, self._moves = False, 0  # and how often the view has moved since depth was asked for
        self._shot: Shot | None = None
        self._ends: Ends | None = None
        self._checked, self._changed, self._due, self._look_due = -np.inf, -np.inf, None, None
        self._left = np.inf  # when the view became another one than that of the pictures
        self._work: Generator | None = None
        self._work_on: tuple = ()  # (shot, coarseness) of the work
        self._spent, self._was_slow, self._coarseness = 0.0, False, 0
        self._began, self._lasted = -np.inf, 0.0  # seconds: when the work began, and how long the last draft took

    @property
    def halvings(self) -> int:
        """How often the number of voxels along each side of a volume was halved for what is shown."""
        return max((one.halvings for one in self.pictures), default=0)

    @property
    def eye(self) -> np.ndarray:
        """(4,) float64: where the view is seen from in the world, homogeneous, see ``eye_of``."""
        matrices = self._request.matrices
        return eye_of(np.reshape(matrices.view, (4, 4)), matrices.window[15] == 0.0)

    @property
    def is_busy(self) -> bool:
        """Whether there is work, now or later."""
        return self._work is not None or self._due is not None or self._look_due is not None

    def redraw(self, request: Request, stamp, surface: DrawnSurface, most: float = BITE) -> None:
        """Look at what a redraw shows; where it changed, work on a draft for a bite, or for half of the time since the
        last change, ``most`` seconds at most.

        ``stamp`` differs from that of the last redraw after any event that may have changed the contents.
        """
        if self._failed in (FOR_GOOD, (request, stamp)):
            return
        now = self._now()
        moved = request != self._request
        turned = self._request is not None and request.matrices != self._request.matrices
        stale = moved or stamp != self._stamp or now - self._checked >= RECHECK
        if not stale:
            self._look_due = self._checked + RECHECK  # an engine's last samples, or its shaders, may have come with it
            return
        self._look_due = None
        self._failed, self._tried = None, (request, stamp)
        try:
            if self._look(request, stamp, surface, moved, now):
                self._left = min(self._left, now) if turned else self._left
                self._begin(now, most)
                self._drop_outdated()
        except Exception as problem:  # one sentence instead of a traceback for every redraw
            self._fail(problem)

    def _look(self, request: Request, stamp, surface: DrawnSurface, moved: bool, now: float) -> bool:
        """Look up contents and depths; return whether the picture is of something else."""
        last = self._request
        self._moves += moved and self._has_triangles
        other = last is None or (request.volumes, request.drawn) != (last.volumes, last.drawn) or self._moves >= AGAIN
        changed = moved
        if other or stamp != self._stamp or now - self._checked >= RECHECK:
            changed |= self._read(request, surface, self._has_triangles and not other)
            if self.waits and not self._contents:
                self.stop()
                self.waits = True
                return False  # the next redraw asks again
            self._stamp, self._checked = (None, -np.inf) if self.waits else (stamp, now)
        shot = shot_of(request.matrices, [*self._contents.values()])
        ends = None
        if surface.hides() and shot.part is not None and not self._has_triangles:
            self.counts["depths"], self._moves = self.counts["depths"] + 1, 0
            drawn = surface.ends(shot.view, shot.part)
            if drawn is not None:
                ends = Ends(drawn, shot.view, shot.part, request.has_floor)
            else:
                self._read(request, surface, True)
                shot, changed = shot_of(request.matrices, [*self._contents.values()]), True
        changed = changed or _ends_differ(ends, self._ends)
        if changed:
            self._request, self._shot, self._ends = request, shot, ends
        return changed

    def _read(self, request: Request, surface: DrawnSurface, with_triangles: bool) -> bool:
        """Look up the contents; return whether they differ.  A volume that waits for its files keeps its own."""
        self.counts["reads"] += 1
        self._has_triangles = with_triangles
        before, found = self._contents, surface.contents(request, with_triangles)
        self.waits = None in found.values()
        problems = {key: one for key, one in found.items() if isinstance(one, str)}
        self.problem = next(iter(problems.values()), "")
        now = {key: one or before.get(key) for key, one in found.items() if key not in problems}
        self._contents = {key: one for key, one in now.items() if one is not None}
        return [one.digest for one in self._contents.values()] != [one.digest for one in before.values()]

    def _begin(self, now: float, most: float) -> None:
        """Begin a draft of what was looked at; one that is under way ends first, or a slow one would never be seen."""
        interval, self._changed = now - self._changed, now
        self._due, self._pause = None, max(STILL, PER_REDRAW * interval if interval < 1.0 else STILL)
        if self._work is not None and self._work_on[1] is None:
            self._stop_work()
        if self._work is None:
            self._start_draft()
        until = now + max(BITE, min(0.5 * interval, most))
        if self._now() < until:
            self._advance(until)

    def work(self) -> bool:
        """Do one step, from a timer; return whether a redraw is due: there is a new picture, or it is to look again."""
        if self._work is None and self._look_due is not None and self._now() >= self._look_due:
            self._look_due, self._checked = None, -np.inf
            return True
        before = self.version, self.problem
        try:
            if self._work is None and self._due is not None and self._now() >= self._due:
                self._due = None
                self._start(None)
            self._advance(self._now())
            self._drop_outdated()
        except Exception as problem:
            self._fail(problem)
        return before != (self.version, self.problem)

    def wait(self) -> float:
        """Seconds until there is work."""
        due = [one for one in (self._due, self._look_due) if one is not None]
        return 0.0 if self._work is not None or not due else max(min(due) - self._now(), 0.0)

    def put_off(self) -> None:
        """Leave the work as it is and come back later: other work is more urgent."""
        if self._work is None and self._due is not None:
            self._due = max(self._due, self._now() + STILL)

    def stop(self) -> None:
        """Drop everything; the next redraw begins anew."""
        self._stop_work()
        self._request, self._shot, self._ends, self._contents = None, None, None, {}
        self._due, self._look_due = None, None
        self._stamp, self._checked, self._left, self.waits = None, -np.inf, np.inf, False
        self._show([])

    def prepare_steps(self, shown, scene, *, is_first: bool = False):
        """Generator: make what drafts of another scene in place of that of a volume need; none is shown.

        They are made as often and as coarse as redraws would make them until one is quick, so that the next one is.
        Nothing is made before the view was refined.

        Parameters
        ----------
        shown : Volume
            The volume whose scene is replaced.
        scene : callable
            ``scene(plain)``: the other scene.
        is_first : bool
            Whether coarseness is chosen anew, from the finest: that of before may be of drafts that made their tables.
        """
        if self.is_busy or self._shot is None or self._failed is not None:
            return
        if is_first:
            self._coarseness, self._was_slow = 0, False
        contents = [replace(one, plain=scene(one.plain)) if one.plain.volume is shown else one
                    for one in self._shot.contents]  # fmt: skip
        shot = replace(self._shot, contents=tuple(contents))
        for _ in range(2 * MOST_COARSENESS):
            coarseness, self._spent = self._draft_coarseness(), 0.0
            for _ in self._timed(picture_steps(shot, self._ends, self._cache, coarseness)):
                yield
            self._choose_coarseness(coarseness)
            if not self._was_slow and coarseness == self._draft_coarseness():
                return

    def try_again(self) -> None:
        """Forget the problem; the next redraw begins anew."""
        self.problem, self._failed = "", None
        self.stop()

    def give_up(self, sentence: str) -> None:
        """Show nothing more, and say why, until ``try_again``."""
        self.stop()
        self.problem, self._failed = sentence, FOR_GOOD

    def _fail(self, problem: Exception) -> None:
        """Show nothing more of these inputs, and say why."""
        self.give_up(sentence_of(problem))
        self._failed = self._tried

    def _start_draft(self) -> None:
        self._start(self._draft_coarseness())

    def _draft_coarseness(self) -> int:
        return max(self._coarseness, self._request.habits.least_coarseness)

    def _start(self, coarseness: int | None) -> None:
        self._work_on, self._spent, self._began = (self._shot, coarseness), 0.0, self._now()
        self._work = self._timed(picture_steps(self._shot, self._ends, self._cache, coarseness))

    def _stop_work(self) -> None:
        if self._work is not None:
            self._work.close()
            self._work = None

    def _advance(self, until: float) -> None:
        """Work for at least one step, until the next one, if it takes as long, would end after a time."""
        while self._work is not None:
            began = self._now()
            try:
                next(self._work)
            except StopIteration as finished:
                self._finish(finished.value)
            if 2.0 * self._now() - began >= until:
                break

    def _timed(self, steps: Generator):
        """Generator: the same steps, whose seconds are added to those spent."""
        while True:
            began = self._now()
            try:
                step = next(steps)
            except StopIteration as finished:
                self._spent += self._now() - began
                return finished.value
            self._spent += self._now() - began
            yield step

    def _finish(self, pictures: list[RegionPicture]) -> None:
        shot, coarseness = self._work_on
        self._left = np.inf if shot.matrices == self._request.matrices else self._now()
        self._work, self.is_refined = None, coarseness is None
        self._show(pictures)
        self.counts["refinements" if coarseness is None else "drafts"] += 1
        if coarseness is None:
            # The next redraw looks once more: EEVEE has no depth while it compiles shaders and sends no event after it.
            self._checked = -np.inf
            return
        self._lasted = self._now() - self._began
        self._choose_coarseness(coarseness)
        if shot is not self._shot:
            self._start_draft()
        elif self._request.habits.refines:
            self._due = self._now() + self._pause

    def _choose_coarseness(self, coarseness: int) -> None:
        """Make drafts coarser after two slow ones, as the first may have made tables, and finer after a quick one."""
        was_slow, self._was_slow = self._was_slow, self._spent > (SLOWER if coarseness else SLOW)
        if was_slow and self._was_slow:
            self._coarseness, self._was_slow = min(coarseness + 1, MOST_COARSENESS), False
        elif self._spent < QUICK * (OF_FEWER_VOXELS if coarseness > 1 else 1.0):
            self._coarseness = max(coarseness - 1, 0)

    def _drop_outdated(self) -> None:
        """Show nothing instead of pictures that have been of another view for too long."""
        if self.pictures and self._now() - self._left > max(MOST_LAG, OF_LAST * self._lasted):
            self._show([])

    def _show(self, pictures: list[RegionPicture]) -> None:
        self.pictures = pictures
        self.version += 1


def _ends_differ(ends: Ends | None, others: Ends | None) -> bool:
    """Whether rays end elsewhere than before, in the part that was read; None is no depth at all.

    Lines of the floor do not count; they are looked for only where the depths with them differ.
    """
    if ends is None or others is None or ends.drawn.shape != others.drawn.shape:
        return ends is not others
    left, top, right, bottom = ends.part
    inside = slice(top, bottom), slice(left, right)

    def differs(one: np.ndarray, other: np.ndarray) -> bool:
        return differ(one[inside], other[inside], CHANGED * one.size / one[inside].size)

    return differs(ends.drawn, others.drawn) and differs(drain(ends.steps()), drain(others.steps()))
