"""The documentation: links and citations lead somewhere, the reference is complete, no path leads outside."""

import ast
import re
import shlex
from pathlib import Path

import pytest

import rle_splat
from devtools import docs, docs_python, docs_reference
from rle_splat.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
ALGORITHM = (ROOT / "docs/explanation/algorithm.md").read_text(encoding="utf-8")
SECTIONS = set(re.findall(r"^#{2,3} (\d+(?:\.\d+)?)\.? ", ALGORITHM, re.MULTILINE))
IDS = set(re.findall(r"\b([VSCAG]\d{1,2})\b", ALGORITHM))
CODE = ("rle_splat", "bridge", "operators", "panels", "devtools", "benchmarks", "tests")
# "algorithm.md 1.4, 4.2", "algorithm.md 1.5 and 1.8", "algorithm.md 2.3, G1 to G12", also over the end of a line.
CITATION = re.compile(
    r"algorithm\.md(?:,)?[\s#]+(?P<first>\d(?:\.\d+)?|appendix)"
    r"(?P<rest>(?:(?:,| and| to)[\s#]+(?:\d\.\d+|[VSCAG]\d+))*)"
)


def sources():
    """Every Python file of the repository but this one, with its text."""
    files = [path for folder in CODE for path in sorted((ROOT / folder).rglob("*.py"))]
    files += [ROOT / "__init__.py", ROOT / "dev.py", ROOT / "docs/conf.py"]
    return [(path, path.read_text(encoding="utf-8")) for path in files if path != Path(__file__)]


def cited(text):
    """The sections and ids of algorithm.md that a text cites."""
    found = []
    for citation in CITATION.finditer(text):
        found += [citation["first"], *re.findall(r"\d\.\d+|[VSCAG]\d+", citation["rest"])]
    return found


def test_citations_are_read_as_they_are_written():
    text = "(algorithm.md 1.4, 4.2) algorithm.md 1.5 and 1.8; algorithm.md\n# 1.7 algorithm.md 2.3, G1 to G12)"
    assert cited(text) == ["1.4", "4.2", "1.5", "1.8", "1.7", "2.3", "G1", "G12"]
    assert cited("algorithm.md 1.10 (ii) algorithm.md, appendix algorithm.md 1.4, 5)") == ["1.10", "appendix", "1.4"]


def test_every_cited_section_exists():
    assert "\n## Appendix" in ALGORITHM
    known = {*SECTIONS, *IDS, "appendix"}
    found = [(path, name) for path, text in sources() for name in cited(text)]
    assert len(found) > 40
    missing = [f"{path.relative_to(ROOT)}: {name}" for path, name in found if name not in known]
    assert not missing, "\n".join(missing)


def test_every_mention_of_the_algorithm_names_a_section():
    """Except where the page itself is meant."""
    for path, text in sources():
        mentions = len(re.findall(r"(?<!/)\balgorithm\.md\b", text))
        assert mentions == len(CITATION.findall(text)), path


def test_links_lead_to_files_of_the_repository_and_to_headings():
    broken = [line for page in docs.linking_pages() for line in docs.broken_links(page, page.read_text("utf-8"))]
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize("page", docs.pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_name_files_of_the_repository(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:[\w-]+/)+[\w.-]+\.(?:py|md|json|txt))`", text)
    # Files of the renderer are named with and without its folder.
    lost = [name for name in named if not any((root / name).exists() for root in (ROOT, ROOT / "rle_splat"))]
    assert [name for name in lost if not name.startswith(("out/", "build/", "nilearn/"))] == []


def test_a_broken_link_is_noticed():
    page = ROOT / "docs/index.md"
    known = "# Here\n[a](glossary.md#voxel) [b](#here) ![c](images/gallery-skull.jpg) `[d](no.md)`"
    assert docs.broken_links(page, known) == []
    assert len(docs.broken_links(page, "[a](glossaries.md#x) [b](../../outside.md)")) == 2
    assert len(docs.broken_links(page, "[a](glossary.md#voxels) [b](#here)")) == 2


def test_anchors_are_those_of_github():
    text = "# `a_b`, [c](d.md): *e* & 2.5\n```\n# no\n```\n## To\n### To\n## LPS, RAS\n"
    assert docs.anchors(text) == {"a_b-c-e--25", "to", "to-1", "lps-ras"}


def test_quoted_messages_are_those_of_the_program():
    """Clause by clause, because names and numbers stand between them."""
    of_others = {"Can't change working space with modified images"}  # Blender's
    of_parts = {"slices are missing and were interpolated", "slices of this series were left out",
                "the volume depends on the constraint"}  # put together from several strings  # fmt: skip
    said = "\n".join(
        node.value for path, text in sources() if path.relative_to(ROOT).parts[0] in CODE[:4]
        for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )  # fmt: skip
    page = (ROOT / "docs/how-to/troubleshoot.md").read_text(encoding="utf-8")
    seen = "\n".join(re.findall(r"^\| (.+?) \|", page, re.MULTILINE))
    clauses = [
        clause.strip() for message in re.findall(r"(?<!\*)\*([^*\n]+)\*(?!\*)", seen)
        for clause in re.split(r"\.\.\.|[;:,]|\.$", message) if clause.strip()
    ]  # fmt: skip
    assert len(clauses) > 30
    assert [clause for clause in clauses if clause not in said] == [
        clause for clause in clauses if clause in of_others | of_parts
    ]


def test_the_walk_through_the_code_has_at_most_fifteen_stops():
    text = (ROOT / "docs/explanation/follow-one-picture.md").read_text(encoding="utf-8")
    stops = [int(number) for number in re.findall(r"^\*\*(\d+)\. \[", text, re.MULTILINE)]
    assert stops == list(range(1, len(stops) + 1)) and 10 <= len(stops) <= 15


def test_documented_commands_are_understood():
    """Every command line in the pages is one that its parser takes."""
    seen = set()
    for page in docs.pages():
        for block in re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            for line in re.findall(r"^(?:rle-splat|python3 -m rle_splat) (.*)$", block, re.MULTILINE):
                command, *words = shlex.split(line, comments=True)
                docs_reference.command_parser(command).parse_args(words)
                seen.add(command)
    assert {"render", "info", "encode", "accuracy"} <= seen


def test_pages_are_linked_from_an_index():
    """Sphinx asks for a place in a tree of contents; a reader of the files asks for a link."""
    for folder in ("tutorial", "how-to", "reference", "explanation"):
        index = (ROOT / "docs" / folder / "index.md").read_text(encoding="utf-8")
        for page in (ROOT / "docs" / folder).glob("*.md"):
            assert page.name == "index.md" or f"({page.name})" in index, page


def test_every_guide_has_a_picture():
    bare = {
        page.stem for page in (ROOT / "docs" / "how-to").glob("*.md") if "](../images/" not in page.read_text("utf-8")
    }
    assert bare == {"index", "translate"}  # Debian's Blender has no languages


def test_nothing_refers_to_a_path_outside_the_repository():
    """Tests and benchmarks may look for the data folder beside the clone; nothing else may."""
    outside = re.compile(r"\.\./shared|(?<![\w.~/-])/(?:home|work|root|Users)/|design notes")
    for page in docs.pages():
        assert not outside.search(page.read_text(encoding="utf-8")), page
    for path, text in sources():
        left = text.replace("../shared/data", "")
        assert not outside.search(left), path


# --- the generated reference ------------------------------------------------------------------------------------------


def test_the_reference_has_a_place_for_every_part():
    marks = [
        name for page in docs.pages()
        for name in re.findall(r"^<!-- generated: ([a-z -]+) -->$", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]  # fmt: skip
    assert sorted(marks) == sorted(docs_reference.PARTS)


def test_the_pages_of_the_reference_are_current():
    stale = [page.relative_to(ROOT).as_posix() for page in docs_reference.outdated()]
    assert not stale, f"run python -m devtools.docs_reference, which writes {', '.join(stale)}"


def test_every_parameter_of_python_says_what_it_is_and_types_lead_to_their_entries():
    pages = {f"{task.replace(' ', '-')}.md": docs_python.names_of(task) for task in docs_python.TASKS}
    headings = {(page, name) for page, text in pages.items() for name in re.findall(r"^## (\w+)$", text, re.MULTILINE)}
    for page, text in pages.items():
        assert not re.findall(r"^- (?:`[^`]*`|[^:`]*|`\w+` \(.*\))$", text, re.MULTILINE)
        links = re.findall(r"\[(\w+)\]\(([\w.-]*)#(\w+)\)", text)
        assert links and all(anchor == name.lower() for name, _, anchor in links)
        assert {(file or page, name) for name, file, _ in links} <= headings
    scene = pages["scene.md"]
    assert "- `camera` ([Camera](#camera)): " in scene and "- `lens : float`: " in scene
    assert "- `volume` ([Volume](read-and-write.md#volume)): " in scene


def test_an_outdated_page_is_noticed(monkeypatch):
    monkeypatch.setitem(docs_reference.PARTS, "licenses", lambda: "Nothing is bundled.")
    ((page, text),) = docs_reference.outdated().items()
    assert page.name == "licenses.md" and "Nothing is bundled." in text and "| --- |" not in text


def test_another_version_is_written_where_it_is_read_without_python(monkeypatch):
    monkeypatch.setattr(docs_reference, "RELEASE", "10.2.0")
    stale = docs_reference.outdated()
    assert list(stale) == list(docs_reference.WITH_VERSION)
    assert all(text.count("10.2.0") == 1 for text in stale.values())


def test_docstrings_become_markdown():
    text = docs_python.docstring(
        "Do it.\n\nParameters\n----------\nname : str\n    What\n    it is\nplain : ``int``\n\nNotes\n-----\nOf ``x``.",
        "scene.md",
    )
    assert text == (
        "Do it.\n\n**Parameters**\n\n- `name : str`: What it is.\n- `plain : ``int```\n\n**Notes**\n\nOf `x`."
    )


def test_the_reference_lists_every_command_and_option():
    text, _, shared = docs_reference.command_line().partition("\n## Options of several commands\n")
    for name in COMMANDS:
        section = text.partition(f"## rle-splat {name}\n")[2].partition("\n## ")[0]
        section += "".join(shared.partition(f"### {title}\n")[2].partition("\n### ")[0]
                           for title in re.findall(r"\[([\w ]+)\]\(#", section))  # fmt: skip
        usage = docs_reference.command_parser(name).format_usage()
        options = set(re.findall(r"--[a-z-]+", usage))
        assert options and all(f"`{option}" in section for option in options), name


def registered(folder, prefix):
    """The classes of a folder that Blender registers, by name, and the idname and label that each declares itself."""
    found = {}
    for path in (ROOT / folder).glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and node.name.startswith(prefix):
                texts = {
                    item.targets[0].id: item.value.value for item in node.body
                    if isinstance(item, ast.Assign) and isinstance(item.value, ast.Constant)
                }  # fmt: skip
                found[node.name] = texts
    return found


def test_the_reference_lists_every_operator_with_its_tooltip():
    text = docs_reference.operators()
    operators = registered("operators", "RLE_SPLAT_OT_")
    assert len(operators) > 20
    for texts in operators.values():
        section = text.partition(f"`bpy.ops.{texts['bl_idname']}()`. ")
        assert f"## {texts['bl_label']}\n" in section[0] and len(section[2].partition("\n")[0]) > 10, texts
    for row in (
        "| `of_file` | Other Channels of This File | bool | `False` |",
        "| `use_meshes` | Meshes Hide Volume | bool | unset |",
        "| `direction` | Direction | float (3) | `(0, 1, 0)` |",
    ):
        assert row in text
    assert "| `directory` | Folder |" in text.partition("## Import DICOM Series\n")[2].partition("\n## ")[0]
    assert "`use_dialog`" not in text and "`filter_glob`" not in text


def test_the_reference_lists_every_panel_with_its_settings():
    text = docs_reference.panels()
    panels = registered("panels", "RLE_SPLAT_PT_")
    assert len(panels) > 10
    for texts in panels.values():
        assert "bl_label" not in texts or f"> {texts['bl_label']}" in text, texts
    for label in ("*Maximum Error*", "*Ambient Occlusion*", "Camera View > *Keep Up to Date*", "*Level*",
                  "*Add Box*", "Segment Tools > *Grow*",
                  "*Axial*, *Coronal*, *Sagittal*", "*Insert Keyframes*", "Segment Tools > *Hide Table*",
                  "*Remove Channel (icon)*", "Camera View > *Preview Position*", "*Meshes Hide Volume*",
                  "*White Background*, *Black Background*", "*Cut Along View*"):  # fmt: skip
        assert f"| {label} | " in text, label
    for label in ("Add Slice", "Add Cutting Object", "Chosen Segment"):
        assert f"*{label}*" not in text, label  # names that no panel draws
    for choice in ("*Very Fine*: ", "*Custom*: ", "*Values*: ", "*Cubic, Fast*: "):
        assert choice in text, choice
    for section in text.split("\n## "):
        rows = re.findall(r"^\| (.+?) \|", section, re.MULTILINE)
        assert len(rows) == len(set(rows)), section.partition("\n")[0]
    shown = re.findall(r"^!\[The panel (.+), open\]\(\.\./images/panel-([a-z-]+)\.\w+\)$", text, re.MULTILINE)
    pictures = [path.stem.removeprefix("panel-") for path in (ROOT / "docs/images").glob("panel-*")]
    assert sorted(name for _, name in shown) == sorted(pictures)
    assert all(f"[{title}](#{name})" in text for title, name in shown)
    assert text.count("*Import Volume*") == 1 and text.index("\n## Segments") < text.index("\n## Channels")


def test_the_reference_explains_every_setting():
    text = docs_reference.settings()
    rows = re.findall(r"^\| (`\w+`) \|([^|]*)\| (\w+) \|[^|]*\|[^|]*\| (.*) \|$", text, re.MULTILINE)
    assert "| `specular` | Specular | float | `0.2` | from 0 (slider to 1) |" in text
    assert "| `dtype` | Type | enum | `AUTO` |  |" in text and "| `use_all_cores` | All Cores | bool |  |  |" in text
    assert len(rows) > 60
    assert [name for name, _, kind, text in rows if kind == "enum" and "`" not in text] == []  # what a script sets
    unexplained = [name for name, _, kind, meaning in rows if not meaning and kind not in ("pointer", "collection")]
    assert unexplained == []


def test_the_reference_lists_every_name_of_the_package():
    text = "\n".join(map(docs_python.names_of, docs_python.TASKS))
    for name in rle_splat.__all__:
        section = text.partition(f"## {name}\n")[2].partition("\n## ")[0]
        called = ("```python\nrle_splat.", "`rle_splat.")[section.startswith("\n`rle_splat.")]
        assert f"{called}{name}" in section and len(section.splitlines()) > 3, name


def test_signatures_show_annotations_with_short_names():
    pictures, scene = (docs_python.names_of(task) for task in ("pictures", "scene"))
    assert "    cache: StageCache | None = None,\n) -> Rendering\n```" in pictures
    assert '    quality: Quality | Literal["draft", "standard", "fine", "strict"] | None = None,\n' in pictures
    assert "\n    volume_matrix: ndarray = np.eye(4),\n" in scene and "\n    lights: Sequence[Light] = (),\n" in scene
    text = "\n".join(map(docs_python.names_of, docs_python.TASKS))
    assert not re.search(r"typing\.|collections\.abc|<class|ForwardRef|: _empty|-> _empty", text)


def test_the_glossary_has_the_words_of_the_project():
    pages = (ROOT / "docs/glossary.md", ROOT / "docs/explanation/glossary.md")
    glossary = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    entries = re.findall(r"^(?:- \*\*(.+?)\*\*: |### (.+)\n\n)[A-Z0-9]", glossary, re.MULTILINE)
    terms = [one or other for one, other in entries]
    assert len(terms) == len(set(terms)) == len(re.findall(r"^(?:- |### )", glossary, re.MULTILINE))
    wanted = """
        voxel, transfer function, lookup table, extinction, optical depth, transmittance, opacity, pre-classified,
        post-classified, run, run-length table, voxel record, sheet, sheet buffer, slab, base plane,
        intermediate image, warp, ray interval, stage cache, buffer pool, reference implementation, error estimate,
        probe error, error map, tolerance, 8-bit step, band, row, block, stage, pipeline, plan, footprint, principal
        axis, T1, T2
    """
    assert {" ".join(word.split()) for word in wanted.split(",")} <= set(terms)


def test_class_methods_and_pages_are_marked_in_the_python_reference():
    pictures = docs_python.names_of("pictures")
    assert re.search(r"^- `preset\(.*\) -> Quality`: Class method\. ", pictures, re.MULTILINE)
    assert re.search(r"^- `clear\(\) -> None`: Drop ", pictures, re.MULTILINE)
    assert "(../json-formats.md#report)" in pictures


def test_the_index_of_the_python_reference_has_every_public_name_with_a_sentence():
    rows = re.findall(
        r"^\| \[(\w+)\]\(python/[a-z-]+\.md#\w+\) \| [A-Z].{10,}[.] \|$", docs_python.index(), re.MULTILINE
    )
    assert rows == rle_splat.__all__
