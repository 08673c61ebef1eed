"""The script of the documentation's figures: command lines that the commands take."""

import pytest

from devtools import docs_reference, example_figures, practice_ct


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


def test_the_code_of_the_readme_imports_once():
    code = example_figures.python_of_the_readme()
    assert code.count("import rle_splat") == 1 and code.count('"FLAIR.nrrd"') == 1
    compile(code, "README.md", "exec")
