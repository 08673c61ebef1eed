"""dev.py docs: the pages of docs/ and the reference that is generated from the code, as a site in build/docs.

Sphinx makes the site, with MyST for Markdown.  The generated parts of the reference are written into their pages first,
by ``python -m devtools.docs_reference``.  Nothing is fetched while it runs.
"""

from __future__ import annotations

import re
from pathlib import Path

from .environments import Environment, ensure
from .places import BUILD, ENVIRONMENTS, PYTHONS, ROOT, Failure, run, say

DOCS = Environment("the documentation", ENVIRONMENTS / "docs", PYTHONS, ("docs.txt",))
PAGES = ROOT / "docs"
SITE = BUILD / "docs"

FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`[^`\n]*`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)
ELSEWHERE = ("http:", "https:", "mailto:", "../../releases", "../../issues")  # of its page, from the README


def pages() -> list[Path]:
    """The README and every page of docs/."""
    return [ROOT / "README.md", *sorted(PAGES.rglob("*.md"))]


def python_of(page: Path) -> str:
    """The blocks of Python code in a page, which go on one after the other."""
    return "".join(re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))


def linking_pages() -> list[Path]:
    """Every page whose links are checked."""
    return [*pages(), ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]


def anchors(text: str) -> set[str]:
    """The anchors of the headings in Markdown, by GitHub's rule; of equal headings, later ones get a number."""
    found: dict[str, int] = {}
    for heading in HEADING.findall(FENCE.sub("", text)):
        words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = re.sub(r"[^\w -]", "", words).replace(" ", "-")
        found[name] = found.get(name, -1) + 1
    return {f"{name}-{number}" if number else name for name, last in found.items() for number in range(last + 1)}


def broken_links(page: Path, text: str) -> list[str]:
    """Sentences on relative links in Markdown that lead to no file of this repository, or to no heading of a page.

    Sphinx checks the links of docs/ too; this also reads the pages outside.
    """
    found = []
    for target in LINK.findall(CODE.sub("", FENCE.sub("", text))):
        if target.startswith(ELSEWHERE):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not (file.exists() and file.is_relative_to(ROOT)):
            found.append(f"{page.relative_to(ROOT)} links to {target}, which is no file of this repository.")
        elif anchor and anchor not in anchors(text if file == page else file.read_text(encoding="utf-8")):
            found.append(f"{page.relative_to(ROOT)} links to {target}, but {file.name} has no such heading.")
    return found


def docs() -> int:
    """Build the site; a Failure when a link leads nowhere or Sphinx warns of anything."""
    broken = [line for page in linking_pages() for line in broken_links(page, page.read_text(encoding="utf-8"))]
    if broken:
        raise Failure("\n".join(broken))
    run([ensure(DOCS), "-m", "devtools.docs_reference"], "The reference could not be made from the code.", cwd=ROOT)
    # All pages are read anew (-E): a warning on a page that is not read would be lost, and so would the code's changes.
    command = [ensure(DOCS), "-m", "sphinx", "--quiet", "-E", "-a", "--nitpicky", "--fail-on-warning"]
    run(
        [*command, "--doctree-dir", BUILD / "docs-doctrees", PAGES, SITE],
        "Sphinx could not build the documentation without warnings.", cwd=ROOT,
    )  # fmt: skip
    say(f"{(SITE / 'index.html').relative_to(ROOT)}")
    return 0
