"""Built-in transfer functions and the default one: they load, fit, keep noise transparent, and never show nothing."""

import os
from pathlib import Path

import numpy as np
import pytest

from rle_splat.classify.default import default_transfer_function, otsu_threshold
from rle_splat.classify.presets import FOLDER, PRESETS, fit_preset, preset
from rle_splat.read.formats import read_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.histogram import histogram
from rle_splat.volume.volume import Volume

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[2] / "../shared/data")
REQUIRED = (
    "ct-bone", "ct-soft-tissue", "ct-lung", "ct-angiography", "mr-head", "mr-angiography", "faint", "smoke"
)  # fmt: skip


def volume_of(voxels, **more):
    return Volume(np.asarray(voxels), np.eye(4), **more)


def scan(name, **options):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the scan {name} in ../shared/data or $RLE_SPLAT_DATA")
    return read_volume(path, spacing=(1.0, 1.0, 1.0), **options)


def kept_share(volume, function):
    """Share of the voxels that are not transparent; for integer volumes that start at 0."""
    counts = np.bincount(volume.voxels.ravel())
    return counts[function.alpha_at(volume.physical(np.arange(counts.size))) > 0.0].sum() / volume.voxels.size


def shown_from(volume, choice):
    """The stored value above which the preset ``choice`` shows voxels, reckoned by hand: its last transparent point,
    on the percentiles of the voxels where its points are relative.  None: without a preset, half way from the air to
    the threshold that parts the voxels into two classes, each nearer to its own mean."""
    if choice is not None:
        function = preset(choice)
        first = max(value for value, alpha in function.opacity if alpha == 0.0)
        if function.unit == volume.value_unit is not None:
            return (first - volume.intercept) / volume.slope
        (low, high), (start, end) = np.percentile(volume.voxels, (1.0, 99.9)), function.span
        return low + (first - start) / (end - start) * (high - low)
    counts = np.bincount(volume.voxels.ravel())
    values, means = np.arange(counts.size), np.percentile(volume.voxels, (5.0, 99.9))
    for _ in range(40):
        above = values > means.mean()
        means = np.array([np.average(values[side], weights=counts[side]) for side in (~above, above)])
    faces = [np.take(volume.voxels, end, axis).ravel() for axis in range(3) for end in (0, -1)]
    return 0.5 * (np.median(np.concatenate(faces)) + means.mean())


def test_the_table_and_the_files_are_one():
    assert set(REQUIRED) <= set(PRESETS)
    assert {path.stem for path in FOLDER.glob("*.json")} == set(PRESETS)
    assert {name: preset(name).name for name in PRESETS} == {name: row.label for name, row in PRESETS.items()}


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_sound(name):
    function = preset(name)
    # one span for a unit, so that fitting means the same for all
    spans = {"HU": (-1000.0, 2000.0), "SUVbw": (0.0, 10.0), "maximum": (0.0, 1.0), None: (0.0, 1.0)}
    assert function.span == spans[function.unit]
    assert function.alpha_at(function.span[0]) == 0.0  # air
    assert max(alpha for _, alpha in function.opacity) > 0.0
    assert all(0.0 <= channel <= 1.0 for _, *rgb in function.color for channel in rgb)


@pytest.mark.parametrize("name", [name for name in PRESETS if preset(name).shade is not None])
def test_what_faces_the_lamp_is_not_burnt_white(name):
    function = preset(name)
    light, lit = function.shade, max(channel for _, *color in function.color for channel in color)
    assert (light.ambient + light.diffuse) * lit + light.specular <= 1.2


def test_an_unknown_preset_lists_those_there_are():
    with pytest.raises(RleSplatError, match=r"ct-bones.*ct-bone.*smoke"):
        preset("ct-bones")


def test_a_preset_in_the_volumes_unit_is_taken_as_it_is():
    volume = volume_of(np.arange(1000, dtype=np.int16).reshape(10, 10, 10), value_unit="HU")
    function, remark = fit_preset("ct-bone", volume)
    assert function == preset("ct-bone")
    assert remark is None


def test_other_values_get_the_points_on_their_percentiles():
    volume = volume_of(np.arange(1001, dtype=np.int16).reshape(7, 11, 13))
    function, remark = fit_preset("ct-bone", volume)
    assert function.span == (10.0, 999.0)  # 1 % of 0..1000 do not exceed 10, 99.9 % do not exceed 999
    assert "10 to 999" in remark and "CT Bone" in remark


def test_padding_below_air_does_not_move_a_preset():
    voxels = np.linspace(-1000, 1000, 1000).astype(np.int16)
    voxels[:200] = -3024
    low, high = fit_preset("faint", volume_of(voxels.reshape(10, 10, 10), value_unit="HU"))[0].span
    assert low == -1030.0 and 990.0 < high <= 1000.0
    assert fit_preset("faint", volume_of(voxels.reshape(10, 10, 10)))[0].span[0] == -3024.0


def test_fitting_survives_values_that_are_nearly_all_alike():
    voxels = np.zeros((20, 20, 20), np.float32)
    voxels[10, 10, 10] = 5.0
    assert fit_preset("mr-head", volume_of(voxels))[0].span == (0.0, 5.0)
    assert fit_preset("mr-head", volume_of(np.full((2, 2, 2), 1e9, np.float32)))[0].span[1] == 1e9


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, options, choice, low, high",
    [
        ("cthead_256x256x113_uint16be.raw.gz", {}, "ct-bone", 0.05, 0.12),
        ("cthead_256x256x113_uint16be.raw.gz", dict(intercept=-1024, value_unit="HU"), "ct-bone", 0.04, 0.12),
        ("cthead_256x256x113_uint16be.raw.gz", {}, "ct-soft-tissue", 0.15, 0.3),
        ("engine_256x256x110_uint8.raw.gz", {}, "ct-industrial", 0.1, 0.25),
        ("bonsai_256x256x256_uint8.raw.gz", {}, "ct-botanical", 0.05, 0.15),
        ("foot_256x256x256_uint8_fromjpeg.raw.gz", {}, "xa-limb", 0.1, 0.3),
        ("lobster_301x324x56_uint8.raw.gz", {}, "ct-specimen", 0.04, 0.1),
        ("mrbrain_256x256x99_uint8.raw.gz", {}, "mr-head", 0.15, 0.3),
    ],
)
def test_presets_keep_a_plausible_share_of_real_scans(name, options, choice, low, high):
    volume = scan(name, **options)
    share = kept_share(volume, fit_preset(choice, volume)[0])
    assert share == (volume.voxels > shown_from(volume, choice)).mean() and low < share < high


@pytest.mark.parametrize("choice", ["xa-limb", "ct-bone", "faint", "ct-skin"])
def test_the_noise_of_the_foot_is_transparent(choice):
    volume = scan("foot_256x256x256_uint8_fromjpeg.raw.gz")
    assert fit_preset(choice, volume)[0].alpha_at(np.arange(11)).max() == 0.0


# --- the default --------------------------------------------------------------------------------------------------


def shows(volume, at):
    """Alpha of the default transfer function at the voxel ``at`` (x, y, z)."""
    function, reason = default_transfer_function(volume)
    assert reason.endswith(".")
    return float(function.alpha_at(volume.physical(volume.voxels[at[::-1]])))


@pytest.mark.parametrize("value", [0, 1, 255])
def test_a_constant_volume_is_shown(value):
    assert shows(volume_of(np.full((4, 4, 4), value, np.uint8)), (1, 1, 1)) > 0.3


@pytest.mark.parametrize("value", (5, -3.5, 1e-30, 0.0))
def test_the_value_of_a_constant_volume_is_said_as_it_is(value):
    _, reason = default_transfer_function(volume_of(np.full((4, 4, 4), value, np.float32)))
    assert reason == f"All values are about {value:g}, so everything is shown."


@pytest.mark.parametrize("dtype, value", [("uint8", 1), ("uint8", 255), ("float32", 1e-6), ("float32", 1e20)])
def test_a_single_voxel_is_shown_and_the_rest_is_not(dtype, value):
    voxels = np.zeros((16, 16, 16), dtype)
    voxels[8, 7, 6] = value
    assert shows(volume_of(voxels), (6, 7, 8)) > 0.5
    assert shows(volume_of(voxels), (0, 0, 0)) == 0.0


def test_values_from_zero_to_one_are_shown():
    z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    ball = np.clip(1.2 - np.sqrt(x * x + y * y + z * z), 0.0, 1.0).astype(np.float32)
    assert shows(volume_of(ball), (12, 12, 12)) > 0.5
    assert shows(volume_of(ball), (0, 0, 0)) == 0.0


def test_a_dark_object_in_bright_surroundings_is_what_is_shown():
    voxels = np.full((20, 20, 20), 200, np.uint8)
    voxels[8:12, 8:12, 8:12] = 10
    assert shows(volume_of(voxels), (10, 10, 10)) > 0.5
    assert shows(volume_of(voxels), (1, 1, 1)) == 0.0


def test_one_absurd_value_does_not_hide_the_object():
    rng = np.random.default_rng(1)
    voxels = rng.normal(0.0, 0.02, (24, 24, 24)).astype(np.float32)
    voxels[8:16, 8:16, 8:16] += 1.0
    voxels[0, 0, 0] = 1e30
    assert shows(volume_of(voxels), (12, 12, 12)) > 0.2
    assert shows(volume_of(voxels), (2, 2, 2)) == 0.0


def test_hounsfield_units_choose_bone_or_soft_tissue():
    voxels = np.full((20, 20, 20), -1000, np.int16)
    voxels[5:15, 5:15, 5:15] = 50
    function, reason = default_transfer_function(volume_of(voxels, value_unit="HU"))
    assert function == preset("ct-muscle") and "Hounsfield" in reason
    voxels[8:12, 8:12, 8:12] = 1200
    assert default_transfer_function(volume_of(voxels, value_unit="HU"))[0] == preset("ct-bone")


def test_a_level_set_shows_its_inside():
    z, y, x = np.mgrid[-8:9, -8:9, -8:9]
    distance = np.clip(np.sqrt(x * x + y * y + z * z) - 5.0, -3.0, 3.0).astype(np.float32)
    volume = volume_of(distance, value_unit="signed distance")
    assert shows(volume, (8, 8, 8)) == 0.9
    assert shows(volume, (0, 0, 0)) == 0.0


def test_nothing_finite_says_so():
    reason = default_transfer_function(volume_of(np.full((2, 2, 2), np.nan, np.float32)))[1]
    assert "no finite value" in reason


def test_a_volume_that_a_preset_would_leave_blank_gets_the_histogram():
    voxels = np.full((10, 10, 10), -1000, np.int16)
    voxels[4:6, 4:6, 4:6] = -700  # a sponge: neither tissue nor bone
    assert shows(volume_of(voxels, value_unit="HU"), (4, 4, 4)) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "choice"),
    [
        ("bonsai_256x256x256_uint8.raw.gz", None), ("cthead_256x256x113_uint16be.raw.gz", "ct-bone"),
        ("engine_256x256x110_uint8.raw.gz", None), ("foot_256x256x256_uint8_fromjpeg.raw.gz", None),
        ("lobster_301x324x56_uint8.raw.gz", None), ("lobster_120x120x34_uint16le.raw.gz", None),
        ("mrbrain_256x256x99_uint8.raw.gz", "mr-head"), ("cthead_128x128x113_uint8_derived.raw.gz", "ct-bone"),
    ],
)  # fmt: skip
def test_no_real_scan_is_blank_or_a_block(name, choice):
    """What is shown is what lies above the preset's first value, or above the noise of the air."""
    volume = scan(name)
    share = kept_share(volume, default_transfer_function(volume)[0])
    expected = (volume.voxels > shown_from(volume, choice)).mean()
    assert share == pytest.approx(expected, rel=0.03 if choice is None else 0.0)
    assert 0.04 < share < 0.4


def test_otsu_lies_in_the_gap_between_two_heaps():
    voxels = np.array([10] * 60 + [110] * 40, np.uint8).reshape(4, 5, 5)
    assert otsu_threshold(histogram(volume_of(voxels))) == pytest.approx(60.0, abs=1.0)


def test_isodose_steps_are_shares_of_the_largest_dose():
    """At the steps of 30 to 95 % of the maximum the color changes, wherever the percentiles of the values are."""
    voxels = np.linspace(0, 4000, 1000, dtype=np.uint16).reshape(10, 10, 10)
    function, remark = fit_preset("isodose", volume_of(voxels, slope=0.015, value_unit="Gy", modality="RTDOSE"))
    assert "shares of the largest value, 60" in remark and function.unit == "Gy"
    below, above = (function.color_at(np.array([0.5, 0.7, 0.8, 0.9, 0.95]) * 60.0 + off) for off in (-1e-6, 1e-6))
    assert (np.abs(above - below).max(axis=1) > 0.1).all()
    assert function.alpha_at(np.array([17.9]))[0] == 0.0 < function.alpha_at(np.array([18.1]))[0]


@pytest.mark.parametrize("spacing, smoothness", ((1.0, 1.6), (2.0, 1.6), (0.1, 0.2)))
def test_smoothness_of_a_preset_is_at_most_two_voxels(spacing, smoothness):
    """A brain is smoothed by 1.6 mm, that of a mouse by two of its voxels."""
    volume = Volume(np.arange(64.0, dtype=np.float32).reshape(4, 4, 4), np.diag((spacing, spacing, spacing, 1.0)))
    function, _ = fit_preset("mr-brain", volume)
    assert function.shade.smoothness == pytest.approx(smoothness)
    assert fit_preset("ct-bone", volume)[0].shade.smoothness is None
