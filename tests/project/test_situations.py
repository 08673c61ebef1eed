"""Family B of the catalogue: each situation in Blender has a test that names it, and the page lists them all."""

import re
from pathlib import Path

from devtools.catalogue import PAGE, situations
from tests.blender.conftest import EVERY_BLENDER, OLDEST_BLENDER
from tests.blender.situations import SITUATIONS

TESTS = Path(__file__).resolve().parents[1] / "blender"
NAMES = re.compile(r"^def (?:test|check)_((?:B\d+_)+)", re.MULTILINE)


def named() -> set[str]:
    """The ids that tests of this folder have in their names, and checks of those that run in a window."""
    found = [ids for path in TESTS.glob("*.py") for ids in NAMES.findall(path.read_text(encoding="utf-8"))]
    return {name for ids in found for name in ids.strip("_").split("_")}


def test_each_situation_has_a_test_and_each_test_a_situation():
    without = [name for name in SITUATIONS if name not in named()]
    unknown = sorted(named() - set(SITUATIONS))
    assert not without and not unknown, f"no test holds {without}; no situation is {unknown}"


def test_every_situation_is_tested_in_the_oldest_blender_and_the_newest():
    files = {path.name: path.read_text(encoding="utf-8") for path in TESTS.glob("test_*.py")}
    assert {name for name, text in files.items() if NAMES.search(text)} <= EVERY_BLENDER | OLDEST_BLENDER <= set(files)


def test_situations_are_numbered_and_told_apart():
    assert list(SITUATIONS) == [f"B{number}" for number in range(1, len(SITUATIONS) + 1)]
    assert len(SITUATIONS) >= 60 and len({situation for situation, _ in SITUATIONS.values()}) == len(SITUATIONS)


def test_the_page_lists_them():
    assert PAGE.read_text(encoding="utf-8").endswith(situations()), "run dev.py test --catalogue"
