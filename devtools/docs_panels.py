"""The page of panels: what each draws, by the labels that are drawn, in the order in which they are drawn.

The draw functions are followed in their source, since panels cannot be imported without Blender: into functions of
ours that are given a layout, into menus and into lists.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from itertools import chain, product
from pathlib import Path

from .places import ROOT

DRAWN = ("draw_header_preset", "draw_header", "draw")  # methods of panels and menus, as they are drawn from the top
A_NAME = "NAME"  # in place of a label that only a scene gives
AN_ICON = "(icon)"
LAYOUTS = re.compile(r"layout|body|row|column|box|self\.layout")


@cache
def module(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def file_of(path: Path, name: str, level: int) -> Path | None:
    """The file of ours that ``from ..name import`` means in the file ``path``."""
    folder = path.parents[level - 1].joinpath(*name.split(".")) if name else path.parents[level - 1]
    return next((one for one in (folder.with_suffix(".py"), folder / "__init__.py") if one.is_file()), None)


@cache
def _names(path: Path) -> dict:
    """Name -> its definition in a file of ours: (file, node), or (file, None) for a module."""
    found = {}
    for node in module(path).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found[node.name] = (path, node)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found[node.targets[0].id] = (path, node.value)
        elif isinstance(node, ast.ImportFrom) and node.level:
            source = file_of(path, node.module or "", node.level)
            for one in node.names:
                inner = file_of(path, ".".join(filter(None, (node.module, one.name))), node.level)
                if inner is not None:
                    found[one.asname or one.name] = (inner, None)
                elif source is not None and one.name in _names(source):
                    found[one.asname or one.name] = _names(source)[one.name]
    return found


def _defined(path: Path, node) -> tuple | None:
    """What a name or an attribute of a module of ours stands for: (file, node)."""
    if isinstance(node, ast.Name):
        return _names(path).get(node.id)
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        owner = _names(path).get(node.value.id)
        return _names(owner[0]).get(node.attr) if owner is not None and owner[1] is None else None
    return None


def declaration(path: Path, node) -> ast.AST | None:
    """What declares a property: the call itself, or that to which its name in a file of ours was set."""
    return node if isinstance(node, ast.Call) else (_defined(path, node) or (path, None))[1]


def _items(path: Path, node, local: dict) -> list:
    """The elements of a tuple, list or dict as nodes, those of both branches of a condition; [] for another value."""
    if isinstance(node, (ast.Tuple, ast.List)):
        parts = (_items(path, one.value, local) if isinstance(one, ast.Starred) else [one] for one in node.elts)
        return list(chain.from_iterable(parts))
    if isinstance(node, ast.Dict):
        return node.keys
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [ast.Constant(letter) for letter in node.value]
    if isinstance(node, ast.IfExp):
        return _items(path, node.body, local) + _items(path, node.orelse, local)
    known = _defined(path, node)
    return _items(known[0], known[1], {}) if known is not None and known[1] is not None else []


def _texts(path: Path, node, local: dict) -> list[str]:
    """The texts that an expression can be, as far as the source shows them."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.IfExp):
        return _texts(path, node.body, local) + _texts(path, node.orelse, local)
    if isinstance(node, ast.BoolOp):
        return list(chain.from_iterable(_texts(path, one, local) for one in node.values))
    if isinstance(node, ast.Name) and node.id in local:
        return list(chain.from_iterable(_texts(path, one, local) for one in local[node.id]))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "title":
        return [text.title() for text in _texts(path, node.func.value, local)]
    if (
        isinstance(node, ast.Call)
        and getattr(node.func, "id", "") in ("with_unit", "with_ellipsis", "filled")
        and node.args
    ):
        return [re.sub(r"\{\w+\}", A_NAME, text) for text in _texts(path, node.args[0], local)]
    if isinstance(node, ast.JoinedStr):
        parts = [_texts(path, getattr(part, "value", part), local) if isinstance(part, ast.FormattedValue)
                 else [part.value] for part in node.values]  # fmt: skip
        return ["".join(one) for one in product(*parts)]
    if isinstance(node, ast.Attribute) and node.attr in ("bl_idname", "__name__"):
        known = _defined(path, node.value)
        return [_assigned(known[1], "bl_idname") or known[1].name] if known is not None else []
    known = _defined(path, node)
    return _texts(known[0], known[1], {}) if known is not None and known[1] is not None else []


def _assigned(node: ast.ClassDef, name: str) -> str:
    """A text that a class declares; "" without it."""
    return next((item.value.value for item in node.body
                 if isinstance(item, ast.Assign) and getattr(item.targets[0], "id", "") == name), "")  # fmt: skip


@cache
def _by_idname() -> dict:
    """Menus by the name that Blender registers, with their files."""
    return {
        node.name: (path, node)
        for path in sorted((ROOT / "panels").glob("*.py")) for node in module(path).body
        if isinstance(node, ast.ClassDef) and "_MT_" in node.name
    }  # fmt: skip


def rows_of(path: Path, panel: str) -> list[tuple[str, str, list[str], str]]:
    """What a panel draws, from the top; ``panel`` is the name of its class.

    For each row "operator" or "property", its name, the labels that are drawn ("" is its own), and its menu.  What a
    menu or a panel within has is listed there alone.
    """
    found: list[tuple] = []
    rows: dict[tuple, list[str]] = {}
    _follow_class(*_names(path)[panel], found, "")
    for kind, name, labels, menu in found:  # one row for what is drawn in several places of a panel
        known = rows.setdefault((kind, name, menu), [])
        known += [label for label in (("",) if labels is None else labels) if label not in known]
    in_menus = {(kind, name) for kind, name, menu in rows if menu}
    return [
        (kind, name, labels, menu) for (kind, name, menu), labels in rows.items()
        if menu or (kind, name) not in in_menus
    ]  # fmt: skip


def _follow_class(path: Path, node: ast.ClassDef, found: list, menu: str) -> None:
    """Follow what a panel, a menu or a list draws, or the base that draws it."""
    methods = {item.name: item for item in node.body if isinstance(item, ast.FunctionDef)}
    for name in (*DRAWN, "draw_item"):
        if name in methods:
            _follow(path, methods[name], {}, found, menu)
    for base in node.bases:
        known = _defined(path, base)
        if known is not None and isinstance(known[1], ast.ClassDef) and "draw" not in methods:
            _follow_class(*known, found, menu)


def _follow(path: Path, function: ast.FunctionDef, local: dict, found: list, menu: str) -> None:
    """Follow the calls of a function in their order; ``local`` has what its names can be, as nodes."""
    local, headings, titled = dict(local), {}, {}  # headings: text of a row or column before what is drawn in it
    disabled = set()  # layouts of examples, which nobody can click
    for node in _ordered(function):
        if isinstance(node, (ast.For, ast.comprehension)):
            items = _items(path, node.iter, local)
            targets = node.target.elts if isinstance(node.target, ast.Tuple) else [node.target]
            for index, target in enumerate(targets):
                columns = [_items(path, item, local) for item in items] if len(targets) > 1 else [[i] for i in items]
                local[ast.unparse(target)] = [row[index] for row in columns if index < len(row)]
        elif isinstance(node, ast.Assign):
            pairs = [(node.targets[0], node.value)]
            if ast.unparse(node).endswith(".enabled = False"):
                disabled.add(node.targets[0].value.id)
            if isinstance(node.value, ast.Call) and getattr(node.value.func, "attr", "") == "panel":
                header, body = node.targets[0].elts
                titled[body.id] = header.id  # a panel within the panel, and what draws its title
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(node.targets[0].elts, node.value.elts))
            for target, value in pairs:
                used = {one.id for one in ast.walk(value) if isinstance(one, ast.Name)}
                if isinstance(target, ast.Name) and target.id not in used:
                    local[target.id] = [value]
                if isinstance(target, ast.Name) and isinstance(value, ast.Call):
                    texts = _texts(path, _keyword(value, "heading"), local)
                    headings[target.id] = texts[0] if texts else headings.get(_root(value), "")
        elif isinstance(node, ast.Call) and _root(node) not in disabled:
            if isinstance(node.func, ast.Attribute) and node.func.attr == "label" and _root(node) != "layout":
                headings[_root(node)] = next(iter(_texts(path, _keyword(node, "text"), local)), "")
            begin, names = len(found), (_root(node), *(getattr(one, "id", "") for one in node.args))
            inner = next((headings.get(titled[name]) for name in names if name in titled), "")
            _read_call(path, node, local, found, inner or menu)
            if heading := headings.get(_root(node)):
                found[begin:] = [(one[0], one[1] or heading, _headed(heading, one[2]), one[3]) for one in found[begin:]]


def _root(call: ast.Call) -> str:
    """The name of the layout that a call draws into, also through ``row.row()``."""
    node = call.func
    while isinstance(node, (ast.Attribute, ast.Call)):
        node = node.value if isinstance(node, ast.Attribute) else node.func
    return getattr(node, "id", "")


def _keyword(call: ast.Call, name: str):
    return next((word.value for word in call.keywords if word.arg == name), None)


def _headed(heading: str, labels: list[str] | None) -> list[str]:
    """Labels after the heading of their row, which stands for an empty one; "Grays: " goes on with the own name."""
    if labels is None:
        return [f"{heading}: "]
    return [f"{heading}: {label}" if label else heading for label in labels if label != heading]


def _ordered(function: ast.FunctionDef):
    """Loops, assignments and calls of a function, as they are written."""
    nodes = [one for one in ast.walk(function) if isinstance(one, (ast.For, ast.Assign, ast.Call))]
    return sorted(nodes, key=lambda one: (one.lineno, one.col_offset, isinstance(one, ast.Call)))


def _read_call(path: Path, call: ast.Call, local: dict, found: list, menu: str) -> None:
    """Add what one call draws."""
    method = call.func.attr if isinstance(call.func, ast.Attribute) else ""
    text = _keyword(call, "text")
    labels = None if text is None else [one.strip() for one in _texts(path, text, local)] or [A_NAME]
    if labels == [""] and method == "operator":
        labels = [AN_ICON]
    if _keyword(call, "expand") is not None:  # only the choices are drawn
        labels = [""]
    if method in ("operator", "operator_menu_enum"):
        found += [("operator", name, labels, menu) for name in _texts(path, call.args[0], local)]
    elif method in ("prop", "prop_enum") and len(call.args) > 1:
        found += [("property", name, labels, menu) for name in _texts(path, call.args[1], local) or labels or ()]
    elif method in ("menu", "template_list"):
        for name in _texts(path, call.args[0], local):
            known = _by_idname().get(name) or _names(path).get(name)
            if known is not None:
                title = _assigned(known[1], "bl_label")
                _follow_class(*known, found, title if method == "menu" else menu)
    elif any(LAYOUTS.fullmatch(ast.unparse(one)) for one in call.args):
        known = _defined(path, call.func)
        if known is not None and isinstance(known[1], ast.FunctionDef):
            _follow(*known, _given(known[1], call), found, menu)


def _given(function: ast.FunctionDef, call: ast.Call) -> dict:
    """The names of a function's parameters with what a call gives for them, or their defaults, if constant."""
    names = [one.arg for one in function.args.args]
    given = dict(zip(reversed(names), reversed(function.args.defaults))) | dict(zip(names, call.args))
    given |= {word.arg: word.value for word in call.keywords}
    return {name: [node] for name, node in given.items() if isinstance(node, ast.Constant)}
