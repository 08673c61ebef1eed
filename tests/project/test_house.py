"""The floor plan, enforced by reading imports: who may import whom, and what shipped code never does.

What ships is the root __init__.py, rle_splat/, bridge/, operators/ and panels/.
"""

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow  # dev.py lint runs it

# A package or module -> its floor.  It imports itself and lower floors, nothing else.
FLOORS = {
    "rle_splat.scene": 1,
    "rle_splat.runtime": 1.5,  # its refusals are the scene's error
    "rle_splat.volume": 2,
    "rle_splat.read": 3,
    "rle_splat.segment": 2.5,  # the automatic transfer function looks for the body
    "rle_splat.classify": 3,
    "rle_splat.view": 3,
    "rle_splat.shade": 4.5,  # codes of its light are those of the encoder's records
    "rle_splat.encode": 4,
    "rle_splat.splat": 5,
    "rle_splat.raycast": 5.5,  # it looks voxels up as the sheets do
    "rle_splat.warp": 5.5,  # it takes the intermediate image
    "rle_splat.effects": 6,
    "rle_splat.pipeline": 7,
    "rle_splat.figure": 7.5,
    "rle_splat.accuracy": 8,
    "rle_splat.accuracy.planner": 8.5,
    "rle_splat": 9,  # the facade exports the pipeline and the planner
    "rle_splat.comparison": 9,
    "rle_splat.cli": 10,
    "rle_splat.__main__": 10.5,
    "bridge": 11,
    "operators": 12,
    "panels": 12.5,  # they draw buttons of the operators
    "": 13,
}

# A truth shares no code with what it measures: accuracy sees the scene's plain data only.
ONLY = {"rle_splat.accuracy": {"rle_splat.scene"}}

# Modules that these importers alone may use, because the extension's zip is without them.
IMPORTERS = {
    "rle_splat.comparison": ("rle_splat.cli.compare",), "rle_splat.cli.compare": (),
    "rle_splat.cli.cluster": ("rle_splat.cli.render",), "rle_splat.cli.cluster_worker": ("rle_splat.cli.cluster",),
}  # fmt: skip

# Packages that are not Python's own, by package or module; every other package of rle_splat has numpy alone.
BLENDER_PACKAGES = ("", "bridge", "operators", "panels")
BLENDERS_OWN = {"bpy", "bmesh", "bpy_extras", "bl_ui", "bl_operators", "mathutils", "gpu", "gpu_extras", "blf", "numpy"}
THIRD_PARTY = {
    "rle_splat.runtime": {"numba", "llvmlite", "numpy"},
    "rle_splat.read": {"numpy", "openvdb", "pyopenvdb", "OpenImageIO", "nibabel", "nrrd", "tifffile"},
    "rle_splat.cli": {"numpy", "OpenEXR", "matplotlib"},
    "rle_splat.cli.cluster": {"distributed"},
    "rle_splat.segment.masks": {"numpy", "cc3d", "edt"},
    "rle_splat.read.dicom.discovery": {"numpy", "pydicom"},
    "rle_splat.read.dicom.elements": {"numpy", "pydicom"},
    "rle_splat.read.dicom.pixels": {"numpy", "pydicom"},
}

# What the Extensions platform refuses, or we do: threads, code from text, the network, other programs.
FORBIDDEN_MODULES = {
    "threading", "_thread", "concurrent", "multiprocessing", "asyncio", "socket", "ssl", "http", "urllib", "ftplib",
    "smtplib", "xmlrpc", "socketserver", "webbrowser", "subprocess", "pip", "ensurepip", "pickle",
}  # fmt: skip
# Where one of them is wanted all the same.
EXCEPTIONS = {
    # numba's form of a compiled kernel.
    "rle_splat.runtime.shipped_kernels": {"pickle"},
    # A damaged frame can end the process that decodes it.
    "rle_splat.read.dicom.decoders": {"subprocess"},
    # Not in the extension: Ctrl+C is kept from the processes that Dask begins.
    "rle_splat.cli.cluster": {"multiprocessing"},
}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__"}


def shipped_files():
    files = [ROOT / "__init__.py"]
    for folder in ("rle_splat", "bridge", "operators", "panels"):
        files += sorted((ROOT / folder).rglob("*.py"))
    return [path.relative_to(ROOT) for path in files if path.is_file()]


def module_name(path: Path) -> str:
    """rle_splat/splat/sheet.py -> rle_splat.splat.sheet; the root __init__.py -> ""."""
    parts = list(path.with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def package_of(module: str) -> str | None:
    """The package that a module of ours is in: the longest name in FLOORS that begins it."""
    parts = module.split(".") if module else []
    for length in range(len(parts), 0, -1):
        if ".".join(parts[:length]) in FLOORS:
            # the package rle_splat itself, not an unknown package inside it
            return ".".join(parts[:length]) if length == len(parts) or parts[:length] != ["rle_splat"] else None
    return "" if not parts else None


def is_module(name: str) -> bool:
    base = ROOT.joinpath(*name.split("."))
    return base.with_suffix(".py").is_file() or base.is_dir()


@cache  # three gates read them
def imports_of(path: Path, source: str):
    """(own modules, other top-level packages) that a shipped file imports, relative imports resolved.

    What only the type checker imports is left out: it is no dependency of what runs.
    """
    package = list(path.parent.parts)
    own, others = set(), set()
    tree = ast.parse(source)
    tree.body = [
        node for node in tree.body if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            others |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            others.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - (node.level - 1)] + (node.module.split(".") if node.module else [])
            for alias in node.names:
                deeper = ".".join([*base, alias.name])
                own.add(deeper if is_module(deeper) else ".".join(base))
    return own, others


def floor_breaks(path: Path, source: str) -> list[str]:
    package = package_of(module_name(path))
    if package is None:
        return [f"{path} is in no package of the plan"]
    found = []
    for imported in imports_of(path, source)[0]:
        other = package_of(imported)
        if other == package:
            continue
        is_other_end = package in BLENDER_PACKAGES and other == "rle_splat.cli"  # two ways to use the same renderer
        is_above = other is None or FLOORS[other] >= FLOORS[package]
        if is_above or is_other_end or other not in ONLY.get(package, {other}):
            found.append(f"{path} ({package or 'root'}) may not import {imported}")
    return found


def zip_breaks(path: Path, source: str) -> list[str]:
    """Imports of what is not in the extension's zip."""
    importer, found = module_name(path), []
    for imported in imports_of(path, source)[0]:
        for outside, importers in IMPORTERS.items():
            inside = importer == outside or importer.startswith(f"{outside}.")
            if (imported == outside or imported.startswith(f"{outside}.")) and not inside and importer not in importers:
                found.append(f"{path} may not import {imported}, which is not in the zip")
    return found


def foreign_imports(path: Path, source: str) -> list[str]:
    package = package_of(module_name(path)) or ""
    in_blender = package in BLENDER_PACKAGES
    allowed = BLENDERS_OWN if in_blender else THIRD_PARTY.get(module_name(path)) or THIRD_PARTY.get(package, {"numpy"})
    return [
        f"{path} may not import {name}"
        for name in imports_of(path, source)[1]
        if name in FORBIDDEN_MODULES - EXCEPTIONS.get(module_name(path), set())
        or (name not in sys.stdlib_module_names and name not in allowed)
    ]


def refused_code(path: Path, source: str) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(source)):
        where = f"{path}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
            found.append(f"{where} calls {node.func.id}")
        elif isinstance(node, ast.Attribute) and ast.unparse(node) in ("sys.path", "os.system", "os.popen"):
            found.append(f"{where} uses {ast.unparse(node)}")
        elif isinstance(node, ast.ExceptHandler):
            broad = node.type is None or ast.unparse(node.type) in ("Exception", "BaseException")
            if node.type is None or (broad and all(isinstance(part, ast.Pass) for part in node.body)):
                found.append(f"{where} swallows every error")
        elif isinstance(node, ast.Name) and node.id == "bl_info":
            found.append(f"{where} has bl_info, which extensions do without")
    return found


@pytest.fixture(scope="module")
def sources():
    files = {path: (ROOT / path).read_text(encoding="utf-8") for path in shipped_files()}
    assert len(files) > 30, "the shipped code was not found"
    return files


@pytest.mark.parametrize("gate", [floor_breaks, zip_breaks, foreign_imports, refused_code])
def test_shipped_code_passes(gate, sources):
    found = [line for path, source in sources.items() for line in gate(path, source)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("gate", "path", "source"),
    [
        (floor_breaks, "rle_splat/splat/sheet.py", "from ..pipeline.render import render"),
        (floor_breaks, "rle_splat/splat/sheet.py", "from ..pipeline import render"),
        (floor_breaks, "rle_splat/splat/sheet.py", "from ..warp import warp"),
        (floor_breaks, "rle_splat/accuracy/oracle.py", "from ..classify.transfer_function import TransferFunction"),
        (floor_breaks, "rle_splat/accuracy/lighting.py", "from ..volume.gradient import unit_normals"),
        (floor_breaks, "rle_splat/encode/encode.py", "def f():\n    from ...bridge import images"),
        (floor_breaks, "bridge/images.py", "from ..operators import render_image"),
        (floor_breaks, "bridge/images.py", "from ..rle_splat.cli.report import number_text"),
        (floor_breaks, "rle_splat/attic/old.py", ""),
        (zip_breaks, "rle_splat/cli/accuracy.py", "def f():\n    from ..comparison.compare import compare_steps"),
        (zip_breaks, "rle_splat/cli/main.py", "from . import compare"),
        (zip_breaks, "operators/accuracy.py", "from ..rle_splat.comparison import levoy"),
        (foreign_imports, "rle_splat/pipeline/render.py", "import bpy"),
        (foreign_imports, "rle_splat/splat/sheet.py", "from numba import njit"),
        (foreign_imports, "rle_splat/warp/warp.py", "import scipy.ndimage"),
        (foreign_imports, "bridge/jobs.py", "def f():\n    import threading"),
        (foreign_imports, "bridge/jobs.py", "import subprocess"),
        (foreign_imports, "rle_splat/read/dicom/decoders.py", "import threading"),
        (foreign_imports, "operators/import_volume.py", "from urllib.request import urlopen"),
        (foreign_imports, "bridge/images.py", "import rle_splat"),
        (refused_code, "panels/main.py", "eval('1')"),
        (refused_code, "bridge/vdb.py", "import sys\nsys.path.append('x')"),
        (refused_code, "bridge/vdb.py", "try:\n    f()\nexcept:\n    g()"),
        (refused_code, "bridge/vdb.py", "try:\n    f()\nexcept Exception:\n    pass"),
        (refused_code, "__init__.py", "bl_info = {}"),
    ],
)
def test_the_gates_see_what_they_forbid(gate, path, source):
    assert gate(Path(path), source)


@pytest.mark.parametrize(
    ("gate", "path", "source"),
    [
        (floor_breaks, "rle_splat/splat/sheet.py", "from ..encode.tables import RunLengthVolume"),
        (floor_breaks, "rle_splat/splat/sheet.py", "from ..runtime import jit"),
        (floor_breaks, "rle_splat/accuracy/oracle.py", "from ..scene import Camera\nfrom .rays import rigid"),
        (floor_breaks, "__init__.py", "from . import bridge, operators, panels"),
        (
            floor_breaks,
            "operators/render_image.py",
            "from ..rle_splat.pipeline.render import render\nfrom ..bridge import images",
        ),
        (zip_breaks, "rle_splat/cli/compare.py", "from ..comparison.compare import compare_steps"),
        (zip_breaks, "rle_splat/comparison/westover.py", "from .medium import Medium\nfrom . import footprint"),
        (foreign_imports, "bridge/images.py", "import bpy, numpy, json"),
        (refused_code, "rle_splat/runtime/jit.py", "try:\n    f()\nexcept Exception as problem:\n    note(problem)"),
    ],
)
def test_the_gates_let_the_plan_through(gate, path, source):
    assert not gate(Path(path), source)


# --- how large a function may be --------------------------------------------------------------------------------

MOST_ARGUMENTS = 30
MOST_NESTING = 5  # blocks within one another: loops, conditions, with and try
BLOCKS = (ast.For, ast.While, ast.If, ast.With, ast.Try, ast.Match)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def argument_count(function) -> int:
    given = function.args
    return len([*given.posonlyargs, *given.args, *given.kwonlyargs])


def nesting(statements) -> int:
    """How deep blocks lie within one another; ``elif`` adds no level, and a function inside is counted by itself."""
    deepest = 0
    for statement in statements:
        if not isinstance(statement, BLOCKS):
            continue
        bodies = [statement.body, getattr(statement, "finalbody", [])] if hasattr(statement, "body") else []
        bodies += [part.body for part in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ()))]
        orelse = getattr(statement, "orelse", [])
        chained = isinstance(statement, ast.If) and len(orelse) == 1 and isinstance(orelse[0], ast.If)
        bodies += [] if chained else [orelse]
        deepest = max(deepest, 1 + max(map(nesting, bodies)), nesting(orelse) if chained else 0)
    return deepest


def test_functions_have_few_arguments_and_little_nesting(sources):
    looked, found = 0, []
    for path, source in sources.items():
        for function in ast.walk(ast.parse(source)):
            if isinstance(function, FUNCTIONS):
                looked += 1
                counts = argument_count(function), nesting(function.body)
                if counts[0] > MOST_ARGUMENTS or counts[1] > MOST_NESTING:
                    found.append(f"{path}: {function.name} has {counts[0]} arguments and {counts[1]} levels")
    assert looked > 1000
    assert not found, "\n".join(found)


@pytest.mark.parametrize("source, arguments, levels", [
    ("def f(a, b=1, /, *c, d): pass", 3, 0),
    ("def f():\n for a in b:\n  if a:\n   pass\n  elif b:\n   pass\n  else:\n   while a: pass", 0, 3),
    ("def f():\n try:\n  pass\n except E:\n  with a:\n   pass", 0, 2),
    ("def f():\n match a:\n  case 1:\n   if b: pass", 0, 2),
    ("def f():\n if a:\n  def g():\n   for b in c: pass", 0, 1),
])  # fmt: skip
def test_arguments_and_nesting_are_counted(source, arguments, levels):
    function = ast.parse(source).body[0]
    assert (argument_count(function), nesting(function.body)) == (arguments, levels)


def test_blender_versions_are_told_apart_in_one_file_only(sources):
    """Every difference between Blender's versions stands in bridge/versions.py."""
    askers = {path.as_posix() for path, source in sources.items() if "bpy.app.version" in source}
    assert askers <= {"bridge/versions.py"}


def test_shaders_are_made_from_a_create_info(sources):
    """Vulkan and Metal take no others, and have no OpenGL."""
    old = ("GPUShader(", "import bgl", "from bgl")
    assert not [f"{path}: {word}" for path, source in sources.items() for word in old if word in source]


# Parts of numba that replace or patch its compiler, and settings of the whole process.
COMPILERS = ("numba.core.lowering", "numba.core.typed_passes", "numba.core.compiler_machinery", "numba.core.compiler")


def process_wide(path: Path, source: str) -> list[str]:
    """Lines that set numba's configuration or replace parts of its compiler."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Assign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [f"{path}:{node.lineno}" for target in targets if "numba.config." in ast.unparse(target)]
        elif isinstance(node, ast.ImportFrom) and node.module in COMPILERS:
            found.append(f"{path}:{node.lineno}")
        elif isinstance(node, ast.Import) and any(alias.name in COMPILERS for alias in node.names):
            found.append(f"{path}:{node.lineno}")
    return found


def test_numba_is_used_as_it_is(sources):
    found = [line for path, source in sources.items() for line in process_wide(path, source)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("source", (
    "numba.config.OPT = 1", "numba.config.OPT, x = 1, 2", "from numba.core.lowering import Lower",
    "import numba.core.typed_passes",
))  # fmt: skip
def test_changes_to_numba_are_seen(source):
    assert process_wide(Path("rle_splat/runtime/jit.py"), source)
