"""Drafts: a quick picture into the same image first, from the same stages, then the very same picture.

The module bpy has no window, so a stand-in made of the operator's own methods is driven as Blender drives a modal
operator; what a window adds is in window.py.
"""

import json
import sys
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

TIMER, ESC = SimpleNamespace(type="TIMER", value="NOTHING"), SimpleNamespace(type="ESC", value="PRESS")
SIZE = 48


@pytest.fixture
def volume(tmp_path):
    """A ball and a box, off the middle and different along every axis, 80 voxels wide."""
    z, y, x = np.indices((70, 64, 80))
    voxels = np.where((x - 28) ** 2 + (y - 36) ** 2 + (z - 30) ** 2 < 22**2, 60, 0).astype(np.uint8)
    voxels[10:30, 5:20, 50:72] = 200
    owner = scenes.import_raw(tmp_path, voxels, name="ball")
    scenes.give_transfer(owner, ((0.0, 0.0), (50.0, 0.0), (51.0, 0.01), (255.0, 0.03)), (0.9, 0.5, 0.2))
    scenes.add_camera((40.0, 32.0, 200.0), type="ORTHO", ortho_scale=100.0)
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = SIZE
    return owner


@pytest.fixture
def slow(bridge, monkeypatch):
    """Every picture counts as one that takes long."""
    monkeypatch.setattr(bridge("pictures.drafts"), "QUICK", -1.0)


class Window:
    """Stands in for the context of a window, and remembers what its status bar said."""

    def __init__(self):
        self.said, self.timers = [], 0
        self.scene, self.view_layer = bpy.context.scene, bpy.context.view_layer
        self.evaluated_depsgraph_get = bpy.context.evaluated_depsgraph_get
        self.window = SimpleNamespace(screen=SimpleNamespace(areas=()))
        self.workspace = SimpleNamespace(status_text_set=self.said.append)
        self.window_manager = SimpleNamespace(
            windows=(), progress_begin=lambda *_: None, progress_update=lambda *_: None, progress_end=lambda: None,
            event_timer_add=self._add, event_timer_remove=self._remove, modal_handler_add=lambda _: None)  # fmt: skip

    def _add(self, *_args, **_options):
        self.timers += 1
        return object()

    def _remove(self, _timer):
        self.timers -= 1


@pytest.fixture
def start(bridge, addon):
    """``start(name, **properties)``: an operator as ``invoke`` in a window starts it, and its window."""
    jobs = bridge("loop.jobs")

    def begin(name, **properties):
        module = sys.modules[f"{addon.__name__}.operators.{name}"]
        cls = getattr(module, f"RLE_SPLAT_OT_{name}")
        own = {key: value for key, value in vars(cls).items() if callable(value)}
        reports = []
        bases = tuple(base for base in cls.__bases__ if base is not bpy.types.Operator)
        stand_in = type("StandIn", bases, {**own, "reports": reports})()
        stand_in.report = lambda kind, sentence: reports.append((kind, sentence))
        stand_in.properties = SimpleNamespace(is_property_set=lambda key: key in properties)
        vars(stand_in).update({**properties, "bl_label": cls.bl_label})
        window = Window()
        assert stand_in._guarded(window, stand_in._start) == {"RUNNING_MODAL"}
        return stand_in, window

    yield begin
    jobs.StepwiseOperator._running = False


def run(operator, window, look, most=5000):
    """Ticks of the timer to the end; ``look()`` after each that showed a draft."""
    shown = []
    for _ in range(most):
        before = operator._is_draft_shown
        done = operator.modal(window, TIMER)
        if done != {"RUNNING_MODAL"}:
            return done, shown
        if operator._is_draft_shown != before:
            shown.append(look())
    raise AssertionError("the work has no end")


def color_image():
    return bpy.data.images.get("ball Splat")


def pixels():
    return scenes.image_pixels(color_image())


def test_a_draft_comes_first_and_the_picture_is_the_same(volume, slow, start, bridge):
    """What is classified, lit and encoded is made once for both, and the report holds all of the time."""
    settings, cache = bpy.context.scene.rle_splat, bridge("scene.render_scene").KEPT
    bpy.ops.rle_splat.render_image()
    plain, depth = pixels(), scenes.image_pixels(settings.depth_image)
    bpy.data.images.remove(color_image())
    cache.clear()
    cache.made.clear()
    operator, window = start("render_image", use_meshes=False)
    done, (draft,) = run(operator, window, pixels)
    assert done == {"FINISHED"} and window.timers == 0 and window.said[-1] is None
    assert set(cache.made.values()) == {1}, cache.made
    stages = json.loads(settings.last_report_json)["stages_ms"]
    assert stages["draft"] > 0.0 and stages["classify"] > 0.0
    assert stages.pop("total") == pytest.approx(sum(stages.values()))
    np.testing.assert_array_equal(pixels(), plain)
    np.testing.assert_array_equal(scenes.image_pixels(settings.depth_image), depth)
    assert settings.image == color_image()
    assert 0.0 < np.abs(draft - plain).mean() < 0.02
    np.testing.assert_allclose(scenes.centroid(draft[..., 3]), scenes.centroid(plain[..., 3]), atol=0.25)


@pytest.mark.parametrize("size", (SIZE, 30))
def test_escape_at_a_draft_brings_the_former_picture_back(volume, slow, start, size):
    bpy.ops.rle_splat.render_image()
    settings = bpy.context.scene.rle_splat
    former, report = pixels(), settings.last_report_json
    volume.location.x += 7.0
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = size
    operator, window = start("render_image", use_meshes=False)
    while not operator._is_draft_shown:
        assert operator.modal(window, TIMER) == {"RUNNING_MODAL"}
    assert color_image().size[0] == size
    assert size != SIZE or np.abs(pixels() - former).max() > 0.05
    assert operator.modal(window, ESC) == {"CANCELLED"}
    np.testing.assert_array_equal(pixels(), former)
    assert settings.image == color_image() and settings.last_report_json == report
    assert window.timers == 0
    assert operator.reports == [({"INFO"}, "Canceled; nothing was changed.")]


def test_escape_at_the_first_draft_ever_leaves_no_image(volume, slow, start):
    count = len(bpy.data.images)
    operator, window = start("render_image", use_meshes=False)
    while not operator._is_draft_shown:
        operator.modal(window, TIMER)
    assert color_image() is not None
    operator.modal(window, ESC)
    assert color_image() is None and len(bpy.data.images) == count
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}


def test_a_failure_after_a_draft_brings_the_former_picture_back(volume, slow, start):
    bpy.ops.rle_splat.render_image()
    former = pixels()
    volume.location.x += 7.0
    operator, window = start("render_image", use_meshes=False)
    while not operator._is_draft_shown:
        operator.modal(window, TIMER)
    bpy.data.objects.remove(volume)
    done, _ = run(operator, window, lambda: None)
    assert done == {"CANCELLED"} and "was removed meanwhile" in operator.reports[-1][1]
    np.testing.assert_array_equal(pixels(), former)


def test_the_backdrop_shows_a_draft_and_is_put_back(volume, slow, start):
    camera = bpy.context.scene.camera.data
    own = camera.background_images.new()
    own.image = bpy.data.images.new("blueprint", 4, 4)
    options = dict(place="FRONT", follow=False)
    operator, window = start("preview_in_camera_view", **options)
    while not operator._is_draft_shown:
        operator.modal(window, TIMER)
    assert [entry.image.name for entry in camera.background_images] == ["blueprint", "ball Splat Backdrop"]
    operator.modal(window, ESC)
    assert [entry.image.name for entry in camera.background_images] == ["blueprint"]
    assert not camera.show_background_images and bpy.data.images.get("ball Splat Backdrop") is None

    bpy.ops.rle_splat.preview_in_camera_view(place="BACK")
    entry = camera.background_images[1]
    entry.alpha = 0.5
    former = scenes.image_pixels(entry.image)
    volume.location.x += 7.0
    operator, window = start("preview_in_camera_view", **options)
    while not operator._is_draft_shown:
        operator.modal(window, TIMER)
    assert not np.array_equal(scenes.image_pixels(entry.image), former), "no draft in the image"
    operator.modal(window, ESC)
    entry = camera.background_images[1]
    assert (entry.display_depth, entry.alpha) == ("BACK", 0.5)
    np.testing.assert_array_equal(scenes.image_pixels(entry.image), former)

    operator, window = start("preview_in_camera_view", **options)
    done, shown = run(operator, window, lambda: scenes.image_pixels(bpy.data.images["ball Splat Backdrop"]))
    assert done == {"FINISHED"} and len(shown) == 1
    made = scenes.image_pixels(bpy.data.images["ball Splat Backdrop"])
    bpy.ops.rle_splat.preview_in_camera_view(**options)
    np.testing.assert_array_equal(scenes.image_pixels(bpy.data.images["ball Splat Backdrop"]), made)


def test_a_draft_of_another_volume_is_shown_in_the_place_of_the_first(volume, slow, start, tmp_path):
    camera = bpy.context.scene.camera.data
    bpy.ops.rle_splat.preview_in_camera_view(place="BACK")
    scenes.import_raw(tmp_path, np.full((40, 40, 40), 90, np.uint8), name="box")
    operator, window = start("preview_in_camera_view", place="FRONT")
    while not operator._is_draft_shown:
        operator.modal(window, TIMER)
    assert [entry.image.name for entry in camera.background_images] == ["box Splat Backdrop"]
    operator.modal(window, ESC)
    assert [entry.image.name for entry in camera.background_images] == ["ball Splat Backdrop"]
    assert bpy.data.images.get("box Splat Backdrop") is None and camera.background_images[0].display_depth == "BACK"


def test_a_quick_picture_has_none(volume, start, bridge, monkeypatch):
    monkeypatch.setattr(bridge("pictures.drafts"), "QUICK", 1e6)  # milliseconds: what counts as quick on any machine
    done, shown = run(*start("render_image", use_meshes=False), lambda: None)
    assert done == {"FINISHED"} and shown == []


def test_one_of_the_draft_quality_or_larger_than_the_stage_cache_has_none(volume, slow, start, bridge, monkeypatch):
    bpy.context.scene.rle_splat.quality = "draft"
    assert run(*start("render_image", use_meshes=False), lambda: None) == ({"FINISHED"}, [])
    bpy.context.scene.rle_splat.quality = "standard"
    monkeypatch.setattr(bridge("pictures.drafts"), "TABLE_BYTES", 1e9)
    assert run(*start("render_image", use_meshes=False), lambda: None) == ({"FINISHED"}, [])


def test_scripts_and_background_mode_have_none(volume, slow, bridge, monkeypatch):
    monkeypatch.setattr(bridge("scene.render_scene"), "drafted_steps", lambda *_, **__: pytest.fail("a draft is made"))
    for how in ("EXEC_DEFAULT", "INVOKE_DEFAULT"):
        assert bpy.ops.rle_splat.render_image(how) == {"FINISHED"}
        assert bpy.ops.rle_splat.preview_in_camera_view(how) == {"FINISHED"}


@pytest.fixture
def timeline(volume, slow, bridge, monkeypatch):
    """The queue, with a following backdrop whose camera moves from frame 1 to 2 while the user scrubs."""
    scene, camera, work = bpy.context.scene, bpy.context.scene.camera, bridge("loop.work")
    for frame, x in ((1, 40.0), (2, 50.0), (3, 30.0)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    scene.frame_set(1)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    monkeypatch.setattr(bridge("pictures.update"), "_is_moving", lambda: True)
    monkeypatch.setattr(bpy.app.timers, "register", lambda *_args, **_options: None)  # the test ticks by itself
    yield work
    work.stop()


def backdrop_pixels():
    return scenes.image_pixels(bpy.data.images["ball Splat Backdrop"])


def tick(work, most=5000):
    """The timer's calls to the end; the pictures that were shown."""
    shown = [backdrop_pixels()]
    work._pictures.update({name: one._replace(due=0.0) for name, one in work._pictures.items()})
    for _ in range(most):
        again = work._tick()
        if not np.array_equal(backdrop_pixels(), shown[-1]):
            shown.append(backdrop_pixels())
        if again is None:
            return shown
    raise AssertionError("the work has no end")


def test_a_scrubbed_backdrop_shows_a_draft_and_refines(timeline, monkeypatch):
    scene, settings = bpy.context.scene, bpy.context.scene.rle_splat
    first = backdrop_pixels()
    scene.frame_set(2)
    settings.last_report_json = ""
    shown = tick(timeline)
    assert len(shown) == 2 and settings.last_report_json
    monkeypatch.undo()
    scene.frame_set(1)
    np.testing.assert_array_equal(backdrop_pixels(), first)
    scene.frame_set(2)  # a script's: at once
    np.testing.assert_array_equal(backdrop_pixels(), shown[-1])
    errors = [np.abs(one - shown[-1]).mean() for one in shown]
    assert errors[0] > errors[1] == 0.0


def test_the_next_frame_drops_what_is_not_done(timeline):
    scene = bpy.context.scene
    scene.frame_set(2)
    scene.frame_set(3)
    shown = tick(timeline)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    np.testing.assert_array_equal(backdrop_pixels(), shown[-1])
    scene.frame_set(1)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)  # the operator's own picture stays
    made = backdrop_pixels()
    assert timeline._tick() is None
    np.testing.assert_array_equal(backdrop_pixels(), made)


def test_a_draft_is_replaced_when_the_scene_is_again_as_it_was(timeline):
    scene, first = bpy.context.scene, backdrop_pixels()
    scene.frame_set(2)
    assert not np.array_equal(backdrop_pixels(), first), "a draft of frame 2"
    scene.frame_set(1)
    np.testing.assert_array_equal(tick(timeline)[-1], first)


def test_while_frames_change_nothing_is_refined(timeline):
    bpy.context.scene.frame_set(2)
    draft = backdrop_pixels()
    assert 0.0 < timeline._tick() <= 0.2
    np.testing.assert_array_equal(backdrop_pixels(), draft)
    assert len(tick(timeline)) > 1


def test_an_edit_is_followed_by_the_timer_alone(timeline, bridge, monkeypatch):
    """The draft of an edit, too, is made in steps, so that the window does not wait for it."""
    update, before = bridge("pictures.update"), backdrop_pixels()
    monkeypatch.setattr(update, "_is_moving", lambda: False)
    monkeypatch.setattr(update, "_attending", [True])  # background mode follows an event at once
    bpy.context.scene.camera.data.ortho_scale *= 1.5
    update.follow(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), later=True)
    np.testing.assert_array_equal(backdrop_pixels(), before)
    assert len(tick(timeline)) == 3, "as it was, the draft, the picture"


def test_a_refinement_that_fails_blanks_and_says_why(timeline, bridge, monkeypatch):
    def fail(*_arguments, **_wishes):
        yield bridge("loop.work").Progress(0.0, "")
        raise ValueError

    update = bridge("pictures.update")
    monkeypatch.setattr(update, "_is_moving", lambda: False)
    monkeypatch.setattr(update, "_attending", [True])
    monkeypatch.setattr(update.render_scene, "steps", fail)
    bpy.context.scene.camera.data.ortho_scale *= 1.5
    update.follow(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), later=True)
    tick(timeline)
    assert backdrop_pixels().max() == 0.0 and "could not be rendered" in bpy.context.scene.rle_splat.message
