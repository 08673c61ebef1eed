"""What reading costs and how it is stopped: memory, how much a step reads, child processes."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRLittleEndian,
    JPEG2000Lossless,
    JPEGLosslessSV1,
    RLELossless,
    generate_uid,
)

from rle_splat.read.dicom import decoders
from rle_splat.read.formats import read_steps, read_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError

from . import dicom_phantoms as phantoms

AXIAL = phantoms.geometries()["axial"]
MANY, SIDE = 120, 256
DATA = Path(os.environ.get("RLE_SPLAT_DATA") or "/nowhere") / "dicom_ct_chest_512x512x46"


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    """A series of 120 slices of 256 x 256, 15 MiB of voxels."""
    folder = tmp_path_factory.mktemp("large")
    one = phantoms.geometry("one", (1, 0, 0), (0, 1, 0), [0.0])
    (first,) = phantoms.write_classic(tmp_path_factory.mktemp("one"), one)
    dataset = phantoms.read(first)
    dataset.Rows = dataset.Columns = SIDE
    rng = np.random.default_rng(0)
    for i in range(MANY):
        dataset.SOPInstanceUID = generate_uid()
        dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID
        dataset.ImagePositionPatient = [0, 0, i]
        dataset.PixelData = rng.integers(0, 4000, (SIDE, SIDE), dtype=np.uint16).tobytes()
        dataset.save_as(folder / f"{i:04}.dcm")
    return folder


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="this system does not say the peak of memory")
def test_peak_memory(tmp_path: Path, large: Path):
    """A child reads a small series, which loads the libraries, then the large one."""
    phantoms.write_classic(tmp_path, AXIAL)
    child = [sys.executable, str(Path(__file__).with_name("reading_child.py"))]
    done = subprocess.run(child, input=f"{tmp_path}\n{tmp_path}\n{large}\n", capture_output=True, text=True, check=True)
    _, small, big = (json.loads(line) for line in done.stdout.splitlines())
    assert big["outcome"] == "read"
    voxels = 2 * MANY * SIDE**2
    assert big["peak"] - small["peak"] <= 1.2 * voxels + 2 * 2 * SIDE**2


def test_memory_is_stated_before_it_is_taken(large: Path, monkeypatch):
    said = []
    for step in read_steps(large):
        said.append(step.message)
        if "15.0 MiB" in step.message:
            break
    assert "15.0 MiB" in said[-1]
    monkeypatch.setattr("rle_splat.runtime.memory.available_bytes", lambda: 1 << 20)
    with pytest.raises(RleSplatError, match=r"15\.0 MiB of memory and 1\.0 MiB are free"):
        read_volume(large)


@pytest.mark.parametrize("syntax", [ExplicitVRLittleEndian, DeflatedExplicitVRLittleEndian, RLELossless])
def test_no_step_reads_more_than_one_picture(tmp_path: Path, large: Path, syntax: str):
    if syntax == ExplicitVRLittleEndian:
        path, pictures = large, MANY
    else:
        where = phantoms.geometry("long", (1, 0, 0), (0, 1, 0), np.arange(400.0))
        pictures = 400
        path = phantoms.write_enhanced(tmp_path / "a.dcm", where, encoding=phantoms.with_syntax(phantoms.PLAIN, syntax))
    told = [step.fraction for step in read_steps(path)]
    assert len(told) > 2 * pictures, "once for its header and once for its voxels"
    assert max(np.diff([*told, 1.0])) <= 0.2


def test_cancel_ends_the_children(tmp_path: Path, monkeypatch):
    encoding = phantoms.with_syntax(phantoms.PLAIN, JPEG2000Lossless)
    phantoms.write_classic(tmp_path / "scan", AXIAL, encoding=encoding)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    started = []
    popen = subprocess.Popen
    monkeypatch.setattr(decoders.subprocess, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1])
    steps = read_steps(tmp_path / "scan")
    while not started:
        next(steps)
    next(steps)
    steps.close()
    assert all(process.poll() is not None for process in started)
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize("locked", [0, 1, 99])
def test_decoded_pixels_do_not_stay_in_the_temporary_folder(tmp_path: Path, monkeypatch, locked):
    """Windows locks the files of a process that has just ended, so their folder is deleted again, at the latest at the
    end of the program."""
    rmtree, tries, at_exit = shutil.rmtree, [], []

    def refuse(folder, ignore_errors):
        tries.append(folder)
        if len(tries) > locked:
            rmtree(folder)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(decoders, "shutil", SimpleNamespace(rmtree=refuse))
    monkeypatch.setattr(decoders, "atexit", SimpleNamespace(register=lambda *call, **options: at_exit.append(call)))
    with decoders._own_folder() as folder:
        (folder / "0.pixels").write_bytes(b"of a patient")
    assert folder.exists() == (locked == 99) and at_exit == ([(refuse, folder)] if locked == 99 else [])
    assert len(tries) == min(locked + 1, len(decoders.PAUSES))


@pytest.mark.parametrize(("module", "syntax", "package"), [
    ("pydicom", ExplicitVRLittleEndian, "pydicom"), ("openjpeg", JPEG2000Lossless, "pylibjpeg-openjpeg"),
    ("libjpeg", JPEGLosslessSV1, "pylibjpeg-libjpeg"),
])  # fmt: skip
def test_a_python_without_the_library_is_told_its_name(tmp_path: Path, monkeypatch, module, syntax, package):
    phantoms.write_classic(tmp_path, AXIAL, encoding=phantoms.with_syntax(phantoms.PLAIN, syntax))
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(decoders, "find_spec", lambda name: None if name == module else object())
    with pytest.raises(RleSplatError, match=f"need the package {package}, which this Python lacks"):
        read_volume(tmp_path)


class TestChildren:
    """A decoder that ends, hangs or cannot be started gives one sentence."""

    @pytest.fixture
    def scan(self, tmp_path: Path) -> Path:
        phantoms.write_classic(tmp_path, AXIAL, encoding=phantoms.with_syntax(phantoms.PLAIN, JPEG2000Lossless))
        return tmp_path

    def child(self, monkeypatch, folder: Path, program: str) -> None:
        script = folder.parent / f"{folder.name}-child.py"
        script.write_text(program)
        monkeypatch.setattr(decoders.decode_child, "__file__", str(script))

    def refusal(self, path: Path, steps=read_steps) -> str:
        with pytest.raises(RleSplatError) as caught:
            drain(steps(path))
        return str(caught.value)

    def pausing(self, monkeypatch):
        """``read_steps`` whose caller pauses for 1000 s, by the decoders' clock, after each step."""
        paused, clock = [0.0], time.monotonic
        stand_in = SimpleNamespace(monotonic=lambda: clock() + paused[0], sleep=time.sleep)
        monkeypatch.setattr(decoders, "time", stand_in)

        def steps(path):
            for step in read_steps(path):
                yield step
                paused[0] += 1000.0
                assert paused[0] < 1e6, "a child that hangs is never ended"

        return steps

    def test_a_signal(self, scan: Path, monkeypatch):
        self.child(monkeypatch, scan, "import os, sys\nsys.stdin.readline()\nos.abort()\n")
        assert "is damaged and cannot be decoded" in self.refusal(scan)

    @pytest.mark.parametrize("pauses", [False, True])
    def test_a_hang(self, scan: Path, monkeypatch, pauses: bool):
        self.child(monkeypatch, scan, "import time\ntime.sleep(60)\n")
        monkeypatch.setattr(decoders, "SECONDS", 0.5)
        steps = self.pausing(monkeypatch) if pauses else read_steps
        assert "is damaged and cannot be decoded" in self.refusal(scan, steps)

    def test_a_caller_that_pauses(self, scan: Path, monkeypatch):
        """Time in which nobody waits for a frame, such as while Blender draws, is no sign of a hang."""
        assert sum(1 for _ in self.pausing(monkeypatch)(scan)) > len(AXIAL.positions)

    def test_no_python(self, scan: Path, monkeypatch):
        monkeypatch.setattr(sys, "executable", "/usr/bin/blender")
        assert "uncompressed" in self.refusal(scan)
        monkeypatch.setattr(sys, "executable", "/nowhere/python")
        assert "cannot be decoded" in self.refusal(scan)


@pytest.mark.skipif(not DATA.is_dir(), reason="RLE_SPLAT_DATA names no folder of real scans")
def test_a_real_scan():
    """Affine and values against SimpleITK."""
    judge = pytest.importorskip("SimpleITK")
    reader = judge.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(DATA)))
    image = reader.Execute()
    volume = read_volume(next(DATA.iterdir()))
    np.testing.assert_array_equal(volume.physical(volume.voxels), judge.GetArrayFromImage(image))
    np.testing.assert_allclose(volume.affine[:3, 3], image.GetOrigin(), atol=1e-9)
    np.testing.assert_allclose(np.diag(volume.affine)[:3], image.GetSpacing(), atol=1e-9)
    assert (volume.value_unit, volume.modality, volume.name) == ("HU", "CT", "CT CHEST")
    assert volume.remarks == ()
