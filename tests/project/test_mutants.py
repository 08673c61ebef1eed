"""Every mutant of ``dev.py test --mutations`` changes code that is there, exactly once."""

from pathlib import Path

import pytest

from devtools.mutations import MUTANTS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_mutant_applies(mutant):
    for file, stable, naive in mutant.changes:
        assert mutant.find(ROOT, file).read_text(encoding="utf-8").count(stable) == 1 and naive != stable
