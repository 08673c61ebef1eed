"""A long session by script: imports, edits, pictures, renders, undo and loading, round after round, and its memory.

    .venvs/bpy-5.2/bin/python tests/blender/long_session.py [rounds]

A job of its own, which CI does not run: 200 rounds take many minutes.  It prints the resident memory after each ten
rounds, and fails where it has grown by more than a tenth since the session was warm.
"""

import ctypes
import gc
import os
import sys
import tempfile
import traceback
from pathlib import Path

os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="rle_splat_user_"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import bpy
import numpy as np

from tests.blender import conftest, scenes
from tests.blender.conftest import MODULE
from tests.blender.scenes import module

ROUNDS, EVERY, WARM = 200, 10, 40  # rounds; between two lines of the table; until caches are full
MOST = 1.1  # times the memory of the warm session
SIDE = 128  # voxels, few of which are shown: 2 MiB
DIGITS = 1024.0 * 1024.0


def resident() -> float:
    """MiB of this process that are in memory, after what is free was given back to the system."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / DIGITS


def held() -> float:
    """MiB that the extension holds: voxels, and results of stages."""
    stages = module("bridge.scene.render_scene").KEPT
    return (module("bridge.loop.store").nbytes() + stages.nbytes) / DIGITS


def new_file() -> None:
    """Another file, with a camera, a mesh and a lamp."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scenes.use_cycles((16, 16))
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    scenes.add_camera((0.0, -50.0, 20.0), (1.2, 0.0, 0.0))
    scenes.add_mesh([(-40, 0, -40), (40, 0, -40), (0, 0, 40)], [(0, 1, 2)], (1.0, 1.0, 1.0))
    light = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    bpy.context.scene.collection.objects.link(light)


def go_round(number: int, folder: Path) -> None:
    """Import a volume that differs from all before, edit and show it in every way, undo, and delete it."""
    away = np.sqrt(sum((axis - SIDE / 2) ** 2 for axis in np.ogrid[:SIDE, :SIDE, :SIDE]))
    ball = np.clip(250.0 - (25.0 + 0.05 * number) * away, 0.0, 255.0).astype(np.uint8)
    owner = scenes.import_raw(folder, ball, name=f"ball {number % 7}")
    owner.location = (-SIDE / 2,) * 3
    labels = folder / f"labels {number % 7}.raw"
    (ball // 64).tofile(labels)
    owner.rle_splat.label_file = str(labels)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="imported")
    bpy.ops.rle_splat.add_slice(kind="AXIAL")
    scenes.activate(owner)
    settings = bpy.context.scene.rle_splat
    settings.lighting = "HEADLIGHT" if number % 10 else "SCENE"  # shadows of a lamp take long without kernels
    owner.rle_splat.shift = 0.1 * (number % 3)
    owner.location.z += 0.5 * (number % 5)
    scenes.update()
    if number % 3 == 0:
        assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
        owner.location.x += 1.0
        scenes.update()
    if number % 2:
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    else:
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
        bpy.context.scene.render.filepath = str(folder / "out.exr")
        bpy.ops.render.render(write_still=True)
        assert not settings.render_problem, settings.render_problem
    bpy.ops.ed.undo_push(message="edited")
    bpy.ops.ed.undo()
    if number % 5 == 4:
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"file {number % 2}.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(folder / f"file {number % 2}.blend"))
        scenes.update()
    for one in [one for one in bpy.data.objects if one.rle_splat.is_volume or one.rle_splat.is_slice]:
        bpy.data.objects.remove(one)
    scenes.update()
    assert held() == 0.0, "the last volume leaves nothing behind"
    if number % 10 == 9:
        new_file()
    if number % 50 == 49:
        bpy.ops.preferences.addon_disable(module=MODULE)
        bpy.ops.preferences.addon_enable(module=MODULE)
        new_file()


def main(rounds: int) -> int:
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_session_"))
    zipped = conftest._pack(Path(tempfile.mkdtemp(prefix="rle_splat_zip_")))
    bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=str(zipped), enable_on_install=True, overwrite=True
    )
    found = []
    new_file()
    for number in range(rounds):
        with module("rle_splat.runtime.jit").use_reference():
            go_round(number, folder)
        found.append(resident())
        if number % EVERY == EVERY - 1:
            print(f"round {number + 1:4d}: {found[-1]:7.1f} MiB", flush=True)
    warm, late = np.median(found[WARM : WARM + EVERY]), np.median(found[-EVERY:])
    print(f"warm {warm:.1f} MiB, at the end {late:.1f} MiB: {late / warm:.3f} times")
    return int(late > MOST * warm)


try:
    code = main(int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS)
except BaseException:
    traceback.print_exc()
    code = 1
sys.stdout.flush()
os._exit(code)
