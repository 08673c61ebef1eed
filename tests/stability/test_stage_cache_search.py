"""Any edits of a scene with a stage cache, P5: no result outlives what it was made from.

After every edit the picture from a filled cache is held against the one from a cache without room, bit for bit; where
one refuses, the other does in the same sentence.  Edits may be undone, and two scenes share parts and the cache.
"""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test

from devtools.fuzzing import asked_for
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.stability.edits import EDITS, limited_blur, taken_over
from tests.stability.effect_strategies import reach_of
from tests.stability.fuzz import examples
from tests.stability.shots import Shot, shots
from tests.stability.strategies import field_of, rotation, stored
from tests.stability.test_scene_fuzz import bits_apart, check_sentence

# What a search begins with -> how many scenes are edited anyhow, how many by each kind of edit alone, and stages of
# which some results must be found again.
SEARCHES = {
    "post": (6, 1, ("relevant", "table", "gradients", "thinned", "surfaces", "normals", "codes", "runs", "scalars")),
    "pre": (6, 1, ("blocks", "visible", "properties", "normals", "runs", "records", "shadows")),
}  # fmt: skip
EDITS_IN_A_ROW, DRAGGED = 30, 4
MOST_BYTES = 1 << 26  # more than a search's stages take
REUSED: Counter = Counter()


def picture(shot: Shot, cache: StageCache):
    """The Rendering, or the sentence that refuses it."""
    try:
        return render(shot.scene, shot.quality, cache=cache)
    except RleSplatError as problem:
        check_sentence(problem)
        return str(problem)


class Editing:
    """A scene that is edited, what it was before, and its stage cache."""

    def __init__(self, shot: Shot):
        self.cache, self.shot, self.before = StageCache(MOST_BYTES), shot, [shot]
        self.shown = False
        self.show(shot)

    def show(self, shot: Shot):
        """Render what the edit made of the scene; an edit that is refused, or leaves nothing to see, is taken back."""
        shot, made, empty = limited_blur(shot), dict(self.cache.made), StageCache(0)
        found, true = picture(shot, self.cache), picture(shot, empty)
        if isinstance(true, str):
            assert found == true
            return
        assert not isinstance(found, str), found
        assert bits_apart(found, true) == 0
        for stage, times in empty.made.items():
            REUSED[stage] += times - (self.cache.made.get(stage, 0) - made.get(stage, 0))
        shown = (true.rgba[..., 3] > 0.02).mean() > 0.02
        if shown or not self.shown:
            self.before.append(self.shot)
            self.shot, self.shown = shot, shown


class EditsOfScenes(RuleBasedStateMachine):
    """Two scenes, one of them shown, and the stages of both kept in one store; ``kind``: of SEARCHES."""

    kind = "post"

    @initialize(data=st.data())
    def begin(self, data):
        self.editing = Editing(data.draw(shots(self.kind)))
        self.other = self.editing.shot

    @rule(data=st.data())
    def undo(self, data):
        self.editing.show(data.draw(st.sampled_from(self.editing.before)))

    @rule()
    def switch_scenes(self):
        shot, self.other = self.other, self.editing.shot
        self.editing.show(shot)

    @rule()
    def copy_scene(self):
        self.other = self.editing.shot

    @rule(data=st.data())
    def take_over_a_part(self, data):
        self.editing.show(taken_over(data.draw, self.editing.shot, self.other))


def _rule_of(edit):
    def edited(self, data):
        self.editing.show(edit(data.draw, self.editing.shot))

    edited.__name__ = edit.__name__
    return rule(data=st.data())(edited)


for _edit in EDITS:
    setattr(EditsOfScenes, _edit.__name__, _rule_of(_edit))


def search(kind: str) -> None:
    anyhow, alone = SEARCHES[kind][:2] if compiled() else (1, 0)
    # A third of a small picture's time went into asking the system how much memory is free.
    asking = (f"rle_splat.pipeline.{module}.available_bytes" for module in ("stage_cache", "memory_estimate"))
    with patch(next(asking), plenty), patch(next(asking), plenty):
        for edit in EDITS if alone else ():
            drag(kind, edit, alone)
        steps = settings(examples(anyhow, shrink=False), stateful_step_count=EDITS_IN_A_ROW)
        run_state_machine_as_test(type(kind, (EditsOfScenes,), {"kind": kind}), settings=steps)


def drag(kind: str, edit, count: int) -> None:
    """One kind of edit again and again, as a slider is dragged, then undone: nothing else hides what it changes."""

    @given(st.data())
    @settings(examples(count, shrink=False), derandomize=False)
    def dragged(data):
        editing = Editing(data.draw(shots(kind)))
        for _ in range(DRAGGED):
            editing.show(edit(data.draw, editing.shot))
        editing.show(editing.before[0])

    # Its own scenes for each edit, where the same are to be found at every run.
    (dragged if asked_for() else seed(zlib.crc32(f"{kind} {edit.__name__}".encode()))(dragged))()


def plenty() -> int:
    return 1 << 34


@pytest.mark.parametrize("kind", SEARCHES)
def test_P5_no_cached_result_outlives_what_it_was_made_from(record, kind):
    REUSED.clear()
    search(kind)
    claim = f"numbers of pictures from a filled stage cache that are not those from an empty one, {kind}"
    record("P5", claim, 0, 0, "either", "whole numbers")
    if compiled():
        assert not [stage for stage in SEARCHES[kind][2] if not REUSED[stage]]


def test_P5_pictures_are_held_to_the_same_light_whatever_range_was_kept(record):
    """A filter with negative lobes is held to the brightest light of any voxel: that of the brightest one kept, which
    may have been kept for a wider range than is shown, let colors through that a fresh start did not."""
    wrong = reused = 0
    for number in (8, 10, 21, 24, 32):
        random = np.random.default_rng(number)
        volume = Volume(stored(field_of("ramp", (10, 11, 12), random), "uint8"), np.eye(4))
        camera, matrix = turntable(volume, 37.0 + 9.0 * number, 24.0)
        colors = (0.0, 1.0, 0.1, 0.1), (250.0, 1.0, 1.0, 1.0)
        wide, narrow = (
            TransferFunction("", None, ((low - 1, 0.0), (low, 0.9), (high, 0.9), (high + 1, 0.0)), colors)
            for low, high in ((41.0, 220.0), (81.0, 170.0))
        )
        scene = Scene(volume, wide, camera, 24, 20, matrix, headlight=False)
        middle, reach = reach_of(scene)
        pose = np.eye(4)
        pose[:3, 3] = middle + 0.9 * reach * rotation(random)[:, 0]
        shot = Shot(
            replace(scene, lights=(Light("POINT", energy=20.0 * reach**2, matrix_world=pose),)),
            Quality.preset("fine", "post", threads=1, rays=0.0),
        )
        cache = StageCache()
        picture(shot, cache)
        shot = shot.with_scene(transfer_function=narrow)
        wrong += bits_apart(picture(shot, cache), picture(shot, StageCache(0)))
        reused += cache.made["relevant"] == 1
    assert reused == 5
    claim = "numbers that differ where voxels are lit that another range kept"
    record("P5", claim, wrong, 0, "either", "whole numbers")
