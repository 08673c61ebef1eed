"""What an import does to 3D viewports: a volume fits into the view, and what hides it is told."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

CUBE = np.full((4, 4, 4), 100, np.uint8)


@pytest.mark.parametrize("width, height", [(1280, 800), (600, 900), (500, 500)])
@pytest.mark.parametrize("lens", [35.0, 50.0, 85.0])
def test_a_sphere_touches_the_nearer_sides_of_the_view(bridge, width, height, lens):
    """By the projection of a viewport: a sensor of 72 mm along the longer side."""
    fit = bridge("viewports").distance_to_fit
    nearer = min(width, height) / max(width, height)
    distance = fit(2.0, lens, nearer, False)
    assert 72.0 / lens * distance * nearer == pytest.approx(4.0)
    distance = fit(2.0, lens, nearer, True)
    tangent = 36.0 / lens * nearer
    # The plane through the eye and the shorter side touches the sphere: its distance from the center is the radius.
    assert distance * tangent / np.hypot(1.0, tangent) == pytest.approx(2.0)


def test_corners_are_those_of_the_box_in_the_world(addon, bridge, tmp_path):
    owner = scenes.import_raw(tmp_path, CUBE)
    owner.location = (1.0, 2.0, 3.0)
    owner.rotation_euler = (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    volume = bridge("volumes").load_volume(owner)
    corners = bridge("viewports").world_corners(owner, volume, bpy.context.scene)
    (holder,) = owner.instance_collection.objects
    seen = [owner.matrix_world @ holder.matrix_world @ vertex.co for vertex in holder.data.vertices]
    np.testing.assert_allclose(sorted(map(tuple, corners)), sorted(map(tuple, seen)), atol=1e-5)


def test_a_mesh_around_the_volume_is_told(addon, bridge, tmp_path, capfd):
    bpy.ops.mesh.primitive_cube_add(size=200.0)
    cube = bpy.context.object
    cube.name = "Around"
    owner = scenes.import_raw(tmp_path, CUBE)
    viewports, layer = bridge("viewports"), bpy.context.view_layer
    assert "It lies inside Around, which hides it" in capfd.readouterr().out
    corners = viewports.world_corners(owner, bridge("volumes").load_volume(owner), bpy.context.scene)
    assert viewports.hiding_meshes(layer, corners) == ["Around"]

    def hides(**changes) -> bool:
        before = {name: getattr(cube, name) for name in changes}
        for name, value in changes.items():
            setattr(cube, name, value)
        layer.update()
        found = viewports.hiding_meshes(layer, corners)
        for name, value in before.items():
            setattr(cube, name, value)
        return found != []

    assert hides()
    assert not hides(display_type="WIRE")
    assert not hides(hide_viewport=True)
    assert not hides(location=(0.0, 0.0, 101.0))  # they cross
    assert not hides(scale=(0.0, 1.0, 1.0))


def test_without_a_window_nothing_is_moved(addon, bridge):
    bridge("viewports").frame(None, [np.zeros((8, 3)), np.ones((8, 3))])
    bridge("viewports").open_tab(None)
