"""Drives a real Blender's window: steps from a timer, what Blender prints while it draws, and photographs.

A scenario is a generator function; at each ``yield`` the window does its own work for a moment:

    import bpy
    from tests.blender.window_driver import drive, in_the_view, new_file, open_panels, passed, photograph

    def scenario():
        open_panels("RLE_SPLAT_PT_picture", "RLE_SPLAT_PT_render")  # and close the others
        yield from new_file()
        with in_the_view():
            bpy.ops.rle_splat.import_volume(filepath=...)
        yield from photograph("imported")
        passed("imported")

    drive(scenario)

``python3 dev.py blender --photograph FILE`` runs it and keeps its pictures in build/window-shots/.  What it imports of
tests/blender is there.  RLE_SPLAT_EXTENSION_ZIP names the zip to install, RLE_SPLAT_SHOTS the folder for photographs.
"""

import ctypes
import faulthandler
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import bpy
import gpu

from tests.blender.real_blender import MODULE, enable, install
from tests.blender.scenes import module

PAUSE = 0.03  # seconds between steps
PATIENCE = 600  # seconds of pauses; each waits for the window, so a busy machine gets more time
STILL = 0.6  # seconds that a photograph waits for work that goes on
SLEEP = 0.005  # seconds between looks for events, as Blender sleeps where none is simulated
SHOTS = "RLE_SPLAT_SHOTS"
# The only photograph of each script that is kept, but for those that a script looks at, and the only one with outlines
# of selected objects and the floor's grid, a quarter of what software takes for a redraw.  Without the variable all are
# kept, and have them.
GOLDEN = json.loads(os.environ.get("RLE_SPLAT_GOLDEN", "null"))
TAB = "RLE Splat"
WIDE = 380  # pixels of the Properties editor, as on a screen of usual size

# What a failing draw function, or a layout that was given nonsense, leaves on the console.
PROBLEM = re.compile(r"Traceback|Error: Python|\bWARN|rna_|unknown|not found")
# The time of a forced redraw, the add-on's messages, what a small system lacks (/proc, languages, the network), and a
# counter of Blender's own that goes wrong when a render's thread and the main one call Python at the same time.
HARMLESS = re.compile(
    r"^(\w+: \d+ . Draw Window.*|RLE Splat: .*|.*mounted file-systems|.*'PreferencesView', .*'language'"
    r"|Repository data: .*|ERROR: Python context internal state bug.*|[\d:.]+ +operator +\| (?!ERROR).*)\n",
    re.MULTILINE | re.IGNORECASE,
)

LONG_LINE = re.compile(r"(.{400}).+")


class Console:
    """Everything the process prints, Blender's own C code included, kept in a file and passed on by ``close``."""

    def __init__(self):
        self._flush()
        self._terminal = os.dup(1)
        faulthandler.enable(self._terminal)  # what a crash leaves in the file is never passed on
        self._file = tempfile.TemporaryFile()
        os.dup2(self._file.fileno(), 1)
        os.dup2(self._file.fileno(), 2)
        self._read = 0

    def _flush(self) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        ctypes.CDLL(None).fflush(None)

    def news(self) -> str:
        """What was printed since the last call; an AssertionError if a function of Python failed and Blender went on,
        as it does when a dialog is drawn or a handler is called."""
        text = self.pass_on()
        assert "Traceback" not in text, f"Blender printed:\n{text}"
        return HARMLESS.sub("", text)

    def pass_on(self) -> str:
        """Print what was printed since the last call; return it."""
        self._flush()
        size = os.fstat(self._file.fileno()).st_size
        text = os.pread(self._file.fileno(), size - self._read, self._read).decode(errors="replace")
        self._read = size
        text = LONG_LINE.sub(r"\1 ...", text)  # the list of all icons
        os.write(self._terminal, text.encode())
        return text


class Run:
    """What is going on: the console, the scenarios, each with whether regions overlap, the checks that passed, the
    script that runs, and the file that new ones begin with."""

    console: Console
    scenarios: list = []
    passed: list = []
    script = ""
    start = ""


def drive(scenario, overlap: bool = True) -> None:
    """Enable the extension and run the scenario's steps, then those of the next script that Blender was given, then end
    Blender: with code 1 after an exception.

    The last line says how many checks passed: those named by ``passed``.  A scenario that has a kernel compiled fails
    at its end: every user who comes to that state would wait for it.

    ``overlap``: the sidebar lies over the view, as Blender has it; beside it, a redraw takes a third less.
    """
    Run.scenarios.append((scenario, overlap))
    if len(Run.scenarios) > 1:
        return
    Run.console = Console()
    running = _steps()

    def tick():
        try:
            drawn = Run.console.news()  # since the last step
            assert not PROBLEM.search(drawn), f"Blender printed:\n{drawn}"
            next(running)
            Run.console.news()
            return PAUSE
        except StopIteration:
            compiled = compiled_kernels()
            failed = int(bool(compiled))
            if compiled:
                print(f"compiled, since the zip does not bring them: {', '.join(compiled)}", flush=True)
        except Exception as problem:
            traceback.print_exception(problem)
            failed = 1
        print(f"{len(Run.passed)} passed, {failed} failed, 0 skipped", flush=True)
        Run.console.pass_on()
        os._exit(failed)  # quitting in the ordinary way would ask to save

    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.system.viewport_aa = "OFF"  # software draws it
    bpy.context.preferences.inputs.mouse_double_click_time = 1  # ms; clicks follow fast
    bpy.app.timers.register(_sleep, persistent=True)
    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)


def _sleep() -> float:
    """Timer function, called in each turn of Blender's loop, which turns without a rest while events are simulated:
    a window that waits then takes a whole processor."""
    time.sleep(SLEEP)
    return 0.0


def _steps():
    check_backend()
    if not enable():
        install()
    # Beside other work software reads depth slowly; a viewport that has waited too often shows no lines in the volume.
    module("bridge.live.surface").WAITS = math.inf
    shots = Path(os.environ.get(SHOTS) or tempfile.mkdtemp(prefix="rle_splat_shots_"))
    for number, (scenario, overlap) in enumerate(Run.scenarios):
        if number:
            window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=-9, y=-9)  # out of all regions, as at first
            yield
        Run.script, Run.start = Path(scenario.__code__.co_filename).stem, ""
        os.environ[SHOTS] = str(shots / Run.script)
        (shots / Run.script).mkdir()
        bpy.context.preferences.system.use_region_overlap = overlap
        yield from scenario()


def check_backend() -> None:
    """Print what the window is drawn with; an AssertionError where Blender was to be drawn with something else."""
    backend = gpu.platform.backend_type_get()
    print(f"drawn with {backend}, {gpu.platform.renderer_get()}", flush=True)
    if "--gpu-backend" in sys.argv:
        assert sys.argv[sys.argv.index("--gpu-backend") + 1].upper() == backend


def compiled_kernels() -> list[str]:
    """The kernels that were compiled here although the zip brings kernels; none of those that it brings is copied."""
    jit = sys.modules.get(f"{MODULE}.rle_splat.runtime.jit")
    if jit is None or not jit.shipped_level():
        return []
    return sorted({path.name.partition("-")[0] for path in jit.KERNELS.rglob("*.nbc")})


def passed(name: str) -> None:
    """Count a check that passed; print it with the processor seconds since Blender's start."""
    Run.passed.append(name)
    print(f"{name} passed, {time.process_time():.1f} s", flush=True)


def window():
    return bpy.context.window_manager.windows[0]


def area_of(kind: str):
    """The largest area of a type."""
    return max((area for area in window().screen.areas if area.type == kind), key=lambda area: area.width * area.height)


def region_of(area, kind: str):
    return next(region for region in area.regions if region.type == kind)


def in_the_view():
    """What an operator needs to be run as from the 3D view."""
    area = area_of("VIEW_3D")
    return bpy.context.temp_override(window=window(), area=area, region=region_of(area, "WINDOW"))


def until(condition):
    """Step back into the window's own loop until the condition holds."""
    for _ in range(int(PATIENCE / PAUSE)):
        if condition():
            return
        yield
    raise AssertionError(f"waited {PATIENCE} s in vain")


def open_panels(*idnames: str) -> None:
    """Have the add-on's panels of these names and the first one open from the start, and the others closed; without
    names, all open.

    Blender keeps whether a panel is open from when it is first drawn, so this acts on files opened later.
    """
    Run.start = ""
    panels, shown = module("panels"), {"RLE_SPLAT_PT_volume", *idnames}
    panels.unregister()
    for cls in panels.CLASSES:
        if issubclass(cls, bpy.types.Panel):
            others = set(getattr(cls, "bl_options", ())) - {"DEFAULT_CLOSED"}
            cls.bl_options = others if not idnames or cls.__name__ in shown else others | {"DEFAULT_CLOSED"}
    panels.register()


def new_file():
    """An empty, unsaved file with two areas: the 3D view with the add-on's tab, and Properties > Render with the
    add-on's panels alone."""
    if not Run.start:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        yield from show_panels()
        scene = bpy.context.scene
        scene.eevee.taa_samples = scene.cycles.preview_samples = 1  # each draws the whole view again
        path = Path(tempfile.mkdtemp(prefix="rle_splat_window_")) / "start.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
        Run.start = str(path)
    else:
        bpy.ops.wm.read_homefile(filepath=Run.start)
    assert MODULE in bpy.context.preferences.addons
    yield


def show_panels():
    """Show the add-on's panels in both places, and close every other area."""
    properties = area_of("PROPERTIES")
    with bpy.context.temp_override(window=window(), area=properties):  # before the mouse is in a region
        bpy.ops.screen.area_move(x=properties.x - 1, y=properties.height // 2, delta=properties.width - WIDE)
    for area in [area for area in window().screen.areas if area.type not in ("VIEW_3D", "PROPERTIES")]:
        with bpy.context.temp_override(window=window(), area=area):
            bpy.ops.screen.area_close()
    yield
    for cls in bpy.types.Panel.__subclasses__():
        if getattr(cls, "bl_context", "") == "render" and not cls.__module__.startswith(MODULE):
            cls.COMPAT_ENGINES = set()  # Blender's own, which would push ours out of sight
    properties, view = area_of("PROPERTIES"), area_of("VIEW_3D")
    properties.spaces.active.context = "RENDER"
    view.spaces.active.show_region_ui = True
    if GOLDEN is not None:
        show_lines(False)
    yield  # a region has no tabs before it was drawn
    region_of(view, "UI").active_panel_category = TAB
    yield


def show_lines(shown: bool) -> None:
    """Show or hide the grid, the axes and outlines of selected objects in all 3D views, and smooth their lines."""
    bpy.context.preferences.system.use_overlay_smooth_wire = shown
    for area in window().screen.areas:
        if area.type == "VIEW_3D":
            overlay = area.spaces.active.overlay
            overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = shown
            overlay.show_outline_selected = shown


def redraw() -> None:
    """Draw the window now; an AssertionError with what Blender printed meanwhile."""
    Run.console.news()
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    said = Run.console.news()
    assert not said, f"while drawing Blender printed:\n{said}"


def is_at_rest() -> bool:
    """Whether the add-on has nothing to do: its timer calls nothing, and neither a render nor its operators run."""
    timer = module("bridge.loop.timer")
    return not timer._due and not timer.must_wait()


def wait_for_rest():
    """Step until the add-on has nothing to do, and the window was drawn without giving it anything to do."""
    rests = 0

    def has_rested() -> bool:
        nonlocal rests
        rests = rests + 1 if is_at_rest() else 0
        return rests == 2

    yield
    yield from until(has_rested)


def drawn():
    """Have all areas drawn in the window's own next turn, in which ``drive`` hears what Blender complains of."""
    for area in window().screen.areas:
        area.tag_redraw()
    yield


def is_kept(name: str) -> bool:
    """Whether a photograph of this name is wanted: in the whole run that of GOLDEN alone."""
    return GOLDEN is None or is_golden(name)


def is_golden(name: str) -> bool:
    """Whether a photograph of this name is compared with an approved one."""
    return GOLDEN is not None and GOLDEN.get(Run.script) == name


def photograph(name: str, looked_at: bool = False):
    """Draw everything and keep a picture of the screen as NAME.png.

    Work of the add-on may end before; what goes on for longer than STILL is photographed as it is then.

    Parameters
    ----------
    name : str
        Of the picture.
    looked_at : bool
        The script reads the picture, so it is kept in any case.
    """
    if is_golden(name):
        show_lines(True)
    yield from drawn()
    yield  # for the work that was found while drawing
    if not is_at_rest():
        end = time.monotonic() + STILL
        yield from until(lambda: time.monotonic() > end or is_at_rest())
    if not (looked_at or is_kept(name)):
        return
    yield from drawn()
    program = shutil.which("import")
    if program is None:
        print("no pictures are kept: ImageMagick's import is not on PATH", flush=True)
        return
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    subprocess.run([program, "-window", "root", "-quality", "10", str(path)], check=True)
    if is_golden(name):
        show_lines(False)
