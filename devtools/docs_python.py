"""The reference of the Python package, as Markdown, from its docstrings, which are numpydoc."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, is_dataclass

import rle_splat

from .docs_markdown import sentence, table

INNER = {  # members that only the package itself uses
    "StageCache": ("job", "has", "keeps", "contents", "make_room", "has_plenty"),
    "StoredVolume": ("of", "stand_in", "tables_steps"),
}
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
DOCUMENTED = re.compile(rf"\b(?:{'|'.join(name for name in rle_splat.__all__ if name[0].isupper())})\b")
ENTRY = re.compile(r"^(\S.*)\n?((?:^(?:[ ]{4}.*)?\n?)*)", re.MULTILINE)  # of a section: a name, and what it means


def python() -> str:
    """Every name of the package, by its docstring."""
    parts = []
    for name in rle_splat.__all__:
        value = getattr(rle_splat, name)
        is_class = isinstance(value, type)
        is_exception = is_class and issubclass(value, Exception)
        text = inspect.getdoc(value) or ""
        is_returned = is_class and "\nAttributes\n---" in text and "\nParameters\n---" not in text  # a user makes none
        typed = "" if is_exception or is_returned else _parameters(value)
        parts += [f"## {name}", f"`rle_splat.{name}{typed}`", docstring(text)]
        members = _members(value) if is_class and not is_exception else []
        parts += [table(("member", "what it is"), members)] if members else []
    return "\n\n".join(parts)


def _parameters(value) -> str:
    """The parameters of a function as they are typed, without annotations: numpydoc has the types."""
    found = []
    made = {one.name: one.default_factory for one in fields(value)} if is_dataclass(value) else {}
    for one in inspect.signature(value).parameters.values():
        if one.kind is one.KEYWORD_ONLY and "*" not in found:
            found.append("*")
        default = "" if one.default is one.empty else f"={one.default!r}"
        if default == "=<factory>":
            default = f"={made[one.name].__name__}" + "()" * isinstance(made[one.name], type)
        found.append({one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "") + one.name + default)
    return f"({', '.join(found)})"


def _members(cls) -> list[tuple[str, str]]:
    """The public methods and properties that a class defines, and what they are."""
    rows = []
    for name, member in vars(cls).items():
        function = getattr(member, "__func__", member)
        if name in INNER.get(cls.__name__, ()):
            continue
        if not name.startswith("_") and (callable(function) or hasattr(member, "fget")) and inspect.getdoc(member):
            typed = name + (_parameters(getattr(cls, name)) if callable(function) else "")
            rows.append((f"`{typed}`", _in_a_cell(inspect.getdoc(member) or "")))
    return rows


def _in_a_cell(text: str) -> str:
    """A docstring in one line: its first paragraph, its parameters and what it returns."""
    beginning, *sections = SECTION.split(text)
    parts = [sentence(_prose(beginning.partition("\n\n")[0]))]
    for title, body in zip(sections[::2], sections[1::2]):
        if title in ("Parameters", "Returns"):
            entries = ENTRY.findall(body.strip("\n"))
            said = "Returns " * (title == "Returns")
            parts += (said + _entry(head, rest).removeprefix("- ") for head, rest in entries)
    return "<br>".join(parts)


def docstring(text: str) -> str:
    """A numpydoc docstring in Markdown: sections in bold, an entry for each name."""
    beginning, *sections = SECTION.split(text)
    parts = [_prose(beginning)]
    for title, body in zip(sections[::2], sections[1::2]):
        parts.append(f"**{title}**")
        entries = ENTRY.findall(body.strip("\n"))
        if title in ("Notes", "Examples", "See Also", "References"):
            parts.append(_prose(body))
        else:
            parts.append("\n".join(_entry(head, rest) for head, rest in entries))
    return "\n\n".join(part for part in parts if part)


def _entry(head: str, rest: str) -> str:
    """A parameter or a returned value: its name and type as code, and what it means; types of this page are links."""
    name, _, kind = head.partition(" : ")
    linked = DOCUMENTED.sub(lambda found: f"[{found[0]}](#{found[0].lower()})", kind or name)
    if linked == (kind or name):
        shown = f"`{head}`"
    else:
        shown = f"`{name}` ({linked})" if kind else linked
    return f"- {shown}" + (f": {sentence(_prose(rest))}" if rest.strip() else "")


def _prose(text: str) -> str:
    """Paragraphs, each in one line, with code as Markdown has it."""
    paragraphs = (" ".join(part.split()) for part in text.strip("\n").split("\n\n"))
    return "\n\n".join(paragraphs).replace("``", "`").strip()
