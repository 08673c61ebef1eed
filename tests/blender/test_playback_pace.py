"""How many frames of a scan in time the first round of playback shows: the loop and a viewport by a clock of the test's
own, with readings, drafts and a window that take so long."""

from types import SimpleNamespace

import bpy
import pytest

from tests.blender import scenes
from tests.blender.stand_ins import Clock, modules_of, request_of

pytestmark = pytest.mark.usefixtures("by_numpy")

N, FRAMES, RATE = 4, 24, 24.0
STEPS = 5  # of a reading and of a draft


@pytest.fixture
def owner(tmp_path):
    """Numbered files whose voxels are the number of their frame, imported."""
    for frame in range(1, FRAMES + 1):
        (tmp_path / f"beat_{frame:04d}.raw").write_bytes(bytes([frame]) * N**3)
    scene = scenes.use_cycles((16, 16))
    scene.frame_start, scene.frame_end = 1, FRAMES
    bpy.ops.rle_splat.import_volume(
        filepath=str(tmp_path / "beat_0001.raw"), shape=(N, N, N), dtype="uint8", spacing=(1, 1, 1), use_sequence=True
    )
    return bpy.context.view_layer.objects.active


class Window:
    """A window that plays the animation, on a clock of its own."""

    def __init__(self, bridge, core, owner, monkeypatch):
        self.clock, self.shown = Clock(), []
        self._live, self._work, self._timer = bridge("live"), bridge("loop.work"), bridge("loop.timer")
        self._made, self._surface = modules_of(bridge), bridge("live.surface")
        app = SimpleNamespace(
            background=False, is_job_running=lambda _: False,
            timers=SimpleNamespace(is_registered=lambda _: False, register=lambda *_, **__: None),
        )  # fmt: skip
        monkeypatch.setattr(self._timer, "bpy", SimpleNamespace(app=app, context=bpy.context))
        for module in (self._timer, self._work):
            monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=self.clock))
        for module in ("loop.work", "loop.timer", "live", "live.ahead"):
            monkeypatch.setattr(bridge(module), "is_playing", lambda: True)
        region = SimpleNamespace(tag_redraw=lambda: None)
        monkeypatch.setattr(
            self._surface, "region_of", lambda _: (region, SimpleNamespace(regions=[]), bpy.context.window)
        )
        live = self._live.Live()
        self.viewport = live.viewport = self._made.viewport.Viewport(
            core("pipeline.stage_cache").StageCache(), self.clock
        )
        monkeypatch.setattr(self._live, "_lives", {1: live})
        key = bridge("loop.index").key_of(owner)
        self._request = request_of(self._made, volumes=(key,))

    def play(self, frames, takes: float) -> None:
        """Show frames of the timeline, of which Blender itself draws each in so many seconds."""
        for frame in frames:
            due = self.clock.now + 1.0 / RATE
            bpy.context.scene.frame_set(frame)
            self._timer.start(self._work._tick)
            surface = self._surface.BlenderSurface(bpy.context, self._request, None, [])
            surface.hides = lambda: False
            self.viewport.redraw(self._request, frame, surface, self._timer.PLAYING)
            assert not self.viewport.problem
            if self.viewport.is_busy:
                self._timer.start(self._live._tick, self._timer.PAUSE)
            self.clock.now += takes
            wait = self._timer._tick()  # Blender calls it once at least between two redraws
            while wait is not None and self.clock.now + wait < due:
                self.clock.now += wait
                wait = self._timer._tick()
            self.clock.now = max(self.clock.now, due)


@pytest.fixture
def window(bridge, core, owner, monkeypatch):
    made = Window(bridge, core, owner, monkeypatch)
    yield made
    bridge("loop.work").stop()
    bridge("loop.timer").stop_all()


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("takes, reading, drafting, least", [
    (0.07, 0.05, 0.03, 22), (0.07, 0.05, 0.06, 22), (0.005, 0.02, 0.01, 22), (0.005, 0.05, 0.02, 11),
])  # fmt: skip
def test_the_first_round_shows_the_frames_that_can_be_read_and_drawn(
    window, bridge, monkeypatch, packed, takes, reading, drafting, least
):
    """In turn.  A packed file is unpacked from where it was read last: a frame that is left out takes as long."""
    volumes, work, last = bridge("volumes.volumes"), bridge("loop.work"), [1]
    read = volumes.file_steps

    def slow_read(path, options):
        frame = int(path[-8:-4])
        unpacked = frame - last[0] if frame > last[0] else frame
        last[0] = frame
        for _ in range(STEPS):
            window.clock.now += reading * (unpacked if packed else 1) / STEPS
            yield work.Progress(0.0, "reading")
        return (yield from read(path, options))

    def slow_draft(shot, _ends, _cache, coarseness):
        for _ in range(STEPS):
            window.clock.now += (drafting if coarseness is not None else 10.0 * drafting) / STEPS
            yield
        window.shown.append(int(shot.contents[0].plain.volume.voxels.max()))
        return []

    monkeypatch.setattr(volumes, "file_steps", slow_read)
    monkeypatch.setattr(bridge("live.viewport"), "picture_steps", slow_draft)
    window.play(range(1, FRAMES + 1), takes)
    assert len(set(window.shown)) >= least, window.shown
    assert window.shown == sorted(window.shown)


def test_playback_shows_the_last_frame_in_memory_unless_it_is_too_late_or_the_round_is_new(
    window, bridge, owner, tmp_path, monkeypatch
):
    work, loading, drain = bridge("loop.work"), bridge("volumes.loading"), bridge("volumes.volumes").drain
    scene, found = bpy.context.scene, []
    for now in (1, 3, 3, 5, 9, 2):
        scene.frame_set(now)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        late = work.late(depsgraph)
        waits = work.want(owner, depsgraph, late)
        found.append((now + late, waits))
        if now == 3:
            drain(loading.load_ahead_steps(owner, 1))
    assert found == [(1, False), (1, False), (1, False), (4, False), (4, False), (2, True)]
    scene.frame_set(4)
    assert work.late(bpy.context.evaluated_depsgraph_get()) == 0
    scene.frame_set(9)
    assert work.late(bpy.context.evaluated_depsgraph_get()) == -5
    monkeypatch.setattr(work, "MOST_LATE", 3)
    assert work.late(bpy.context.evaluated_depsgraph_get()) == 0
    (tmp_path / "beat_0012.raw").unlink()
    scene.frame_set(12)
    assert work.late(bpy.context.evaluated_depsgraph_get()) == 0, "what is wrong with a frame is not said"
