"""Any edits of a scene with stages kept, P5: what is kept never outlives what it was made from.

After every edit the picture of a store of results is held against the one of a store without room, bit for bit; where
one refuses, the other does in the same sentence.  Edits may be undone, and two scenes share parts and the store.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import event, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.jit import compiled
from rle_splat.kept import Kept
from rle_splat.render import render
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.stability.edits import EDITS, Shot, limited_blur, shots, taken_over
from tests.stability.effect_strategies import reach_of
from tests.stability.fuzz import examples
from tests.stability.strategies import field_of, rotation, stored
from tests.stability.test_scene_fuzz import bits_apart, check_sentence

# What a search begins with -> how many scenes are edited, and stages of which some results must be found again.
SEARCHES = {
    "post": (40, ("relevant", "table", "gradients", "thinned", "normals", "light", "lights", "runs", "scalars")),
    "pre": (45, ("blocks", "visible", "looks", "normals", "runs", "records", "shadows")),
    "refined": (10, ("blocks", "visible", "looks", "normals", "runs", "records")),
    "pool": (12, ("visible", "looks", "nodes", "node records")),
}  # fmt: skip
EDITS_IN_A_ROW = 30
MOST_BYTES = 1 << 26  # more than a search's stages take
REUSED: Counter = Counter()


def picture(shot: Shot, kept: Kept):
    """The Rendering, or the sentence that refuses it."""
    try:
        return render(shot.scene, shot.quality, kept=kept)
    except RleSplatError as problem:
        check_sentence(problem)
        return str(problem)


class EditsOfScenes(RuleBasedStateMachine):
    """Two scenes, one of them shown, and the stages of both kept in one store; ``kind``: of SEARCHES."""

    kind = "post"

    def __init__(self):
        super().__init__()
        self.kept = Kept(MOST_BYTES)

    @initialize(data=st.data())
    def begin(self, data):
        self.before = []
        self.shot = self.other = data.draw(shots(self.kind))
        self.show(self.shot)

    def show(self, shot: Shot):
        """Render what the edit made of the scene; an edit that is refused, or leaves nothing to see, is taken back."""
        shot, made = limited_blur(shot), dict(self.kept.made)
        empty = Kept(0)
        found, true = picture(shot, self.kept), picture(shot, empty)
        if isinstance(true, str):
            event("refused")
            assert found == true
            return
        assert not isinstance(found, str), found
        assert bits_apart(found, true) == 0
        for stage, times in empty.made.items():
            REUSED[stage] += times - (self.kept.made.get(stage, 0) - made.get(stage, 0))
        if (true.rgba[..., 3] > 0.02).mean() > 0.02 or not self.before:
            self.before.append(self.shot)
            self.shot = shot

    @rule(data=st.data())
    def undo(self, data):
        if self.before:
            self.show(data.draw(st.sampled_from(self.before)))

    @rule()
    def switch_scenes(self):
        shot, self.other = self.other, self.shot
        self.show(shot)

    @rule()
    def copy_scene(self):
        self.other = self.shot

    @rule(data=st.data())
    def take_over_a_part(self, data):
        self.show(taken_over(data.draw, self.shot, self.other))


def _rule_of(edit):
    def edited(self, data):
        self.show(edit(data.draw, self.shot))

    edited.__name__ = edit.__name__
    return rule(data=st.data())(edited)


for _edit in EDITS:
    setattr(EditsOfScenes, _edit.__name__, _rule_of(_edit))


def search(kind: str) -> None:
    # A third of a small picture's time went into asking the system how much memory is free.
    with patch("rle_splat.kept.available_bytes", plenty), patch("rle_splat.memory_estimate.available_bytes", plenty):
        count = SEARCHES[kind][0] if compiled() else 2
        steps = settings(examples(count, shrink=False), stateful_step_count=EDITS_IN_A_ROW)
        run_state_machine_as_test(type(kind, (EditsOfScenes,), {"kind": kind}), settings=steps)


def plenty() -> int:
    return 1 << 34


@pytest.mark.parametrize("kind", SEARCHES)
def test_P5_what_is_kept_never_outlives_what_it_was_made_from(record, kind):
    REUSED.clear()
    search(kind)
    claim = f"numbers of pictures with stages kept that are not those of an empty store, {kind}"
    record("P5", claim, 0, 0, "either", "whole numbers")
    if compiled():
        assert not [stage for stage in SEARCHES[kind][1] if not REUSED[stage]]


def test_P5_pictures_are_held_to_the_same_light_whatever_range_was_kept(record):
    """A filter with negative lobes is held to the brightest light of any voxel: that of the brightest one kept, which
    may have been kept for a wider range than is shown, let colours through that a fresh start did not."""
    wrong = reused = 0
    for seed in (8, 10, 21, 24, 32):
        random = np.random.default_rng(seed)
        volume = Volume(stored(field_of("ramp", (10, 11, 12), random), "uint8"), np.eye(4))
        camera, matrix = turntable(volume, 37.0 + 9.0 * seed, 24.0, width=24, height=20)
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
        kept = Kept()
        picture(shot, kept)
        shot = shot.with_scene(transfer_function=narrow)
        wrong += bits_apart(picture(shot, kept), picture(shot, Kept(0)))
        reused += kept.made["relevant"] == 1
    assert reused == 5
    claim = "numbers that differ where voxels are lit that another range kept"
    record("P5", claim, wrong, 0, "either", "whole numbers")
