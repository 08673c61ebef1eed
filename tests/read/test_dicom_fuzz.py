"""Damaged DICOM files: no signal, no hang, no memory beyond the honest file's, and one sentence for each refusal.

RLE_SPLAT_FUZZ=5000 reads that many; the default is for every run of the tests.
"""

import json
import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pydicom")

from pydicom.uid import JPEGBaseline8Bit, JPEGLSLossless

from . import dicom_phantoms as phantoms
from .test_dicom_segmentation import truth, write_seg

COUNT = int(os.environ.get("RLE_SPLAT_FUZZ", "80"))
SEED = int(os.environ.get("RLE_SPLAT_FUZZ_SEED", "1"))
SECONDS = 20.0  # for one file, on a busy machine; a decoder that hangs is ended after 10
MEMORY = 64 << 20  # bytes beyond the honest file's peak
SENTENCE = re.compile(r"[^\n]{10,400}\.")
WHERE = phantoms.geometry("short", (1, 0, 0), (0, 1, 0), [0.0, 1.0, 2.0, 3.5])


def honest_files(folder: Path, syntaxes) -> list[Path]:
    """The files to damage: of a series for each transfer syntax, and two segmentations."""
    found = []
    for number, syntax in enumerate(syntaxes):
        encoding = phantoms.with_syntax(phantoms.PLAIN, syntax)
        if syntax == JPEGBaseline8Bit:
            encoding = phantoms.Encoding(syntax, 8, 8, slopes=(1.0,), intercepts=(2000.0,))
        found.append(phantoms.write_classic(folder / f"{number}c", WHERE, 1, encoding)[1])
        found.append(phantoms.write_enhanced(folder / f"{number}e" / "a.dcm", WHERE, 1, encoding))
    masks = truth(WHERE, 3)
    return [*found, *(write_seg(folder / kind / "a.dcm", WHERE, masks, kind) for kind in ("BINARY", "LABELMAP"))]


def mutated(data: bytes, chance: random.Random) -> bytes:
    """The bytes with damage of one kind; half of it in the header."""
    data = bytearray(data)
    end = min(len(data), 3000) if chance.random() < 0.5 else len(data)
    kind = chance.randrange(6)
    if kind == 0:
        return bytes(data[: chance.randrange(len(data))])
    if kind == 1:
        at = chance.randrange(end)
        del data[at : at + chance.choice((1, 2, 7, 100))]
    elif kind == 2:
        at = chance.randrange(end)
        data[at:at] = chance.randbytes(chance.choice((1, 2, 8, 64)))
    elif kind == 3:
        at = chance.randrange(end)
        data[at : at + 4] = chance.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\x40"))
    else:
        for _ in range(chance.choice((1, 1, 3, 10, 50))):
            data[chance.randrange(end)] = chance.randrange(256)
    return bytes(data)


class Reader:
    """The child process; started again after a signal or a hang."""

    def __init__(self):
        self.process = None

    def read(self, path: Path) -> dict:
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("reading_child.py"))], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if line:
            return json.loads(line)
        code = self.process.wait()
        self.process = None
        return {"outcome": "ended", "text": f"exit code {code}", "seconds": 0.0, "peak": 0}

    def end(self) -> str:
        """What the child wrote to standard error."""
        return self.process.communicate()[1] if self.process is not None else ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "syntaxes", [
        (*phantoms.WRITABLE, *phantoms.BY_PILLOW),
        pytest.param((JPEGLSLossless, phantoms.HTJ2KLossless), marks=pytest.mark.extras),
    ], ids=["own", "imagecodecs"],
)  # fmt: skip
def test_damaged_files(tmp_path: Path, syntaxes):
    chance, reader, wrong, outcomes = random.Random(SEED), Reader(), [], {}
    honest = honest_files(tmp_path / "honest", syntaxes)
    most = 0
    for path in honest:
        answer = reader.read(path)
        assert answer["outcome"] == "read", answer
        most = max(most, answer["peak"])
    for number in range(COUNT):
        original = honest[number % len(honest)]
        folder = tmp_path / "damaged"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(original.parent, folder)
        (folder / original.name).write_bytes(mutated(original.read_bytes(), chance))
        answer = reader.read(folder / original.name if number % 3 else folder)
        outcomes[answer["outcome"]] = outcomes.get(answer["outcome"], 0) + 1
        is_sentence = SENTENCE.fullmatch(answer["text"]) and phantoms.PERSON not in answer["text"]
        sentence = answer["outcome"] == "read" or (answer["outcome"] == "refused" and is_sentence)
        if not sentence or answer["seconds"] > SECONDS or answer["peak"] > most + MEMORY:
            kept = tmp_path / f"wrong{number}"
            shutil.copytree(folder, kept)
            wrong.append((number, str(kept), answer))
    print(outcomes)
    assert reader.end() == ""
    assert not wrong, "\n".join(map(str, wrong[:20]))
    assert outcomes.get("refused", 0) > COUNT // 10 and outcomes.get("read", 0) > COUNT // 10, outcomes
