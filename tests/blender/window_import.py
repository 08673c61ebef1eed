"""Reading files in a real Blender with a window: in steps, with progress, Esc and the chooser of series.

dev.py test runs it. A slice of work is watched for how long it keeps the window waiting.
"""

import gzip
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.formats import write_series
from tests.blender.scenes import module
from tests.blender.user_steps import confirm_browser, settled
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
    wait_for_rest,
    window,
)

LARGE = (128, 512, 512)  # (nz, ny, nx) voxels of 16 bits, 64 MiB: long enough for progress and Esc
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_import_"))
SHORT = 0.01  # seconds of a slice
MENU = 5  # turns of the window's loop until a menu takes keys
slices: list[float] = []  # seconds of each slice of work


def jobs():
    return module("bridge.loop.jobs").StepwiseOperator


def volumes():
    return [one for one in bpy.data.objects if one.rle_splat.is_volume]


def watch_slices() -> None:
    job = jobs()
    work = job._work_a_while

    def watched(self, context):
        began = time.perf_counter()
        try:
            return work(self, context)
        finally:
            slices.append(time.perf_counter() - began)

    job._work_a_while = watched


def large_file() -> Path:
    """A packed raw file that takes seconds to read."""
    path = FOLDER / "large_512x512x128_int16_1.0x1.0x1.0.raw.gz"
    if not path.exists():
        noise = np.random.default_rng(0).integers(-50, 50, LARGE[1:], dtype=np.int16)
        with gzip.open(path, "wb", compresslevel=1) as stream:
            for z in range(LARGE[0]):
                stream.write((noise + z).astype(np.int16).tobytes())
    return path


def start(path, **options) -> None:
    slices.clear()
    with in_the_view():
        done = bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=str(path), use_dialog=False, **options)
        assert done == {"RUNNING_MODAL"}


def press(kind: str) -> None:
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=kind, value=value)


def check_steps():
    """A large file is read little by little, with progress; the object is there at the end and gone after undo."""
    yield from new_file()
    path = large_file()
    bpy.ops.ed.undo_push(message="start")
    start(path)
    yield from until(lambda: jobs().progress() is not None and jobs().progress().fraction > 0.1)
    yield from photograph("progress")
    yield from until(lambda: not jobs()._running)
    assert len(volumes()) == 1 and volumes()[0].rle_splat.frame_count == 1
    print(f"{len(slices)} slices, the longest {1e3 * max(slices):.0f} ms", flush=True)
    assert len(slices) > 3
    with in_the_view():
        bpy.ops.ed.undo()
    assert not volumes()


def check_escape():
    """Esc ends the reading at once, and nothing is left of it."""
    yield from new_file()
    job, ended = jobs(), []
    abandon = job._abandon
    job._abandon = lambda self, context: (abandon(self, context), ended.append(time.perf_counter()))
    start(large_file())
    yield
    yield
    assert jobs()._running
    pressed = time.perf_counter()
    press("ESC")
    yield from until(lambda: ended)
    print(f"Esc took {1e3 * (ended[0] - pressed):.0f} ms", flush=True)
    assert not jobs()._running and not volumes()
    assert not module("bridge.loop.store")._entries
    job._abandon = abandon


def check_dialog():
    """The dialog of a dropped file, confirmed by Enter, leads to the same steps."""
    yield from new_file()
    slices.clear()
    with in_the_view():
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=str(large_file()))
    yield from photograph("dialog")
    press("RET")
    yield from until(lambda: volumes())
    assert len(slices) > 3


def check_browser():
    """What is chosen in the file browser is read in steps too: a file by Add > Volume, a folder, and the new place of a
    volume."""
    yield from new_file()
    slices.clear()
    with in_the_view():
        bpy.ops.wm.call_menu(name="VIEW3D_MT_volume_add")
    for key in ("END", "RET"):  # ours is the last entry
        for _ in range(MENU):
            yield
        press(key)
    yield from confirm_browser(FOLDER, large_file().name)
    yield from until(volumes)
    assert len(slices) > 3
    slices.clear()
    with in_the_view():
        bpy.ops.rle_splat.relocate_volume("INVOKE_DEFAULT")
    yield from confirm_browser(FOLDER, large_file().name)
    yield from until(lambda: len(slices) > 3)
    yield from until(lambda: not jobs()._running)
    with in_the_view():
        bpy.ops.rle_splat.import_dicom_series("INVOKE_DEFAULT")
    yield from confirm_browser(FOLDER / "study" / "2")
    yield from until(lambda: len(volumes()) == 2)


def check_chooser():
    """Of a folder with three series the first is chosen by Enter; Esc before that leaves nothing."""
    yield from new_file()
    for number, count in ((1, 8), (2, 12), (3, 20)):
        write_series(FOLDER / "study" / str(number), number, count)
    series = module("bridge.volumes.series")
    for key, found in (("ESC", 0), ("RET", 1)):
        start(FOLDER / "study")
        yield from until(series.offered)
        yield from photograph("chooser")
        assert all(series.offered().icon(number) for number in (1, 2, 3))
        press(key)
        yield from until(lambda: not jobs()._running and not series.offered())
        yield
        yield from until(lambda: not jobs()._running)
        assert len(volumes()) == found
    assert volumes()[0].rle_splat.series == 1


def check_playback():
    """After the import all frames are read ahead, and playback reads none and draws each; without them it reads one
    after another.  A followed backdrop shows its frame."""
    yield from new_file()
    for frame in range(1, 5):  # darker and darker: a brighter one would look as the first does
        (FOLDER / f"beat_{frame:02d}.raw").write_bytes(bytes([250 - 50 * frame]) * 64**3)
    with in_the_view():
        bpy.ops.rle_splat.import_volume(
            filepath=str(FOLDER / "beat_01.raw"), shape=(64, 64, 64), dtype="uint8", spacing=(1, 1, 1),
            use_sequence=True)  # fmt: skip
    ours, owner = module("bridge.volumes.volumes"), volumes()[0]
    yield from photograph("time")
    yield from wait_for_rest()
    assert all(ours.is_at_hand(owner, ahead=n) for n in range(4))
    scene, reads, drawn = bpy.context.scene, [], []
    scene.frame_start, scene.frame_end, owner.rle_splat.playback = 1, 4, "LOOP"
    scene.render.fps = 6  # a window drawn by software on a busy machine has the time for a draft of each
    store, live = module("bridge.loop.store"), module("bridge.live")
    counts, load = next(iter(live._lives.values())).viewport.counts, ours.file_steps
    ours.file_steps = lambda *given: reads.append(given) or load(*given)
    bpy.app.handlers.frame_change_pre.append(lambda scene, _depsgraph: drawn.append(counts["drafts"]))
    with in_the_view():
        bpy.ops.screen.animation_play()
    yield from until(lambda: np.count_nonzero(np.diff(drawn)[-4:]) >= 3)  # each is drawn before the next one
    print(f"drafts between frames of playback: {np.diff(drawn)}", flush=True)
    assert not reads
    drafts = counts["drafts"]
    store.forget_all()
    yield from until(lambda: len(reads) >= 4 and counts["drafts"] > drafts + 8)
    del reads[:], bpy.app.handlers.frame_change_pre[-1]
    drafts = counts["drafts"]
    yield from until(lambda: counts["drafts"] > drafts + 8)
    ours.file_steps = load
    assert not reads, "a second round reads nothing"
    with in_the_view():
        bpy.ops.screen.animation_play()
    yield from check_followed(ours, owner)


def check_followed(ours, owner):
    """A backdrop that follows waits for voxels that are not in memory, without keeping the window waiting."""
    scene = bpy.context.scene
    scenes.add_camera((0.03, 0.03, 1.0))
    scene.rle_splat.quality = "draft"
    scene.render.resolution_x = scene.render.resolution_y = 64
    with in_the_view():
        bpy.context.view_layer.objects.active = owner
        scene.frame_set(1)
        assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    image = scene.camera.data.background_images[0].image
    before = np.array(image.pixels[:])
    ahead = module("bridge.loop.work")
    asked = []
    want = ahead.want
    ahead.want = lambda *given: asked.append(want(*given)) or asked[-1]
    ours.forget_all()
    owner.rle_splat.frame_offset = 3
    yield from until(lambda: not np.array_equal(np.array(image.pixels[:]), before))
    assert asked[0] and ours.is_at_hand(owner) and scene.rle_splat.message == ""
    ahead.want = want


def write_beat(side: int, frames: int) -> tuple[Path, Path]:
    """A ball that moves with three organs in it, as a scan in time with noise, and a label map of each frame."""
    import nibabel  # there when the extension is

    random, paths = np.random.default_rng(0), (FOLDER / "heart.nii.gz", FOLDER / "organs.nii.gz")
    volumes_of = np.empty((side, side, side, frames), np.int16), np.zeros((side, side, side, frames), np.uint8)
    for n in range(frames):
        place = np.indices((side, side, side), np.float32) / side - 0.5 - 0.01 * n
        radius = np.sqrt((place**2).sum(axis=0))
        values = 1000.0 * np.exp(-((radius / 0.35) ** 6)) + random.normal(0.0, 12.0, radius.shape)
        volumes_of[0][..., n] = values
        for label, at in enumerate((-0.16, 0.0, 0.16), 1):
            apart = np.sqrt((place[0] - at) ** 2 + place[1] ** 2 + place[2] ** 2)
            volumes_of[1][..., n][apart < 0.09 + 0.02 * np.sin(n)] = label
    for path, values in zip(paths, volumes_of):
        nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), path)
    return paths


def play_round(name: str, viewport, frames: int):
    """Play a round at 24 frames a second; print what was shown, and return how often each stage ran."""
    live, kept = module("bridge.live"), module("bridge.scene.render_scene").KEPT
    scene, made, finished, drawn = bpy.context.scene, dict(kept.made), [], []
    finish, draw = viewport._finish, live._draw

    def watch_finish(pictures):
        finished.append((viewport._work_on[0].contents[0].plain.volume.key, viewport._work_on[1]))
        finish(pictures)

    def watch_draw(*given):
        drawn.extend([(scene.frame_current, *finished[-1])] if finished else [])
        draw(*given)

    viewport._finish, live._draw = watch_finish, watch_draw
    began, start, seen = time.perf_counter(), scene.frame_current, set()
    with in_the_view():
        bpy.ops.screen.animation_play()
    yield from until(
        lambda: seen.add(scene.frame_current) or (len(seen) > frames // 2 and scene.frame_current == start)
    )
    seconds = time.perf_counter() - began
    with in_the_view():
        bpy.ops.screen.animation_play()
    del viewport._finish
    live._draw = draw
    print(f"{name}: {len({volume for _, volume, _ in drawn})} of {frames} frames shown in {seconds:.2f} s, coarseness "
          f"{[coarseness for *_, coarseness in drawn]}", flush=True)  # fmt: skip
    return {stage: count - made.get(stage, 0) for stage, count in kept.made.items()}


def check_organs_in_time(side: int = 64, frames: int = 8, coarseness: int | None = 2):
    """Playback of a scan with a label map of each frame finds no boundaries once the window had a rest.

    ``coarseness``: of drafts; None for that which viewports choose, by how busy the machine is.
    """
    yield from new_file()
    scan, organs = write_beat(side, frames)
    with in_the_view():
        bpy.ops.rle_splat.import_volume(filepath=str(scan))
        owner, scene = volumes()[0], bpy.context.scene
        owner.rle_splat.label_file = str(organs)
        assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
        module("bridge.volumes.labels").show_anatomy(owner.rle_splat.labels)
    scene.frame_start, scene.frame_end, owner.rle_splat.playback = 1, frames, "LOOP"
    scene.render.fps, scene.rle_splat.classification = 24, "post"
    live, kept = module("bridge.live"), module("bridge.scene.render_scene").KEPT
    area_of("VIEW_3D").spaces.active.show_region_ui = False
    with in_the_view():
        bpy.ops.rle_splat.frame_volume(side="A")
    yield from wait_for_rest()
    viewport = next(iter(live._lives.values())).viewport
    if coarseness is not None:
        viewport._coarseness, viewport._choose_coarseness = coarseness, lambda _: None
    kept.clear()
    unprepared = yield from play_round("without a rest", viewport, frames)
    yield from play_round("second round", viewport, frames)
    kept.clear()
    yield from settled()
    area_of("VIEW_3D").tag_redraw()
    yield from wait_for_rest()
    prepared = yield from play_round("after a rest", viewport, frames)
    yield from photograph("organs")
    print(
        f"labels' boundaries found: {unprepared['labels']} times without a rest, {prepared['labels']} after", flush=True
    )
    assert unprepared["labels"] and not prepared["labels"]


def check_framing():
    """From a scene with Blender's usual cube and a closed sidebar: the volume fills the view, the tab is open, and what
    hides the volume is told; in perspective and not, and nothing is moved where that is not wanted."""
    yield from new_file()
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    view = area_of("VIEW_3D")
    region_3d, space = view.spaces.active.region_3d, view.spaces.active
    space.show_region_ui = False
    grid = np.indices((64, 64, 64)) - 32.0
    ball = np.clip(200.0 - 6.0 * np.sqrt((grid**2).sum(axis=0)), 0.0, 255.0).astype(np.uint8)
    path = FOLDER / "ball_64x64x64_uint8.raw"
    ball.tofile(path)
    viewports = module("bridge.scene.viewports")
    for perspective in ("PERSP", "ORTHO"):
        region_3d.view_perspective = perspective
        region_3d.view_location, region_3d.view_distance = (5.0, 5.0, 5.0), 20.0
        with in_the_view():
            assert bpy.ops.rle_splat.import_volume(filepath=str(path), spacing=(4.0, 4.0, 4.0)) == {"FINISHED"}
        owner = bpy.context.view_layer.objects.active
        yield from until(lambda: region_of(view, "UI").active_panel_category == viewports.tab())
        yield
        corners = module("bridge.volumes.box").world_corners(owner)
        seen = np.column_stack((corners, np.ones(8))) @ np.array(region_3d.perspective_matrix).T
        seen = np.abs(seen[:, :3] / seen[:, 3:])
        assert seen.max() < 1.0 and seen[:, :2].max() > 0.3, seen
        assert viewports.hiding_meshes(bpy.context.view_layer, corners) == ["Cube"]
        yield from settled()
        yield from photograph(f"framed_{perspective.lower()}")
    before = region_3d.view_distance
    owner.rle_splat.space = "patient"
    with in_the_view():
        assert bpy.ops.rle_splat.frame_volume(side="R") == {"FINISHED"}
    yield from photograph("from_the_right")
    before = region_3d.view_distance
    region_3d.view_distance = 3.0 * before
    with in_the_view():
        bpy.ops.rle_splat.import_volume(filepath=str(path), use_framing=False)
    assert abs(region_3d.view_distance - 3.0 * before) < 1e-6 * before


def check_reload():
    """After a .blend is opened, a picture reads the voxels in steps."""
    yield from new_file()
    with in_the_view():
        bpy.ops.rle_splat.import_volume(filepath=str(large_file()))
    scenes.add_camera((0.25, 0.25, 3.0))
    scene = bpy.context.scene
    scene.rle_splat.quality = "draft"
    scene.render.resolution_x = scene.render.resolution_y = 16
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "saved.blend"))
    works = [getattr(module(f"operators.{name}"), f"RLE_SPLAT_OT_{name}")
             for name in ("render_image", "apply_preset")]  # fmt: skip
    for one in works:
        one.time_budget = SHORT  # so that fast machines take several slices, too
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "saved.blend"))
    yield
    slices.clear()
    bpy.context.view_layer.objects.active = volumes()[0]
    with in_the_view():
        assert bpy.ops.rle_splat.render_image("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from until(lambda: "measuring" in getattr(jobs().progress(), "message", ""))
    print(f"{len(slices)} slices, the longest {1e3 * max(slices):.0f} ms", flush=True)
    assert len(slices) > 3
    press("ESC")
    yield from until(lambda: not jobs()._running)
    slices.clear()
    before = volumes()[0].rle_splat.transfer_name
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset("INVOKE_DEFAULT", preset="faint") == {"RUNNING_MODAL"}
    yield from until(lambda: volumes()[0].rle_splat.transfer_name != before)
    assert len(slices) > 3
    for one in works:
        del one.time_budget


def scenario():
    watch_slices()
    open_panels("RLE_SPLAT_PT_scan", "RLE_SPLAT_PT_playback")
    reading = check_steps, check_escape, check_dialog, check_chooser, check_browser, check_playback
    for check in (*reading, check_organs_in_time, check_reload, check_framing):
        yield from check()
        passed(check.__name__)


drive(scenario, overlap=False)
