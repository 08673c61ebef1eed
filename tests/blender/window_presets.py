"""Thumbnails of presets and own presets in a real window: rendered while the tab is shown, kept, applied by a button.

dev.py test runs it.  Its photographs are to be looked at.
"""

import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

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
    wait_for_rest,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_presets_"))
MRML = """<MRML>
<VolumeProperty name="Rose" shade="1" ambient="0.1" diffuse="0.9" specular="0.2" specularPower="10"
 scalarOpacity="6 0 0 60 0 255 0.4" gradientOpacity="6 0 0 9 1 255 1" colorTransfer="8 0 0 0 0 255 1 0.6 0.6"/>
<VolumeProperty name="Sea" shade="0" scalarOpacity="6 0 0 90 0 255 0.1" gradientOpacity="4 0 1 255 1"
 colorTransfer="8 0 0 0.2 0.4 255 0.4 1 1"/>
</MRML>"""


def pictures() -> dict:
    """The icons that there are, by the name of their preset."""
    (collection,) = module("bridge.look.thumbnails")._collections
    return {name.rsplit("'", 2)[1]: preview for name, preview in collection.items()}  # the last text of its key


def import_scan():
    """Import a ball with bright spots within, a little as a head."""
    z, y, x = (np.mgrid[:96, :80, :72] - np.array((48.0, 40.0, 36.0))[:, None, None, None]) / 36.0
    radius = np.sqrt(x**2 + y**2 + 0.7 * z**2)
    spots = 0.6 + 0.4 * np.sin(9 * x) * np.cos(7 * z)
    voxels = np.where(radius < 0.95, 60 + 150 * (radius < 0.8) * spots, 0)
    path = FOLDER / "head_72x80x96_uint8.raw"
    path.write_bytes(voxels.astype(np.uint8).tobytes())
    with in_the_view():
        bpy.ops.rle_splat.import_volume(filepath=str(path), shape=(72, 80, 96), dtype="uint8", modality="MR")
    return bpy.context.view_layer.objects.active


def watch_calls(thumbnails) -> list:
    """Have the timer's function note how long each call takes."""
    took, tick = [], thumbnails._tick

    def timed():
        began = time.perf_counter()
        try:
            return tick()
        finally:
            took.append(time.perf_counter() - began)

    thumbnails._tick = timed
    return took


def suits(owner) -> list:
    return [one for one in module("bridge.look.preset_entries").groups(owner.rle_splat) if one.is_open]


def check_thumbnails(owner, took):
    """Placeholders first, then the pictures; made in short steps."""
    yield from photograph("placeholders")
    wanted = {entry.name for group in suits(owner) for entry in group.entries}
    yield from until(lambda: wanted <= set(pictures()))
    yield from photograph("thumbnails")
    for name, preview in pictures().items():
        pixels = np.array(preview.image_pixels_float).reshape(128, 128, 4)
        assert pixels[..., :3].std() > 0.01, f"the thumbnail of {name} is blank"
    # The first calls load kernels that the viewport has not needed.
    first, later = took[: len(took) // 3], took[len(took) // 3 :]
    for name, calls in (("first third", first), ("later", later)):
        print(f"{len(calls)} calls, {name}, the longest {sorted(round(1e3 * t) for t in calls)[-4:]} ms", flush=True)
    assert len(took) >= len(wanted)


def check_apply(owner):
    """A button applies its preset, as the operator does, and is drawn pressed."""
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="smoke") == {"FINISHED"}
    yield
    yield from until(lambda: not viewport_is_busy())
    yield from photograph("applied")
    assert owner.rle_splat.transfer_name


def viewport_is_busy() -> bool:
    return any(one.is_busy for one in module("bridge.live").viewports_of(area_of("VIEW_3D")))


def check_own(owner):
    """Own presets stand in a group of their own, with thumbnails."""
    path = FOLDER / "presets.xml"
    path.write_text(MRML)
    with in_the_view():
        bpy.ops.rle_splat.import_presets(filepath=str(path), overwrite=True)
        bpy.ops.rle_splat.save_user_preset(name="My Smoke", overwrite=True)
    shipped = module("rle_splat.runtime.jit").shipped_level()
    # Gradient opacity has kernels of its own, which no thumbnail compiles.
    wanted = {"Rose", "Sea", "My Smoke"} if shipped else {"My Smoke"}
    yield from until(lambda: wanted <= set(pictures()))
    yield from photograph("own")


def check_dialogs(owner):
    """The dialogs: save as preset, several in a file, delete."""
    path = FOLDER / "presets.xml"
    for name, options in (
        ("save_user_preset", {"name": "My Smoke"}),
        ("load_transfer_function", {"filepath": str(path)}),
        ("delete_user_preset", {"name": "Sea"}),
    ):
        with in_the_view():
            kind = "EXEC_DEFAULT" if name == "load_transfer_function" else "INVOKE_DEFAULT"
            getattr(bpy.ops.rle_splat, name)(kind, **options)
        yield from photograph(name)
        for value in ("PRESS", "RELEASE") * 2:  # the first ends typing, where a dialog begins with that
            window().event_simulate(type="ESC", value=value)
            yield


def check_from_disk(owner):
    """Another session finds the pictures on disk and renders nothing."""
    thumbnails = module("bridge.look.thumbnails")
    thumbnails.stop()
    rendered = []
    original = thumbnails.thumbnail_steps
    thumbnails.thumbnail_steps = lambda *arguments: rendered.append(arguments) or original(*arguments)
    area_of("VIEW_3D").tag_redraw()
    yield from until(lambda: {"AUTO", "faint"} <= set(pictures()))
    thumbnails.thumbnail_steps = original
    assert not rendered


def check_other_tab(owner):
    """Without the tab nothing is made."""
    thumbnails = module("bridge.look.thumbnails")
    yield from until(lambda: not thumbnails._wanted)
    region_of(area_of("VIEW_3D"), "UI").active_panel_category = "View"
    yield
    thumbnails.stop()
    for group in suits(owner):
        for entry in group.entries:
            thumbnails.icon(owner, entry)
    yield from wait_for_rest()
    assert not pictures() and not thumbnails._wanted and thumbnails._tick not in module("bridge.loop.timer")._due
    region_of(area_of("VIEW_3D"), "UI").active_panel_category = "RLE Splat"
    yield


def scenario():
    open_panels("RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets")
    yield from new_file()
    took = watch_calls(module("bridge.look.thumbnails"))
    owner = import_scan()
    yield
    yield from check_thumbnails(owner, took)
    passed("check_thumbnails")
    for check in (check_apply, check_own, check_dialogs, check_from_disk, check_other_tab):
        yield from check(owner)
        passed(check.__name__)


drive(scenario, overlap=False)
