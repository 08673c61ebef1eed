"""Surfaces are read and hashed again only after something has changed them, and then as if nothing had been known."""

import bpy
import numpy as np
import pytest

from tests.blender.scenes import update


@pytest.fixture
def meshes(bridge):
    return bridge("scene.meshes")


@pytest.fixture
def grid(volume_object):
    """A grid of two triangles, big enough to be hashed on its own with its 100 x 100 faces."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=100, y_subdivisions=100)
    one = bpy.context.view_layer.objects.active
    one.data.materials.append(bpy.data.materials.new("plain"))
    update()
    return one


def known(meshes):
    return meshes.known_surfaces(bpy.context.evaluated_depsgraph_get())


def move(grid):
    grid.location.x = 2.0


def bend(grid):
    grid.data.vertices[3].co.z = 1.0
    grid.data.update()


def modify(grid):
    grid.modifiers.new("array", "ARRAY")


def hide(grid):
    grid.hide_render = True


def hide_from_camera(grid):
    grid.visible_camera = False


def hide_in_the_viewport(grid):
    grid.hide_viewport = True


def be_glass(grid):
    tree = grid.data.materials[0].node_tree
    if tree is None:
        grid.data.materials[0].use_nodes = True
        tree = grid.data.materials[0].node_tree
    tree.nodes["Principled BSDF"].inputs["Transmission Weight"].default_value = 1.0


def add_another(_grid):
    bpy.ops.mesh.primitive_cube_add()


def delete(grid):
    bpy.data.objects.remove(grid)


def instance(grid):
    collection = bpy.data.collections.new("asset")
    collection.objects.link(grid)
    empty = bpy.data.objects.new("instancer", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(empty)
    update()
    empty.location.z = 3.0


def move_parent(grid):
    empty = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(empty)
    grid.parent = empty
    update()
    empty.location.y = 4.0


def next_frame(grid):
    grid.keyframe_insert("location", frame=1)
    grid.location.z = 5.0
    grid.keyframe_insert("location", frame=9)
    update()
    bpy.context.scene.frame_set(9)


@pytest.mark.parametrize("edit", [
    move, bend, modify, hide, hide_from_camera, hide_in_the_viewport, be_glass, add_another, delete, instance,
    move_parent, next_frame,
])  # fmt: skip
def test_after_an_edit_they_are_read_again(edit, grid, meshes):
    before = known(meshes)
    edit(grid)
    update()
    found, expected = known(meshes), meshes.read_surfaces(bpy.context.evaluated_depsgraph_get())
    for mine, true in zip(found, expected):
        assert (mine is None) == (true is None)
        if true is not None:
            np.testing.assert_array_equal(mine, true)
    assert not (found.panes is None and before.panes is None and np.array_equal(found.triangles, before.triangles))


def test_what_changes_no_surface_reads_none(grid, volume_object, meshes, bridge, monkeypatch):
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    bpy.context.scene.collection.objects.link(lamp)
    bpy.context.scene.world = bpy.data.worlds.new("World")
    update()
    held = known(meshes)
    monkeypatch.setattr(meshes, "_read_pieces", lambda *_: pytest.fail("the meshes are looked at again"))
    lamp.location.x = 1.0
    update()
    lamp.data.energy = 3.0
    volume_object.location.z = 2.0
    volume_object.rle_splat.opacity_scale = 0.5
    update()
    bpy.context.scene.world.color = 0.1, 0.2, 0.3
    update()
    assert known(meshes) is held


def test_known_surfaces_are_hashed_once_and_alike(grid, meshes, core, monkeypatch):
    hashes = core("runtime.array_hash")
    triangles = known(meshes).triangles
    first = hashes.hash_plain(triangles)
    assert hashes.hash_plain(triangles.copy()) == first, "of other surfaces with the same triangles it is the same"
    monkeypatch.setattr(hashes.np, "ascontiguousarray", lambda _: pytest.fail("the triangles are hashed again"))
    assert hashes.hash_plain(triangles) == first


def test_another_file_has_none(grid, meshes):
    assert known(meshes) and meshes._Read.known
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not meshes._Read.known


@pytest.fixture
def reads(meshes, monkeypatch):
    """Names of the meshes whose triangles were read."""
    found, read = [], meshes.mesh_triangles
    monkeypatch.setattr(meshes, "mesh_triangles", lambda mesh: (found.append(mesh.name), read(mesh))[1])
    return found


# From 5.3 on, Blender tags the shape of an object whose material was edited, as it does for a modifier.
GLASS = ["Grid"] if bpy.app.version >= (5, 3, 0) else []


@pytest.mark.parametrize(("edit", "expected"), [
    (move, []), (hide, []), (move_parent, []), (be_glass, GLASS), (bend, ["Grid"]), (modify, ["Grid"]),
    (add_another, ["Cube"]),
])  # fmt: skip
def test_only_the_mesh_that_was_edited_is_read_again(edit, expected, grid, meshes, reads):
    bpy.ops.mesh.primitive_monkey_add()
    update()
    known(meshes)
    assert sorted(reads) == ["Grid", "Suzanne"]
    reads.clear()
    edit(grid)
    update()
    found = known(meshes)
    assert reads == expected
    for mine, true in zip(found, meshes.read_surfaces(bpy.context.evaluated_depsgraph_get())):
        np.testing.assert_array_equal(mine, true)


def test_a_frame_in_which_no_surface_differs_costs_nothing(grid, volume_object, meshes, monkeypatch):
    volume_object.keyframe_insert("location", frame=1)
    volume_object.location.x = 2.0
    volume_object.keyframe_insert("location", frame=9)
    update()
    held = known(meshes)
    monkeypatch.setattr(meshes, "_read_pieces", lambda *_: pytest.fail("the meshes are looked at again"))
    for frame in (3, 5):
        bpy.context.scene.frame_set(frame)
        assert known(meshes) is held


def test_an_event_after_which_no_surface_differs_keeps_the_arrays(grid, meshes):
    held = known(meshes)
    grid.color = 1.0, 0.0, 0.0, 1.0  # an event of an object with a surface
    update()
    assert known(meshes) is held


def test_undo_reads_all_again(grid, meshes, reads):
    bpy.ops.ed.undo_push(message="before")
    bend(grid)
    update()
    bpy.ops.ed.undo_push(message="bend")
    known(meshes)
    bpy.ops.ed.undo()
    reads.clear()
    found = known(meshes)
    assert reads == ["Grid"] and np.ptp(found.triangles[..., 2]) == 0.0


def test_instances_of_generated_geometry_and_of_one_mesh_in_two_objects(grid, meshes):
    other = grid.copy()
    bpy.context.scene.collection.objects.link(other)
    other.location.x = 7.0
    other.modifiers.new("array", "ARRAY")
    text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
    text.data.body = "abc"
    bpy.context.scene.collection.objects.link(text)
    for act in (lambda: None, lambda: setattr(text.data, "body", "ab"), lambda: bend(grid)):
        act()
        update()
        found, expected = known(meshes), meshes.read_surfaces(bpy.context.evaluated_depsgraph_get())
        np.testing.assert_array_equal(found.triangles, expected.triangles)
