"""The volume live in the 3D views of a real window: colors in each shading mode, alignment with a mesh of the same box,
meshes inside the volume, kinds of views, and how often it is drafted and refined.  dev.py test runs it."""

import os
import tempfile
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler

from tests.blender.real_blender import N, import_cube, pixels_of
from tests.blender.scenes import module
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    passed,
    photograph,
    region_of,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_live_"))
COLOR = (0.5, 0.18, 0.05)  # linear; Standard shows it as DISPLAYED
DISPLAYED = (188, 118, 63)
BEHIND_GREEN = (137, 118, 29)  # through glass of the color (0.5, 1, 0.25)
NEAR = 3  # levels: two conversions to half precision, and a screen of 8 bits
MIDDLE = (0.5 * (N - 1),) * 3
ALIGNED = 0.6  # pixels between the middles of the volume and of the box around it, on pixels of a screen


def live():
    return module("bridge.live")


def view():
    """The state of the largest 3D view's window region."""
    return area_of("VIEW_3D").spaces.active.region_3d


def viewport():
    return live().viewports_of(area_of("VIEW_3D"))[0]


def counts():
    found = live().viewports_of(area_of("VIEW_3D"))
    return found[0].counts.copy() if found else {}


def settled():
    """Wait until the picture of the view as it is now has been refined."""
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    yield from until(lambda: live().viewports_of(area_of("VIEW_3D")) and not viewport().is_busy)
    assert not viewport().problem, viewport().problem
    yield


def screen(name: str):
    """A photograph of the screen: (H, W, 3) float, 0 to 255, row 0 at the top."""
    image = bpy.data.images.load(str(Path(os.environ[SHOTS]) / f"{name}.png"))
    flat = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(flat)
    pixels = flat.reshape(image.size[1], image.size[0], 4)[::-1, :, :3] * 255.0
    bpy.data.images.remove(image)
    return pixels


def at(pixels, point):
    """The color of a photograph where the view shows a point of the world."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    place = location_3d_to_region_2d(region, view(), point)
    column, row = int(region.x + place.x), int(len(pixels) - region.y - place.y)
    return pixels[row, column]


def look(rotation=(0.0, 0.0, 0.0), distance=22.0, kind="PERSP"):
    held = view()
    held.view_perspective = kind
    held.view_location, held.view_distance = MIDDLE, distance
    held.view_rotation = Euler(tuple(map(radians, rotation))).to_quaternion()
    held.update()


def set_up():
    yield from new_file()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    scene.rle_splat.quality = "standard"
    with in_the_view():
        volume = import_cube(FOLDER)
    functions = module("rle_splat.classify.transfer_function")
    module("bridge.look.transfer").write_transfer(volume, functions.TransferFunction(
        name="opaque", unit=None, opacity=((0.0, 0.9), (255.0, 0.9)), color=((0.0, *COLOR), (255.0, *COLOR)),
        opacity_unit_distance=1.0, shade=None))  # fmt: skip
    scene.rle_splat.classification = "post"
    area_of("VIEW_3D").spaces.active.show_region_ui = False
    overlay = area_of("VIEW_3D").spaces.active.overlay
    overlay.show_cursor = overlay.show_object_origins = overlay.show_extras = False
    look()
    return volume


SHADINGS = [
    ("SOLID", "BLENDER_WORKBENCH"), ("MATERIAL", "BLENDER_EEVEE"), ("RENDERED", "BLENDER_EEVEE"),
    ("RENDERED", "CYCLES"), ("RENDERED", "BLENDER_WORKBENCH"), ("WIREFRAME", "BLENDER_WORKBENCH"),
]  # fmt: skip


def check_shadings():
    """The color of an opaque volume is what Standard makes of it, in every shading mode, with and without overlays."""
    space = area_of("VIEW_3D").spaces.active
    for shading, engine in SHADINGS:
        bpy.context.scene.render.engine = engine
        space.shading.type = shading
        for overlays in (True, False):
            space.overlay.show_overlays = overlays
            yield from settled()
            name = f"{shading.lower()}_{engine.lower()}{'' if overlays else '_bare'}"
            yield from photograph(name)
            shown = at(screen(name), (MIDDLE[0] + 0.6, MIDDLE[1] + 0.7, N - 1))
            np.testing.assert_allclose(shown, DISPLAYED, atol=NEAR, err_msg=name)
    space.overlay.show_overlays = True
    space.shading.type = "SOLID"


def add_box(low, high):
    """A mesh of a box, in the color that the viewport gives to objects."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    mesh = bpy.data.meshes.new("box")
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata(corners, [], faces)
    box = bpy.data.objects.new("box", mesh)
    box.color = (0.1, 0.1, 0.9, 1.0)
    bpy.context.scene.collection.objects.link(box)
    return box


def outline(pixels, background):
    """(left, top, right, bottom) of what differs from the background in the view."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    top = len(pixels) - region.y - region.height
    part = (slice(top + 90, top + region.height - 40), slice(region.x + 60, region.x + region.width - 60))
    rows, columns = np.nonzero(np.abs(pixels[part] - background[part]).max(axis=2) > 24)
    return np.array((columns.min(), rows.min(), columns.max() + 1, rows.max() + 1), float)


def check_alignment(volume):
    """The volume lies where a mesh of the same box does, in perspective, orthographic and camera views."""
    space = area_of("VIEW_3D").spaces.active
    space.shading.light, space.shading.color_type = "FLAT", "OBJECT"
    space.overlay.show_overlays = False
    box = add_box((0.0,) * 3, (N - 1.0,) * 3)
    camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    camera.data.shift_x, camera.data.lens = 0.1, 40.0
    camera.location = (MIDDLE[0], MIDDLE[1], 30.0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    for kind in ("PERSP", "ORTHO", "CAMERA"):
        look((20.0, 0.0, 30.0) if kind != "CAMERA" else (0.0, 0.0, 0.0), kind=kind)
        view().view_camera_zoom, view().view_camera_offset = 10.0, (0.05, -0.04)
        outlines = []
        background = None
        for shown in ("nothing", "box", "volume"):
            box.hide_set(shown != "box")
            space.show_object_viewport_volume = shown == "volume"
            if shown == "volume":
                yield from settled()
            name = f"aligned_{kind.lower()}_{shown}"
            yield from photograph(name)
            pixels = screen(name)
            if shown == "nothing":
                background = pixels
            else:
                outlines.append(outline(pixels, background))
        middles = [0.5 * (one[:2] + one[2:]) for one in outlines]
        print(f"{kind}: box {outlines[0]}, volume {outlines[1]}", flush=True)
        np.testing.assert_allclose(middles[0], middles[1], atol=ALIGNED, err_msg=kind)
        np.testing.assert_allclose(outlines[0], outlines[1], atol=2.0, err_msg=kind)
    bpy.data.objects.remove(box)
    space.overlay.show_overlays = True


def check_mesh_inside():
    """A mesh in the volume hides what lies behind it and is hidden by what lies before it; moving it redraws."""
    box = add_box((-2.0, -2.0, -1.0), (MIDDLE[0], N + 1.0, N + 1.0))
    look((0.0, 0.0, 0.0))
    yield from settled()
    yield from photograph("mesh_before")
    pixels = screen("mesh_before")
    left, right = at(pixels, (1.5, 4.4, N + 1.0)), at(pixels, (6.5, 4.4, N - 1.0))
    np.testing.assert_allclose(right, DISPLAYED, atol=NEAR)
    assert left[2] > 120 and left[0] < 100, f"the box hides nothing: {left}"
    yield from check_mesh_hides_in_every_shading()
    before = counts()
    box.location.z = -4.0  # its front face now lies two units below the volume's, which hide nearly all of it
    yield from settled()
    yield from photograph("mesh_inside")
    left = at(screen("mesh_inside"), (1.5, 4.4, N - 1.0))
    np.testing.assert_allclose(left, DISPLAYED, atol=8.0, err_msg="two units of an opaque volume before the box")
    assert counts()["drafts"] > before["drafts"]
    bpy.data.objects.remove(box)
    yield from settled()


def check_mesh_hides_in_every_shading():
    """A mesh before the volume hides it by its depth, and by its triangles where an engine leaves no depth."""
    space = area_of("VIEW_3D").spaces.active
    for shading, engine in (("MATERIAL", "BLENDER_EEVEE"), ("RENDERED", "CYCLES")):
        bpy.context.scene.render.engine, space.shading.type = engine, shading
        for overlays in (True, False):
            space.overlay.show_overlays = overlays
            for _ in range(3):  # an engine may have its depth some redraws later
                yield from settled()
            name = f"mesh_{shading.lower()}{'' if overlays else '_bare'}"
            yield from photograph(name)
            pixels = screen(name)
            left, right = at(pixels, (1.5, 4.4, N + 1.0)), at(pixels, (6.5, 4.4, N - 1.0))
            np.testing.assert_allclose(right, DISPLAYED, atol=NEAR, err_msg=name)
            assert np.abs(left - DISPLAYED).max() > 40.0, f"{name}: the box hides nothing: {left}"
    space.overlay.show_overlays, space.shading.type = True, "SOLID"
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    yield from settled()


def check_glass():
    """A volume in a box of green glass is seen tinted where materials are shown, and hidden in Solid shading."""
    box = add_box((-2.0, -2.0, -1.0), (MIDDLE[0], N + 1.0, N + 1.0))
    glass = bpy.data.materials.new("glass")
    tree = glass.node_tree
    shader = tree.nodes.new("ShaderNodeBsdfGlass")
    shader.inputs["Color"].default_value = (0.5, 1.0, 0.25, 1.0)
    tree.links.new(shader.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
    box.data.materials.append(glass)
    space = area_of("VIEW_3D").spaces.active
    look()
    for shading, engine in (
        ("MATERIAL", "BLENDER_EEVEE"), ("RENDERED", "BLENDER_EEVEE"), ("RENDERED", "CYCLES"),
        ("SOLID", "BLENDER_WORKBENCH"),
    ):  # fmt: skip
        bpy.context.scene.render.engine, space.shading.type = engine, shading
        for _ in range(3):
            yield from settled()
        name = f"glass_{shading.lower()}_{engine.lower()}"
        yield from photograph(name)
        pixels = screen(name)
        left, right = at(pixels, (1.5, 4.4, N + 1.0)), at(pixels, (6.5, 4.4, N - 1.0))
        np.testing.assert_allclose(right, DISPLAYED, atol=NEAR, err_msg=name)
        if shading == "SOLID":
            assert left[2] > 120 and left[0] < 100, f"{name}: solid glass hides nothing: {left}"
        else:
            np.testing.assert_allclose(left, BEHIND_GREEN, atol=NEAR, err_msg=name)
    bpy.data.objects.remove(box)
    bpy.data.materials.remove(glass)
    yield from settled()


def check_equals_render_image():
    """The refined picture is that of Render to Image through a camera with the same view, within one level."""
    scene = bpy.context.scene
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    scene.render.resolution_x, scene.render.resolution_y = region.width, region.height
    scene.render.resolution_percentage = 100
    camera = scene.camera
    camera.location, camera.rotation_euler = (10.0, -14.0, 16.0), (0.8, 0.05, 0.35)
    space = area_of("VIEW_3D").spaces.active
    space.overlay.show_overlays = False  # lines of the box would hide a part
    look(kind="CAMERA")
    yield from settled()
    held = viewport()
    seen, (picture,) = held._shot.view.camera, held.pictures  # with the view's own zoom and offset
    camera.data.sensor_fit, camera.data.lens = "HORIZONTAL", seen.lens * camera.data.sensor_width / seen.sensor_width
    camera.data.shift_x, camera.data.shift_y = seen.shift_x, seen.shift_y
    yield
    with in_the_view():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    whole = pixels_of(scene.rle_splat.image)
    left, top, right, bottom = (round(share * side) for share, side in zip(picture.place, 2 * whole.shape[1::-1]))
    levels = 255.0 * np.abs(whole[top:bottom, left:right] - picture.rgba)
    print(f"against Render to Image: at most {levels.max():.3f} levels", flush=True)
    assert picture.rgba[..., 3].max() > 0.9 and levels.max() < 1.0
    assert whole[..., 3].sum() < picture.rgba[..., 3].sum() * 1.001, "the part leaves something out"
    space.overlay.show_overlays = True
    look()
    yield from settled()


def check_unchanged():
    """Redraws of an unchanged view draft and refine nothing; neither does selecting an object."""
    yield from settled()
    before = counts()
    for selected in (True, False, True):
        bpy.context.view_layer.objects.active.select_set(selected)
        area_of("VIEW_3D").tag_redraw()
        yield
    after = counts()
    assert (after["drafts"], after["refinements"]) == (before["drafts"], before["refinements"]), (before, after)


def check_orbit():
    """While the view turns there are drafts; a picture is refined once it is still."""
    before = counts()
    steps = 12
    for n in range(steps):
        look((40.0, 0.0, 10.0 * n))
        area_of("VIEW_3D").tag_redraw()
        yield
    yield from settled()
    after = counts()
    drafts, refined = (after[name] - before[name] for name in ("drafts", "refinements"))
    print(f"orbit of {steps} steps: {drafts} drafts, {refined} refinements", flush=True)
    assert drafts >= 3 and 1 <= refined <= steps
    yield from photograph("orbit_end")


def check_inside():
    """The eye inside the volume."""
    look((70.0, 0.0, 20.0), distance=0.5)
    yield from settled()
    yield from photograph("inside")
    np.testing.assert_allclose(screen("inside")[320, 400], DISPLAYED, atol=NEAR)
    look()


def check_edit(volume):
    """An edit of the object, a property and undo show at once."""
    yield from settled()
    before = counts()
    volume.location.x += 2.0
    yield from settled()
    middle = counts()
    assert middle["refinements"] > before["refinements"], "moving the volume shows nothing"
    volume.rle_splat.opacity_scale = 0.1
    yield from settled()
    assert counts()["refinements"] > middle["refinements"], "an edit of the transfer function shows nothing"
    volume.rle_splat.opacity_scale = 1.0
    yield from settled()
    middle = counts()
    tree = volume.rle_splat.transfer
    tree.nodes["Opacity"].mapping.curves[0].points[0].location.y = 0.5
    tree.update_tag()  # as an edit in the panel does; nothing else asks for a redraw
    yield from until(lambda: counts()["refinements"] > middle["refinements"])
    yield from settled()
    tree.nodes["Opacity"].mapping.curves[0].points[0].location.y = 0.9
    tree.update_tag()
    volume.location.x -= 2.0
    yield from settled()


def check_quad_view():
    """Each of four regions shows the volume in its own view."""
    with in_the_view():
        bpy.ops.screen.region_quadview()
    yield
    yield from until(lambda: len(live().viewports_of(area_of("VIEW_3D"))) == 4)
    yield from until(lambda: not any(one.is_busy for one in live().viewports_of(area_of("VIEW_3D"))))
    assert all(one.pictures and not one.problem for one in live().viewports_of(area_of("VIEW_3D")))
    yield from photograph("quad")
    with in_the_view():
        bpy.ops.screen.region_quadview()
    yield
    yield from settled()


def check_local_view(volume):
    """In a local view without the volume nothing is drawn."""
    other = add_box((20.0,) * 3, (21.0,) * 3)
    for one in bpy.context.view_layer.objects:
        one.select_set(one == other)
    with in_the_view():
        bpy.ops.view3d.localview(frame_selected=False)
    yield
    yield
    assert not live().viewports_of(area_of("VIEW_3D")), "the volume is shown in another object's local view"
    with in_the_view():
        bpy.ops.view3d.localview(frame_selected=False)
    yield from settled()
    bpy.data.objects.remove(other)
    volume.select_set(True)


def check_switch():
    """The switch of the viewport; when it is off, handlers return at once."""
    space = area_of("VIEW_3D").spaces.active
    yield from settled()
    space.show_object_viewport_volume = False
    area_of("VIEW_3D").tag_redraw()
    yield
    before = live().calls.copy()
    for _ in range(3):
        area_of("VIEW_3D").tag_redraw()
        yield
    after = live().calls
    assert after["before"] > before["before"] and after["drawn"] == before["drawn"]
    assert not live().viewports_of(area_of("VIEW_3D")), "pictures are kept"
    space.show_object_viewport_volume = True
    yield from settled()


def check_failure():
    """A failure shows one sentence in the panel, not a traceback per redraw, and Try Again ends it."""
    surface = module("bridge.live.surface")
    contents = surface.BlenderSurface.contents
    calls = []

    def fail(*_arguments):
        calls.append(1)
        raise ValueError("no depth")

    surface.BlenderSurface.contents = fail
    live().try_again(area_of("VIEW_3D"))
    for _ in range(4):
        area_of("VIEW_3D").tag_redraw()
        yield
    assert len(calls) == 1 and "no depth" in live().problem_of(area_of("VIEW_3D"))
    area_of("VIEW_3D").spaces.active.show_region_ui = True
    yield from photograph("failure")
    area_of("VIEW_3D").spaces.active.show_region_ui = False
    surface.BlenderSurface.contents = contents
    with in_the_view():
        assert bpy.ops.rle_splat.try_again() == {"FINISHED"}
    yield from settled()
    assert viewport().pictures


def check_closed():
    """A viewport that is closed while it is refined is forgotten, without a complaint."""
    area = area_of("VIEW_3D")
    look((33.0, 0.0, 12.0))
    area.tag_redraw()
    yield from until(lambda: viewport().is_busy)
    closed = viewport()
    area.type = "CONSOLE"
    yield from until(lambda: not closed.is_busy and not closed.pictures)
    area.type = "VIEW_3D"
    yield
    yield from settled()
    assert len(live()._lives) == 1, "closed viewports are kept"
    look()
    yield from settled()


def check_render(volume):
    """During F12 nothing of it runs."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 64
    scene.render.resolution_x, scene.render.resolution_y = 400, 300
    ended, drawn = [], []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append(True))
    with in_the_view():
        assert bpy.ops.render.render("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    at_start = live().calls["drawn"]
    look((10.0, 0.0, 10.0))
    while not ended:
        area_of("VIEW_3D").tag_redraw()
        yield
        if bpy.app.is_job_running("RENDER"):
            drawn.append(live().calls["drawn"] - at_start)
    print(f"redraws looked at during a render: {drawn}", flush=True)
    assert len(drawn) > 1 and not any(drawn[1:])
    yield from settled()
    scene.render.engine = "BLENDER_WORKBENCH"


def check_without_volumes(volume):
    """Without a volume handlers return at once, and a file that is loaded while a picture is refined is no problem."""
    look((5.0, 0.0, 5.0))
    area_of("VIEW_3D").tag_redraw()
    yield
    yield from new_file()
    before = live().calls.copy()
    for _ in range(3):
        area_of("VIEW_3D").tag_redraw()
        yield
    after = live().calls
    assert after["before"] > before["before"] and after["drawn"] == before["drawn"]
    assert not live().viewports_of(area_of("VIEW_3D"))


def scenario():
    volume = yield from set_up()
    name = volume.name
    yield from settled()
    yield from photograph("first")
    for check in (
        check_shadings, check_alignment, check_mesh_inside, check_glass, check_equals_render_image,
        check_unchanged, check_orbit, check_inside, check_edit, check_quad_view, check_local_view, check_switch,
        check_failure, check_closed, check_render, check_without_volumes,
    ):  # fmt: skip
        wants = check.__code__.co_argcount
        yield from check(*[bpy.data.objects[name]] * wants)
        passed(check.__name__)


drive(scenario)
