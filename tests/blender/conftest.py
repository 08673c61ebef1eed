"""Tests in real Blender (the module bpy), of the extension as it is installed from its zip.

The zip comes from RLE_SPLAT_EXTENSION_ZIP, which ``dev.py test`` sets.  Without it one is packed from the tree,
without wheels, by Blender's own tool: quick, but kernels then need numba in this Python, else numpy does the work.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from importlib import import_module, util
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
ZIP_VARIABLE = "RLE_SPLAT_EXTENSION_ZIP"
MODULE = "bl_ext.user_default.rle_splat"
HAS_BPY = util.find_spec("bpy") is not None

if HAS_BPY:
    # Before bpy is imported: nothing may touch the user's own Blender settings.
    os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="rle_splat_user_"))
    import bpy
else:
    collect_ignore_glob = ["test_*.py"]

# The files whose tests also run in Blender's older versions: those marked every_blender in each, and those marked
# oldest_blender in the oldest, too.  They test what differs between versions.
EVERY_BLENDER = {
    # The zip: installation, registration, the kernels' Python, files of earlier versions of the extension.
    "test_register.py", "test_package.py", "test_kernels.py", "test_migration.py", "test_documented_script.py",
    # Blender's data: undo, files, linked and copied datablocks, handlers, color spaces.
    "test_persistence.py", "test_linked.py", "test_images.py",
    # Compositors and view layers; panels; each operator, with what users do to a file meanwhile.
    "test_composite.py", "test_view_layers.py", "test_panels.py", "test_situations_edits.py",
}  # fmt: skip
OLDEST_BLENDER = {
    # Blender's data: keyframes, dialogs, OpenVDB.
    "test_animation.py", "test_motion.py", "test_transfer.py", "test_import.py", "test_vdb.py",
    # Renders: Cycles, EEVEE, the world's nodes.
    "test_world_light.py", "test_mesh_shadows.py", "test_camera.py",
    # The interface: viewports, and what they leave in the depth buffer.
    "test_viewports.py", "test_live_switch.py", "test_live_bad_input.py",
    # What users do to a file: every other situation of the catalogue of hard cases.
    "test_situations_copies.py", "test_situations_deletion.py", "test_situations_files.py",
    "test_situations_identity.py", "test_situations_renders.py", "test_situations_stale.py",
    "test_situations_window.py", "test_messages.py", "test_modes.py", "test_switches.py",
}  # fmt: skip

_status = [0]


@pytest.hookimpl(tryfirst=True)  # before pytest leaves tests out by their marks
def pytest_collection_modifyitems(items):
    for item in items:
        for mark, files in (("every_blender", EVERY_BLENDER), ("oldest_blender", OLDEST_BLENDER)):
            if item.path.parent == Path(__file__).parent and item.path.name in files:
                item.add_marker(mark)


def pytest_report_header():
    if HAS_BPY:
        return f"Blender {bpy.app.version_string}, extension {os.environ.get(ZIP_VARIABLE) or 'packed from the tree'}"
    return "tests/blender goes UNTESTED: this Python has no bpy; run python3 dev.py test"


def pytest_sessionfinish(exitstatus):
    _status[0] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure():
    if HAS_BPY:  # bpy 4.5 deadlocks in a destructor when the interpreter ends with handlers or classes registered
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_status[0])


def _pack(folder: Path) -> Path:
    """A zip of the tree without wheels, made by the packaging tool of this bpy."""
    from devtools.build import MANIFEST, shipped

    source = folder / "source"
    for path in shipped():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, source / path)
    shutil.copyfile(MANIFEST, source / MANIFEST.name)
    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
    subprocess.run(
        [sys.executable, str(tool), "build", "--source-dir", str(source), "--output-dir", str(folder)],
        check=True, capture_output=True)  # fmt: skip
    return next(folder.glob("*.zip"))


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory) -> Path:
    given = os.environ.get(ZIP_VARIABLE)
    return Path(given) if given else _pack(tmp_path_factory.mktemp("zip"))


@pytest.fixture(scope="session")
def installed(extension_zip) -> str:
    """The name of the add-on's module, after the zip has really been installed."""
    done = bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=str(extension_zip), enable_on_install=True, overwrite=True
    )
    assert done == {"FINISHED"}
    assert MODULE in bpy.context.preferences.addons
    return MODULE


@pytest.fixture(autouse=True)
def addon(installed):
    """The enabled add-on's module, in an empty file.

    The add-on stays enabled from test to test: enabling it unpacks its wheels anew, which takes a second.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if MODULE not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module=MODULE)
    assert MODULE in bpy.context.preferences.addons
    return import_module(MODULE)


@pytest.fixture(scope="session")
def grids_in_cycles(tmp_path_factory):
    """Skips where Cycles shows no OpenVDB grids, with no add-on either."""
    if bpy.app.binary_path:
        grids = import_module("tests.blender.grids")  # it takes a module that Blender has only now
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        grids.needs_any_grid(tmp_path_factory.mktemp("grids"))


@pytest.fixture(scope="module")
def by_numpy(installed):
    """Let the numpy reference of the installed add-on do the work of a whole module: no kernels to compile."""
    with import_module(f"{MODULE}.rle_splat.runtime.jit").use_reference():
        yield


@pytest.fixture
def classified_first(addon):
    """The scene's classification is the paper's, for tests whose closed forms have its ramps over the face voxels."""
    bpy.context.scene.rle_splat.classification = "pre"


@pytest.fixture
def bridge(addon):
    """``bridge("volumes.volumes")`` is the installed add-on's module bridge.volumes.volumes."""
    return lambda name: import_module(f"{MODULE}.bridge.{name}")


@pytest.fixture
def core(addon):
    """``core("scene")`` is the module rle_splat.scene inside the installed add-on."""
    return lambda name: import_module(f"{MODULE}.rle_splat.{name}")


@pytest.fixture
def phantom(tmp_path):
    """A raw file of 7 x 6 x 5 voxels, no two alike, with a name that says nothing: (path, voxels (5, 6, 7) uint8)."""
    voxels = np.arange(5 * 6 * 7, dtype=np.uint8).reshape(5, 6, 7)
    path = tmp_path / "phantom.raw"
    path.write_bytes(voxels.tobytes())
    return path, voxels


@pytest.fixture
def volume_object(phantom):
    """The phantom imported with spacing 1, 2 and 3 mm and its values' own range as the preset's."""
    bpy.ops.rle_splat.import_volume(
        filepath=str(phantom[0]), shape=(7, 6, 5), dtype="uint8", spacing=(1.0, 2.0, 3.0), preset="faint"
    )
    return bpy.context.view_layer.objects.active


@pytest.fixture
def library(addon, tmp_path):
    """The path of a library, see ``linking.make_library``."""
    return import_module("tests.blender.linking").make_library(tmp_path)


def contents() -> dict:
    """How many datablocks of each kind there are, and what is active: what a failed operator must leave alone."""
    kinds = ("objects", "meshes", "collections", "node_groups", "images", "cameras", "actions")
    counts = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    return {**counts, "active": bpy.context.view_layer.objects.active}


@pytest.fixture
def refused():
    """``refused(operator, words, **options)``: the operator fails with one sentence holding the words and changes
    nothing."""

    def check(operator, words, **options):
        before = contents()
        with pytest.raises(RuntimeError) as caught:
            operator(**options)
        message = str(caught.value)
        assert words.lower() in message.lower(), message
        assert "Traceback" not in message
        assert len(message.strip().removeprefix("Error: ").strip().splitlines()) == 1, message
        assert contents() == before

    return check
