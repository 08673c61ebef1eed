"""Classes of Blender as the source of the extension declares them, for without Blender they cannot be imported."""

from __future__ import annotations

import ast
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

from . import docs_panels
from .places import ROOT

DIALOG = "use_dialog"  # which scripts need not set
UNSET = "If unset"  # in the description of a property that has another default than its type's


@dataclass
class Declared:
    """A class of the extension as its source declares it."""

    name: str
    module: ast.Module
    file: str
    bases: list[str]
    doc: str
    texts: dict[str, str] = field(default_factory=dict)  # its bl_... attributes
    properties: dict[str, dict] = field(default_factory=dict)  # Python name -> kind, name, description, choices
    methods: list[str] = field(default_factory=list)


@cache
def namespace_of(path: Path) -> dict:
    """What a module of the extension assigns and the functions it defines, as far as that works without Blender."""
    names: dict = {"__name__": path.stem}
    needs_blender = suppress(NameError, ImportError, AttributeError, KeyError)
    for node in docs_panels.module(path).body:
        if isinstance(node, ast.ImportFrom) and node.level:
            for one in node.names:
                with needs_blender:
                    names[one.asname or one.name] = _imported(path, node, one.name)
        elif isinstance(node, (ast.Assign, ast.FunctionDef, ast.ImportFrom, ast.Import)):
            with needs_blender:
                exec(compile(ast.Module([node], []), str(path), "exec"), names)
    return names


def _imported(path: Path, node: ast.ImportFrom, name: str):
    """What ``from ..module import name`` of a file of ours gives: a value, or a module as a namespace."""
    inner = docs_panels.file_of(path, ".".join(filter(None, (node.module, name))), node.level)
    file = inner or docs_panels.file_of(path, node.module or "", node.level)
    if file is None:
        raise ImportError(name)
    if file.is_relative_to(ROOT / "rle_splat"):
        parts = file.relative_to(ROOT).with_suffix("").parts
        module = import_module(".".join(part for part in parts if part != "__init__"))
        return module if inner else getattr(module, name)
    return SimpleNamespace(**namespace_of(file)) if inner else namespace_of(file)[name]


def _value(node, names: dict):
    """The value of an expression; None for one that needs Blender."""
    try:
        return eval(compile(ast.Expression(node), "", "eval"), names)
    except (NameError, AttributeError, TypeError):
        return None


def _property(call: ast.Call, names: dict, *, is_set_by_scripts: bool) -> dict | None:
    """One property from the call that declares it; None for a hidden one, unless scripts set it."""
    given = {word.arg: _value(word.value, names) for word in call.keywords}
    if "HIDDEN" in (given.get("options") or ()) and not (is_set_by_scripts and given.get("description")):
        return None
    items = given.get("items")
    kind = ast.unparse(call.func).rpartition(".")[2].removesuffix("Property")
    kind = kind.removeprefix("Live").removeprefix("Knob").lower()
    if kind.endswith("vector"):
        given["size"] = given.get("size", 3)  # Blender's own default
        kind = f"{kind.removesuffix('vector')} ({given['size']})"
    return {
        "kind": kind, "name": given.get("name") or "", "description": given.get("description") or "",
        "choices": [item[:3] for item in items] if isinstance(items, (list, tuple)) else [],
        "default": _default(kind, given), "range": _range(given),
    }  # fmt: skip


def _default(kind: str, given: dict) -> str:
    """What a property is until somebody sets it; "" for a computed or an empty one."""
    if UNSET in given.get("description", ""):
        return "unset"
    plain = {"bool": False, "int": 0, "float": 0.0}.get(kind.partition(" ")[0])
    if "size" in given:
        plain = (plain,) * given["size"]
    if kind == "enum" and isinstance(given.get("items"), (list, tuple)):
        plain = given["items"][0][0]
    value = given.get("default", plain)
    if value in (None, "") or None in given or "get" in given:  # None: by ``**``, which gives getter and setter
        return ""
    is_vector = isinstance(value, (tuple, list))
    text = ", ".join(f"{one:g}" if isinstance(one, float) else str(one) for one in (value if is_vector else [value]))
    return f"`({text})`" if is_vector else f"`{text}`"


def _range(given: dict) -> str:
    """The limits of a number; in parentheses those of its slider, beyond which a number can be typed."""
    low, high, soft = (given.get(name) for name in ("min", "max", "soft_max"))
    if low is None and high is None:
        return ""
    ends = [f"from {low:g}" if high is None else f"{low:g}"] if low is not None else []
    text = " to ".join(ends + ([f"{high:g}"] if high is not None else []))
    return text + (f" (slider to {soft:g})" if soft is not None and soft != high else "")


def _declared(node: ast.ClassDef, path: Path, names: dict) -> Declared:
    file = f"{path.relative_to(ROOT).parts[0]}/{path.name}"
    bases = [ast.unparse(base).rpartition(".")[2] for base in node.bases]
    made = Declared(node.name, docs_panels.module(path), file, bases, ast.get_docstring(node) or "")
    for item in node.body:
        if isinstance(item, ast.Assign) and isinstance(item.targets[0], ast.Name):
            made.texts[item.targets[0].id] = _value(item.value, names)
        elif isinstance(item, ast.FunctionDef):
            made.methods.append(item.name)
        elif isinstance(item, ast.AnnAssign):
            call = docs_panels.declaration(path, item.annotation)
            by_scripts = file.startswith("operators/") and item.target.id != DIALOG
            found = _property(call, names, is_set_by_scripts=by_scripts) if isinstance(call, ast.Call) else None
            if found is not None:
                made.properties[item.target.id] = found
    return made


@cache
def blender_classes() -> dict[str, Declared]:
    """Every class of bridge/, operators/ and panels/, by name."""
    found = {}
    for folder in ("bridge", "operators", "panels"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in docs_panels.module(path).body:
                if isinstance(node, ast.ClassDef):
                    found[node.name] = _declared(node, path, namespace_of(path))
    return found


def with_bases(one: Declared) -> list[Declared]:
    """A class and those of ours that it inherits from, nearest first."""
    classes = blender_classes()
    return [one, *(further for base in one.bases if base in classes for further in with_bases(classes[base]))]


def text_of(one: Declared, name: str) -> str:
    return next((part.texts[name] for part in with_bases(one) if part.texts.get(name)), "")


def properties_of(one: Declared) -> dict[str, dict]:
    return {name: entry for part in reversed(with_bases(one)) for name, entry in part.properties.items()}


def of_kind(prefix: str) -> list[Declared]:
    """The classes that Blender registers under names that begin so, in their own order."""
    return [one for name, one in blender_classes().items() if name.startswith(prefix)]
