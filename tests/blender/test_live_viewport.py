"""What a viewport does from redraw to redraw, with a clock, matrices and depths of the test's own."""

from dataclasses import replace

import numpy as np
import pytest

from tests.blender.stand_ins import SIZE, contents_of, finish, make, modules_of, request_of

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def live(bridge):
    return modules_of(bridge)


@pytest.fixture
def contents(live, core):
    return contents_of(live, core)


@pytest.fixture
def made(live, contents, core):
    return make(live, contents, core)


def test_a_draft_comes_at_once_and_the_picture_when_all_is_still(live, made):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    assert (viewport.counts["drafts"], viewport.counts["refinements"]) == (1, 0), viewport.problem
    assert viewport.pictures[0].rgba[..., 3].max() > 0.5 and viewport.is_busy
    assert viewport.wait() == pytest.approx(live.viewport.STILL)
    assert not viewport.work() and viewport.counts["refinements"] == 0, "refined before all was still"
    finish(viewport, clock)
    assert (viewport.counts["drafts"], viewport.counts["refinements"]) == (1, 1)


def five_steps(clock, done: list):
    """What makes no picture in five steps of 8 ms, which are listed in ``done``."""

    def work(*_):
        for number in range(5):
            clock.now += 0.008
            done.append(number)
            yield
        return []

    return work


@pytest.mark.parametrize("looks, steps", [(0.0, 2), (0.009, 1), (0.025, 0)])  # seconds of looking up
def test_a_redraw_ends_before_a_step_would_take_it_beyond_its_bite(live, made, monkeypatch, looks, steps):
    viewport, clock, surface = made
    done, drawn = [], surface.ends

    def look(*arguments):
        clock.now += looks
        return drawn(*arguments)

    monkeypatch.setattr(surface, "ends", look)
    monkeypatch.setattr(live.viewport, "picture_steps", five_steps(clock, done))
    surface.depth = 5.0
    viewport.redraw(request_of(live), 1, surface)
    assert len(done) == steps and viewport.is_busy
    viewport.work()
    assert len(done) == steps + 1, "one step at each call of the timer"


@pytest.mark.parametrize("most, interval, steps", [(0.1, 0.3, 5), (0.1, 0.06, 3), (0.02, 0.3, 2), (0.1, 0.02, 2)])
def test_a_redraw_during_playback_works_for_half_of_the_time_between_frames(
    live, made, monkeypatch, most, interval, steps
):
    viewport, clock, surface = made
    done = []

    viewport.redraw(request_of(live), 1, surface, most)
    finish(viewport, clock)
    monkeypatch.setattr(live.viewport, "picture_steps", five_steps(clock, done))
    clock.now = viewport._changed + interval
    viewport.redraw(request_of(live, 31.0), 1, surface, most)
    assert len(done) == steps and (viewport.counts["drafts"] == 2) == (steps == 5)


def test_the_refined_picture_is_that_of_render(live, made, contents, core):
    viewport, clock, surface = made
    request = request_of(live)
    viewport.redraw(request, 1, surface)
    finish(viewport, clock)
    seen = live.view.view_of(request.matrices)
    plain = replace(contents.plain, camera=seen.camera, width=SIZE[0], height=SIZE[1])
    whole = core("pipeline.render").render(plain, contents.quality).rgba
    (picture,) = viewport.pictures
    left, top, right, bottom = (round(share * side) for share, side in zip(picture.place, 2 * SIZE))
    np.testing.assert_array_equal(picture.rgba, whole[top:bottom, left:right])
    assert whole[..., 3].sum() == pytest.approx(picture.rgba[..., 3].sum()), "the part leaves something out"


def test_an_unchanged_redraw_makes_nothing_and_is_looked_at_once_more_when_all_is_still(live, made):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    viewport.redraw(request_of(live), 1, surface)
    before, version = viewport.counts.copy(), viewport.version
    clock.now = viewport._checked + 0.1
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts == before and viewport.version == version
    clock.now += viewport.wait()
    assert viewport.work(), "no redraw is asked for"
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts["reads"] == before["reads"] + 1 and viewport.version == version and not viewport.is_busy


def test_an_event_that_changes_nothing_makes_no_picture(live, made):
    viewport, clock, surface = made
    surface.depth = 50.0
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    version, reads = viewport.version, viewport.counts["reads"]
    viewport.redraw(request_of(live), 2, surface)
    assert viewport.counts["reads"] == reads + 1 and viewport.version == version and not viewport.is_busy


@pytest.mark.parametrize("change", ["view", "contents", "depth", "hides", "size"])
def test_what_changed_is_drafted_and_refined_again(change, live, made):
    viewport, clock, surface = made
    surface.depth = 29.0
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    request = request_of(live)
    if change == "view":
        request = request_of(live, 31.0)
    elif change == "size":
        request = replace(request, matrices=replace(request.matrices, width=44))
    elif change == "contents":
        surface.held = [replace(surface.held[0], digest="second")]
    elif change == "depth":
        surface.depth = 31.0
    else:
        surface.hiding = False
    viewport.redraw(request, 2, surface)
    finish(viewport, clock)
    assert (viewport.counts["drafts"], viewport.counts["refinements"]) == (2, 2)


def test_a_change_cancels_the_refinement(live, made):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    clock.now += 1.0
    viewport._start(None)
    next(viewport._work)
    refinement = viewport._work
    viewport.redraw(request_of(live, 31.0), 1, surface)
    assert viewport._work is not refinement and list(refinement) == [], "it goes on"
    finish(viewport, clock)
    assert viewport.counts["refinements"] == 1


@pytest.fixture
def slow_steps(live, made, monkeypatch):
    """``slow_steps(seconds)``: each step of a picture takes so long on the clock."""
    _viewport, clock, _surface = made
    make = live.viewport.picture_steps

    def slow_down(seconds):
        def steps(*arguments):
            running = make(*arguments)
            while True:
                clock.now += seconds
                try:
                    step = next(running)
                except StopIteration as finished:
                    return finished.value
                yield step

        monkeypatch.setattr(live.viewport, "picture_steps", steps)

    return slow_down


def test_a_redraw_takes_less_than_30_ms_where_a_step_takes_9(live, made, slow_steps):
    viewport, clock, surface = made
    slow_steps(0.009)
    for n in range(20):
        before = clock.now
        viewport.redraw(request_of(live, 30.0 + 0.1 * n), 1, surface)
        assert 0.0 < clock.now - before < 0.03
    finish(viewport, clock)
    assert viewport.counts["drafts"] and viewport.is_refined


@pytest.mark.parametrize("step, most", ((0.009, 0.0181), (0.015, 0.0151), (0.05, 0.0501)))
def test_a_bite_of_the_timer_begins_no_step_that_may_end_after_20_ms(step, most, live, made, slow_steps):
    """Of a draft as of a refined picture; a single step may take longer."""
    viewport, clock, surface = made
    slow_steps(step)
    viewport.redraw(request_of(live, 30.0), 1, surface)
    while viewport.is_busy:
        clock.now += viewport.wait()
        before = clock.now
        viewport.work()
        assert clock.now - before <= most
    assert viewport.is_refined


def test_a_slow_draft_ends_although_the_view_moves_on(live, made, slow_steps):
    viewport, clock, surface = made
    slow_steps(0.02)  # so that a bite is one step
    seen = []
    for n in range(60):
        viewport.redraw(request_of(live, 30.0 + 0.1 * n), 1, surface)
        viewport.work()
        seen.append(len(viewport.pictures))
    assert viewport.counts["drafts"] >= 3 and viewport.counts["refinements"] == 0 and seen[-1] == 1
    assert viewport._coarseness >= 1, "a slow draft makes the next one coarser"
    finish(viewport, clock)
    assert viewport._work_on[0].matrices == request_of(live, 30.0 + 0.1 * 59).matrices
    assert viewport.counts["refinements"] == 1


def test_drafts_have_fewer_pixels_above_14_ms_fewer_voxels_above_30_and_become_finer_again(live, made):
    viewport, _clock, _surface = made

    def after(*seconds):
        for spent in seconds:
            viewport._spent = spent
            viewport._choose_coarseness(viewport._coarseness)
        return viewport._coarseness

    assert after(0.02) == 0, "the first one may have made tables"
    assert after(0.02) == 1
    assert after(0.02, 0.02, 0.02) == 1, "what is seen is not worth it"
    assert after(0.04, 0.04) == 2
    assert after(0.01, 0.01) == 2 and after(0.002) == 1
    assert after(0.006, 0.006) == 1 and after(0.004) == 0


def rows_of_view(viewport) -> float:
    """How many rows of the first picture's pixels the whole view would have."""
    (picture,) = viewport.pictures
    return picture.rgba.shape[0] / (picture.place[3] - picture.place[1])


def test_what_drafts_of_another_frame_need_is_made_before_it_is_shown(live, made, contents, monkeypatch):
    """Those that playback would make: drafts of every pixel are slow here."""
    viewport, clock, surface = made
    shown, draw = contents.plain.volume, live.viewport.picture_steps
    other = replace(contents.plain, volume=replace(shown, voxels=shown.voxels - shown.voxels // 4))

    def slow_steps(*arguments):
        clock.now += 0.02 if arguments[-1] == 0 else 0.01
        return (yield from draw(*arguments))

    viewport.redraw(request_of(live), 1, surface)
    assert not list(viewport.prepare_steps(shown, lambda _: other)), "before the view was refined"
    finish(viewport, clock)
    monkeypatch.setattr(live.viewport, "picture_steps", slow_steps)
    pictures, version, before = viewport.pictures, viewport.version, dict(viewport._cache.made)
    viewport._coarseness = 4  # of drafts during playback that had to make their tables
    assert list(viewport.prepare_steps(shown, lambda _: other, is_first=True)) and viewport._coarseness == 1
    prepared = dict(viewport._cache.made)
    assert viewport.pictures is pictures and viewport.version == version and prepared != before
    surface.held = [replace(contents, plain=other, digest="another frame")]
    viewport.redraw(request_of(live), 2, surface)
    while viewport.counts["drafts"] < 2:
        viewport.work()
    assert viewport._cache.made == prepared and viewport._coarseness == 1


def test_a_user_may_have_drafts_only_and_of_half_the_pixels(live, made):
    viewport, clock, surface = made
    drafts = live.viewport.Habits(refines=False, least_coarseness=1)
    viewport.redraw(request_of(live, habits=drafts), 1, surface)
    assert not viewport.is_busy and not viewport.is_refined and viewport._work_on[1] == 1
    assert rows_of_view(viewport) == pytest.approx(SIZE[1] / 2)
    viewport.redraw(request_of(live), 1, surface)  # the preferences have changed
    finish(viewport, clock)
    assert viewport.is_refined and viewport.counts["refinements"] == 1
    assert rows_of_view(viewport) == pytest.approx(SIZE[1])


def test_a_volume_out_of_the_view_is_no_work(live, made):
    viewport, clock, surface = made
    surface.held = [replace(surface.held[0], corners=surface.held[0].corners + (500.0, 0.0, 0.0))]
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    assert viewport.pictures == [] and viewport.counts["depths"] == 0 and not viewport.problem


def test_the_furthest_of_several_volumes_is_drawn_first(live, contents):
    near = replace(contents, corners=contents.corners + (0.0, 0.0, 9.0), digest="near")
    shot = live.frames.shot_of(request_of(live).matrices, [near, contents])
    assert [one.digest for one in shot.contents] == ["first", "near"] and list(shot.pixels) == [0, 1]


def test_volumes_that_overlap_are_one_picture_and_let_through_the_product(live, made):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    (alone,) = viewport.pictures
    held = surface.held[0]
    matrix = held.plain.volume_matrix.copy()
    matrix[2, 3] += 3.0
    other = replace(
        held, plain=replace(held.plain, volume_matrix=matrix), corners=held.corners + (0.0, 0.0, 3.0), digest="other"
    )
    surface.held = [held, other]
    viewport.redraw(request_of(live, volumes=("one", "other")), 2, surface)
    (draft,) = viewport.pictures
    finish(viewport, clock)
    (both,) = viewport.pictures
    alpha, together = (one.rgba[one.rgba.shape[0] // 2, one.rgba.shape[1] // 2, 3] for one in (alone, both))
    assert together == pytest.approx(1.0 - (1.0 - alpha) ** 2, abs=0.01) and alpha > 0.5
    assert draft.rgba[..., 3].max() == pytest.approx(together, abs=0.05)


def test_voxels_that_are_being_read_are_waited_for(live, made):
    viewport, _clock, surface = made
    surface.held, held = [None], surface.held
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.pictures == [] and not viewport.is_busy and not viewport.problem and viewport.waits
    surface.held = held
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts["drafts"] == 1 and not viewport.waits


def test_a_volume_that_waits_for_its_files_is_drawn_as_it_was_in_every_view(live, made):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    surface.held, held = [None], surface.held
    viewport.redraw(request_of(live), 2, surface)
    drafts, place = viewport.counts["drafts"], viewport.pictures[0].place
    viewport.redraw(request_of(live, 20.0), 2, surface)
    assert viewport.waits and viewport.counts["drafts"] == drafts + 1
    assert viewport.pictures[0].place[0] < place[0], "the picture does not follow the view"
    viewport.redraw(request_of(live, 20.0, ("another",)), 3, surface)
    assert viewport.waits and viewport.pictures == [], "another volume's picture is shown for it"
    surface.held = held
    viewport.redraw(request_of(live, 20.0), 3, surface)
    finish(viewport, clock)
    assert not viewport.waits and viewport.is_refined


@pytest.mark.parametrize("redraws", [True, False])
@pytest.mark.parametrize("turns", [True, False])
def test_pictures_of_another_view_are_not_shown_for_long(live, made, monkeypatch, turns, redraws):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)

    def endless(*_arguments):
        while True:
            clock.now += live.viewport.BITE
            yield

    monkeypatch.setattr(live.viewport, "picture_steps", endless)
    surface.held = [replace(surface.held[0], digest="second")]
    viewport.redraw(request_of(live, 29.0 if turns else 30.0), 2, surface)
    assert viewport.pictures, "it flickers"
    for step in range(int(live.viewport.MOST_LAG / live.viewport.BITE) + 1):
        viewport.redraw(request_of(live, 28.0 - step if turns else 30.0), 2, surface) if redraws else viewport.work()
    assert bool(viewport.pictures) != turns and viewport.is_busy


def test_slow_drafts_do_not_alternate_with_nothing(live, made, monkeypatch):
    viewport, clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    pictures = viewport.pictures

    def slow(*_arguments):
        for _bite in range(int(1.6 * live.viewport.MOST_LAG / live.viewport.BITE)):
            clock.now += live.viewport.BITE
            yield
        return pictures

    monkeypatch.setattr(live.viewport, "picture_steps", slow)
    drafts, shown = viewport.counts["drafts"], []
    for step in range(200):
        viewport.redraw(request_of(live, 29.0 - 0.01 * step), 1, surface)
        shown.append(bool(viewport.pictures) or viewport.counts["drafts"] == drafts)
    assert viewport.counts["drafts"] > drafts + 3 and all(shown)


def test_a_failure_is_not_tried_again_until_its_inputs_change(live, made, core):
    viewport, _clock, surface = made
    calls = []

    def fail(*_arguments):
        calls.append(1)
        raise core("scene").RleSplatError("The file is gone; click Relocate.")

    surface.contents = fail
    for _ in range(5):
        viewport.redraw(request_of(live), 1, surface)
    assert viewport.problem == "The file is gone; click Relocate." and len(calls) == 1
    assert viewport.pictures == [] and not viewport.is_busy
    viewport.redraw(request_of(live, 31.0), 1, surface)
    viewport.redraw(request_of(live, 31.0), 2, surface)
    assert len(calls) == 3 and viewport.problem, "another view, and an event"
    del surface.contents
    viewport.redraw(request_of(live, 31.0), 2, surface)
    assert viewport.problem and not viewport.pictures, "nothing has changed"
    viewport.redraw(request_of(live, 31.0), 3, surface)
    assert viewport.problem == "" and viewport.counts["drafts"] == 1


def test_trying_again_needs_no_change(live, made):
    viewport, _clock, surface = made
    viewport.give_up("The driver cannot draw.")
    for stamp in range(3):
        viewport.redraw(request_of(live), stamp, surface)
    assert viewport.problem == "The driver cannot draw." and not viewport.counts
    viewport.try_again()
    viewport.redraw(request_of(live), 3, surface)
    assert viewport.problem == "" and viewport.counts["drafts"] == 1


def test_a_volume_that_cannot_be_shown_leaves_the_others(live, made, contents):
    viewport, clock, surface = made
    surface.held = ["The file of 'other' is gone.", contents]
    request = request_of(live, volumes=("other", "one"))
    viewport.redraw(request, 1, surface)
    finish(viewport, clock)
    assert viewport.problem == "The file of 'other' is gone." and len(viewport.pictures) == 1
    assert not viewport.work(), "a problem that stays needs no redraw"
    surface.held = [contents, contents]
    viewport.redraw(request, 2, surface)
    finish(viewport, clock)
    assert viewport.problem == "" and len(viewport._contents) == 2


def test_a_failure_of_the_work_is_a_sentence_too(live, made):
    viewport, _clock, surface = made
    scene = surface.held[0].plain
    flat = np.diag((1.0, 0.0, 1.0, 1.0))
    surface.held = [replace(surface.held[0], plain=replace(scene, volume_matrix=flat))]
    viewport.redraw(request_of(live), 1, surface)
    assert "flattens the volume" in viewport.problem and viewport.pictures == []


def test_a_region_of_no_size_is_a_sentence(live, made):
    viewport, _clock, surface = made
    request = request_of(live)
    viewport.redraw(replace(request, matrices=replace(request.matrices, width=0)), 1, surface)
    assert viewport.problem.startswith("The viewport has 0 x 40 pixels")


def test_stopping_drops_the_work(live, made):
    viewport, _clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    viewport._start(None)
    work = viewport._work
    next(work)
    viewport.stop()
    assert not viewport.is_busy and list(work) == [] and viewport.pictures == []
