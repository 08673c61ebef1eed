"""The reference of the Python package, as Markdown, from its signatures and its docstrings, which are numpydoc."""

from __future__ import annotations

import inspect
import math
import re
import sys
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import ForwardRef, Literal, Union, get_args, get_origin

import rle_splat
from rle_splat.scene.checks import identity

from .docs_markdown import sentence, table
from .places import ROOT

INNER = {  # members that only the package itself uses
    "Scene": ("shines", "hides_volume"),
    "StageCache": ("job", "has", "keeps", "contents", "make_room", "has_plenty"),
    "StoredVolume": ("of", "stand_in", "tables_steps"),
}
WIDE = 88  # columns; a longer signature has a line for each parameter
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
DOCUMENTED = re.compile(rf"\b(?:{'|'.join(name for name in rle_splat.__all__ if name[0].isupper())})\b")
REFERENCE = re.compile(r"docs/reference/(([\w-]+)\.md(?:#[\w-]+)?)")  # in a docstring
ENTRY = re.compile(r"^(\S.*)\n?((?:^(?:[ ]{4}.*)?\n?)*)", re.MULTILINE)  # of a section: a name, and what it means


def _tasks() -> dict[str, list[str]]:
    """The public names by task, as the package lists them."""
    found: dict[str, list[str]] = {}
    for line in (ROOT / "rle_splat" / "__init__.pyi").read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            names = found[line[2:]] = []
        elif line.startswith("from "):
            names.append(line.split()[-1])
    return {task: names for task, names in found.items() if names}


TASKS = _tasks()
PAGE_OF = {name: f"{task.replace(' ', '-')}.md" for task, names in TASKS.items() for name in names}


def index() -> str:
    """Every name of the package by task, with a link to its entry and the first paragraph of its docstring."""
    parts = []
    for task, names in TASKS.items():
        rows = [
            (
                f"[{name}](python/{PAGE_OF[name]}#{name.lower()})",
                _prose((inspect.getdoc(getattr(rle_splat, name)) or "").partition("\n\n")[0]),
            )
            for name in names
        ]
        parts += [f"## [{task[0].upper()}{task[1:]}](python/{PAGE_OF[names[0]]})", table(("name", "summary"), rows)]
    return "\n\n".join(parts)


def names_of(task: str) -> str:
    """Every name of a task, by its signature and docstring."""
    parts = []
    for name in TASKS[task]:
        value = getattr(rle_splat, name)
        is_class = isinstance(value, type)
        text = inspect.getdoc(value) or ""
        is_returned = is_class and "\nAttributes\n---" in text and "\nParameters\n---" not in text  # a user makes none
        is_made = not (is_returned or (is_class and issubclass(value, Exception)))
        called = f"```python\n{signature(f'rle_splat.{name}', value)}\n```" if is_made else f"`rle_splat.{name}`"
        parts += [f"## {name}", called, docstring(text, PAGE_OF[name])]
        if is_class and not issubclass(value, Exception):
            parts += _members(value)
    return "\n\n".join(parts)


# --- signatures -------------------------------------------------------------------------------------------------------


def signature(name: str, value, wide: float = WIDE) -> str:
    """A function or class as it is called, with its annotations; a line for each parameter beyond so many columns.

    Where a docstring lists parameters, those that it leaves out are for the package itself and are not shown.
    """
    listed = dict(zip(*[iter(SECTION.split(inspect.getdoc(value) or "")[1:])] * 2)).get("Parameters", "")
    shown = {one.strip(" *") for head, _ in ENTRY.findall(listed) for one in head.partition(" : ")[0].split(",")}
    made = {one.name: one.default_factory for one in fields(value)} if is_dataclass(value) else {}
    found, signed = [], inspect.signature(value)
    for one in signed.parameters.values():
        if one.name == "self" or (shown and one.name not in shown):
            continue
        if one.kind is one.KEYWORD_ONLY and "*" not in found:
            found.append("*")
        stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        default = "" if one.default is one.empty else f" = {_default(one.default, made.get(one.name))}"
        found.append(f"{stars}{one.name}: {_annotation(one.annotation, value)}{default}")
    ending = ")" if isinstance(value, type) else f") -> {_annotation(signed.return_annotation, value)}"
    line = f"{name}({', '.join(found)}{ending}"
    lines = [f"{name}(", *(f"    {one}," for one in found), ending]
    return "\n".join(lines) if len(line) > wide and len(found) > 1 else line


def _default(value, factory) -> str:
    """The default of a parameter; of a field that is made anew for each object, what makes it."""
    if repr(value) == "<factory>":
        return "np.eye(4)" if factory is identity else f"{factory.__name__}()"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _annotation(kind, of) -> str:
    """An annotation of a function or class, with short names."""
    if isinstance(kind, ForwardRef):
        kind = kind.__forward_arg__
    if isinstance(kind, str):
        names = {name: getattr(rle_splat, name) for name in rle_splat.__all__} | vars(sys.modules[of.__module__])
        try:
            kind = eval(kind, names)
        except (NameError, AttributeError):  # imported for type checkers alone
            return kind
    if kind in (None, NoneType):
        return "None"
    if kind is Ellipsis:
        return "..."
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return f"Literal[{', '.join(_default(one, None) for one in inner)}]"
    if origin in (Union, UnionType):
        return " | ".join(_annotation(one, of) for one in inner)
    if isinstance(kind, list):
        return f"[{', '.join(_annotation(one, of) for one in kind)}]"
    name = getattr(origin or kind, "__name__", str(kind))
    return f"{name}[{', '.join(_annotation(one, of) for one in inner)}]" if inner else name


# --- docstrings -------------------------------------------------------------------------------------------------------


def _members(cls) -> list[str]:
    """The public properties and methods that a class defines, as two lists."""
    entries: dict[str, list[str]] = {"Properties": [], "Methods": []}
    for name, member in vars(cls).items():
        function = getattr(member, "__func__", member)
        text = inspect.getdoc(member) or ""
        if name.startswith("_") or name in INNER.get(cls.__name__, ()) or not text:
            continue
        if callable(function):
            called = signature(name, getattr(cls, name), math.inf)
            of_class = "Class method. " * isinstance(member, classmethod)
            entries["Methods"].append(_member(called, of_class + text, PAGE_OF[cls.__name__]))
        elif hasattr(member, "fget"):
            typed = f"{name}: {_annotation(inspect.signature(member.fget).return_annotation, cls)}"
            entries["Properties"].append(_member(typed, text, PAGE_OF[cls.__name__]))
    return [f"**{title}**\n\n" + "\n".join(lines) for title, lines in entries.items() if lines]


def _member(typed: str, text: str, page: str) -> str:
    """A member as an entry of a list: its docstring's first paragraph, its parameters and what it returns."""
    beginning, *sections = SECTION.split(text)
    lines = [f"- `{typed}`: {sentence(_prose(beginning.partition(chr(10) * 2)[0]))}"]
    for title, body in zip(sections[::2], sections[1::2]):
        if title in ("Parameters", "Returns"):
            said = "Returns " * (title == "Returns")
            entries = (_entry(head, rest, page).removeprefix("- ") for head, rest in ENTRY.findall(body.strip("\n")))
            lines += (f"  - {said}{entry}" for entry in entries)
    return "\n".join(lines)


def docstring(text: str, page: str) -> str:
    """A numpydoc docstring in Markdown, for a page of a task: sections in bold, an entry for each name."""
    beginning, *sections = SECTION.split(text)
    parts = [_prose(beginning)]
    for title, body in zip(sections[::2], sections[1::2]):
        parts.append(f"**{title}**")
        entries = ENTRY.findall(body.strip("\n"))
        if title in ("Notes", "Examples", "See Also", "References"):
            parts.append(_prose(body))
        else:
            parts.append("\n".join(_entry(head, rest, page) for head, rest in entries))
    return "\n\n".join(part for part in parts if part)


def _entry(head: str, rest: str, page: str) -> str:
    """A parameter or a returned value: its name and type as code, and what it means; public types are links."""
    name, _, kind = head.partition(" : ")
    linked = DOCUMENTED.sub(lambda found: f"[{found[0]}]({_link(found[0], page)})", kind or name)
    if linked == (kind or name):
        shown = f"`{head}`"
    else:
        shown = f"`{name}` ({linked})" if kind else linked
    return f"- {shown}" + (f": {sentence(_prose(rest))}" if rest.strip() else "")


def _link(name: str, page: str) -> str:
    """Where a public name is described, from the page of a task."""
    return f"{PAGE_OF[name] * (PAGE_OF[name] != page)}#{name.lower()}"


def _prose(text: str) -> str:
    """Paragraphs, each in one line, with code and links to other pages of the reference as Markdown has them."""
    paragraphs = (" ".join(part.split()) for part in text.strip("\n").split("\n\n"))
    return REFERENCE.sub(r"[\2](../\1)", "\n\n".join(paragraphs).replace("``", "`").strip())
