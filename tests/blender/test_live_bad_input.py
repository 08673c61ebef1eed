"""What a viewport does with bad input: a fallback or one sentence, never a traceback per redraw.

A volume that does not fit in memory is tests/unit/test_larger_voxels.py, a framebuffer smaller than its region
test_live_switch.py, a flat matrix and a region without pixels test_live_viewport.py.  window_live.py closes a viewport
and loads a file while a picture is refined.
"""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

MATRICES = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0), (
    2.0, 0, 0, 0, 0, 2.5, 0, 0, 0, 0, -1.002, -0.2, 0, 0, -1.0, 0)  # fmt: skip


class NoDepth:
    """A framebuffer of a driver that cannot read depth."""

    def __init__(self, problem):
        self.problem, self.asked = problem, 0

    def viewport_get(self):
        return 0, 0, 40, 30

    def read_depth(self, *_arguments, **_options):
        self.asked += 1
        raise self.problem


class Held:
    """Stands in for a viewport's picture and work: busy, with one picture."""

    halvings, is_refined, is_busy, problem, version, pictures = 1, True, True, "", 3, ("picture",)

    def __init__(self):
        self.stopped = 0

    def wait(self):
        return 0.0

    def stop(self):
        self.stopped += 1

    def give_up(self, sentence):
        self.problem, self.pictures = sentence, ()


@pytest.fixture
def live(bridge):
    found = bridge("live")
    yield found
    found._lives.clear()
    found.stop()


@pytest.fixture
def request_of(bridge):
    view, viewport = bridge("live.view"), bridge("live.viewport")

    def make(volumes=()):
        return viewport.Request(view.Matrices(*MATRICES, 40, 30), volumes, ("SOLID", "CYCLES", True, False, False))

    return make


def one_live(live, address=12345):
    """A Live at an address where there is no region."""
    found = live._lives[address] = live.Live()
    found.viewport = Held()
    return found


@pytest.mark.parametrize("problem", (ValueError("outside"), RuntimeError("not supported")))
def test_a_driver_without_depth_leaves_it_to_triangles(problem, bridge, request_of, monkeypatch):
    surface, view = bridge("live.surface"), bridge("live.view")
    of_array = SimpleNamespace(Buffer=lambda _kind, _shape, array: array)
    monkeypatch.setattr(surface, "gpu", SimpleNamespace(types=of_array))
    framebuffer = NoDepth(problem)
    looked = surface.BlenderSurface(bpy.context, request_of(), framebuffer, [])
    assert looked.ends(view.view_of(request_of().matrices), (2, 3, 38, 29)) is None and framebuffer.asked == 1


def test_a_driver_without_float_textures_is_one_sentence(live, monkeypatch):
    asked = []

    def refuse(_picture):
        asked.append(1)
        raise RuntimeError("RGBA32F is not supported")

    monkeypatch.setattr(live.drawing, "texture_of", refuse)
    found = one_live(live)
    for _ in range(3):
        live._draw(found, None)
    assert len(asked) == 1 and not found.placed
    assert "cannot draw the volume with this graphics driver: RGBA32F is not supported" in found.viewport.problem


def test_a_file_that_is_gone_is_one_sentence_and_found_again(volume_object, phantom, bridge, request_of, tmp_path):
    surface, viewport = bridge("live.surface"), bridge("live.viewport").Viewport(bridge("scene.render_scene").KEPT)
    key = bridge("loop.index").key_of(volume_object)
    away = phantom[0].rename(tmp_path / "elsewhere.raw")
    bridge("volumes.volumes").forget_all()
    request = request_of((key,))
    for stamp in range(3):
        viewport.redraw(request, stamp, surface.BlenderSurface(bpy.context, request, None, []))
    assert "phantom.raw" in viewport.problem and "Traceback" not in viewport.problem
    assert viewport.counts["reads"] == 3 and not viewport.pictures
    away.rename(phantom[0])
    bridge("volumes.volumes").load_volume(volume_object)  # as a timer does in a window
    contents = surface.BlenderSurface(bpy.context, request, None, []).contents(request, False)
    viewport.redraw(request, 3, surface.BlenderSurface(bpy.context, request, None, []))
    assert viewport.problem == "" and [type(one).__name__ for one in contents.values()] == ["Contents"]


def test_larger_voxels_than_the_volumes_are_said(live, monkeypatch):
    area = SimpleNamespace(regions=[SimpleNamespace(type="WINDOW", as_pointer=lambda: 12345)])
    found = one_live(live)
    assert "voxels 2 times as large" in live.remark_of(area)
    found.viewport.is_refined = False
    assert live.remark_of(area) == "", "of a draft that is coarser for speed it would not be true"


def test_a_viewport_that_was_closed_while_refining_is_forgotten(live, monkeypatch):
    monkeypatch.setattr(live, "is_allowed", lambda: True)
    held = one_live(live).viewport
    assert live._tick() == live.timer.PAUSE
    assert held.stopped == 1 and not live._lives and live._tick() is None


def test_a_file_that_is_loaded_while_refining_ends_the_work(live, bridge):
    held = one_live(live).viewport
    timer = bridge("loop.timer")
    timer._due[live._tick] = 1e9  # as in a window
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert held.stopped == 1 and not live._lives and live._tick not in timer._due


def test_depths_that_are_no_numbers_end_no_ray(bridge):
    view = bridge("live.view")
    found = view.view_of(view.Matrices(*MATRICES, 4, 3))
    depths = np.full((3, 4), np.nan, np.float32)
    assert np.isinf(view.ray_ends(found, depths, (0, 0, 4, 3))).all()
