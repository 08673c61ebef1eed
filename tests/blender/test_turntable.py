"""Turntable: the camera turns about the volume and sees all of it, files are written, and no setting is lost."""

from math import radians
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix

from tests.blender import scenes
from tests.blender.scenes import module

pytestmark = pytest.mark.usefixtures("by_numpy")

FRAMES = 4


@pytest.fixture
def cube(tmp_path):
    owner = scenes.cube_scene(tmp_path)
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 11, 250
    return owner


def turn(tmp_path=None, **options):
    path = {} if tmp_path is None else {"filepath": str(tmp_path / "new" / "turn")}
    done = bpy.ops.rle_splat.turntable(**{"frames": FRAMES, "render": tmp_path is not None, **path, **options})
    assert done == {"FINISHED"}


def settings() -> dict:
    """All output settings of the scene, its camera and frames, and the cameras of its markers."""
    scene = bpy.context.scene
    groups = (scene.render, scene.render.image_settings, scene.render.ffmpeg, scene.view_settings)
    found = {
        (group.bl_rna.identifier, entry.identifier): getattr(group, entry.identifier)
        for group in groups for entry in group.bl_rna.properties
        if entry.type in ("INT", "FLOAT", "BOOLEAN", "ENUM", "STRING") and not getattr(entry, "is_array", False)
    }  # fmt: skip
    found.pop(("RenderSettings", "use_lock_interface"))  # on as long as renders include a volume
    markers = [(one.name, one.frame, one.camera) for one in scene.timeline_markers]
    return {**found, "camera": scene.camera, "world": scene.world, "markers": markers, "frame": scene.frame_current,
            "frames": (scene.frame_start, scene.frame_end, scene.frame_step)}  # fmt: skip


def corners_in_view(frame, bridge, owner):
    """(8, 3): the corners of the volume's box in the picture of a frame, 0 to 1 from its lower left."""
    scene = bpy.context.scene
    scenes.to_frame(frame)
    from_box = bridge("volumes.box").world_corners(owner)
    return np.array([world_to_camera_view(scene, scene.camera, Matrix.Translation(p).translation) for p in from_box])


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("size", [(64, 32), (20, 40)])
def test_all_of_the_volume_is_seen_from_every_side(cube, bridge, perspective, size):
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = size
    cube.matrix_world = Matrix.Rotation(1.0, 4, "X") @ Matrix.Diagonal((1.0, 3.0, 0.5, 1.0))
    scenes.update()
    turn(perspective=perspective, elevation=35.0, frames=24)
    seen = np.array([corners_in_view(frame, bridge, cube) for frame in range(11, 35)])
    assert 0.0 < seen[..., :2].min() and seen[..., :2].max() < 1.0
    assert np.abs(seen[..., :2] - 0.5).max() > 0.44  # and it fills the picture
    assert seen[..., 2].min() > bpy.context.scene.camera.data.clip_start


def test_a_full_turn_closes_and_an_arc_ends_at_its_end(cube):
    for angle, step in ((360.0, 90.0), (-90.0, -30.0)):
        turn(angle=angle, azimuth=10.0)
        camera = bpy.context.scene.camera
        angles = []
        for frame in range(11, 11 + FRAMES):
            scenes.to_frame(frame)
            angles.append(camera.parent.rotation_euler[2])
        np.testing.assert_allclose(angles, np.radians(10.0 + step * np.arange(FRAMES)), atol=1e-5)
    assert sum(one.type == "CAMERA" for one in bpy.data.objects) == 2  # the second turn took the first one's camera


def test_the_camera_turns_about_a_patients_own_axis(cube, bridge):
    """As the command line's turntable: 0 and 0 look at the face, a positive azimuth moves to the patient's left."""
    cube.rle_splat.space = "patient"
    placed = Matrix.Translation((5.0, 6.0, 7.0)) @ Matrix.Rotation(0.7, 4, "X") @ Matrix.Rotation(0.4, 4, "Z")
    cube.matrix_world = placed
    scenes.update()
    turn(azimuth=0.0, angle=360.0, elevation=0.0)
    to_patient = np.array(placed.inverted())
    middle = np.append(bridge("volumes.box").world_corners(cube).mean(axis=0), 1.0)
    for frame, side in ((11, (0, -1, 0)), (12, (1, 0, 0))):
        scenes.to_frame(frame)
        matrix = np.array(bpy.context.scene.camera.matrix_world)
        away = (to_patient @ (matrix[:, 3] - middle))[:3]
        np.testing.assert_allclose(away / np.linalg.norm(away), side, atol=1e-5)
        np.testing.assert_allclose(to_patient[:3, :3] @ matrix[:3, 1], (0, 0, 1), atol=1e-5)  # the head is up


@pytest.mark.parametrize(("output", "extension"), [("PNG", "png"), ("EXR", "exr")])
def test_pictures_are_written_and_no_setting_is_lost(cube, tmp_path, output, extension):
    scene = bpy.context.scene
    other = scene.camera
    marker = scene.timeline_markers.new("to the other", frame=12)
    marker.camera = other
    scene.render.filepath, scene.render.image_settings.file_format = "//mine_", "JPEG"
    scene.render.image_settings.quality, scene.render.use_overwrite = 31, False
    before = settings()
    turn(tmp_path, frames=2, output=output)
    assert settings() == before
    files = sorted((tmp_path / "new").iterdir())
    assert [file.name for file in files] == [f"turn_00{frame}.{extension}" for frame in (11, 12)]
    pictures = [scenes.load_pixels(file) for file in files]
    for pixels in pictures:
        assert pixels[12, 12, 3] > 0.5 and pixels[0, 0, 3] < 0.01  # through the new camera, not the marker's
    assert scene.rle_splat.use_composite


def test_a_movie_is_written_and_no_setting_is_lost(cube, tmp_path, refused):
    if not bpy.app.ffmpeg.supported:
        refused(bpy.ops.rle_splat.turntable, "without FFmpeg", filepath=str(tmp_path / "turn"))
        return
    bpy.context.scene.render.resolution_x = 32
    before = settings()
    turn(tmp_path, frames=3, output="MP4")
    assert settings() == before
    movie = tmp_path / "new" / "turn.mp4"
    assert [file.name for file in movie.parent.iterdir()] == [movie.name]
    assert bpy.data.movieclips.load(str(movie)).frame_duration == 3


@pytest.mark.parametrize(("output", "typed", "final"), [
    ("MP4", "turn", "turn.mp4"), ("MP4", "turn.png", "turn.mp4"), ("MP4", "turn_####.png", "turn.mp4"),
    ("PNG", "turn", "turn_####.png"), ("PNG", "turn.mp4", "turn_####.png"), ("EXR", "a.b #", "a.b #.exr"),
])  # fmt: skip
def test_the_file_browser_completes_the_name(cube, output, typed, final):
    """So that it marks the name in red where that file is there."""
    dialog = SimpleNamespace(output=output, filepath=f"/there/{typed}")
    check = bpy.types.RLE_SPLAT_OT_turntable.check
    assert check(dialog, bpy.context) is True and dialog.filepath == f"/there/{final}"
    assert check(dialog, bpy.context) is False
    assert bpy.ops.rle_splat.turntable.get_rna_type().properties["check_existing"].default


def test_a_dialog_writes_over_no_pictures_and_nothing_over_a_scan(cube, bridge, core, tmp_path):
    settings, scene = bridge("render.output_settings"), bpy.context.scene
    settings.write_to(scene, "PNG", str(tmp_path / "turn"))
    for were_typed in (True, False):
        settings.check_frames(scene, range(11, 14), were_typed)
    (tmp_path / "turn_0013.png").write_bytes(b"of another volume")
    settings.check_frames(scene, range(11, 14), False)
    with pytest.raises(core("scene").RleSplatError, match=r"turn_0013\.png is there already; give another name"):
        settings.check_frames(scene, range(11, 14), True)
    cube.rle_splat.filepath = str(tmp_path / "turn_0013.png")
    with pytest.raises(core("scene").RleSplatError, match="is the file that 'cube' is read from"):
        settings.check_frames(scene, range(11, 14), False)


def test_the_default_name_is_free(cube, bridge, tmp_path):
    settings = bridge("render.output_settings")

    def free():
        return settings.free_path("turn", ".mp4", lambda path: not Path(path).exists())

    assert free() == "turn.mp4"  # the file browser says where
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for number in ("", " 2", " 3"):
        assert free() == str(tmp_path / f"turn{number}.mp4")
        Path(free()).touch()


def test_the_active_cameras_own_motion_is_rendered(cube, tmp_path):
    scene, camera = bpy.context.scene, bpy.context.scene.camera
    scene.frame_end = 12
    scenes.to_frame(11)
    for frame, x in ((11, 3.0), (12, 5.0)):
        camera.location.x = x
        camera.keyframe_insert("location", index=0, frame=frame)
    turn(tmp_path, path="CAMERA", output="EXR")
    assert scene.camera == camera and sum(one.type == "CAMERA" for one in scene.objects) == 1
    first, second = (scenes.load_pixels(tmp_path / "new" / f"turn_00{frame}.exr")[..., 3] for frame in (11, 12))
    np.testing.assert_allclose(scenes.centroid(second) - scenes.centroid(first), (-4.0, 0.0), atol=0.05)


def test_what_cannot_be_rendered_is_refused(cube, tmp_path):
    scene = bpy.context.scene
    before = settings()
    for options, words in (
        ({"filepath": ""}, "no file name"),
        ({"filepath": str(tmp_path) + "/"}, "folder"),
        ({"filepath": str(tmp_path / "cube.raw" / "a")}, "cannot be made"),
    ):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.rle_splat.turntable(frames=2, output="PNG", **options)
        assert settings() == before
    objects = set(bpy.data.objects)
    scene.render.resolution_x = 25
    before = settings()
    with pytest.raises(RuntimeError, match="even width and height"):
        bpy.ops.rle_splat.turntable(filepath=str(tmp_path / "turn"), frames=2, output="MP4")
    assert settings() == before
    assert set(bpy.data.objects) == objects
    scene.camera = None
    with pytest.raises(RuntimeError, match="no active camera"):
        bpy.ops.rle_splat.turntable(filepath=str(tmp_path / "turn"), path="CAMERA", output="PNG")


def test_a_size_that_no_movie_has_is_said_in_the_dialog_which_proposes_pictures(cube, bridge):
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 643, 361, 100
    assert "643 x 361" in bridge("render.output_settings").why_no_movie(scene.render)
    operator = module("operators.turntable")
    given = SimpleNamespace(is_property_set=lambda name: name == "background")
    chosen = SimpleNamespace(output="MP4", filepath="turn.mp4", properties=given)
    manager = SimpleNamespace(fileselect_add=lambda _operator: None)
    context = SimpleNamespace(scene=scene, window_manager=manager)
    operator.RLE_SPLAT_OT_turntable.invoke(chosen, context, None)
    assert chosen.output == "PNG"
    scene.render.resolution_x, scene.render.resolution_y = 644, 362
    chosen.output = "MP4"
    operator.RLE_SPLAT_OT_turntable.invoke(chosen, context, None)
    assert chosen.output == "MP4" and not bridge("render.output_settings").why_no_movie(scene.render)


@pytest.mark.parametrize("end", ["rendered", "canceled", "refused"])
def test_a_render_leaves_no_camera_however_it_ends(end, cube, tmp_path, monkeypatch):
    operator = module("operators.turntable")
    scene, before = bpy.context.scene, set(bpy.data.objects)
    cameras, camera = len(bpy.data.cameras), scene.camera
    if end in ("rendered", "canceled"):
        bpy.app.handlers.render_pre.append(lambda *_: end == "canceled" and operator._canceled.append(True))
        turn(tmp_path, output="PNG", frames=1)
        bpy.app.handlers.render_pre.pop()
    else:
        monkeypatch.setattr(operator.camera_path, "keyframe_turn", lambda *_: 1 / 0)
        with pytest.raises(RuntimeError):
            bpy.ops.rle_splat.turntable(filepath=str(tmp_path / "turn"), frames=2, output="PNG")
    made = {one for one in set(bpy.data.objects) - before if one.type in ("CAMERA", "EMPTY")}
    assert made == set() and len(bpy.data.cameras) == cameras and scene.camera == camera


def test_undo_removes_the_camera_and_its_empty(cube):
    bpy.ops.ed.undo_push(message="before")
    before = {one.name for one in bpy.data.objects}
    turn()
    bpy.ops.ed.undo_push(message="Turntable")
    bpy.ops.ed.undo()
    assert {one.name for one in bpy.data.objects if one.type in ("CAMERA", "EMPTY")} <= before


def test_a_scene_gets_the_new_camera_if_nothing_is_rendered(cube, tmp_path):
    bpy.context.scene.camera = None
    turn(tmp_path, frames=1, output="PNG")
    assert bpy.context.scene.camera is None
    turn()
    assert bpy.context.scene.camera.name.endswith("Turntable Camera")


def test_the_turn_follows_a_tilted_volume_without_patient_axes(cube):
    cube.rotation_euler = (radians(90.0), 0.0, 0.0)
    scenes.update()
    turn(elevation=0.0)
    scenes.to_frame(11)
    np.testing.assert_allclose(np.array(bpy.context.scene.camera.matrix_world)[:3, 1], (0, -1, 0), atol=1e-5)


def test_the_report_is_of_the_scene_that_was_rendered(cube, bridge):
    """The window may show another scene when a render ends, and the scene may be gone."""
    operator = module("operators.turntable")
    scene, said = bpy.context.scene, []
    scene.rle_splat.failed_frames, scene.rle_splat.render_problem = "2", "The file is gone."
    ended = SimpleNamespace(
        _scene=bridge("held").Held(scene), _written="turn.mp4", report=lambda kinds, text: said.append((*kinds, text))
    )
    bpy.context.window.scene = bpy.data.scenes.new("Another")
    operator.RLE_SPLAT_OT_turntable._say(ended)
    bpy.data.scenes.remove(scene)
    operator.RLE_SPLAT_OT_turntable._say(ended)
    assert said == [("WARNING", "The file is gone."), ("INFO", "The animation is at turn.mp4.")]


@pytest.mark.parametrize("engine", ["BLENDER_WORKBENCH", "CYCLES"])
@pytest.mark.parametrize("has_world", [True, False])
@pytest.mark.parametrize(("background", "level"), [("WHITE", 1.0), ("BLACK", 0.0)])
def test_a_plain_background_is_behind_the_volume(cube, tmp_path, engine, has_world, background, level):
    """In colors as they are; world and view are the scene's again afterwards."""
    scene = bpy.context.scene
    scene.render.engine, scene.render.film_transparent = engine, True
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    if engine == "CYCLES":
        scene.cycles.samples = 1
    scene.world = bpy.data.worlds.new("mine") if has_world else None
    scene.view_settings.view_transform, scene.view_settings.exposure = "AgX", 0.5
    cube.rle_splat.display = "mip"
    cube.rle_splat.window_center, cube.rle_splat.window_width = 25.0, 50.0  # all is above it
    cube.rle_splat.use_inverted_grays = background == "WHITE"
    before, worlds = settings(), len(bpy.data.worlds)
    turn(tmp_path, frames=1, output="PNG", background=background)
    assert settings() == before and len(bpy.data.worlds) == worlds
    pixels = scenes.load_pixels(next((tmp_path / "new").glob("*.png")))[..., :3]
    np.testing.assert_allclose(pixels[[0, 0, -1, -1], [0, -1, 0, -1]], level, atol=0.005)  # dithered
    assert np.abs(pixels[12, 16] - level).min() > 0.9, "the volume is as far from it as can be"
