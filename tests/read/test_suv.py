"""SUV by body weight from the header of a PET, computed by hand here; without it, values stay and a remark says why."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.dataset import Dataset

from rle_splat.classify.default import default_transfer_function
from rle_splat.read.formats import read_volume
from rle_splat.read.labels import read_labels

from . import dicom_phantoms as phantoms

AXIAL = phantoms.geometries()["axial"]
WEIGHT, DOSE, HALF_LIFE = 70.0, 350e6, 6586.2
AT_INJECTION = 1000.0 * WEIGHT / DOSE
FACTORS = {hours: AT_INJECTION * 2.0 ** (hours * 3600.0 / HALF_LIFE) for hours in (0.5, 1.0, 24.5)}
DRUG = {"RadionuclideTotalDose": DOSE, "RadionuclideHalfLife": HALF_LIFE, "RadiopharmaceuticalStartTime": "100000"}


def pet(folder: Path, drug=(), encoding=phantoms.PLAIN, **changes):
    """A PET an hour after the injection; a value of None leaves the element out."""

    def change(dataset, i):
        dataset.Modality, dataset.SOPClassUID = "PT", "1.2.840.10008.5.1.4.1.1.128"
        dataset.Units, dataset.DecayCorrection, dataset.PatientWeight = "BQML", "START", WEIGHT
        dataset.SeriesDate = dataset.AcquisitionDate = "20210304"
        dataset.SeriesTime, dataset.AcquisitionTime = "110000.5", f"1100{10 + i}"
        for target, values in ((dataset, changes), (item := Dataset(), {**DRUG, **dict(drug)})):
            for name, value in values.items():
                value = value(i) if callable(value) else value
                if value is None:
                    target.pop(name, None)
                else:
                    setattr(target, name, value)
        dataset.RadiopharmaceuticalInformationSequence = [item]

    phantoms.write_classic(folder, AXIAL, change=change, encoding=encoding)
    return read_volume(folder)


@pytest.mark.parametrize(
    ("changes", "factor"),
    [
        ({}, FACTORS[1.0] * 2.0 ** (0.5 / HALF_LIFE)),
        ({"DecayCorrection": "ADMIN"}, AT_INJECTION),
        # a series that was made again in the evening: the first picture counts
        ({"SeriesTime": "190000", "AcquisitionTime": lambda i: f"110{i}00"}, FACTORS[1.0]),
        ({"SeriesTime": "103000", "AcquisitionTime": None}, FACTORS[0.5]),
        # over midnight: times of day alone, and dates
        ({"SeriesTime": "003000", "AcquisitionTime": None, "drug": {"RadiopharmaceuticalStartTime": "233000.000"}},
         FACTORS[1.0]),
        ({"SeriesDate": "20210305", "AcquisitionTime": None, "SeriesTime": "003000",
          "drug": {"RadiopharmaceuticalStartDateTime": "20210304233000.00+0100"}}, FACTORS[1.0]),
        # an isotope of days, a day and half an hour later
        ({"SeriesDate": "20210305", "AcquisitionDate": "20210305", "SeriesTime": "103000", "AcquisitionTime": "103001",
          "drug": {"RadiopharmaceuticalStartDateTime": "20210304100000", "RadionuclideHalfLife": 282240.0}},
         AT_INJECTION * 2.0 ** (24.5 * 3600.0 / 282240.0)),
    ],
)  # fmt: skip
def test_the_factor_is_that_of_the_formula(tmp_path: Path, changes, factor: float):
    volume = pet(tmp_path, **changes)
    assert volume.value_unit == "SUVbw" and volume.modality == "PT" and not volume.remarks
    assert volume.slope == pytest.approx(factor * phantoms.PLAIN.slopes[0], rel=1e-9)
    assert volume.intercept == pytest.approx(factor * phantoms.PLAIN.intercepts[0], rel=1e-9)


def test_slices_of_different_scales(tmp_path: Path):
    volume = pet(tmp_path, encoding=phantoms.ENCODINGS["per-slice rescale"])
    assert volume.voxels.dtype == np.float32 and volume.value_unit == "SUVbw"
    assert volume.slope == pytest.approx(FACTORS[1.0], rel=1e-3) and volume.intercept == 0.0


@pytest.mark.parametrize(
    ("changes", "unit", "word"),
    [
        ({"PatientWeight": None}, "Bq/ml", "state the weight"),
        ({"PatientWeight": 0.0}, "Bq/ml", "state the weight"),
        ({"Units": "CNTS"}, "counts", "unit is not Bq/ml"),
        ({"DecayCorrection": "NONE"}, "Bq/ml", "decay of the activity was not corrected"),
        ({"DecayCorrection": None}, "Bq/ml", "decay of the activity was not corrected"),
        ({"drug": {"RadionuclideTotalDose": None}}, "Bq/ml", "state the injected dose"),
        ({"drug": {"RadionuclideHalfLife": None}}, "Bq/ml", "state the half-life"),
        ({"drug": {"RadiopharmaceuticalStartTime": None}}, "Bq/ml", "state the times"),
        ({"SeriesTime": "095900", "AcquisitionTime": None}, "Bq/ml", "do not fit each other"),  # before the injection
        ({"drug": {"RadionuclideHalfLife": 282240.0}}, "Bq/ml", "state the days"),
    ],
)
def test_without_it_values_stay_and_a_remark_says_why(tmp_path: Path, changes, unit: str, word: str):
    volume = pet(tmp_path, **changes)
    assert (volume.value_unit, volume.slope) == (unit, phantoms.PLAIN.slopes[0])
    (remark,) = volume.remarks
    assert word in remark and "stored values are used" in remark and "70" not in remark


@pytest.mark.parametrize(("kind", "unit"), [(None, "SUVbw"), ("BW", "SUVbw"), ("LBM", "g/ml")])
def test_values_that_are_suv_already(tmp_path: Path, kind, unit: str):
    volume = pet(tmp_path, Units="GML", SUVType=kind)
    assert (volume.value_unit, volume.slope) == (unit, phantoms.PLAIN.slopes[0])
    assert len(volume.remarks) == (unit != "SUVbw")


def test_a_real_scan_has_the_figures_of_its_readme(data):
    folder = data / "pet_seg"
    volume = read_volume(folder / "dicom_pet_128x128x266")
    assert volume.value_unit == "SUVbw" and volume.slope / 2.0222414 == pytest.approx(2.944804e-4, rel=1e-6)
    assert volume.value_range[1] == pytest.approx(19.51, abs=0.005)
    labels = read_labels(folder / "dicom_seg_tumour_13frames.dcm", volume)
    for number, most, mean in ((1, 4.426, 3.516), (2, 7.208, 3.714)):
        values = volume.physical(volume.voxels[labels.voxels == number])
        assert values.max() == pytest.approx(most, abs=6e-4) and values.mean() == pytest.approx(mean, abs=6e-4)
    function, reason = default_transfer_function(volume)
    assert function.span == (0.0, 10.0) and function.unit == "SUVbw" and "modality of the volume is PT" in reason
