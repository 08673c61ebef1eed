"""The worst error of DICOM readers in millimeters, on phantoms whose values say where they lie.

    python3 dev.py judges [--json FILE]

Each phantom is written in three versions, whose values tell the x, y and z coordinate; the table has the largest error
of the three. Rows: geometries and encodings, each as one file a slice and as one multi-frame file; transfer syntaxes
for our reader alone. A judge that raises an error "refuses".
"""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import subprocess
import sys
import tempfile
import warnings
from contextlib import redirect_stderr, suppress
from io import StringIO
from pathlib import Path

import numpy as np

from rle_splat.read.formats import read_volume
from tests.read import dicom_phantoms as phantoms

KINDS = ("classic", "enhanced")
BOUND = 0.1  # mm
LPS_FROM_RAS = np.diag((-1.0, -1.0, 1.0, 1.0))
SECONDS = 60


def ours(path: Path):
    """Physical values (nz, ny, nx) and affine to LPS, by this project."""
    volume = read_volume(path)
    return [(volume.physical(volume.voxels), volume.affine)]


def simple_itk(path: Path):
    """By SimpleITK's series reader, or its file reader for one file."""
    import SimpleITK

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    if path.is_dir():
        reader = SimpleITK.ImageSeriesReader()
        reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(path)))
        image = reader.Execute()
    else:
        image = SimpleITK.ReadImage(str(path))
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) @ np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    return [(SimpleITK.GetArrayFromImage(image), affine)]


def highdicom(path: Path):
    """By highdicom's volumes."""
    import highdicom
    import pydicom

    if path.is_dir():
        volume = highdicom.get_volume_from_series([pydicom.dcmread(file) for file in sorted(path.iterdir())])
    else:
        volume = highdicom.imread(path).get_volume()
    affine = volume.affine[:, [2, 1, 0, 3]]  # its indices are slice, row, column
    return [(volume.array, affine)]


def dicom2nifti(path: Path):
    """By dicom2nifti, with its limits on slices off."""
    from dicom2nifti import convert_directory, settings

    settings.disable_validate_slicecount()
    settings.disable_validate_slice_increment()
    settings.disable_validate_orthogonal()
    settings.enable_resampling()
    with tempfile.TemporaryDirectory() as folder:
        convert_directory(_folder(path, folder), folder, compression=False, reorient=False)
        return _niftis(Path(folder))


def dcm2niix(path: Path):
    """By dcm2niix; of several volumes that it writes the best one counts."""
    with tempfile.TemporaryDirectory() as folder:
        words = [Path(sys.executable).with_name("dcm2niix"), "-o", folder, "-f", "a", "-z", "n", _folder(path, folder)]
        subprocess.run([str(word) for word in words], capture_output=True, timeout=SECONDS)
        return _niftis(Path(folder))


JUDGES = (ours, simple_itk, dicom2nifti, dcm2niix, highdicom)


def _folder(path: Path, folder: str) -> Path:
    """The folder of a phantom, which holds nothing else."""
    return path if path.is_dir() else path.parent


def _niftis(folder: Path):
    """Volumes of the NIfTI files in a folder."""
    import nibabel

    found = []
    for path in sorted(folder.glob("*.nii")):
        image = nibabel.load(path)
        found.append((np.asarray(image.get_fdata()).T, LPS_FROM_RAS @ image.affine))
    if not found:
        raise ValueError("nothing was written")
    return found


def worst(values: np.ndarray, affine, axis: int, low: float, high: float) -> float:
    """Largest error in mm of the voxels whose values may be the phantom's; others fill what a reader added."""
    if values.ndim != 3:
        raise ValueError("no volume")
    z, y, x = np.indices(values.shape)
    coordinate = np.tensordot(np.asarray(affine)[axis, :3], np.stack([x, y, z]), 1) + affine[axis][3]
    inside = (values > low - 1.0) & (values < high + 1.0)
    if np.count_nonzero(inside) < values.size / 3:
        return float("inf")  # other values altogether
    error = np.abs((values - phantoms.OFFSET) / phantoms.SCALE - coordinate)
    return float(error[inside].max())


def error_of(judge, paths, where) -> float | None:
    """Worst error of a judge over phantoms whose values tell the axes; None if it refuses one."""
    found = 0.0
    for axis, path in paths.items():
        truth = np.stack([where.values(i, axis) for i in range(len(where.positions))])
        try:
            with warnings.catch_warnings(), redirect_stderr(StringIO()):  # judges print tracebacks
                warnings.simplefilter("ignore")
                volumes = judge(path)
                errors = [worst(values, affine, axis, truth.min(), truth.max()) for values, affine in volumes]
        except Exception as problem:
            logging.debug("%s: %s", judge.__name__, problem)
            return None
        found = max(found, min(errors))
    return found


def written(folder: Path, kind: str, where, encoding, axes) -> dict:
    """Phantoms of the axes: axis -> the folder of a classic series or the file of an enhanced one."""
    shutil.rmtree(folder, ignore_errors=True)
    found = {}
    for axis in axes:
        if kind == "classic":
            phantoms.write_classic(folder / str(axis), where, axis, encoding)
            found[axis] = folder / str(axis)
        else:
            found[axis] = phantoms.write_enhanced(folder / str(axis) / "all.dcm", where, axis, encoding)
    return found


def rows():
    """(name, geometry, encoding, axes, judges) of each row of the table."""
    geometries = phantoms.geometries()
    for name, where in geometries.items():
        yield name, where, phantoms.PLAIN, (0, 1, 2), JUDGES
    for name, encoding in phantoms.ENCODINGS.items():
        yield name, geometries["axial"], encoding, (1,), JUDGES
    for syntax in dict.fromkeys((*phantoms.WRITABLE, *phantoms.BY_IMAGECODECS, *phantoms.BY_PILLOW)):
        encoding = phantoms.LOSSY.get(syntax, phantoms.Encoding(stored=12, intercepts=(200.0,)))
        yield syntax.keyword, geometries["non-square"], phantoms.with_syntax(encoding, syntax), (1,), (ours,)


def table(folder: Path, kinds=KINDS) -> list[dict]:
    """Measure; one mapping a row: name, kind, and the error of each judge, None where it refuses."""
    found = []
    for name, where, encoding, axes, judges in rows():
        for kind in kinds:
            row = {"phantom": name, "kind": kind}
            with suppress(ImportError):  # an encoder that is not installed
                paths = written(folder, kind, where, encoding, axes)
                row.update({judge.__name__: error_of(judge, paths, where) for judge in judges})
                found.append(row)
                print(_line(row), flush=True)
    return found


def _line(row: dict) -> str:
    """A row of the Markdown table."""
    cells = [row["phantom"], row["kind"]]
    for judge in JUDGES:
        error = row.get(judge.__name__, "")
        if error is None:
            cells.append("refuses")
        elif error == float("inf"):
            cells.append("**other values**")
        elif error == "":
            cells.append("")
        else:
            cells.append(f"{error:.2f}" if error <= BOUND + 1e-6 else f"**{error:.1f}**")
    return f"| {' | '.join(cells)} |"


def main(words=None) -> int:
    parser = argparse.ArgumentParser(prog="dev.py judges", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the errors as JSON")
    parser.add_argument("--kind", choices=KINDS, help="only these files")
    known = parser.parse_args(words)
    logging.disable(logging.ERROR)
    print(f"| phantom | files | {' | '.join(judge.__name__ for judge in JUDGES)} |")
    print("|---|---|" + "---|" * len(JUDGES))
    with tempfile.TemporaryDirectory() as folder:
        found = table(Path(folder) / "phantom", (known.kind,) if known.kind else KINDS)
    if known.json:
        known.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    # JPEG-LS near lossless keeps values to one step of 0.1 mm.
    wrong = [
        row for row in found if row["ours"] is None or row["ours"] > BOUND * (1 + ("Near" in row["phantom"])) + 1e-6
    ]
    print(f"{len(found)} rows; ours is beyond {BOUND} mm in {len(wrong)}.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
