"""Whether a CT was taken with contrast medium: computed bodies, the scans at hand, and what Automatic then shows."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rle_splat.classify.default import default_transfer_function
from rle_splat.classify.presets import preset
from rle_splat.read.formats import read_volume
from rle_splat.runtime.steps import drain
from rle_splat.segment.contrast import LEAST_SHARE, contrast_share_steps
from rle_splat.volume.volume import PATIENT, Volume

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[2] / "../shared/data")
SIDE = 2.0  # mm


def trunk(blood=45.0, spine=180.0, noise=25.0, metal=0.0, rod=-1000.0):
    """HU (40, 100, 120) in z, y, x: muscle with lungs, an aorta of 24 mm, a spine of 36 mm of porous bone with a hard
    shell, a rod of 24 mm on a table behind the body, and a hip of metal."""
    random = np.random.default_rng(1)
    _, y, x = np.indices((40, 100, 120)) - np.array((19.5, 49.5, 59.5))[:, None, None, None]
    values = np.full(x.shape, -1000.0)
    values[(x / 50.0) ** 2 + ((y + 6.0) / 32.0) ** 2 <= 1.0] = 55.0
    values[((np.abs(x) - 26.0) / 14.0) ** 2 + ((y + 8.0) / 20.0) ** 2 <= 1.0] = -850.0
    values[np.hypot(x - 4.0, y + 8.0) < 6.0] = blood
    bone = np.hypot(x, y - 14.0)
    porous = spine + 140.0 * random.standard_normal(x.shape)
    values = np.where(bone < 9.0, np.where(bone < 7.5, porous, 700.0), values)
    values[(np.abs(y - 36.0) < 1.6) & (np.abs(x) < 56.0)] = -200.0
    values[np.hypot(x - 20.0, y - 42.0) < 6.0] = rod
    values[np.hypot(x + 40.0, y + 2.0) < 3.0] += metal
    return values + noise * random.standard_normal(x.shape)


def scan(values) -> Volume:
    affine = np.diag((SIDE, SIDE, SIDE, 1.0))
    return Volume(np.rint(values).astype(np.int16), affine, value_unit="HU", modality="CT", space=PATIENT)


def is_enhanced(volume: Volume) -> bool:
    return drain(contrast_share_steps(volume)) >= LEAST_SHARE


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, False), ({"spine": 260.0}, False), ({"metal": 3000.0}, False), ({"noise": 80.0}, False),
        ({"rod": 300.0}, False),  # outside of the body, as calibration rods are
        ({"blood": 300.0}, True), ({"blood": 300.0, "noise": 80.0}, True), ({"blood": 450.0, "metal": 3000.0}, True),
        ({"blood": 130.0}, False),  # late after the medium: ct-angiography would show next to nothing of it
    ],
)  # fmt: skip
def test_computed_bodies(changes, expected):
    volume = scan(trunk(**changes))
    assert is_enhanced(volume) is expected
    function, reason = default_transfer_function(volume)
    assert function == preset("ct-angiography" if expected else "ct-bone")
    assert ("contrast medium" in reason) is expected


def test_a_part_without_air_around_it():
    inside = trunk(blood=300.0)[:, 30:66, 46:76]
    assert is_enhanced(scan(inside)) and not is_enhanced(scan(trunk()[:, 30:66, 46:76]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("dicom_ct_chest_512x512x46", {}, False), ("dicom_ct_chest_cta_512x512x95", {}, True),
        ("dicom_ct_skull_phantom_512x512x140", {}, False),
        ("cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz", {}, True),
        ("cthead_256x256x113_uint16be.raw.gz", {"intercept": -1024.0}, False),
        # 8 bits of a window, which is not stated; about -200 to 800 HU
        ("ct_chest_256x256x133_uint8.mha", {"slope": 1000 / 255, "intercept": -200.0}, True),
    ],
)  # fmt: skip
def test_scans(name, changes, expected):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the scan {name} in ../shared/data or $RLE_SPLAT_DATA")
    spacing = {"spacing": (0.9, 0.9, 1.8)} if ".raw" in name else {}
    assert is_enhanced(replace(read_volume(path, **spacing), **changes)) is expected
