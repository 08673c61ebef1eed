"""Each kind of bad medical file gets one sentence from the command line, and leaves nothing behind."""

import pytest

pytest.importorskip("pydicom")
pytest.importorskip("nibabel")

from tests.read.bad_files import BAD
from tests.read.dicom_phantoms import PERSON


@pytest.mark.parametrize("name", BAD)
def test_each_is_refused_in_a_sentence(refused, tmp_path, name):
    """``refused`` checks one line on stderr, no traceback, and exit code 2."""
    write, words = BAD[name]
    path = write(tmp_path / "bad")
    before = sorted(tmp_path.rglob("*"))
    for command in (("render", path, "-o", tmp_path / "a.png"), ("encode", path, "-o", tmp_path / "a.rle"),
                    ("convert", path, tmp_path / "a.nii")):  # fmt: skip
        sentence = refused(*command)
        assert words in sentence and PERSON not in sentence
    assert sorted(tmp_path.rglob("*")) == before
