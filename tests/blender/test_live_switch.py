"""Which volumes a viewport shows, its switch, and that nothing runs in background mode."""

from itertools import pairwise
from types import SimpleNamespace

import bpy
import pytest

from tests.blender import layout_recorder
from tests.blender.real_blender import MODULE
from tests.blender.scenes import save_and_reload, update

SENTENCE = "The file is gone; click Relocate."


@pytest.fixture
def live(bridge):
    return bridge("live")


@pytest.fixture
def shown(bridge):
    return bridge("live.shown")


def area_of_view():
    return next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")


def visible(shown):
    names = shown.visible_volumes(bpy.context.scene, bpy.context.view_layer, area_of_view().spaces.active)
    return [key.name for key in names]


def hide_object(owner):
    owner.hide_set(True)


def disable_object(owner):
    owner.hide_viewport = True


def exclude_collection(owner):
    collection = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(collection)
    for other in owner.users_collection:
        other.objects.unlink(owner)
    collection.objects.link(owner)
    bpy.context.view_layer.layer_collection.children["hidden"].exclude = True


def filter_type(_owner):
    area_of_view().spaces.active.show_object_viewport_empty = False


def switch_off(_owner):
    area_of_view().spaces.active.show_object_viewport_volume = False


@pytest.mark.parametrize("hide", [hide_object, disable_object, exclude_collection, filter_type, switch_off])
def test_a_hidden_volume_is_not_shown(hide, volume_object, shown):
    assert visible(shown) == [volume_object.name]
    hide(volume_object)
    update()
    assert visible(shown) == []


def test_instances_of_a_volume_are_shown_where_they_are(volume_object, shown, bridge):
    scene, layer, space = bpy.context.scene, bpy.context.view_layer, area_of_view().spaces.active
    collection = bpy.data.collections.new("asset")
    for holder in volume_object.users_collection:
        holder.objects.unlink(volume_object)
    collection.objects.link(volume_object)
    instancer = bpy.data.objects.new("instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(instancer)
    instancer.location = (0.0, 0.0, 5.0)
    update()
    (key,) = shown.visible_volumes(scene, layer, space)
    assert shown.has_volumes(scene) and not bridge("loop.index").of(scene).volumes and shown.find(key) == volume_object
    assert shown.matrix_of(key)[2, 3] == pytest.approx(volume_object.location.z + 5.0)
    volume_object.hide_render = instancer.hide_render = True  # counts in renders alone, as for Blender's own objects
    update()
    assert shown.visible_volumes(scene, layer, space) == (key,)
    volume_object.hide_viewport = True
    update()
    assert shown.visible_volumes(scene, layer, space) == ()
    volume_object.hide_viewport = False
    instancer.hide_set(True)
    update()
    assert shown.visible_volumes(scene, layer, space) == ()


def test_a_channel_is_not_drawn_twice(volume_object, shown):
    other = volume_object.copy()
    bpy.context.scene.collection.objects.link(other)
    update()
    assert len(visible(shown)) == 2
    other.rle_splat.channels.add().source = volume_object
    update()
    assert visible(shown) == [other.name]
    volume_object.rle_splat.channels.add().source = other
    update()
    assert len(visible(shown)) == 1


def test_the_switch_survives_undo_and_saving(volume_object, shown, tmp_path):
    switch_off(volume_object)
    bpy.ops.ed.undo_push(message="one")
    volume_object.location.x = 1.0
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.ed.undo()
    assert visible(shown) == []
    save_and_reload(tmp_path / "file.blend")
    assert visible(shown) == [] and shown.has_volumes(bpy.context.scene)
    area_of_view().spaces.active.show_object_viewport_volume = True
    assert len(visible(shown)) == 1


def test_a_deleted_or_renamed_volume_is_found_out(volume_object, shown):
    assert visible(shown)
    volume_object.name = "renamed"
    update()
    assert visible(shown) == ["renamed"]
    bpy.data.objects.remove(volume_object)
    update()
    assert visible(shown) == []


def test_edits_frames_and_undo_are_noticed(volume_object, shown):
    stamps = [shown.stamp()]

    def note():
        stamps.append(shown.stamp())

    volume_object.location.x = 3.0
    update()
    note()
    bpy.context.scene.frame_set(7)
    note()
    volume_object.rle_splat.opacity_scale = 0.5
    update()
    note()
    bpy.ops.ed.undo_push(message="one")
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.ed.undo()
    note()
    assert all(after > before for before, after in pairwise(stamps)), stamps


def test_nothing_runs_in_background_mode(volume_object, live, bridge):
    assert bpy.app.background and not live.DRAW_HANDLERS._handles, "draw handlers are registered without a window"
    assert not live.is_allowed()
    with bpy.context.temp_override(area=area_of_view()):
        before = live.calls.copy()
        live._before()
        live._after()
    assert live.calls["before"] == before["before"] + 1 and live.calls["drawn"] == before["drawn"]
    assert not live._lives and live._tick not in bridge("loop.timer")._due


def test_the_timer_ends_when_live_view_is_switched_off(live, bridge, monkeypatch):
    monkeypatch.setattr(bridge("data.preferences"), "value", lambda name: name != "show_live")
    held = live._lives[1] = live.Live()
    held.viewport._due = 0.0
    live._missed.add(1)
    assert live._tick() is None and not live._missed and not held.viewport.is_busy
    live.stop()


def test_the_panel_has_the_switch_and_says_why_nothing_is_shown(volume_object, live, core):
    area = area_of_view()
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(area=area, region=region):
        log = layout_recorder.draw_all(MODULE, bpy.context)
        assert log.count(("prop", "show_object_viewport_volume")) == 2, "in the panel and among the overlays"
        assert ("operator", "rle_splat.try_again") not in log
        held = live._lives[region.as_pointer()] = live.Live()
        held.viewport.give_up(SENTENCE)
        log = layout_recorder.draw_all(MODULE, bpy.context)
        assert SENTENCE.split()[-1] in " ".join(str(value) for kind, value in log if kind == "label")
        assert ("operator", "rle_splat.try_again") in log
        assert bpy.ops.rle_splat.try_again() == {"FINISHED"}
        assert live.problem_of(area) == "" and held.viewport.problem == ""
    live.stop()


def test_contents_equal_those_of_a_picture(volume_object, bridge, live):
    """Everything but the view is read as Render to Image reads it."""
    surface, render_scene = bridge("live.surface"), bridge("scene.render_scene")
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    looked = surface.BlenderSurface(bpy.context, None, None, [])
    request = bridge("live.viewport").Request(None, (bridge("loop.index").key_of(volume_object),))
    (found,) = looked.contents(request, True).values()
    plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=True)
    assert found.quality == quality
    for name in ("volume", "transfer_function", "lights", "headlight", "clips", "mode", "mist", "world", "triangles"):
        assert getattr(found.plain, name) is getattr(plain, name) or getattr(found.plain, name) == getattr(plain, name)
    assert (found.plain.index_to_world == plain.index_to_world).all()
    (again,) = looked.contents(request, True).values()
    assert again.digest == found.digest
    volume_object.rle_splat.opacity_scale = 0.5
    update()
    assert looked.contents(request, True)[request.volumes[0]].digest != found.digest


@pytest.mark.parametrize("lit, counts", [(("HEADLIGHT", "BOTH"), 12), (("SCENE", "SCENE"), 12), (("NONE",) * 2, None)])
def test_meshes_cast_shadows_on_every_volume_that_the_scenes_lights_shine_on(
    volume_object, phantom, bridge, lit, counts
):
    bpy.ops.rle_splat.import_volume(filepath=str(phantom[0]), shape=(7, 6, 5), dtype="uint8", preset="faint")
    second = bpy.context.view_layer.objects.active
    bpy.ops.mesh.primitive_cube_add()
    volume_object.rle_splat.lighting, second.rle_splat.lighting = lit
    update()
    looked = bridge("live.surface").BlenderSurface(bpy.context, None, None, [])
    request = bridge("live.viewport").Request(None, (bridge("loop.index").key_of(second),))
    (found,) = looked.contents(request, False).values()
    triangles = found.plain.triangles
    assert (triangles if triangles is None else len(triangles)) == counts


def test_depth_is_not_expected_where_engines_leave_none(bridge):
    surface, viewport = bridge("live.surface"), bridge("live.viewport")

    def has(shading, engine, overlays):
        return surface.has_depth(viewport.Request(None, (), (shading, engine, overlays, False, False)))

    assert has("SOLID", "CYCLES", False) and has("RENDERED", "CYCLES", True)
    assert not has("RENDERED", "CYCLES", False) and not has("MATERIAL", "BLENDER_WORKBENCH", False)
    assert has("RENDERED", "BLENDER_WORKBENCH", False) and has("WIREFRAME", "CYCLES", False)


class Framebuffer:
    """Stands in for a framebuffer of a size, whose depth is one number."""

    def __init__(self, size, depth):
        self.size, self.depth = size, depth

    def viewport_get(self):
        return 0, 0, *self.size

    def read_depth(self, _left, _bottom, width, height, data):
        data[:] = [[self.depth] * width for _ in range(height)]


@pytest.mark.parametrize(
    ("size", "depth", "expected"), [((40, 30), 0.5, True), ((40, 30), 0.0, False), ((30, 30), 0.5, False)]
)
def test_a_framebuffer_that_is_too_small_or_empty_gives_no_depth(size, depth, expected, bridge, monkeypatch):
    surface, viewport, view = bridge("live.surface"), bridge("live.viewport"), bridge("live.view")
    of_array = SimpleNamespace(Buffer=lambda _kind, _shape, array: array)  # there is none without a window
    monkeypatch.setattr(surface, "gpu", SimpleNamespace(types=of_array))
    window = (2.0, 0, 0, 0, 0, 2.5, 0, 0, 0, 0, -1.002, -0.2, 0, 0, -1.0, 0)
    identity = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0)
    request = viewport.Request(view.Matrices(identity, window, 40, 30), (), ("SOLID", "CYCLES", True, False, False))
    looked = surface.BlenderSurface(bpy.context, request, Framebuffer(size, depth), [])
    found = looked.ends(view.view_of(request.matrices), (2, 3, 38, 29))
    assert (found is not None) == expected
    if expected:
        waits = [1.0] * surface.MOST_WAITS
        slow = surface.BlenderSurface(bpy.context, request, Framebuffer(size, depth), waits)
        assert slow.ends(view.view_of(request.matrices), (2, 3, 38, 29)) is None, "a driver that waits is asked again"
        assert slow.ends(view.view_of(request.matrices), (2, 3, 38, 29)) is not None, "it is not asked again later"
        assert len(waits) == surface.MOST_WAITS and waits[-1] < surface.WAITS


def test_draw_handlers_are_added_in_order_and_all_removed(live, bridge, monkeypatch):
    """As in a window: those of slices before those of volumes; a part that is replaced is called in its place."""
    drawing, called = bridge("live.drawing"), []
    space = SimpleNamespace(
        draw_handler_add=lambda function, _, region, when: called.append((when, region)) or function,
        draw_handler_remove=lambda function, region: called.remove((whens[function], region)),
    )
    window = SimpleNamespace(app=SimpleNamespace(background=False), types=SimpleNamespace(SpaceView3D=space))
    monkeypatch.setattr(drawing, "bpy", window)
    owners = bridge("live.letters").HANDLERS, bridge("live.bars").HANDLERS, bridge("live.slice_drawing").HANDLERS
    whens = dict(pair for one in (*owners, live.DRAW_HANDLERS) for pair in one._functions)
    for one in owners[:2]:
        one.register()
    live.register()
    views = "PRE_VIEW", "POST_VIEW"
    assert [when for when, _ in called] == ["POST_PIXEL"] * 2 + [*views, "POST_PIXEL", *views]
    assert {region for _, region in called} == {"WINDOW"}
    monkeypatch.setattr(live, "_before", lambda: called.append("replaced"))
    live.DRAW_HANDLERS._functions[0][0]()
    assert called.pop() == "replaced"
    live.unregister()
    for one in owners[:2]:
        one.unregister()
    assert called == []
