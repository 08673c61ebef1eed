"""Save Figure in a real window: its button, its file browser, and the view of a viewport.

    python3 dev.py blender --photograph tests/blender/window_figure.py

keeps photographs and the figure of a viewport in build/window-shots/window_figure.
"""

import json
import os
import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_figure_"))


def add_balls():
    """Two balls side by side, the larger one toward +X."""
    z, y, x = np.mgrid[:40, :40, :60]
    large = np.sqrt((x - 40.0) ** 2 + (y - 20.0) ** 2 + (z - 20.0) ** 2) / 15.0
    small = np.sqrt((x - 12.0) ** 2 + (y - 20.0) ** 2 + (z - 20.0) ** 2) / 8.0
    voxels = np.clip(250.0 * (1.6 - np.minimum(large, small)), 0.0, 250.0).astype(np.uint8)
    scenes.import_raw(FOLDER, voxels, name="balls")


def confirmed(name):
    """Open the operator's file browser with a name, and press its button."""
    with in_the_view():
        bpy.ops.rle_splat.save_figure("INVOKE_DEFAULT", filepath=str(FOLDER / name), names=True)
    yield
    yield from photograph(f"file browser {name}")
    window, area = next(
        (window, area) for window in bpy.context.window_manager.windows for area in window.screen.areas
        if area.type == "FILE_BROWSER"
    )  # fmt: skip
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.file.execute()
    yield


def scenario():
    open_panels("RLE_SPLAT_PT_picture")
    yield from new_file()
    with in_the_view():
        add_balls()
        bpy.ops.rle_splat.frame_volume()
        bpy.ops.view3d.view_axis(type="FRONT")
    yield
    yield
    yield from photograph("panel")
    shots = Path(os.environ.get(SHOTS) or FOLDER)
    with in_the_view():
        path = shots / "viewport.png"
        done = bpy.ops.rle_splat.save_figure(filepath=str(path), view="VIEWPORT", width_cm=8.0, dpi=150.0)
    assert done == {"FINISHED"} and path.is_file()
    scene = json.loads((shots / "viewport.figure.json").read_text())["panels"][0]["scene"]
    assert scene["camera"]["type"] == "ORTHO"
    region = next(one for one in area_of("VIEW_3D").regions if one.type == "WINDOW")
    assert abs(scene["width"] / scene["height"] - region.width / region.height) < 0.01
    passed("the view of a viewport")

    with in_the_view():
        assert bpy.ops.rle_splat.threshold_segment(low=150.0, high=255.0) == {"FINISHED"}
    bpy.context.object.rle_splat.labels[-1].label_name = "balls"
    yield from confirmed("chosen.svg")
    yield from until(lambda: (FOLDER / "chosen.figure.json").is_file())
    made = (FOLDER / "chosen.svg").read_text()
    assert made.startswith("<?xml") and ">Balls</text>" in made
    passed("a figure in steps, from the file browser")
    yield from photograph("after")

    sidecar = (FOLDER / "chosen.figure.json").read_bytes()
    yield from confirmed("chosen.png")
    yield from photograph("refused")
    assert not (FOLDER / "chosen.png").exists() and (FOLDER / "chosen.figure.json").read_bytes() == sidecar
    passed("the sidecar of another figure is not replaced")


drive(scenario, overlap=False)
