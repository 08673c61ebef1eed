"""Volumes in time: which frame is shown, each rendered frame shows its own, and how many are kept in memory."""

from importlib import import_module
from time import perf_counter
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

N = 7
ALPHAS = (0.05, 0.1, 0.2, 0.4)


@pytest.fixture
def sequence(tmp_path):
    """Four numbered raw files of one value each: 50, 100, 150, 200."""
    for frame in range(1, 5):
        (tmp_path / f"beat_{frame:04d}.raw").write_bytes(bytes([50 * frame]) * N**3)
    return tmp_path / "beat_0001.raw"


@pytest.fixture
def owner(sequence):
    """The sequence imported, its values shown with the opacities ALPHAS."""
    scene = scenes.use_cycles((16, 16))
    scene.rle_splat.scene_scale, scene.rle_splat.classification = 1.0, "pre"
    scene.rle_splat.quality = "fine"
    assert bpy.ops.rle_splat.import_volume(
        filepath=str(sequence), shape=(N, N, N), dtype="uint8", spacing=(1, 1, 1), use_sequence=True
    ) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    points = ((0.0, 0.0), *((50.0 * i, alpha) for i, alpha in enumerate(ALPHAS, 1)), (255.0, ALPHAS[-1]))
    scenes.give_transfer(owner, points, (1.0, 1.0, 1.0))
    scenes.add_camera((3.0, 3.0, 30.0), type="ORTHO", ortho_scale=16.0)
    return owner


def value_now(bridge, owner) -> int:
    """The value of the frame that is shown, over 50."""
    return int(bridge("volumes.volumes").load_volume(owner).voxels[0, 0, 0]) // 50


def shown_at(bridge, owner, frames) -> list:
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        found.append(value_now(bridge, owner))
    return found


def test_a_sequence_follows_the_timeline(owner, bridge):
    assert (owner.rle_splat.frame_count, owner.rle_splat.playback) == (4, "HOLD")
    assert shown_at(bridge, owner, (-5, 1, 2, 3, 4, 5, 99)) == [1, 1, 2, 3, 4, 4, 4]


def test_the_live_view_follows_a_script_that_sets_the_time_point(owner):
    owner.rle_splat.playback = "FIXED"
    bpy.context.view_layer.update()
    seen = []

    def note(_scene, depsgraph):
        seen.extend(update.id.name for update in depsgraph.updates)

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        owner.rle_splat.frame = 3
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert owner.name in seen


@pytest.mark.parametrize("playback, offset, step, expected", [
    ("HOLD", 2, 1.0, [3, 4, 4, 4, 4, 4]), ("HOLD", -2, 1.0, [1, 1, 1, 2, 3, 4]), ("HOLD", 0, 0.5, [1, 1, 2, 2, 3, 3]),
    ("LOOP", 0, 1.0, [1, 2, 3, 4, 1, 2]), ("LOOP", -1, 1.0, [4, 1, 2, 3, 4, 1]), ("LOOP", 0, -1.0, [1, 4, 3, 2, 1, 4]),
    ("LOOP", 0, 2.0, [1, 3, 1, 3, 1, 3]), ("FIXED", 2, 2.0, [1] * 6),
])  # fmt: skip
def test_offset_step_hold_and_loop(owner, bridge, playback, offset, step, expected):
    properties = owner.rle_splat
    properties.playback, properties.frame_offset, properties.frame_step = playback, offset, step
    assert shown_at(bridge, owner, range(1, 7)) == expected


def test_the_frame_can_be_keyframed(owner, bridge):
    owner.rle_splat.playback = "FIXED"
    for time, frame in ((1, 4), (2, 2), (3, 9)):
        owner.rle_splat.frame = frame
        owner.keyframe_insert("rle_splat.frame", frame=time)
    assert shown_at(bridge, owner, (1, 2, 3)) == [4, 2, 4]


def test_each_rendered_frame_shows_its_own_volume(owner, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 4
    scenes.write_exr(tmp_path / "frame_####.exr")
    bpy.ops.render.render(animation=True)
    middles = [scenes.load_pixels(tmp_path / f"frame_{frame:04d}.exr")[8, 8, 3] for frame in range(1, 5)]
    np.testing.assert_allclose(middles, [1.0 - (1.0 - alpha) ** N for alpha in ALPHAS], atol=1.5 / 255)
    scene.frame_set(2)
    bpy.ops.render.render(write_still=True)
    np.testing.assert_allclose(scenes.load_pixels(tmp_path / "frame_0002.exr")[8, 8, 3], middles[1], atol=1e-6)


def test_a_missing_frame_gets_the_placeholder_and_a_sentence(owner, sequence, tmp_path):
    sequence.with_name("beat_0003.raw").unlink()
    bpy.ops.rle_splat.show_in_renders()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 2, 4
    scenes.write_exr(tmp_path / "frame_####.exr")
    bpy.ops.render.render(animation=True)
    assert scene.rle_splat.failed_frames == "3" and "Time point 3 is missing" in scene.rle_splat.render_problem


def entries(bridge) -> int:
    """How many frames are in memory."""
    return len(bridge("loop.store")._entries)


def run_timer(work) -> int:
    """Let the timer function run until it stops, as in a window; returns how often it ran."""
    count = 0
    while work._tick() is not None:
        count += 1
    return count


@pytest.fixture
def reads(bridge, monkeypatch):
    """The files that were read, each once for each reading."""
    volumes, found = bridge("volumes.volumes"), []
    read = volumes.file_steps
    monkeypatch.setattr(volumes, "file_steps", lambda path, options: found.append(path) or read(path, options))
    return found


def test_all_frames_are_read_ahead_while_nothing_else_is_done(owner, bridge, reads):
    work, timer = bridge("loop.work"), bridge("loop.timer")
    assert shown_at(bridge, owner, (1, 2)) == [1, 2] and entries(bridge) == 1
    del reads[:]
    work._ahead[0], timer._due[run_timer] = 1, perf_counter() + 0.1
    assert work._tick() == work.LOOK_AROUND and not work._queue, "other work comes first"
    timer.stop(run_timer)
    run_timer(work)
    assert [path[-8:] for path in reads] == ["0003.raw", "0004.raw", "0001.raw"] and work.progress() is None
    assert shown_at(bridge, owner, (1, 3, 2)) == [1, 3, 2] and len(reads) == 3
    assert not work._queue and work._tick() is None  # nothing more until the frame changes
    work._ahead[0] = 1
    run_timer(work)
    assert len(reads) == 3


@pytest.mark.parametrize("room, expected", [(1, [2]), (3, [2, 3])])
def test_frames_are_read_ahead_until_memory_is_full(owner, bridge, reads, monkeypatch, room, expected):
    """The next one always."""
    work = bridge("loop.work")
    monkeypatch.setattr(bridge("loop.store"), "MOST_BYTES", room * N**3)
    assert value_now(bridge, owner) == 1
    work._ahead[0] = 1
    run_timer(work)
    assert [int(path[-8:-4]) for path in reads] == expected


def test_drafts_of_all_frames_in_memory_are_made_once_while_nothing_else_is_done(owner, bridge, playing, monkeypatch):
    """In the order of playback from the one that is shown, and none while it plays."""
    ahead, timer, found = bridge("live.ahead"), bridge("loop.timer"), []
    bpy.context.scene.frame_end = 4
    shown_at(bridge, owner, (1,))
    work = bridge("loop.work")
    playing[0], work._ahead[0] = False, 1
    run_timer(work)
    playing[0] = True
    volume = bridge("volumes.volumes").load_volume(owner)
    plain = SimpleNamespace(labels=None)
    monkeypatch.setattr(ahead, "replace", lambda _, volume: int(volume.voxels[0, 0, 0]) // 50)

    def prepare_steps(shown, scene, is_first):
        assert shown is volume and is_first == (not found)
        found.append(scene(plain))
        yield

    views = [(SimpleNamespace(version=1, prepare_steps=prepare_steps), owner, bpy.context.evaluated_depsgraph_get())]
    ahead.stop()
    assert ahead.work(run_timer, views) is None and not found
    playing[0] = False
    timer._due[value_now] = perf_counter() + 0.3
    assert ahead.work(run_timer, views) == ahead.LOOK and not found, "other work comes first"
    timer.stop(value_now)
    while ahead.work(run_timer, views) is not None:
        pass
    assert found == [1, 2, 3, 4]
    assert ahead.work(run_timer, views) is None and len(found) == 4


def test_what_is_wanted_now_is_read_by_the_timer_and_then_shown(owner, bridge, sequence):
    volumes, work = bridge("volumes.volumes"), bridge("loop.work")
    assert not work.want(owner)  # it is in memory
    volumes.forget_all()
    assert work.want(owner) and work.want(owner) and len(work._queue) == 1
    run_timer(work)
    assert volumes.is_at_hand(owner) and not work.want(owner)
    volumes.forget_all()
    sequence.write_bytes(b"cut")
    assert work.want(owner)
    run_timer(work)
    assert not work.want(owner)  # so that whoever asks reads it at once, and says what is wrong
    work.stop()


def test_the_next_frame_is_read_ahead(owner, bridge, core):
    volumes = bridge("volumes.volumes")
    shown_at(bridge, owner, (2,))
    assert not volumes.is_at_hand(owner, ahead=1)
    core("runtime.steps").drain(volumes.load_ahead_steps(owner, 1))
    assert volumes.is_at_hand(owner, ahead=1) and entries(bridge) == 2
    assert shown_at(bridge, owner, (3, 1)) == [3, 1] and entries(bridge) == 2  # that frame stays
    bpy.data.objects.remove(owner)
    bridge("loop.store").forget_deleted()
    assert not entries(bridge)


@pytest.fixture
def playing(bridge, monkeypatch):
    """A list whose item says whether the animation plays, which lasts as long as that of a window."""
    state = [True]
    for module in ("loop.work", "live.ahead"):
        monkeypatch.setattr(bridge(module), "is_playing", lambda: state[0])
    return state


def test_playback_reads_the_frames_that_come_next(owner, bridge, playing):
    """Reading takes two frames of the timeline: it reads what is shown when it is done, and that stays."""
    work, scene = bridge("loop.work"), bpy.context.scene
    owner.rle_splat.playback, scene.frame_start, scene.frame_end = "LOOP", 1, 4
    bridge("loop.store").forget_all()
    there = []
    for _ in range(3):
        for frame in range(1, 5):
            scene.frame_set(frame)
            there.append(not work.want(owner))
            if frame % 2:
                work._tick()
            else:
                run_timer_once_read(work)
    assert not any(there[:4]) and sum(there[4:8]) >= 2 and all(there[8:]), there
    assert shown_at(bridge, owner, range(1, 5)) == [1, 2, 3, 4]
    work.stop()


def run_timer_once_read(work) -> None:
    """Let the timer function run until a reading is done."""
    for _ in range(1000):
        if not work._queue:
            return
        work._tick()
    raise AssertionError("the reading does not end")


def test_a_frame_that_is_late_is_shown_when_playback_stops(owner, bridge, playing):
    work, scene, volumes = bridge("loop.work"), bpy.context.scene, bridge("volumes.volumes")
    bridge("loop.store").forget_all()
    scene.frame_set(3)
    assert work.want(owner) and work._playing and not work._queue
    playing[0] = False
    tagged = []
    while work._tick() is not None:
        tagged.append(True)
    assert not work._playing and not work._queue
    assert work.want(owner) and work._queue, "as the update that it was tagged for does"
    run_timer(work)
    assert volumes.is_at_hand(owner)
    work.stop()


@pytest.mark.parametrize("now, ahead, expected", [(1, 1, 2), (3, 1, 4), (4, 1, 2), (4, 4, 2), (9, 1, 2), (0, 1, 1)])
def test_playback_begins_again_after_the_last_frame(now, ahead, expected, bridge):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 2, 4
    scene.frame_set(now)
    assert now + bridge("data.playback").frames_until(scene, ahead) == expected


def test_frames_read_ahead_go_when_memory_is_short(owner, bridge, core, monkeypatch):
    """The oldest first, not the newest or the one that is shown."""
    store, volumes = bridge("loop.store"), bridge("volumes.volumes")
    app = SimpleNamespace(background=False, is_job_running=lambda kind: False)
    monkeypatch.setattr(store, "bpy", SimpleNamespace(app=app, context=bpy.context))
    monkeypatch.setattr(store, "_shown_objects", lambda: {owner.session_uid})
    monkeypatch.setattr(store, "MOST_BYTES", 3 * N**3)
    assert value_now(bridge, owner) == 1
    for ahead in (1, 2, 3):
        core("runtime.steps").drain(volumes.load_ahead_steps(owner, ahead))
    assert [volumes.is_at_hand(owner, ahead=ahead) for ahead in range(4)] == [True, False, True, True]
    monkeypatch.setattr(store, "MOST_BYTES", 1)
    core("runtime.steps").drain(volumes.load_ahead_steps(owner, 1))
    assert [volumes.is_at_hand(owner, ahead=ahead) for ahead in range(4)] == [True, True, False, False]


@pytest.mark.parametrize("playback, name, keys", [
    ("FIXED", "frame", ((1, 1), (2, 4))), ("HOLD", "frame_offset", ((1, 0), (2, 2))),
    ("HOLD", "frame_step", ((1, 1), (2, 3))),
])  # fmt: skip
def test_the_next_keyframed_frame_is_read_ahead(owner, bridge, playback, name, keys):
    work, volumes = bridge("loop.work"), bridge("volumes.volumes")
    owner.rle_splat.playback = playback
    for time, value in keys:
        setattr(owner.rle_splat, name, value)
        owner.keyframe_insert(f"rle_splat.{name}", frame=time)
    assert shown_at(bridge, owner, (1,)) == [1]
    work._ahead[0] = 1
    run_timer(work)
    assert entries(bridge) == 2
    bpy.context.scene.frame_set(2)
    assert volumes.is_at_hand(owner) and value_now(bridge, owner) == 4


def test_the_one_frame_that_is_shown_is_not_read_again(owner, bridge, reads):
    owner.rle_splat.playback, work = "FIXED", bridge("loop.work")
    assert value_now(bridge, owner) == 1
    work._ahead[0] = 1
    run_timer(work)
    assert not reads and entries(bridge) == 1


def test_another_frame_that_was_written_again_is_told(owner, bridge, sequence):
    volumes, warnings = bridge("volumes.volumes"), []
    bpy.context.scene.frame_set(3)
    volumes.load_volume(owner, warnings.append)
    assert not warnings
    sequence.with_name("beat_0003.raw").write_bytes(bytes([99]) * N**3)
    volumes.load_volume(owner, warnings.append)
    assert len(warnings) == 1 and "have changed since the import; if frame 3 looks wrong" in warnings[0]


def test_a_picture_of_another_frame_is_out_of_date(owner, bridge):
    freshness, scene = bridge("pictures.outdated"), bpy.context.scene
    scene.frame_set(1)
    bpy.ops.rle_splat.render_image()
    assert not freshness.out_of_date(scene)
    scene.frame_set(2)
    freshness.update_status(scene, bpy.context.evaluated_depsgraph_get())
    assert freshness.out_of_date(scene) == [scene.rle_splat.image]
    scene.frame_set(1)
    freshness.update_status(scene, bpy.context.evaluated_depsgraph_get())
    assert not freshness.out_of_date(scene)


def test_a_followed_backdrop_shows_the_frame(owner):
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    scene = bpy.context.scene
    entry = scene.camera.data.background_images[0]
    middles = []
    for frame in (1, 2, 4):
        scene.frame_set(frame)
        middles.append(scenes.image_pixels(entry.image)[8, 8, 3])
    np.testing.assert_allclose(middles, [1.0 - (1.0 - ALPHAS[i]) ** N for i in (0, 1, 3)], atol=1.5 / 255)


def test_a_chosen_file_of_the_middle_keeps_its_place(sequence, bridge):
    bpy.ops.rle_splat.import_volume(
        filepath=str(sequence.with_name("beat_0003.raw")), shape=(N, N, N), dtype="uint8", use_sequence=True
    )
    owner = bpy.context.view_layer.objects.active
    assert owner.rle_splat.data_frame == 3
    assert shown_at(bridge, owner, (1, 3)) == [1, 3]
    warnings = []
    bridge("volumes.volumes").load_volume(owner, warnings.append)
    assert not warnings


def test_without_the_option_a_numbered_file_is_one_volume(sequence, bridge):
    bpy.ops.rle_splat.import_volume(filepath=str(sequence), shape=(N, N, N), dtype="uint8")
    owner = bpy.context.view_layer.objects.active
    assert (owner.rle_splat.frame_count, owner.rle_splat.playback) == (1, "FIXED")
    assert shown_at(bridge, owner, (1, 3)) == [1, 1]


def test_all_files_of_a_sequence_are_one_volume(sequence):
    names = [{"name": f"beat_{frame:04d}.raw"} for frame in (2, 1, 3)]
    options = dict(shape=(N, N, N), dtype="uint8", use_sequence=True)
    bpy.ops.rle_splat.import_volume(directory=str(sequence.parent), files=names, **options)
    found = [one for one in bpy.data.objects if one.rle_splat.is_volume]
    assert [one.rle_splat.frame_count for one in found] == [4]


def test_pages_chosen_together_are_one_stack_and_stacks_are_not(tmp_path, addon):
    tifffile = pytest.importorskip("tifffile")
    values = np.arange(5 * 7 * 9, dtype=np.uint16).reshape(5, 7, 9)
    for number, page in enumerate(values, 1):
        tifffile.imwrite(tmp_path / f"page_{number}.tif", page)
    for number in (1, 2):
        tifffile.imwrite(tmp_path / f"time_{number}.tif", number * values)
    operators = import_module(f"{addon.__name__}.operators.import_volume")
    in_time = "2 frames from time_1.tif", True
    for name, count, proposed, added in (("page", 5, ("", False), 1), ("time", 2, in_time, 2)):
        names, before = [f"{name}_{number}.tif" for number in range(1, count + 1)], set(bpy.data.objects)
        paths = [str(tmp_path / one) for one in names]
        assert operators._sequence_among(paths, operators._shared_format(paths)) == proposed
        bpy.ops.rle_splat.import_volume(directory=str(tmp_path), files=[{"name": one} for one in names])
        found = [one for one in set(bpy.data.objects) - before if one.rle_splat.is_volume]
        assert [one.rle_splat.frame_count for one in found] == [1] * added


def test_sequence_of_a_file_alone_is_refused(phantom, refused):
    refused(bpy.ops.rle_splat.import_volume, "switch Sequence off", filepath=str(phantom[0]), shape=(7, 6, 5),
            dtype="uint8", use_sequence=True)  # fmt: skip


def test_frames_of_one_file_survive_a_reload(tmp_path, bridge):
    nibabel = pytest.importorskip("nibabel")
    values = np.zeros((N, N, N, 3), np.uint8)
    values[...] = np.array((50, 100, 150), np.uint8)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "bold.nii.gz")
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "bold.nii.gz")) == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    owner = bpy.context.view_layer.objects.active
    assert shown_at(bridge, owner, (1, 2, 3, 4)) == [1, 2, 3, 3]
    (tmp_path / "bold.nii.gz").rename(tmp_path / "moved.nii.gz")
    bridge("volumes.volumes").forget_all()
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(tmp_path / "moved.nii.gz")) == {"FINISHED"}
    assert shown_at(bridge, owner, (2,)) == [2]


@pytest.mark.parametrize("scan, organs, sentence", [
    (3, 2, "has 2 volumes and the scan 3; beyond them the last one is shown"),
    (2, 3, "has 3 volumes and the scan 2; the first 2 are shown"),
    (1, 3, "has 3 volumes and the scan 1; the first is shown"), (3, 1, ""), (2, 2, ""),
])  # fmt: skip
def test_labels_of_another_number_of_frames_are_said(scan, organs, sentence, tmp_path, capfd, bridge):
    """Each frame shows the labels of its own number, or else the last ones."""
    nibabel = pytest.importorskip("nibabel")
    for name, frames in (("beat", scan), ("organs", organs)):
        voxels = np.ones((N, N, N, frames), np.uint8) * np.arange(1, frames + 1, dtype=np.uint8)
        image = nibabel.Nifti1Image(voxels if frames > 1 else voxels[..., 0], np.eye(4))
        nibabel.save(image, tmp_path / f"{name}.nii.gz")
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "beat.nii.gz")) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    owner.rle_splat.label_file = str(tmp_path / "organs.nii.gz")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    said = capfd.readouterr().out
    assert sentence in said and bool(sentence) == ("The segmentation file has" in said)
    shown = []
    for frame in range(1, scan + 1):
        bpy.context.scene.frame_set(frame)
        volume, depsgraph = bridge("volumes.volumes").load_volume(owner), bpy.context.evaluated_depsgraph_get()
        function = bridge("look.transfer").read_transfer(owner, depsgraph)
        shown.append(int(bridge("volumes.labels").read_labels(owner, depsgraph, volume, function).volume.voxels.max()))
    assert shown == [min(frame, organs) for frame in range(1, scan + 1)]


@pytest.mark.parametrize("frames", [3, 1])
def test_labels_follow_the_frame_of_a_file_in_time(frames, tmp_path, bridge, core, refused):
    """A map of each frame, with a segment that only the second has; or one map for all frames, which is read once."""
    nibabel = pytest.importorskip("nibabel")
    values = np.zeros((N, N, N, 3), np.uint8) + np.array((50, 100, 150), np.uint8)
    maps = np.zeros((N, N, N, frames), np.uint8)
    for frame in range(frames):
        maps[: frame + 1, :, :, frame] = 5 if frame == 1 else 1
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "beat.nii.gz")
    nibabel.save(nibabel.Nifti1Image(maps if frames > 1 else maps[..., 0], np.eye(4)), tmp_path / "organs.nii.gz")
    assert bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "beat.nii.gz")) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    owner.rle_splat.label_file = str(tmp_path / "organs.nii.gz")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert [row.label for row in owner.rle_splat.labels] == ([0, 1, 5] if frames > 1 else [0, 1])
    labels, loading = bridge("volumes.labels"), bridge("volumes.loading")
    store, volume = bridge("loop.store"), bridge("volumes.volumes").load_volume(owner)
    for forget in (store.forget_all, lambda: None):  # also where the frame that is shown is in memory
        forget()
        wish = store.wish_of(owner, None, labels.PURPOSE)
        done = [step.fraction for step in labels.listed_steps(labels.file_of(owner), volume, wish)]
        between = {int(frames * (2.0 * fraction - 1.0)) for fraction in done if 0.5 <= fraction < 1.0}
        assert done == sorted(done) and (frames == 1 or len(between) >= frames - 1), "each frame shows progress"
    found, keys = [], set()
    for frame in (1, 2, 3, 4, 1):
        bpy.context.scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        volume = bridge("volumes.volumes").load_volume(owner)
        own = labels.read_labels(owner, depsgraph, volume, bridge("look.transfer").read_transfer(owner, depsgraph))
        found.append([int((own.volume.voxels == number).sum()) // N**2 for number in (1, 5)])
        keys.add(labels.file_of(owner, depsgraph))
        assert loading.is_at_hand(owner, depsgraph)
    assert found == ([[1, 0], [0, 2], [3, 0], [3, 0], [1, 0]] if frames > 1 else 5 * [[1, 0]])
    assert len(keys) == frames
    work = bridge("loop.work")
    work._ahead[0] = 1
    run_timer(work)
    assert len(store._entries) == (6 if frames > 1 else 4)
    for frame in (2, 3):
        bpy.context.scene.frame_set(frame)
        assert loading.is_at_hand(owner, bpy.context.evaluated_depsgraph_get())
    if frames > 1:
        owner.rle_splat.active_label = 1
        refused(bpy.ops.rle_splat.change_segment, "change with time", tool="FILL")


def test_a_sequence_of_openvdb_files(tmp_path, bridge, addon):
    bpy.utils.expose_bundled_modules()
    import openvdb

    for frame in (1, 2, 3):
        grid = openvdb.FloatGrid()
        grid.name = "density"
        grid.copyFromArray(np.full((N, N, N + frame), 50.0 * frame, np.float32))
        openvdb.write(str(tmp_path / f"smoke_{frame:04d}.vdb"), grids=[grid])
        del grid
    operators = import_module(f"{addon.__name__}.operators.import_volume")
    path = str(tmp_path / "smoke_0002.vdb")
    proposed = operators._sequence_among([path], operators._shared_format([path]))
    assert proposed == ("3 frames from smoke_0001.vdb", True)
    assert bpy.ops.rle_splat.import_volume(filepath=path, use_sequence=True) == {"FINISHED"}
    owner = bpy.context.view_layer.objects.active
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        volume = bridge("volumes.volumes").load_volume(owner)
        assert volume.shape_xyz == (N + 2, N + 2, N + frame + 2) and volume.voxels.max() == 50.0 * frame
