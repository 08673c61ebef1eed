"""What each scene has is known without looking at objects: only after collections have changed are they looked at."""

import sys
from contextlib import contextmanager

import bpy
import pytest

from tests.blender import layout_recorder, scenes
from tests.blender.scenes import update

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def index(bridge):
    return bridge("loop.index")


@contextmanager
def objects_without_our_properties(bridge):
    """Whoever looks at an object raises AttributeError, which Blender prints where a handler does."""
    del bpy.types.Object.rle_splat
    try:
        yield
    finally:
        pointer = bridge("data.overridable").PointerProperty
        bpy.types.Object.rle_splat = pointer(type=bridge("data.properties").VolumeProperties)


def add_empties(count: int) -> list:
    found = [bpy.data.objects.new(f"Empty {n}", None) for n in range(count)]
    for one in found:
        bpy.context.scene.collection.objects.link(one)
    bpy.context.view_layer.objects.active = found[0]
    update()
    return found


def poll_all() -> int:
    """Ask every panel, gizmo group and operator of ours whether it is shown; how many there are."""
    bases = bpy.types.Panel, bpy.types.GizmoGroup, bpy.types.Operator
    found = [one for base in bases for one in layout_recorder.subclasses(base) if "rle_splat" in one.__module__]
    for one in found:
        getattr(one, "poll", bool)(bpy.context)
    return len(found)


def test_without_a_volume_no_object_is_looked_at(bridge, index, capfd):
    first, *_ = add_empties(20)
    bpy.context.scene.world = bpy.data.worlds.new("World")
    update()
    assert not any(index.of(bpy.context.scene)), "known before"
    with objects_without_our_properties(bridge):
        with pytest.raises(AttributeError):
            first.rle_splat.is_volume  # noqa: B018
        first.location.x = 2.0  # an update
        update()
        bpy.context.scene.frame_set(3)
        bpy.context.scene.world.color = 0.1, 0.2, 0.3
        update()
        assert poll_all() > 60  # a redraw of panels and handles
        bridge("live.letters")._draw()
        assert not bridge("live.shown").has_volumes(bpy.context.scene)
    assert "AttributeError" not in capfd.readouterr().err


def calls_of_ours(act) -> list:
    """Names of the functions of the bridge that are called meanwhile."""
    found = []

    def note(frame, event, _argument):
        if event == "call" and "/rle_splat/bridge/" in frame.f_code.co_filename.replace("\\", "/"):
            found.append(frame.f_code.co_name)

    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(None)
    return found


def test_without_a_volume_an_event_calls_one_handler_and_nobody_else(bridge):
    first, *_ = add_empties(3)
    for act in (update, lambda: bpy.context.scene.frame_set(bpy.context.scene.frame_current + 1)):
        first.location.x += 1.0
        update()
        first.location.x += 1.0
        called = calls_of_ours(act)
        assert called.count("handle") >= 1, "Blender says that something has changed"
        assert set(called) <= {"handle", "_on_update", "_is_idle", "has_any", "of", "<genexpr>"}, called


def test_the_last_volume_leaves_no_stages_and_no_voxels(volume_object, bridge):
    bpy.context.scene.camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    bpy.context.scene.collection.objects.link(bpy.context.scene.camera)
    bpy.context.scene.camera.location.z = 30.0
    update()
    plain, quality = scenes.read_scene(volume_object)
    list(bridge("scene.render_scene").steps(plain, quality, refuse_empty_view=False))
    update()
    assert bridge("scene.render_scene").KEPT.contents and bridge("loop.store")._entries
    bpy.data.objects.remove(volume_object)
    update()
    assert not bridge("scene.render_scene").KEPT.contents and not bridge("loop.store")._entries


def test_objects_are_looked_at_once_after_collections_changed(volume_object, index, bridge):
    scene, shown = bpy.context.scene, bridge("live.shown")
    update()
    assert shown.has_volumes(scene)
    looks = index._Now.looks
    for x in range(3):
        volume_object.location.x = x
        update()
        scene.frame_set(x + 5)
        poll_all()
    assert shown.has_volumes(scene) and index._Now.looks == looks
    add_empties(2)
    poll_all()
    assert index._Now.looks == looks + 1


def unlink(owner):
    bpy.context.scene.collection.objects.unlink(owner)


def remove(owner):
    bpy.data.objects.remove(owner)


def be_none(owner):
    owner.rle_splat.is_volume = False


@pytest.mark.parametrize("leave", [unlink, remove, be_none])
def test_a_volume_that_leaves_is_gone(leave, volume_object, index):
    for holder in volume_object.users_collection:
        holder.objects.unlink(volume_object)
    bpy.context.scene.collection.objects.link(volume_object)
    update()
    (key,) = index.of(bpy.context.scene).volumes
    assert index.find(key) == volume_object
    leave(volume_object)
    if leave is unlink:  # the two others need no event
        update()
    assert not index.of(bpy.context.scene).volumes


def test_a_renamed_volume_and_another_of_its_name_are_told_apart(volume_object, index):
    (key,) = index.of(bpy.context.scene).volumes
    name, volume_object.name = volume_object.name, "renamed"
    other = bpy.data.objects.new(name, None)
    assert index.find(key) == volume_object != other


def test_undo_of_an_import_and_of_a_deletion_is_noticed(volume_object, index):
    bpy.ops.ed.undo_push(message="import")
    bpy.data.objects.remove(volume_object)
    bpy.ops.ed.undo_push(message="delete")
    assert not index.of(bpy.context.scene).volumes
    bpy.ops.ed.undo()
    assert len(index.of(bpy.context.scene).volumes) == 1
    bpy.ops.ed.redo()
    assert not index.of(bpy.context.scene).volumes


def test_the_timer_begins_no_step_that_may_end_after_its_bite(bridge, monkeypatch):
    """A function that has more to do is called again, as long as another step like its last one fits."""
    timer, now, began = bridge("loop.timer"), [0.0], []
    monkeypatch.setattr(timer.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(timer, "_due", {})
    for step, times in ((0.001, 20), (0.008, 2), (0.011, 1), (0.05, 1)):

        def work(step=step):
            began.append(now[0])
            now[0] += step
            return timer.AT_ONCE

        began.clear()
        timer._due[work] = now[0]
        assert timer._tick() == pytest.approx(timer.PAUSE) and abs(len(began) - times) <= 1, step
        assert len(began) == 1 or now[0] - began[0] <= timer.BITE + 1e-9
        timer.stop(work)
    assert timer._tick() is None
