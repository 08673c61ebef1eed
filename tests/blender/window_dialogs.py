"""Every dialog in a real Blender's window: File > Import and the drop dialog with a file of every format, and every
other dialog once.  A file is chosen and read as a user does it, with mouse and keys.

dev.py test runs it.  It fails for an exception in a draw function, for an error that is reported, for options that are
not drawn, and for a dialog that is left out.  Its photographs are to be looked at.
"""

import inspect
import tempfile
from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

from tests.blender.formats import write_every_format, write_series
from tests.blender.layout_recorder import Drawn, subclasses
from tests.blender.panel_states import add_volume
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    passed,
    photograph,
    region_of,
    until,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_dialogs_"))
PLACING = {"at_cursor", "use_framing", "use_headlight"}
VALUES = {"modality", "value_unit", "use_calibration"}
ENCODED = ("ball.rle", "tables.rle/header.json")
NO_ZARR = "needs the package zarr"
FILES: dict = {}  # name of a file -> options of its own in the import dialog
drawn: dict = {}  # name of an operator -> what is in its dialog


def operators() -> list:
    return [cls for cls in subclasses(bpy.types.Operator) if cls.__module__.startswith(MODULE)]


def name_of(cls) -> str:
    return cls.bl_idname.split(".")[1]


def watch_draws() -> None:
    """Have each dialog that was drawn to its end note what is in it."""
    for cls in operators():
        if inspect.isfunction(getattr(cls, "draw", None)):
            cls.draw = watched(cls, cls.draw)


def watched(cls, draw):
    def draw_and_note(self, context):
        draw(self, context)
        log: list = []
        draw(Drawn(cls, log, self.properties), context)
        drawn[name_of(cls)] = {argument for _function, argument in log}

    return draw_and_note


def volumes() -> list:
    return [one for one in bpy.data.objects if one.rle_splat.is_volume]


def press(kind: str, at=None) -> None:
    """A key, or a button of the mouse at a pixel of the window."""
    place = {} if at is None else {"x": int(at[0]), "y": int(at[1])}
    if place:
        window().event_simulate(type="MOUSEMOVE", value="NOTHING", **place)
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=kind, value=value, **place)


def rest_mouse() -> None:
    """Move the mouse to the middle of the 3D view, about which popups are drawn."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    place = {"x": region.x + region.width // 2, "y": region.y + region.height // 2}
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", **place)


def reports() -> str:
    """All that the add-on and Blender have reported, from the Info editor."""
    area = area_of("PROPERTIES")
    before = area.type
    area.type = "INFO"
    with bpy.context.temp_override(window=window(), area=area, region=region_of(area, "WINDOW")):
        bpy.ops.info.select_all(action="SELECT")
        bpy.ops.info.report_copy()
    area.type = before
    return bpy.context.window_manager.clipboard


def browser():
    return next((one for one in window().screen.areas if one.type == "FILE_BROWSER"), None)


def first_row() -> tuple[int, int]:
    """Where the browser lists its first file."""
    region = region_of(browser(), "WINDOW")
    return region.x + 80, region.y + region.height - 32


def go_to(folder: Path, name: str = ""):
    """List what a folder holds, or of that one file, in the browser that an operator has opened."""
    yield from until(lambda: browser() and browser().spaces.active.params)
    params = browser().spaces.active.params
    params.directory, params.display_type, params.filter_search = str(folder).encode(), "LIST_VERTICAL", name
    yield
    yield


def choose(folder: Path, name: str):
    """Click a file in the browser, and wait until it is chosen."""
    yield from go_to(folder, name)
    press("LEFTMOUSE", first_row())
    yield from until(lambda: browser().spaces.active.params.filename == name)
    yield


def write_tables() -> None:
    """A ball in the two forms of encoded voxels."""
    owner = add_volume(FOLDER)
    plain, _ = module("bridge.scene.render_scene").read_scene(
        owner, bpy.context.evaluated_depsgraph_get(), with_meshes=False
    )
    quality = module("rle_splat.scene").Quality(classification="pre")
    file, header = ENCODED
    module("rle_splat.encode.store").write_encoded(
        module("rle_splat.pipeline.encode_scene").encode(plain, quality), FOLDER / file
    )
    module("rle_splat.pipeline.encode_folder").encode_folder(plain, (FOLDER / header).parent, quality)


def expected(name: str) -> set:
    """What the import dialog has to hold for a file."""
    return PLACING if name in ENCODED else PLACING | VALUES | set(FILES[name])


def check_import():
    """The options of each format in File > Import, and what is read after Return."""
    for name in (*FILES, *ENCODED):
        yield from new_file()
        path = FOLDER / name
        drawn.clear()
        with in_the_view():
            bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT")
        yield from choose(path.parent, path.name)
        yield from photograph(f"import {name.replace('/', ' ')}")
        assert drawn["import_volume"] >= expected(name) and "preset" not in drawn["import_volume"], f"{name}: {drawn}"
        press("RET", first_row())
        yield from read(name)


def check_pages():
    """All pages of a stack, chosen together, are one volume and no frames."""
    yield from new_file()
    with in_the_view():
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT")
    yield from choose(FOLDER, "page_01.tif")
    browser().spaces.active.params.filter_search = "page_"
    yield
    yield
    press("A", first_row())
    yield from until(lambda: "5 files; numbered pages are one stack" in drawn["import_volume"])
    yield from photograph("import pages")
    assert "use_sequence" not in drawn["import_volume"]
    press("RET", first_row())
    yield from read("pages")
    assert volumes()[0].rle_splat.frame_count == 1


def check_folder():
    """A folder of a series and one of masks in File > Import."""
    for name in ("series", "masks"):
        yield from new_file()
        drawn.clear()
        with in_the_view():
            bpy.ops.rle_splat.import_dicom_series("INVOKE_DEFAULT")
        yield from go_to(FOLDER / name)
        yield from photograph(f"import folder {name}")
        assert drawn["import_dicom_series"] >= PLACING and "preset" not in drawn["import_dicom_series"], (
            f"{name}: {drawn}"
        )
        press("RET", first_row())
        yield from read(name)


def check_drop():
    """The dialog of a dropped file for each set of options that files have, and what is read after Return; the same
    dialog has those of every format in ``check_import``."""
    dropped = module("operators.import_volume").RLE_SPLAT_FH_volume.bl_file_extensions.split(";")
    names = [name for name in (*FILES, ENCODED[0]) if Path(name).suffix in dropped]
    assert len(names) > 10
    options = {FILES.get(name): name for name in names}
    assert len(options) > 4
    for name in options.values():
        yield from new_file()
        path = FOLDER / name
        drawn.clear()
        rest_mouse()
        yield
        with in_the_view():
            bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=str(path.parent), files=[{"name": path.name}])
        if name.endswith(".vdb"):  # Blender asks who reads it: Import OpenVDB Volume, or Import Volume
            yield
            press("V")
        yield from photograph(f"drop {name.replace('/', ' ')}")
        assert drawn["import_volume"] >= expected(name) and "preset" not in drawn["import_volume"], f"{name}: {drawn}"
        press("RET")
        yield from read(name)


def read(name: str):
    """Wait until a file is read, or refused where it has to be."""
    yield from until(lambda: browser() is None)
    yield from until(lambda: volumes() or "zarr" in name)
    yield
    yield from until(lambda: not module("bridge.loop.jobs").StepwiseOperator.is_running())
    yield
    if "zarr" in name:
        assert NO_ZARR in reports() and not volumes()
    else:
        assert_no_error(name)
        assert len(volumes()) == 1, name


def assert_no_error(what: str) -> None:
    said = reports()
    assert not any(word in said for word in ("Error", "Traceback")), f"{what}: {said}"


def opens_dialog(cls) -> bool:
    """Whether an operator asks before it works."""
    asks = ("invoke_confirm", "invoke_props_dialog", "fileselect_add")
    own = inspect.getsource(cls.invoke) if inspect.isfunction(getattr(cls, "invoke", None)) else ""
    return issubclass(cls, (ImportHelper, ExportHelper)) or any(word in own for word in asks)


def write_functions() -> Path:
    """A file with two transfer functions."""
    kind = '<VolumeProperty name="{}" scalarOpacity="4 0 0 255 1" colorTransfer="8 0 0 0 0 255 1 1 1"/>'
    path = FOLDER / "presets.xml"
    path.write_text(f"<MRML>{kind.format('Rose')}{kind.format('Sea')}</MRML>")
    return path


def check_others():
    """Every dialog that is not of an import, opened once and left by Esc."""
    yield from new_file()
    owner = add_volume(FOLDER)
    with in_the_view():  # the tools for segments want one
        assert bpy.ops.rle_splat.threshold_segment("EXEC_DEFAULT", low=100.0) == {"FINISHED"}
    owner.rle_splat.active_label = 1
    owner.rle_splat.level, owner.rle_splat.frame_count = 0, 2
    options = {"reload_volume": {"use_dialog": True}, "delete_user_preset": {"name": "mine"}}
    leads_to = {
        "choose_transfer_function": ("load_transfer_function", "EXEC_DEFAULT", {"filepath": str(write_functions())})
    }
    of_imports = {"import_volume", "import_dicom_series", "choose_series"}
    names = {name_of(cls): cls for cls in operators() if opens_dialog(cls)}
    assert of_imports | set(options) < set(names), sorted(names)
    for name in sorted(set(names) - of_imports):
        drawn.clear()
        rest_mouse()
        yield
        with in_the_view():
            opener, call, given = leads_to.get(name, (name, "INVOKE_DEFAULT", options.get(name, {})))
            getattr(bpy.ops.rle_splat, opener)(call, **given)
        yield
        yield from photograph(name)
        if inspect.isfunction(getattr(names[name], "draw", None)):
            asks = name != "import_channel"  # for more than a file
            assert bool(drawn.get(name)) == asks, f"in the dialog of {name}: {drawn}"
        for _ in range(1 if browser() else 2):  # the first ends typing, where a dialog begins with that
            press("ESC", first_row() if browser() else None)
            yield
        yield from until(lambda: browser() is None)
    assert_no_error("the dialogs")


def check_series():
    """The choice among the series of a folder."""
    yield from new_file()
    write_series(FOLDER / "study" / "1", 1, 4)
    write_series(FOLDER / "study" / "2", 2, 6)
    drawn.clear()
    with in_the_view():
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=str(FOLDER / "study"), use_dialog=False)
    yield from until(module("bridge.volumes.series").offered)
    yield from photograph("choose_series")
    assert drawn["choose_series"]
    press("RET")
    yield from read("study")


def scenario():
    bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
    bpy.context.preferences.addons[MODULE].preferences.show_imported = False  # no kernel is compiled
    FILES.update(write_every_format(FOLDER, MODULE))
    watch_draws()
    yield from new_file()
    write_tables()
    for check in (check_others, check_series, check_folder, check_pages, check_drop, check_import):
        yield from check()
        passed(check.__name__)


drive(scenario, overlap=False)
