"""The generated parts of the reference, as Markdown: command line, operators, panels, settings, Python names.

    python -m devtools.docs_reference

writes each part between its two marks in a page of docs/reference, and the version where it is read without Python.
The pages are committed, so that they can be read without building the site; a test compares them with the code.  The
command line comes from the parsers themselves, operators, panels and settings from their source (docs_declared.py).
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

from rle_splat.classify.presets import PRESETS
from rle_splat.cli.main import COMMANDS, example
from rle_splat.read.format import LEVEL, MEANING_OPTIONS, PLACE_OPTIONS
from rle_splat.read.formats import FORMATS
from rle_splat.runtime.cache_folder import RELEASE

from . import docs_python
from .docs_declared import Declared, blender_classes, namespace_of, of_kind, properties_of, text_of, with_bases
from .docs_markdown import sentence, table
from .docs_panels import A_NAME, AN_ICON, rows_of
from .licenses import bundled
from .places import ROOT

PLACES = {  # (bl_space_type, bl_category or bl_context) -> where a user finds a panel
    ("VIEW_3D", "RLE Splat"): "Sidebar > RLE Splat",
    ("PROPERTIES", "render"): "Properties > Render",
    ("PROPERTIES", "data"): "Properties > Object Data",
}
OWN = "Positional arguments", "Options"  # groups of argparse that each command lists itself
LONG_LIST = 12, 13  # choices, in panels and for scripts; of more, only the names are listed
IN_LINES = 2  # choices; of more, each has a line of its own
LONG_TABLE = 20  # properties of a group; of more, there is a table for each panel
LINE = "<br>"  # between choices that have lines of their own
IMAGES = ROOT / "docs" / "images"
BLENDERS = {  # what Blender declares, by the name in a panel
    "show_object_viewport_volume": ("Eye", "Show volumes live in this viewport."),
    "hide_viewport": ("Hide in Viewports", "Hide this object in viewports."),
    "hide_render": ("Hide in Renders", "Hide this object in renders."),
    "use_lock_interface": ("Lock Interface", "Lock Blender's window during renders. Without this, Blender may crash."),
}
FILES = {"ImportHelper": "The file to read", "ExportHelper": "The file to write"}  # Blender's bases that have filepath
OF_VOLUME = "The file, or the folder of a DICOM series"  # of operators that read a volume
FILE_OPTIONS_AT = "RLE_SPLAT_OT_import_volume"  # the operator that lists the options of a file for all
FILE_OPTIONS = "How the File Is Read"  # their heading
GROUPS = {  # a property group -> how a script reaches it
    "SceneSettings": "scene.rle_splat",
    "VolumeProperties": "object.rle_splat",
    "ChannelProperties": "object.rle_splat.channels[...]",
    "LabelProperties": "object.rle_splat.labels[...]",
    "RLE_SPLAT_AP_preferences": "preferences.addons[...].preferences",
}


# --- the command line -------------------------------------------------------------------------------------------------


def command_parser(name: str) -> argparse.ArgumentParser:
    """The parser of one command, with all its options."""
    parser = argparse.ArgumentParser(prog=f"rle-splat {name}", add_help=False)
    import_module(f"rle_splat.cli.{name}").add_arguments(parser)
    return parser


def _invocation(action: argparse.Action) -> str:
    """An option as it is typed, with the names of its values."""
    metavar = action.metavar or action.dest.upper()
    if not action.option_strings:
        return f"`{metavar}`"
    values = "" if action.nargs == 0 else " " + (metavar if isinstance(metavar, str) else " ".join(metavar))
    return ", ".join(f"`{option}{values}`" for option in action.option_strings)


def _groups(name: str) -> dict[str, str]:
    """The options of one command: a table for each group, by its title, under what the group says of itself."""
    found = {}
    for group in command_parser(name)._action_groups:
        shown = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
        rows = [(_invocation(action), sentence((action.help or "") % vars(action))) for action in shown]
        if rows:
            text = table(("option", "what it does"), rows)
            found[group.title.capitalize()] = f"{sentence(group.description)}\n\n{text}" if group.description else text
    return found


def command_line() -> str:
    """Every command and its own options, then the groups of options that several commands have."""
    groups = {name: _groups(name) for name in COMMANDS}
    times = Counter(group for name in COMMANDS for group in groups[name].items())
    shared = {title: text for (title, text), n in times.items() if n > 1 and title not in OWN}
    parts = []
    for name, purpose in COMMANDS.items():
        parts += [f"## rle-splat {name}", sentence(purpose), f"```\n{example(name)}\n```"]
        for title, text in groups[name].items():
            if shared.get(title) != text:
                parts += [f"**{title}.**", text]
        also = [f"[{title}](#{title.lower().replace(' ', '-')})" for title in groups[name] if title in shared]
        if also:
            parts.append(f"**Also**: {', '.join(also)}.")
    parts.append("## Options of several commands")
    return "\n\n".join([*parts, *(f"### {title}\n\n{text}" for title, text in shared.items())])


def presets() -> str:
    """The built-in transfer functions."""
    rows = [(f"`{row.name}`", row.label, row.modality or "any", row.description) for row in PRESETS.values()]
    return table(("name", "in Blender", "for", "what it shows"), rows)


def formats() -> str:
    """The volume formats that are read and written."""
    common = (*MEANING_OPTIONS, *PLACE_OPTIONS, LEVEL)
    rows = [
        (f.name, ", ".join(f"`{s}`" for s in f.suffixes), f.description, "yes" if f.write_steps else "no",
         ", ".join(f"`{o}`" for o in f.options if o not in common))
        for f in FORMATS
    ]  # fmt: skip
    options = f"In Python, `read_volume` has the options {', '.join(f'`{o}`' for o in common)} for all formats."
    return f"{options}\n\n{table(('format', 'suffixes', 'what is read', 'written too', 'further options'), rows)}"


# --- Blender ----------------------------------------------------------------------------------------------------------


def _meaning(entry: dict, script: bool = False, explained: bool = False) -> str:
    """A property's tooltip, and its choices as a panel draws them, for scripts after their identifiers.

    Of a long list only the names: presets have a page of their own, and the layers are explained for scripts.  Of
    choices that are explained elsewhere, identifiers and labels.
    """
    is_long = len(entry["choices"]) > LONG_LIST[script]
    is_brief = is_long or explained
    separator = ", " if is_brief else LINE if len(entry["choices"]) > IN_LINES else "; "
    choices = separator.join(
        " ".join([f"`{name}`"] * script + [f"*{label}*"] * (not (is_long and script)))
        + (f": {text}" if text and not is_brief else "")
        for name, label, text in entry["choices"]
    )  # fmt: skip
    return f"{sentence(entry['description'])}{LINE if separator == LINE else ' '}{choices}".strip()


def _property_table(properties: dict[str, dict], explained: bool = False) -> str:
    """The properties of an operator or of a group of settings, by the names that scripts use.

    ``explained``: the page of panels says what the choices do, except those of a list that is long there.
    """
    rows = [
        (f"`{name}`", entry["name"], entry["kind"], entry["default"], entry["range"],
         _meaning(entry, True, explained and len(entry["choices"]) <= LONG_LIST[False]))
        for name, entry in properties.items()
    ]  # fmt: skip
    return table(("property", "label", "type", "default", "range", "what it does"), rows)


def _options_of_file(properties: dict[str, dict]) -> dict[str, dict]:
    """Those of the properties that say how a file is read."""
    return {name: properties[name] for name in blender_classes()["SourceOptions"].properties if name in properties}


def operators() -> str:
    """Every operator with its tooltip and its properties."""
    parts = []
    for one in sorted(of_kind("RLE_SPLAT_OT_"), key=lambda one: text_of(one, "bl_label")):
        tooltip = text_of(one, "bl_description") or one.doc
        parts += [f"## {text_of(one, 'bl_label')}", f"`bpy.ops.{text_of(one, 'bl_idname')}()`. {sentence(tooltip)}"]
        properties, inherited = properties_of(one), {part.name for part in with_bases(one)}
        for base in FILES.keys() & set(one.bases):
            path = {"name": "File Path", "kind": "string",
                    "description": OF_VOLUME if "ReadsFiles" in inherited else FILES[base]}  # fmt: skip
            properties = {"filepath": dict.fromkeys(("default", "range", "choices"), "") | path} | properties
        options = _options_of_file(properties) if "SourceOptions" in inherited else {}
        own = {name: entry for name, entry in properties.items() if name not in options}
        if options and one.name != FILE_OPTIONS_AT:
            parts.append(f"Also [how the file is read](#{_slug(FILE_OPTIONS)}).")
        parts += [_property_table(own)] if own else []
        if one.name == FILE_OPTIONS_AT:
            parts.append(f"### {FILE_OPTIONS}\n\n{_property_table(options)}")
    return "\n\n".join(parts)


def panels() -> str:
    """Every panel: its picture, where it is, and what it draws, from the top; choices are explained once."""
    in_order = _in_tab()
    parts = [" · ".join(_link(text_of(ours[0], "bl_label")) for _, ours in in_order)]
    explained: dict[str, str] = {}  # a setting with its choices -> the panel that had it first
    for file, ours in in_order:
        title = text_of(ours[0], "bl_label")
        known = BLENDERS | _effects()
        known |= {name: (entry["name"], _meaning(entry)) for name, entry in _settings_of(file).items()}
        for one in of_kind("RLE_SPLAT_OT_"):
            tooltip = sentence(text_of(one, "bl_description") or one.doc)
            known[text_of(one, "bl_idname")] = text_of(one, "bl_label"), tooltip
        rows: dict[str, str] = {}
        for kind, name, drawn, menu in rows_of(ROOT / file, ours[0].name):
            tooltips = _tooltips(name, drawn) if kind == "operator" else None
            if tooltips:
                rows |= {_drawn("", [label], menu): sentence(text) for label, text in tooltips.items()}
            elif name in known:
                label, meaning = _drawn(known[name][0], drawn, menu), known[name][1]
                if LINE in meaning and (first := explained.setdefault(meaning, title)) != title:
                    meaning = f"As in {_link(first)}."
                rows.setdefault(label, meaning)
        parts.append(f"## {title}")
        parts.append(sentence(ast.get_docstring(ours[0].module).partition(": ")[2] or ours[0].doc))
        parts += [f"![The panel {title}, open](../images/{one.name})" for one in IMAGES.glob(f"panel-{_slug(title)}.*")]
        parts.append(f"Where: {'; '.join(map(_where, ours))}.")
        parts += [table(("button or setting", "what it does"), rows.items())] if rows else []
    return "\n\n".join(parts)


def _tooltips(idname: str, labels: list[str]) -> dict[str, str] | None:
    """The tooltip of each of an operator's buttons, if it describes its choices, as *Add Box* that of Box."""
    one = next((one for one in of_kind("RLE_SPLAT_OT_") if text_of(one, "bl_idname") == idname), None)
    entries = properties_of(one).values() if one is not None and "description" in one.methods else ()
    texts = {label: text for entry in entries for _, label, text in entry["choices"] if text}
    found = {label: texts.get(label.removeprefix("Add ")) for label in labels}
    return found if len(found) > 1 and all(found.values()) else None


def _slug(title: str) -> str:
    """A title as links and names of files have it."""
    return title.lower().replace(" ", "-")


def _link(title: str) -> str:
    return f"[{title}](#{_slug(title)})"


def _drawn(name: str, labels: list[str], menu: str) -> str:
    """How a button or a setting is drawn: its label, or its name and that it is an icon."""
    texts = [f"{name} {label}" if label == AN_ICON else label + name if label.endswith(": ") else label or name
             for label in labels if label != f"{name}: "] or [name]  # fmt: skip
    return (f"{menu} > " if menu and texts != [menu] else "") + ", ".join(
        text if text == A_NAME else f"*{text}*" for text in texts
    )


@cache
def _in_tab() -> list[tuple[str, list[Declared]]]:
    """The files of panels with their panels, in the order of the tab."""
    files: dict[str, list[Declared]] = {}
    for one in of_kind("RLE_SPLAT_PT_"):
        files.setdefault(one.file, []).append(one)
    return sorted(files.items(), key=lambda entry: _place_in_tab(entry[1][0]))


def _place_in_tab(one: Declared) -> tuple:
    """Panels in the order of the tab; those inside others after these, first those that show on their own."""
    parent, own = text_of(one, "bl_parent_id"), (text_of(one, "bl_order") or 0, one.file)
    return (*_place_in_tab(blender_classes()[parent]), own) if parent else (own,)


def _settings_of(file: str) -> dict[str, dict]:
    """Python name -> property, of all that a panel may draw: those of its own rows, as of a label, before others."""
    row = file.rpartition("/")[2].removesuffix("s.py").capitalize()
    groups = sorted((group for group in GROUPS if "_" not in group), key=lambda group: group.startswith(row))
    return {
        name: entry for group in groups for name, entry in properties_of(blender_classes()[group]).items()
        if entry["name"]
    }  # fmt: skip


def _effects() -> dict[str, tuple[str, str]]:
    """Label -> label and tooltip of the effects, which panels draw beside their labels."""
    of = SimpleNamespace(**namespace_of(ROOT / "bridge" / "data" / "effects.py"))
    return {
        of.title(name): (of.title(name), _meaning({"description": text, "choices": of.items_of(name)}))
        for name, text in of.TEXTS.items()
    }


def _where(one: Declared) -> str:
    """Where a panel is, by the labels that lead to it."""
    parent = {other.name: other for other in of_kind("RLE_SPLAT_PT_")}.get(text_of(one, "bl_parent_id"))
    place = PLACES[text_of(one, "bl_space_type"), text_of(one, "bl_category") or text_of(one, "bl_context")]
    return f"{_where(parent) if parent else place} > {text_of(one, 'bl_label')}"


def settings() -> str:
    """What a .blend and the preferences hold, by the names that scripts use."""
    parts = []
    for group, path in GROUPS.items():
        properties = properties_of(blender_classes()[group])
        parts.append(f"## `{path}`")
        parts += _by_panel(properties) if len(properties) > LONG_TABLE else [_property_table(properties)]
    return "\n\n".join(parts)


def _by_panel(properties: dict[str, dict]) -> list[str]:
    """A heading and a table for each panel that draws some of these, then how a file is read, and the others."""
    titles: dict[str, list[str]] = {}  # of the panels that draw a property, in the order of the tab
    for file, ours in _in_tab():
        for kind, name, _, _ in rows_of(ROOT / file, ours[0].name):
            if kind == "property":
                titles.setdefault(name, []).append(text_of(ours[0], "bl_label"))
    grouped: dict[str, dict] = {text_of(ours[0], "bl_label"): {} for _, ours in _in_tab()}
    for name in filter(properties.__contains__, titles):
        # A property of several panels is of the one in its name, as slice_center of Slices, or of the first.
        of_name = (title for title in titles[name] if name.startswith(title.lower().removesuffix("s")))
        grouped[next(of_name, titles[name][0])][name] = properties[name]
    others = {name: entry for name, entry in properties.items() if name not in titles}
    options = _options_of_file(others)
    rest = {FILE_OPTIONS: options, "Others": {name: others[name] for name in others if name not in options}}
    tables = [(title, group, title in grouped) for title, group in (grouped | rest).items() if group]
    return [f"### {title}\n\n{_property_table(group, explained)}" for title, group, explained in tables]


def licenses() -> str:
    """The table of packages in the extension's zip."""
    rows = [(f"[{one['name']}]({one['page']})", one["license"]) for one in bundled()]
    return table(("package", "license"), rows)


PARTS = {
    "command line": command_line, "presets": presets, "formats": formats, "python": docs_python.index,
    **{f"python {task}": partial(docs_python.names_of, task) for task in docs_python.TASKS},
    "operators": operators, "panels": panels, "settings": settings, "licenses": licenses,
}  # fmt: skip


# --- the pages --------------------------------------------------------------------------------------------------------

PAGES = ROOT / "docs" / "reference"
END = "<!-- end of the generated part -->"
GENERATED = re.compile(rf"^<!-- generated: ([a-z -]+) -->$.*?^{END}$", re.MULTILINE | re.DOTALL)
HOW_TO = ROOT / "docs" / "how-to"
WITH_VERSION = (
    ROOT / "blender_manifest.toml", HOW_TO / "install.md", HOW_TO / "blender-without-a-window.md", ROOT / "README.md"
)  # fmt: skip
VERSION = re.compile(
    r'(?<=^version = ")[\d.]+(?="$)|(?<=\brle_splat-)[\d.]+(?=-)|(?<=\[Version )[\d.]+(?=\])', re.MULTILINE
)


def filled(text: str) -> str:
    """A page with its generated part, and the version, made from the code of today."""
    text = GENERATED.sub(lambda found: f"<!-- generated: {found[1]} -->\n\n{PARTS[found[1]]()}\n\n{END}", text)
    return VERSION.sub(RELEASE, text)


def outdated() -> dict[Path, str]:
    """The pages that are not as the code has it, with what they should be."""
    pages = {page: page.read_text(encoding="utf-8") for page in (*sorted(PAGES.rglob("*.md")), *WITH_VERSION)}
    return {page: new for page, old in pages.items() if (new := filled(old)) != old}


def update() -> None:
    """Write the pages that are not as the code has it."""
    for page, text in outdated().items():
        page.write_text(text, encoding="utf-8")
        print(page.relative_to(ROOT))


if __name__ == "__main__":
    update()
