"""The volume's shadow on meshes and its reflection in them, as Cycles renders them through the grid beside it."""

import math
import os
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.scenes import (
    RED,
    add_camera,
    add_mesh,
    add_white_floor,
    centroid,
    cube_scene,
    import_raw,
    load_color,
    rendered,
    update,
    use_cycles,
)

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = 32  # pixels along each side of a picture, and world units that it shows
LEFT, TOP = -19.0, 22.5  # world coordinates of its corner
ALPHA, THICK = 0.2, 4  # opacity of a voxel of the slab, and how many it is thick
NO_LIGHT = 0.02  # largest error of a mean of the floor's light, where 1 is unshadowed
SHADOW = slice(12, 20), slice(8, 11)  # pixels that are shadowed by all of the slab
COLOR = (0.8, 0.1, 0.0)  # of the slab, whose light on the floor leaves the blue alone


def add_sun(slant=math.pi / 4.0):
    """A sun without size under which a white floor facing up has radiance cos(slant); it shines toward -x."""
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.data.angle = math.pi, 0.0
    light.rotation_euler = (0.0, slant, 0.0)
    bpy.context.scene.collection.objects.link(light)
    return light


@pytest.fixture
def slab(grids_in_cycles, addon, tmp_path):
    """A slab of 12 x 12 x 4 voxels over a floor, from x = 0.5 and z = 14.5 on, included in renders.

    Its shadow is as far to the left as the slab is high: from x = -18 to -2, and whole from -14 to -6.
    """
    voxels = np.zeros((6, 14, 14), np.uint8)
    voxels[1:5, 1:13, 1:13] = 100
    scene = use_cycles((SIZE, SIZE), samples=16)
    bpy.context.scene.cycles.volume_step_rate = 0.25  # four steps a voxel
    owner = import_raw(tmp_path, voxels)
    load_color(tmp_path, COLOR, alpha=ALPHA)
    owner.location = (0.0, 0.0, 14.0)
    scene.rle_splat.quality = "standard"
    add_white_floor(60.0)
    add_sun()
    add_camera((LEFT + SIZE / 2, TOP - SIZE / 2, 60.0), type="ORTHO", ortho_scale=float(SIZE))
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    return owner


@pytest.fixture
def grid(bridge):
    """``grid()`` is the only grid of the scene, None if there is none."""

    def only():
        found = bridge("render.mesh_shadows").grids(bpy.context.scene)
        assert len(found) <= 1
        return found[0] if found else None

    return only


def render():
    bpy.ops.render.render()


def force(state):
    bpy.context.scene.rle_splat.effect_overrides.shadows_on_meshes = state


def floor_light(tmp_path):
    """(SIZE, SIZE) blue radiance of the floor, 1 where it is not shadowed; the slab hides it from column 19 on."""
    return rendered(tmp_path / "floor.exr")[..., 2] * math.sqrt(2.0)


def row_of(name="shadows on meshes"):
    return bpy.context.scene.rle_splat.effect_rows[name]


@pytest.mark.parametrize("side", [14, 7], ids=["voxels", "blocks"])
def test_the_shadow_of_a_slab_obeys_beer_and_lambert_where_it_belongs(slab, tmp_path, core, monkeypatch, side):
    """Averaged over blocks of two voxels a side, too, which begin half inside the slab."""
    for name in ("LEAST_SIDE", "MOST_SIDE"):
        monkeypatch.setattr(core("pipeline.medium_grid"), name, side)
    light = floor_light(tmp_path)
    through = (1.0 - ALPHA) ** (THICK * math.sqrt(2.0))
    found = light[SHADOW].mean()
    print(f"transmittance {found:.4f}, by the law {through:.4f}")
    assert found == pytest.approx(through, abs=NO_LIGHT)
    assert light[:5].mean() == pytest.approx(1.0, abs=1e-3)
    column, row = centroid(1.0 - light[:, :18])
    off = np.array((LEFT + column + 10.0, TOP - row - 6.5))
    print(f"off by {off} world units")
    assert np.abs(off).max() < 0.5 * 14 / side, "half a voxel of the grid"
    assert row_of().on and row_of().reason == "cast by 1 sun" and row_of().ms > 0.0


def test_a_mesh_in_the_box_is_shadowed_and_one_on_the_volume_is_not(grids_in_cycles, addon, tmp_path):
    """A floor below an opaque slab, inside the volume's box, and a plate on the slab; a sun from the right."""
    voxels = np.zeros((16, 32, 32), np.uint8)
    voxels[11:15, 10:22, 18:28] = 100
    scene = use_cycles((32, 32), samples=16)
    owner = import_raw(tmp_path, voxels)
    load_color(tmp_path, COLOR, alpha=1.0)
    scene.rle_splat.quality = "standard"
    floor, plate = add_white_floor(31.0), add_white_floor(31.0)
    floor.location.z, plate.location, plate.scale = 3.0, (23.0, 15.5, 15.1), (0.15, 0.15, 1.0)
    plate.visible_shadow = False
    add_sun()
    add_camera((15.5, 15.5, 60.0), type="ORTHO", ortho_scale=32.0)
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    light = rendered(tmp_path / "inside.exr")[..., 2] * math.sqrt(2.0)
    print(light[16].round(1))
    assert light[12:20, 7:14].mean() == pytest.approx(0.0, abs=0.1), "12 voxels to the left"
    assert light[2:8, :-1].mean() == pytest.approx(1.0, abs=0.03)
    assert light[13:19, 20:26].mean() == pytest.approx(1.0, abs=0.03), "the plate"
    owner.location.x = 1000.0
    assert rendered(tmp_path / "away.exr")[12:20, 7:14, 2].mean() > 0.6


def test_the_camera_does_not_see_the_grid(slab, tmp_path):
    """Neither against nothing, nor through it to a lamp-less mesh, nor from within."""
    bpy.data.objects["mesh"].hide_render = True
    add_mesh([(-9, -9, 3), (9, -9, 3), (9, 30, 3)], [(0, 1, 2)], color=(0.1, 0.2, 0.9))
    camera = bpy.context.scene.camera
    for place, kind in ((camera.location.copy(), "ORTHO"), ((6.0, 6.0, 16.0), "PERSP")):
        camera.location, camera.data.type = place, kind
        shots = []
        for state in ("off", "on"):
            force(state)
            update()
            shots.append(rendered(tmp_path / "seen.exr"))
            assert row_of().on == (state == "on")
        assert shots[0][..., 3].max() > 0.3
        assert np.array_equal(*shots)


def coat(one, **inputs):
    """Give a mesh a white Principled material; ``inputs``: of its shader."""
    material = bpy.data.materials.new("coat")
    if material.node_tree is None:
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    for name, value in {"Base Color": (1.0, 1.0, 1.0, 1.0), **inputs}.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    one.data.materials.append(material)


def test_the_grid_is_not_seen_through_glass(slab, tmp_path):
    """The slab's picture is, and the grid would be seen once more."""
    lid = add_mesh([(-30, -30, 30), (30, -30, 30), (30, 30, 30), (-30, 30, 30)], [(0, 1, 2, 3)])
    coat(lid, Transmission_Weight=1.0, Roughness=0.0)
    lid.visible_shadow = False
    shots = []
    for state in ("off", "on"):
        force(state)
        shots.append(rendered(tmp_path / "glass.exr")[12:20, 22:30, :3])
        assert row_of().on == (state == "on")
    off, on = (shot.mean(axis=(0, 1)) for shot in shots)
    print(f"without the grid {off}, with it {on}")
    assert off.max() > 0.3
    assert on == pytest.approx(off, abs=0.05), "noise; with the grid, 0.19"


def test_a_mirror_shows_the_lit_color_and_not_a_black_shape(grids_in_cycles, addon, tmp_path):
    """An opaque red cube beside a mirror that leans by 45 degrees, in which the camera above sees it."""
    bpy.context.scene.cycles.volume_step_rate = 0.25  # four steps a voxel
    owner = cube_scene(tmp_path, size=(16, 16), alpha=1.0)
    owner.location = (-20.0, 0.0, 0.0)
    mirror = add_mesh([(0, -3, 0), (6, -3, 6), (6, 9, 6), (0, 9, 0)], [(0, 1, 2, 3)])
    coat(mirror, Metallic=1.0, Roughness=0.0)
    add_sun()
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    middle = rendered(tmp_path / "mirror.exr")[6:10, 6:10, :3].mean(axis=(0, 1))
    print(f"the mirror shows {middle}")
    assert middle / middle[0] == pytest.approx(np.array(RED) / RED[0], abs=0.01)
    # From 5.0 on Cycles adds up more light than there is where it marches through dense matter.
    assert middle[0] == pytest.approx(RED[0], abs=0.01) if bpy.app.version < (5, 0) else middle[0] > 0.75
    force("off")
    assert rendered(tmp_path / "mirror.exr")[6:10, 6:10, :3].max() < 1e-3


def test_the_shadow_follows_edits_and_frames(slab, tmp_path, grid):
    """A curve, a clip object and the object's matrix; what was made before is used again."""
    render()
    first = grid().data.filepath
    dark = floor_light(tmp_path)[SHADOW].mean()
    assert grid().data.filepath == first
    load_color(tmp_path, COLOR, alpha=0.02)
    assert floor_light(tmp_path)[SHADOW].mean() > dark + 0.4
    assert grid().data.filepath != first
    load_color(tmp_path, COLOR, alpha=ALPHA)
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
    clip = bpy.context.view_layer.objects.active
    clip.location.x += 6.0
    update()
    light = floor_light(tmp_path)
    bpy.data.objects.remove(clip)
    whole = floor_light(tmp_path)
    assert grid().data.filepath == first
    assert (whole - light)[11:21, 3:8].mean() < -0.2 and abs((whole - light)[11:21, 12:16].mean()) < 0.05
    slab.keyframe_insert("location", frame=1)
    slab.location.y += 5.0
    slab.keyframe_insert("location", frame=2)
    bpy.context.scene.frame_set(2)
    moved = floor_light(tmp_path)
    assert centroid(1.0 - whole[:, :18])[1] - centroid(1.0 - moved[:, :18])[1] == pytest.approx(5.0, abs=0.2)


@pytest.fixture
def cube(addon, tmp_path):
    """A cube over a floor under a sun, included in renders; its grid is there, and no file yet."""
    owner = cube_scene(tmp_path, size=(4, 4))
    bpy.context.scene.cycles.volume_step_rate = 0.25  # four steps a voxel
    floor = add_white_floor(9.0)
    floor.location.z = -3.0
    add_sun()
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    return owner


def test_the_effect_says_why_it_is_on_or_off(cube, grid):
    def reason():
        assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
        return row_of().on, row_of().reason

    scene, sun = bpy.context.scene, bpy.data.objects["Sun"]
    assert reason() == (True, "cast by 1 sun") and not row_of().is_timed
    sun.data.use_shadow = False
    assert reason() == (False, "no light casts shadows")
    render()
    assert grid().data.filepath == "" and row_of().reason == "no light casts shadows"
    force("on")
    assert reason() == (True, "by hand: no light casts shadows")
    force("auto")
    sun.data.use_shadow = True
    bpy.data.objects["mesh"].hide_render = True
    assert reason() == (False, "no mesh can receive them")
    bpy.data.objects["mesh"].hide_render = False
    tree = bpy.data.objects["mesh"].material_slots[0].material.node_tree
    white, output = (
        next(node for node in tree.nodes if node.type == kind) for kind in ("BSDF_DIFFUSE", "OUTPUT_MATERIAL")
    )
    tree.nodes.remove(white)
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], output.inputs["Surface"])
    assert reason() == (False, "no mesh can receive them"), "as that of a slice"
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], output.inputs["Surface"])
    assert reason() == (True, "cast by 1 sun")
    scene.rle_splat.mode = "mip"
    assert reason() == (False, "the mode shows no surfaces")
    scene.rle_splat.mode = "composite"
    scene.render.engine = "BLENDER_WORKBENCH"
    assert reason() == (False, "this render engine casts none")
    scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
    assert reason() == (True, "cast by 1 sun, of an opaque surface in EEVEE")
    scene.render.engine = "CYCLES"
    force("off")
    assert reason() == (False, "by hand")
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    force("auto")
    assert reason() == (False, "renders do not include the volume") and grid() is None


def test_the_grid_is_no_part_of_what_viewports_and_our_pictures_show(cube, grid, bridge):
    shadow, depsgraph = grid(), bpy.context.evaluated_depsgraph_get()
    assert not shadow.visible_get() and shadow.hide_select and not shadow.visible_camera and shadow.parent == cube
    triangles = bridge("scene.render_scene").read_occluders(depsgraph)["triangles"]
    assert len(triangles) == 2, "the floor's"
    force("off")
    update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert grid() is None and len(bridge("scene.render_scene").read_occluders(depsgraph)["triangles"]) == 2
    left = *bpy.data.volumes, *bpy.data.materials, *bpy.data.meshes, *bpy.data.objects
    assert not [one for one in left if "Shadow" in one.name]
    force("auto")
    update()
    assert grid() is not None


@pytest.mark.parametrize("alpha", [1.0, 0.02])
def test_eevee_gets_the_surface_of_what_is_dense(cube, grid, bridge, tmp_path, alpha):
    """Its vertices in the evaluated scene of a render; Cycles gets it only if a mesh is close to the grid."""
    load_color(tmp_path, RED, alpha=alpha)
    surface, corners = bridge("render.mesh_shadows").surface_of(grid()), []
    assert not surface.visible_get() and not surface.visible_camera and surface.parent == grid()
    nodes = grid().data.materials[0].node_tree.nodes
    assert [node.target for node in nodes if node.type == "OUTPUT_MATERIAL"] == ["CYCLES"], "EEVEE 5.2 would draw it"

    def note(scene, depsgraph):
        mesh = surface.evaluated_get(depsgraph).data
        corners.append(np.array([vertex.co[:] for vertex in mesh.vertices]).reshape(-1, 3))

    render()
    path = Path(bpy.path.abspath(grid().data.filepath))
    bpy.context.scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
    depsgraph = bpy.context.evaluated_depsgraph_get()
    bridge("render.mesh_shadows").show(bpy.context.scene, {cube: (path, 1.0, False)})
    assert surface.modifiers[0].show_render and surface.modifiers[0].threshold == pytest.approx(math.log(2.0))
    grid().hide_viewport = surface.hide_viewport = False  # the evaluated scene of no render has what viewports show
    surface.modifiers[0].show_viewport = True
    for moved in (False, True):
        assert surface.modifiers[1].show_render == moved
        surface.modifiers[1].show_viewport = moved
        update()
        note(None, depsgraph)
        bpy.context.scene.render.engine = "CYCLES"
        bridge("render.mesh_shadows").show(bpy.context.scene, {cube: (path, 1.0, True)})
    floor = bpy.data.objects["mesh"]
    for height in (-3.0, -30.0):
        floor.location.z = height
        render()
        assert surface.modifiers[0].show_render == (height == -3.0)
    if alpha == 1.0:  # voxels 0 to 6, which end half-way to the next; in Cycles 1.5 voxels inward along normals
        assert corners[0].min() == pytest.approx(-0.9, abs=0.2) and corners[0].max() == pytest.approx(6.9, abs=0.2)
        assert np.quantile(corners[1], (0.2, 0.8)) == pytest.approx((-0.9 + 1.5, 6.9 - 1.5), abs=0.2)
    else:
        assert len(corners[0]) == 0, "too thin for a surface"


def test_a_file_is_saved_with_an_empty_grid_and_its_renders_fill_it(cube, grid, tmp_path):
    render()
    unsaved = Path(bpy.path.abspath(grid().data.filepath))
    assert unsaved.is_file() and "volume shadows" in unsaved.parts[-2]
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert Path(bpy.path.abspath(grid().data.filepath)) == unsaved
    bpy.ops.wm.open_mainfile(filepath=str(path))
    # Blender makes an empty path relative, too.
    assert not grid().data.filepath.endswith(".vdb") and grid().parent.rle_splat.is_volume
    render()
    beside = Path(bpy.path.abspath(grid().data.filepath))
    assert grid().data.filepath.startswith("//") and beside.parent == tmp_path / "scene volume shadows"
    assert beside.is_file() and beside.name == unsaved.name, "named after what it holds"


def test_old_files_are_deleted(cube, grid, bridge, tmp_path, monkeypatch):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    folder = tmp_path / "scene volume shadows"
    for step in range(7):
        cube.rle_splat.opacity_scale = 1.0 - 0.1 * step
        render()
    made = list(folder.iterdir())
    assert len(made) == 7, "another Blender may still want what was just made"
    for path in made:
        os.utime(path, ns=(0, path.stat().st_mtime_ns - 10**12))
    cube.rle_splat.opacity_scale = 0.2
    unlink = Path.unlink

    def refuse(path, missing_ok=False):
        if path in made:  # another Blender on Windows shows it
            raise PermissionError(13, "Access is denied")
        unlink(path, missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refuse)
        render()
    assert bpy.context.scene.rle_splat.message == "" and len(list(folder.iterdir())) == 8
    cube.rle_splat.opacity_scale = 0.1
    render()
    left = list(folder.iterdir())
    assert len(left) == bridge("render.mesh_shadows").KEPT + 2, "and what was shown and is shown"
    assert Path(bpy.path.abspath(grid().data.filepath)) in left


def test_deleting_the_volume_deletes_its_grid(cube, grid):
    render()
    with bpy.context.temp_override(selected_objects=[cube]):
        bpy.ops.object.delete()
    update()
    assert grid() is None and not bpy.data.volumes
    render()


def test_a_grid_removed_by_hand_takes_its_surface_along(cube, grid, bridge):
    bpy.data.objects.remove(grid())
    update()
    held = [one for one in bpy.data.objects if one.rle_splat.is_shadow_grid]
    assert len(held) == 2 and bridge("render.mesh_shadows").surface_of(grid()) in held
    assert [mesh.name for mesh in bpy.data.meshes if "Shadow" in mesh.name] == ["cube Shadow Surface"]


def test_copies_of_the_volume_and_of_the_scene(cube, grid, bridge):
    """A copied volume gets a grid of its own, whether that was copied, too, or not."""
    grids = bridge("render.mesh_shadows").grids
    copies = [cube.copy(), cube.copy(), grid().copy()]
    for one in copies:
        bpy.context.scene.collection.objects.link(one)
    copies[2].parent = copies[0]
    update()
    found = grids(bpy.context.scene)
    assert {one.parent for one in found} == {cube, *copies[:2]} and len(found) == 3
    assert len({one.data for one in found}) == 3
    assert len({bridge("render.mesh_shadows").surface_of(one) for one in found}) == 3
    copies[0].location.x += 9.0
    render()
    assert row_of().on and len({one.data.filepath for one in found}) == 2, "unlit, so that two have one content"
    copies[0].hide_render = True
    render()
    assert [bool(one.data.filepath) for one in found if one.parent == copies[0]] == [False]
    again = bpy.context.scene.copy()
    assert grids(again) == found, "scenes that share the volumes share their grids"


def test_undo_and_redo_leave_one_grid_that_renders_fill(cube, grid):
    bpy.ops.ed.undo_push(message="included")
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="removed")
    assert grid() is None
    bpy.ops.ed.undo()
    render()
    assert Path(bpy.path.abspath(grid().data.filepath)).is_file()
    bpy.ops.ed.redo()
    assert grid() is None


def test_a_linked_volume_casts_its_shadow_and_a_linked_scene_says_why_not(cube, grid, tmp_path):
    library = str(tmp_path / "library.blend")
    name = cube.name
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(library, link=True) as (_, into):
        into.objects = [name, "mesh", "Sun"]
    for one in into.objects:
        bpy.context.scene.collection.objects.link(one)
    use_cycles((4, 4))
    bpy.context.scene.cycles.volume_step_rate = 0.25  # four steps a voxel
    bpy.context.scene.rle_splat.scene_scale = 1.0
    add_camera((3.0, 3.0, 30.0), type="ORTHO", ortho_scale=12.0)
    bpy.context.view_layer.objects.active = into.objects[0]
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    render()
    assert row_of().on and grid().library is None and grid().parent == into.objects[0]
    assert Path(bpy.path.abspath(grid().data.filepath)).is_file()


def test_what_cannot_be_written_is_said_and_the_volume_drawn_all_the_same(cube, grid, tmp_path, bridge, monkeypatch):
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where a folder is wanted")
    monkeypatch.setattr(bridge("render.mesh_shadows"), "_folder", lambda: blocked / "inside")
    pixels = rendered(tmp_path / "drawn.exr")
    assert pixels[..., 0].max() > 0.3 and grid().data.filepath == ""
    problem = bpy.context.scene.rle_splat.render_problem
    assert "casts no shadow on meshes" in problem and "Traceback" not in problem
