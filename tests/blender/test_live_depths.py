"""Where rays of a viewport end: at depths that come late, are compared and prepared, or at triangles."""

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


def test_a_depth_that_comes_late_is_found_by_the_redraw_after_the_refinement(live, made):
    viewport, clock, surface = made
    surface.depth = np.inf
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    surface.depth = 29.0
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts["drafts"] == 2
    finish(viewport, clock)
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts["drafts"] == 2 and not viewport.is_busy


def test_a_depth_that_comes_soon_after_the_last_look_is_found(live, made):
    viewport, clock, surface = made
    surface.depth = np.inf
    viewport.redraw(request_of(live), 1, surface)
    finish(viewport, clock)
    viewport.redraw(request_of(live), 1, surface)  # looks after the refinement
    surface.depth = 29.0  # as when a shader is ready
    clock.now += 0.1
    viewport.redraw(request_of(live), 1, surface)
    clock.now += viewport.wait()
    assert viewport.work() and viewport.counts["drafts"] == 1
    viewport.redraw(request_of(live), 1, surface)
    assert viewport.counts["drafts"] == 2


def test_depths_are_compared_where_they_were_read(live, bridge):
    """Of a small part of a view a change must not be too small a share of all pixels to count."""

    def differ(*depths):
        found = [None if one is None else bridge("live.frames").Ends(one, None, part) for one in depths]
        return live.viewport._ends_differ(*found)

    ends = np.full((40, 50), np.inf, np.float32)
    other = ends.copy()
    part = 10, 10, 20, 20
    other[12:15, 12:15] = 3.0
    assert differ(ends, other) and not differ(ends, ends.copy())
    assert differ(ends, None) and not differ(None, None)
    one = ends.copy()
    one[12, 12] = 3.0
    assert not differ(ends, one), "a pixel in 2000 is what an engine's samples move"


def test_pictures_go_to_the_driver_without_their_transparent_border(live):
    whole = np.zeros((20, 30, 4), np.float32)
    whole[5:9, 12:20] = 0.5
    whole[7, 29, 2] = 0.1  # at the right edge, without opacity
    rgba, crop = live.frames.without_border(whole, (100, 200, 130, 220))
    assert crop == (111, 204, 130, 210) and rgba.shape == (6, 19, 4) and rgba.flags.c_contiguous
    np.testing.assert_array_equal(rgba, whole[4:10, 11:])
    blank, same = live.frames.without_border(np.zeros_like(whole), (100, 200, 130, 220))
    assert blank.shape == whole.shape and same == (100, 200, 130, 220)


@pytest.mark.parametrize("coarseness, count", [(0, 3), (1, 3), (None, 1)])
def test_depths_are_prepared_in_steps_of_their_own(live, core, contents, coarseness, count):
    """Without lines of the floor: one step looks for them, and for a draft another one widens what is behind."""
    shot = live.frames.shot_of(request_of(live).matrices, [contents])
    drawn = np.full(SIZE[::-1], 30.0, np.float32)
    ends = live.frames.Ends(drawn, shot.view, shot.part, has_floor=True)
    cache = core("pipeline.stage_cache").StageCache()
    messages = [step.message for step in live.frames.picture_steps(shot, ends, cache, coarseness)]
    assert [message == live.frames.READING for message in messages] == [n < count for n in range(len(messages))]


def test_depth_ends_rays_and_without_one_triangles_do(live, made):
    viewport, _clock, surface = made
    surface.depth = 30.0
    viewport.redraw(request_of(live), 1, surface)
    half = viewport.pictures[0].rgba[..., 3].max()
    surface.depth = None
    viewport.redraw(request_of(live, drawn=("RENDERED",)), 1, surface)
    whole = viewport.pictures[0].rgba[..., 3].max()
    assert surface.with_triangles == [False, False, True] and half < whole - 0.1
    depths = viewport.counts["depths"]
    viewport.redraw(request_of(live, 31.0, drawn=("RENDERED",)), 1, surface)
    assert viewport.counts["depths"] == depths, "it asks again at every redraw"


def test_without_depth_it_is_asked_for_again_after_some_moves(live, made):
    """Reading it may have been slow because the machine was busy."""
    viewport, _clock, surface = made
    viewport.redraw(request_of(live), 1, surface)
    assert surface.with_triangles[-1], "no depth"
    surface.depth = 30.0
    for move in range(1, live.viewport.AGAIN):
        viewport.redraw(request_of(live, 30.0 + 0.01 * move), 1, surface)
    assert surface.with_triangles[-1] and viewport.counts["depths"] == 1
    for move in (1, 2):
        viewport.redraw(request_of(live, 31.0 + move), 1, surface)
        assert not surface.with_triangles[-1] and viewport.counts["depths"] == 1 + move
    surface.depth = None
    viewport.redraw(request_of(live, 34.0), 1, surface)
    assert surface.with_triangles[-1], "triangles again"
