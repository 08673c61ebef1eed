"""The script of the documentation's figures: command lines that the commands take."""

import pytest

from devtools import docs, docs_reference, example_figures, practice_ct
from devtools.places import ROOT


@pytest.mark.parametrize("has_scan", [True, False])
def test_the_command_lines_are_understood(monkeypatch, tmp_path, has_scan):
    monkeypatch.setattr(example_figures, "data_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(practice_ct, "write_series", lambda folder: folder.mkdir())
    scan = tmp_path / "data" / example_figures.SKULL
    if has_scan:
        scan.mkdir(parents=True)
    named = set()
    for command, *words in example_figures.command_lines(tmp_path):
        args = docs_reference.command_parser(command).parse_args(words)
        named.add(args.volume)
    assert named == {str(scan if has_scan else tmp_path / "practice-ct")}


@pytest.mark.parametrize("page", [ROOT / "README.md", example_figures.PYTHON_TUTORIAL], ids=lambda page: page.name)
def test_the_code_of_a_page_imports_once(page):
    code = docs.python_of(page)
    assert code.count("import rle_splat") == 1 and code.count('read_volume("FLAIR.nrrd")') == 1
    compile(code, page.name, "exec")
