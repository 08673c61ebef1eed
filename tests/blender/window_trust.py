"""What a user sees where something would once have been lost or gone blank without a word: a photograph of each case.

    python3 dev.py blender --photograph tests/blender/window_trust.py --size 1280x1400

keeps them in build/window-shots/window_trust.  Each step also asserts the sentence, where it is a property.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_trust_"))
SIDE = 40


def add_ball(name: str, x: float = 0.0):
    """A shaded ball of SIDE voxels, active and selected."""
    z, y, x_ = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    voxels = np.clip(300.0 - 16.0 * np.sqrt(x_**2 + y**2 + z**2), 0.0, 255.0).astype(np.uint8)
    owner = scenes.import_raw(FOLDER, voxels, name=name)
    owner.location.x = x
    return owner


def scene_with_camera():
    """An empty file with a camera that sees the ball, which the 3D view looks through."""
    yield from new_file()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    scene.render.engine = "BLENDER_WORKBENCH"
    middle = (SIDE - 1) / 2
    scenes.add_camera((middle, middle, 150.0), type="ORTHO", ortho_scale=2.2 * SIDE, clip_end=400.0)
    for area in window().screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.region_3d.view_perspective = "CAMERA"


def backdrop(**options):
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view(**options) == {"FINISHED"}


def settings():
    return bpy.context.scene.rle_splat


def picture_is_mine():
    """1: the user's image of our name is left alone, and the backdrop has its own."""
    yield from scene_with_camera()
    own = bpy.data.images.new("ball Splat Backdrop", 8, 8)
    add_ball("ball")
    backdrop()
    assert tuple(own.size) == (8, 8) and settings().image != own
    yield from photograph("01-identity")


def deleted_volume():
    """2: X takes the volume away; its backdrop goes too, with a sentence."""
    yield from scene_with_camera()
    add_ball("ball")
    backdrop(follow=True)
    yield
    with in_the_view():
        bpy.ops.object.delete()
    yield from until(lambda: settings().message)
    assert settings().message == "The volume 'ball' was deleted, so its backdrop was removed."
    yield from photograph("02-deletion")


def hidden_layer():
    """3: a render of a view layer that excludes the volume says so."""
    yield from scene_with_camera()
    owner = add_ball("ball")
    collection = bpy.data.collections.new("scan")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(owner)
    bpy.context.scene.collection.objects.unlink(owner)
    with in_the_view():
        bpy.ops.rle_splat.show_in_renders()
    bpy.context.view_layer.layer_collection.children["scan"].exclude = True
    bpy.ops.render.render()
    assert "excluded from view layer" in settings().message, settings().message
    yield from photograph("03-view-layer")


def failed_frame():
    """4: the file is missing at one of three frames: the message outlives the frames after it."""
    yield from scene_with_camera()
    owner = add_ball("ball")
    with in_the_view():
        bpy.ops.rle_splat.show_in_renders()
    right, scene = owner.rle_splat.filepath, bpy.context.scene

    def change_file(scene, *_):
        bpy.data.objects["ball"].rle_splat.filepath = right if scene.frame_current != 2 else str(FOLDER / "gone.raw")

    scene.frame_start, scene.frame_end = 1, 3
    scene.render.filepath = str(FOLDER / "frame_")
    bpy.app.handlers.frame_change_pre.append(change_file)
    bpy.ops.render.render(animation=True)
    bpy.app.handlers.frame_change_pre.remove(change_file)
    assert settings().failed_frames == "2" and "gone.raw" in settings().message, settings().message
    yield from show_image(bpy.data.images.load(str(FOLDER / "frame_0002.png")))
    yield from photograph("04-failed-frame")


def linked_volume():
    """5: a linked volume: what would be lost on reload cannot be edited."""
    yield from new_file()
    panel_states.linked(FOLDER)
    try:
        bpy.ops.rle_splat.apply_preset(preset="ct-bone")
    except RuntimeError as refusal:
        assert "library override" in str(refusal)
    else:
        raise AssertionError("a linked volume was edited")
    yield from photograph("05-linked")


def edited_by_a_script():
    """6: colors set by a script are followed; points of a curve, of which Blender sends no event, once it is tagged."""
    yield from scene_with_camera()
    owner = add_ball("ball")
    backdrop(follow=True)
    yield from photograph("06-before-a-scripts-edit")
    before = scenes.image_pixels(settings().image)
    ramp = owner.rle_splat.transfer.nodes["Color"].color_ramp
    for element in ramp.elements:
        element.color = (0.1, 0.4, 1.0, 1.0)
    yield from until(lambda: np.abs(scenes.image_pixels(settings().image) - before).max() > 0.1)
    yield from photograph("06-after-a-scripts-edit")
    scenes.lower_curve(owner)
    owner.rle_splat.transfer.update_tag()
    yield from until(lambda: scenes.image_pixels(settings().image)[..., 3].max() == 0.0)


def meshes_occlude():
    """7: Render to Image obeys Meshes Hide Volume, as the backdrop and renders do."""
    yield from scene_with_camera()
    add_ball("ball")
    plane = scenes.add_mesh([(-50, -50, 90), (20, -50, 90), (20, 90, 90), (-50, 90, 90)], [(0, 1, 2, 3)])
    plane.select_set(False)
    with in_the_view():
        bpy.ops.rle_splat.render_image()
    yield from show_image(settings().image)
    yield from photograph("07-meshes-occlude")


def guessed_name():
    """8: the import dialog of a little-endian file whose name begins with "big"."""
    yield from new_file()
    values = np.linspace(0, 900, 32**3).astype("<u2").reshape(32, 32, 32)
    path = FOLDER / "big_head_32x32x32_uint16.raw"
    path.write_bytes(values.tobytes())
    with in_the_view():
        bpy.ops.rle_splat.import_volume("EXEC_DEFAULT", filepath=str(path))
    owner = bpy.context.object
    assert owner.rle_splat.value_high == 900.0
    yield from photograph("08-guessing")


def undone_settings():
    """9 and 11: undo takes settings back but not pixels, and the panel says so."""
    yield from scene_with_camera()
    owner = add_ball("ball")
    with in_the_view():
        bpy.ops.ed.undo_push(message="imported")
        owner.rle_splat.opacity_scale = 0.05
        bpy.ops.ed.undo_push(message="opacity")
        bpy.ops.rle_splat.preview_in_camera_view()
        bpy.ops.ed.undo_push(message="backdrop")
        bpy.context.object.rle_splat.opacity_scale = 2.0
        bpy.ops.ed.undo_push(message="opacity again")
        bpy.ops.rle_splat.preview_in_camera_view()
        bpy.ops.ed.undo()
    freshness = module("bridge.pictures.outdated")
    yield from until(lambda: freshness.out_of_date(bpy.context.scene))
    yield from photograph("09-undone-settings")


def preferences():
    """9: where pictures are kept."""
    yield from new_file()
    bpy.context.preferences.active_section = "ADDONS"
    bpy.context.window_manager.addon_search = "RLE Splat"
    area_of("PROPERTIES").type = "PREFERENCES"
    yield
    bpy.ops.preferences.addon_expand(module=MODULE)
    yield from photograph("09-preferences")


def broken_transfer():
    """10: a node of the transfer function was deleted."""
    yield from scene_with_camera()
    owner = add_ball("ball")
    tree = owner.rle_splat.transfer
    tree.nodes.remove(tree.nodes["Opacity"])
    yield from photograph("10-transfer-function-without-a-node")


def without_shadows():
    """11: a maximum error says what it leaves out."""
    yield from scene_with_camera()
    add_ball("ball")
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    bpy.context.scene.collection.objects.link(light)
    settings().max_error = 4.0
    yield from photograph("11-maximum-error")


def missing_file():
    """12: the file of one of two volumes is gone when the .blend is opened.

    The viewport says so, the button that mends it is beside the sentence in the tab, and the other volume is drawn.
    """
    live = module("bridge.live")
    yield from scene_with_camera()
    add_ball("ball")
    path = Path(add_ball("gone", SIDE).rle_splat.filepath)
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "missing.blend"))
    away = path.rename(FOLDER / "elsewhere.raw")
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "missing.blend"))
    yield from until(lambda: live.problem_of(area_of("VIEW_3D")))
    assert "gone.raw" in live.problem_of(area_of("VIEW_3D"))
    (viewport,) = live.viewports_of(area_of("VIEW_3D"))
    yield from until(lambda: viewport.pictures and not viewport.is_busy)
    yield from photograph("12-missing-file")
    away.rename(path)
    bpy.context.view_layer.objects.active = bpy.data.objects["gone"]
    with in_the_view():
        bpy.ops.rle_splat.relocate_volume("EXEC_DEFAULT", filepath=str(path), use_dialog=False)
    yield from until(lambda: not live.problem_of(area_of("VIEW_3D")) and len(viewport._contents) == 2)
    yield from until(lambda: not viewport.is_busy)
    yield from photograph("12-file-found-again")


def show_image(image):
    """Show an image in place of the Properties editor, all of it."""
    editor = area_of("PROPERTIES")
    editor.type = "IMAGE_EDITOR"
    editor.spaces.active.image = image
    yield
    with bpy.context.temp_override(window=window(), area=editor, region=region_of(editor, "WINDOW")):
        bpy.ops.image.view_all(fit_view=True)


def scenario():
    open_panels("RLE_SPLAT_PT_transfer", "RLE_SPLAT_PT_picture", "RLE_SPLAT_PT_scan", "RLE_SPLAT_PT_advanced")
    for step in (
        picture_is_mine, deleted_volume, hidden_layer, failed_frame, linked_volume, edited_by_a_script, meshes_occlude,
        guessed_name, undone_settings, preferences, broken_transfer, without_shadows,
        missing_file,
    ):  # fmt: skip
        yield from step()
        passed(step.__name__)


drive(scenario, overlap=False)
