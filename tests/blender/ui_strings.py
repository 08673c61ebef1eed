"""Every text of the add-on that Blender's interface shows, and the file that it is in.

Texts of operators, panels, menus and properties are those that the running Blender has registered.  Texts that draw
functions pass to the layout, and whole sentences of reports and refusals, are read from the source.
"""

import ast
import inspect
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import bpy

from tests.blender import layout_recorder

ROOT = Path(__file__).resolve().parents[2]
BASES = (
    bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.UIList, bpy.types.PropertyGroup,
    bpy.types.AddonPreferences, bpy.types.FileHandler, bpy.types.GizmoGroup,
)  # fmt: skip
FOLDERS = ("bridge", "operators", "panels")
# A call -> which of its positional arguments is a text for the user.
POSITIONAL = {
    "report": 1, "needs": 2, "refuse": 1, "RleSplatError": 0, "paragraph": 2, "tell": 0, "pgettext_tip": 0,
    "pgettext_iface": 0, "with_unit": 0, "with_ellipsis": 0, "filled": 0, "_step": 2,
}  # fmt: skip
# Sentences of the renderer that users meet most and that ``translate`` finds as they stand.
WHOLE = (
    "the values are Hounsfield units and include bone", "the values are Hounsfield units and include little bone",
    "the values are Hounsfield units and include little but fat", "above", "below",
    "The values are signed distances, so the inside of the surface is shown.",
    "The file states no unit of length; mm is assumed.",
    "The file does not say where the patient's left and right are.",
    "The file does not say how it lies in the patient, so left and right are not known.",
    "The world has changed since its light was rendered; the volume shows the earlier light. Click Update World Light.",
    "The world's light is not rendered yet, so it is left out; click Update World Light.",
    "rendering the world's light",
    "Looking through the voxels", "Shading", "Splatting", "Warping", "Mixing volumes",
    "counting the values", "adding the volume",
    "The camera does not see the volume; point it at the volume, or move the volume between its clip distances.",
    "The scene has no active camera; add a camera and make it active with Ctrl+Numpad 0.",
)  # fmt: skip
OF_CLASS = ("bl_label", "bl_description")  # also of a tool, which is no registered class
LAYOUT_TEXT = "text"  # the keyword argument of layout functions
BLENDERS = "Unique name used in the code and scripting"  # how a description begins that Blender gives


def registered(module: str) -> dict:
    """Text -> file, of everything that the add-on's module has registered."""
    found = {}
    for cls in dict.fromkeys(cls for base in BASES for cls in layout_recorder.subclasses(base)):
        if not cls.__module__.startswith(module):
            continue
        file = cls.__module__.removeprefix(f"{module}.").replace(".", "/") + ".py"
        kind, texts = cls.bl_rna, [getattr(cls, "bl_label", ""), getattr(cls, "bl_category", "")]
        if issubclass(cls, bpy.types.Operator):
            group, _, name = cls.bl_idname.partition(".")
            kind = getattr(getattr(bpy.ops, group), name).get_rna_type()
            texts += [kind.name, kind.description]
        ours = [base for base in cls.__mro__ if base.__module__.startswith(module)]
        own = {name for base in ours for name in inspect.get_annotations(base)}
        texts += [text for entry in kind.properties if entry.identifier in own for text in _of_property(entry)]
        found.update((text, file) for text in texts if _is_text(text))
    return found


def _of_property(entry) -> list:
    texts = [] if entry.is_hidden else [entry.name, entry.description]
    if entry.type == "ENUM" and not entry.is_hidden:
        items = entry.enum_items_static or entry.enum_items
        texts += [text for item in items for text in (item.name, item.description)]
    return texts


def written(root: Path = ROOT) -> dict:
    """Text -> file and line, of texts in the source that are whole as they stand."""
    paths = sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
    trees = {path.relative_to(root).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    constants = [(path, name, text) for path, tree in trees.items() for name, text in _named(tree)]
    named = {}
    for _, name, text in constants:
        named.setdefault(name, []).append(text)
    found = {text: path for path, name, text in constants if name in OF_CLASS and _is_text(text)}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                found.update((text, f"{path}:{node.lineno}") for text in _of_call(node, named) if _is_text(text))
    return found


def of_the_renderer(module: str) -> dict:
    """Text -> file, of the sentences of the renderer that the interface translates."""
    path = "bridge/translations/__init__.py"
    known = import_module(f"{module}.bridge.translations")
    return dict.fromkeys((*known.COMPOSED, *WHOLE), path)


def said_by_the_renderer(root: Path = ROOT) -> set:
    """The texts in the renderer's sources, those that are composed with {} for each field."""
    found = set()
    paths = (path for folder in ("rle_splat", "bridge", "operators") for path in (root / folder).rglob("*.py"))
    for path in (one for one in paths if one.parent.name != "translations"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                found.add("".join(getattr(part, "value", "{}") if isinstance(part, ast.Constant) else "{}"
                                  for part in node.values))  # fmt: skip
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(node.value)
    return found


def _named(tree):
    """(name, text) of each constant that is a text, and of what a loop over written tuples gives a name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.For) and isinstance(node.target, ast.Tuple) and isinstance(node.iter, ast.Tuple):
            for row in node.iter.elts:
                for target, value in zip(node.target.elts, getattr(row, "elts", ())):
                    if target.id == LAYOUT_TEXT and isinstance(value, ast.Constant):
                        yield target.id, value.value
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            for target in node.targets:
                if isinstance(target, ast.Name):
                    yield target.id, node.value.value


def _of_call(node: ast.Call, named: dict) -> list:
    function = node.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    values = [keyword.value for keyword in node.keywords if keyword.arg == LAYOUT_TEXT]
    position = POSITIONAL.get(name)
    if position is not None and len(node.args) > position:
        values.append(node.args[position])
    return [constant for value in values for constant in _constants(value, named)]


def _constants(node, named: dict) -> list:
    """The strings that an expression can be, of those written in it or named by it."""
    if isinstance(node, ast.IfExp):
        return _constants(node.body, named) + _constants(node.orelse, named)
    if isinstance(node, (ast.Name, ast.Attribute)):
        name = node.id if isinstance(node, ast.Name) else node.attr
        return named.get(name, [])
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def _is_text(text: str) -> bool:
    """Whether there is something of ours to translate: a word of at least two letters."""
    return not text.startswith(BLENDERS) and any(a.isalpha() and b.isalpha() for a, b in pairwise(text))
