"""Values of DICOM pictures: slopes and types that differ, modality lookup tables, padding."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.dataset import Dataset
from pydicom.uid import generate_uid

from rle_splat.read.formats import read_volume

from . import dicom_phantoms as phantoms
from .test_dicom_series import error_of

GEOMETRIES = phantoms.geometries()
AXIAL = GEOMETRIES["axial"]
SLICES = len(AXIAL.positions)


def test_slices_of_several_types(tmp_path: Path):
    """Signed and unsigned slices, some of 32 bits, in one series."""
    series = generate_uid()
    thirds = [AXIAL.positions[i::3] for i in range(3)]
    encodings = (
        phantoms.PLAIN,
        phantoms.Encoding(signed=True),
        phantoms.Encoding(allocated=32, stored=32, signed=True),
    )
    for number, (positions, encoding) in enumerate(zip(thirds, encodings)):
        where = phantoms.Geometry("third", AXIAL.row, AXIAL.column, AXIAL.spacing, positions)
        phantoms.write_classic(tmp_path, where, encoding=encoding, series=series, first=100 * number)
    volume = read_volume(tmp_path)
    assert volume.voxels.dtype == np.int16 and volume.voxels.shape[0] == SLICES and error_of(volume) <= 0.05 + 1e-6


def modality_table(first: int, values, bits: int = 16, packed: bool = False) -> Dataset:
    table = Dataset()
    table.LUTDescriptor, table.ModalityLUTType = [len(values) % 65536, first, bits], "HU"
    table["LUTDescriptor"].VR = "SS" if first < 0 else "US"
    data = np.asarray(values, np.uint8 if packed else "<u2").tobytes()
    table.add_new(0x00283006, "OW", data + b"\0" * (len(data) % 2))
    return table


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"])
@pytest.mark.parametrize("signed", [False, True])
def test_a_table_of_values_is_applied(tmp_path: Path, signed: bool, syntax: str):
    """Modality LUT: the values are those of the table; stored ones beyond its ends have those of its ends."""
    first, entries = (-5, 900) if signed else (2240, 60)
    values = (np.arange(entries) * 700 + 3) % 50000

    def change(dataset, i):
        table = modality_table(first, values)
        if syntax.endswith(".2.2"):
            table["LUTData"].value = np.asarray(values, ">u2").tobytes()
        dataset.ModalityLUTSequence = [table]
        del dataset.RescaleSlope, dataset.RescaleIntercept

    encoding = phantoms.with_syntax(phantoms.Encoding(signed=signed), syntax)
    phantoms.write_classic(tmp_path / "with", AXIAL, encoding=encoding, change=change)
    phantoms.write_classic(tmp_path / "without", AXIAL, encoding=encoding)
    stored = read_volume(tmp_path / "without").voxels.astype(int)
    found = read_volume(tmp_path / "with")
    np.testing.assert_array_equal(found.voxels, values[np.clip(stored - first, 0, entries - 1)])
    assert found.value_unit == "HU" and "which was applied" in " ".join(found.remarks)
    assert stored.min() < first or stored.max() >= first + entries, "beyond the table"


def test_a_table_of_bytes_and_a_damaged_one(tmp_path: Path):
    def change(dataset, i, table):
        dataset.ModalityLUTSequence = [table]

    values = np.arange(55)
    tables = {
        "packed": modality_table(2250, values, 8, packed=True), "words": modality_table(2250, values, 8),
        "damaged": modality_table(2250, values),
    }  # fmt: skip
    tables["damaged"].LUTDescriptor = [700, 2250, 16]
    found = {}
    for name, table in tables.items():
        phantoms.write_classic(tmp_path / name, AXIAL, change=partial(change, table=table))
        found[name] = read_volume(tmp_path / name)
    stored = found["damaged"].voxels.astype(int)
    for name in ("packed", "words"):
        np.testing.assert_array_equal(found[name].voxels, np.clip(stored - 2250, 0, 54))
    assert "damaged table of values (Modality LUT), which is not applied" in " ".join(found["damaged"].remarks)
    assert error_of(found["damaged"]) <= 0.05 + 1e-6


@pytest.mark.parametrize("value", [3000, -5, 0])
@pytest.mark.parametrize("slopes", [(1.0,), (0.5, 0.25)])
def test_padding_above_the_lowest_value_becomes_it(tmp_path: Path, value: int, slopes):
    """Padding that is higher than the lowest real value would be seen; lower padding is kept."""
    encoding = phantoms.Encoding(signed=True, slopes=slopes, intercepts=(2100.0,))

    def change(dataset, i):
        dataset.PixelPaddingValue = value
        dataset["PixelPaddingValue"].VR = "SS"

    def spoil(words):
        words[0, :3] = np.int16(value).view(np.uint16)
        return words

    written = encoding.words
    object.__setattr__(encoding, "words", lambda values, i: spoil(written(values, i)))
    phantoms.write_classic(tmp_path, AXIAL, axis=0, encoding=encoding, change=change)
    volume = read_volume(tmp_path)
    found = volume.physical(volume.voxels)
    real = found[:, 1:]
    for k in range(SLICES):
        stated = value * slopes[k % len(slopes)] + 2100.0
        np.testing.assert_allclose(found[k, 0, :3], min(stated, real.min()), atol=1e-3)
    assert phantoms.worst_error(real, volume.affine, 0) <= 0.05 + 1e-3
