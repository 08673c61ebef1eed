"""The viewport's own compositor and the live volume in a real window: after F12 the volume is moved, and only the live
picture of it may be seen.

    python3 dev.py blender --photograph tests/blender/window_compositor.py --size 1280x800
"""

import tempfile
from pathlib import Path

import bpy

from tests.blender import panel_states, scenes
from tests.blender.user_steps import settled
from tests.blender.window_driver import area_of, by_numpy, drive, in_the_view, new_file, passed, photograph, until


def scenario():
    by_numpy()
    yield from new_file()
    with in_the_view():
        owner = panel_states.add_volume(Path(tempfile.mkdtemp(prefix="rle_splat_compositor_")))
        scenes.use_cycles((96, 72))
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    space = area_of("VIEW_3D").spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.overlay.show_overlays = False
    for mode in ("DISABLED", "CAMERA", "ALWAYS"):
        space.shading.type, space.shading.use_compositor = "RENDERED", mode
        for x in (0.0, 4.0):
            owner.location.x = x
            yield from settled()
            for _ in range(8):
                yield
            yield from photograph(f"compositor {mode.lower()} {x:g}")
    passed("the viewport's compositor")


drive(scenario)
