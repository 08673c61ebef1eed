"""Seconds from a fresh installation of the zip to the first picture: a raw file of 256^3 voxels, then a DICOM folder.

    RLE_SPLAT_EXTENSION_ZIP=ZIP .venvs/bpy-5.2/bin/python tests/blender/first_pictures.py
    python3 dev.py blender --photograph tests/blender/first_pictures.py --size 1280x800

prints for each scan of ``SCANS`` that lies (or is linked) in tests/blender/scans the seconds of reading, and from then
to a picture of 800 x 600 pixels in Blender's module, or to the refined one of a window's viewport; behind them the
processor time.  The folder of compiled kernels begins empty; it fails where one was compiled.
"""

import os
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="rle_splat_user_"))
os.environ["RLE_SPLAT_CACHE"] = tempfile.mkdtemp(prefix="rle_splat_cache_")
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import bpy
import numpy as np

from tests.blender import real_blender, scenes, user_steps, window_driver

DATA = Path(__file__).parent / "scans"
SCANS = ("bonsai_256x256x256_uint8.raw.gz", "dicom_ct_skull_phantom_512x512x140")
SIZE = 800, 600


class Watch:
    """Seconds since the last look, of the clock and of the processor."""

    def __init__(self):
        self.look()

    def look(self) -> str:
        before, self.now = getattr(self, "now", None), (time.perf_counter(), time.process_time())
        return "" if before is None else "{:.2f} s ({:.2f} s)".format(*(b - a for a, b in zip(before, self.now)))


def read(scan: str) -> None:
    assert bpy.ops.rle_splat.import_volume(filepath=str(DATA / scan)) == {"FINISHED"}


def report(scan: str, reading: str, picture: str) -> None:
    print(f"{scan}: reading {reading}, picture {picture}", flush=True)


def in_a_window():
    window_driver.PAUSE = 0.01  # seconds, which count in what is measured
    for scan in filter(lambda scan: (DATA / scan).exists(), SCANS):
        yield from window_driver.new_file()
        watch = Watch()
        with window_driver.in_the_view():
            read(scan)
        reading = watch.look()
        yield from user_steps.settled()
        report(scan, reading, watch.look())
        yield from window_driver.photograph(scan.partition("_")[0])
        window_driver.passed(scan)


def look_from_the_front() -> None:
    """A camera that sees all of the volume."""
    corners = import_module(f"{real_blender.MODULE}.bridge.volumes.box").world_corners(bpy.context.object)
    middle, side = corners.mean(0), float(np.ptp(corners, 0).max())
    scenes.add_camera(middle - (0.0, 3.0 * side, 0.0), (0.5 * np.pi, 0.0, 0.0), type="ORTHO", ortho_scale=1.5 * side)


def in_the_module() -> None:
    real_blender.install()
    for scan in filter(lambda scan: (DATA / scan).exists(), SCANS):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = SIZE
        watch = Watch()
        read(scan)
        reading = watch.look()
        look_from_the_front()
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
        report(scan, reading, watch.look())
    assert not window_driver.compiled_kernels()
    sys.stdout.flush()
    os._exit(0)


in_the_module() if bpy.app.background else window_driver.drive(in_a_window)
