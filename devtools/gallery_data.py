"""What the gallery shows: scans where the data folder has them, else volumes made of numbers.

Each function takes a folder that it may write to and returns (file, properties of rle_splat.import_volume, where it is
from).  Runs in an environment with numpy.
"""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
from gallery_grids import doubled, smoothed

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("RLE_SPLAT_DATA") or ROOT.parent / "shared" / "data")
MADE = "made of numbers"


def _scan(name: str) -> Path | None:
    path = DATA / name
    return path if path.is_file() else None


def _raw(folder: Path, name: str, voxels: np.ndarray, spacing, **options) -> tuple[Path, dict]:
    """(nz, ny, nx) voxels as a bare file, and what it takes to import it."""
    path = folder / f"{name}.raw"
    path.write_bytes(np.ascontiguousarray(voxels).tobytes())
    return path, {"shape": voxels.shape[::-1], "dtype": voxels.dtype.name, "byte_order": "little",
                  "header_bytes": 0, "spacing": spacing, **options}  # fmt: skip


def head(folder: Path):
    """A CT head in Hounsfield units, with twice the scan's slices; its z runs from the crown down."""
    path = _scan("cthead_256x256x113_uint16be.raw.gz")
    if path is not None:
        slices = np.frombuffer(gzip.decompress(path.read_bytes()), ">u2").reshape(113, 256, 256) - 1024.0
        fine = np.rint(smoothed(doubled(slices, 0))).astype(np.int16)
        return *_raw(folder, "head", fine, (1.0, 1.0, 1.0), **IN_HU), path.name
    from phantom import SPACING_MM, head_phantom

    return *_raw(folder, "head", head_phantom()[::-1, ::-1], (SPACING_MM,) * 3, **IN_HU), MADE


IN_HU = {"modality": "CT", "value_unit": "HU", "preset": "ct-bone"}


def _asked_for(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        raise RuntimeError(f"The data folder has no {name}; set RLE_SPLAT_DATA to the folder that holds it.")
    return path


def heart(folder: Path):
    """A CT angiography of a heart and a dissected aorta after surgery."""
    path = _asked_for("cta_aorta_labels") / "cta_heart_aorta_120x126x164_int16.nii.gz"
    return path, {}, path.name


def skull(folder: Path):
    """A CT of a skull of plastic, slices 1 mm apart: the first file of its DICOM series."""
    series = _asked_for("dicom_ct_skull_phantom_512x512x140")
    return min(series.iterdir()), {}, series.name


def nuclei(folder: Path):
    """Nuclei in a confocal stack, whose file does not give the spacing, with a label map of them."""
    path = _asked_for("fluorescence/nuclei_256x256x60_uint16.tif")
    return path, {"use_file_spacing": False, "spacing": (0.26, 0.26, 0.29), "length_unit_given": "um"}, path.name


def cortex(folder: Path):
    """Two channels of fluorescence in mouse cortex."""
    path = _asked_for("fluorescence/cortex_2ch_288x288x30_uint16.ome.tif")
    return path, {}, path.name


def pet(folder: Path):
    """A PET in SUV, whose folder has a segmentation of its tumors beside it."""
    series = _asked_for("pet_seg/dicom_pet_128x128x266")
    return min(series.iterdir()), {}, series.name


def brain(folder: Path):
    """An MR (FLAIR) of an extracted brain."""
    path = _asked_for("flair_brain_124x160x140_uint8.nrrd")
    return path, {}, path.name


def shadows(folder: Path):
    """A foot, by a rotating X-ray C-arm."""
    path = _asked_for("foot_256x256x256_uint8_fromjpeg.raw.gz")
    return path, {"spacing": (1.0, 1.0, 1.0)}, path.name


meshes = baked = lamps = brain
light = worlds = skull  # the first of several scans
