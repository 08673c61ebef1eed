"""NIfTI and Analyze, written and judged by nibabel."""

import gzip

import nibabel
import numpy as np
import pytest

from rle_splat.read import streaming
from rle_splat.read.formats import format_of, read_volume, write_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.orientation import axis_letters
from rle_splat.volume.volume import PATIENT, STORED_TYPES, Volume

from .judges import affine_by_itk
from .phantoms import AFFINES, LEAST_ERROR, coordinates, ras, rotation, worst_error

KINDS = {"one": (nibabel.Nifti1Image, ".nii"), "packed": (nibabel.Nifti1Image, ".nii.gz"),
         "two": (nibabel.Nifti2Image, ".nii"), "pair": (nibabel.Nifti1Pair, ".img")}  # fmt: skip


def saved(path, values, affine=None, kind=nibabel.Nifti1Image, **fields):
    """A file by nibabel; ``fields`` are set in the header last."""
    image = kind(values, None if affine is None else ras(affine))
    image.header.set_xyzt_units("mm")
    for name, value in fields.items():
        image.header[name] = value
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", AFFINES)
def test_every_voxel_lies_where_its_value_says(tmp_path, name, kind):
    image, suffix = KINDS[kind]
    values = coordinates(AFFINES[name])
    volumes = [read_volume(saved(tmp_path / f"{i}{suffix}", v, AFFINES[name], image)) for i, v in enumerate(values)]
    assert worst_error(volumes) <= LEAST_ERROR
    assert all(volume.space == PATIENT and volume.unit == "mm" for volume in volumes)
    assert np.shares_memory(volumes[0].voxels, volumes[0].voxels) and volumes[0].voxels.dtype == np.int16


def test_big_endian_files_are_read_alike(tmp_path):
    values = coordinates(AFFINES["oblique"])
    volumes = []
    for i, v in enumerate(values):
        header = nibabel.Nifti1Header(endianness=">")
        header.set_data_dtype(np.int16)
        image = nibabel.Nifti1Image(v, ras(AFFINES["oblique"]), header)
        nibabel.save(image, tmp_path / f"{i}.nii")
        assert (tmp_path / f"{i}.nii").read_bytes()[:4] == b"\0\0\x01\x5c"
        volumes.append(read_volume(tmp_path / f"{i}.nii"))
    assert worst_error(volumes) <= LEAST_ERROR


def test_the_sform_counts_before_the_qform(tmp_path):
    image = nibabel.Nifti1Image(coordinates(AFFINES["oblique"])[0], ras(AFFINES["oblique"]))
    image.set_qform(np.diag((3.0, 3.0, 3.0, 1.0)), code=1)
    nibabel.save(image, tmp_path / "a.nii")
    np.testing.assert_allclose(read_volume(tmp_path / "a.nii").affine, AFFINES["oblique"], rtol=1e-6, atol=1e-5)
    image.set_sform(None, code=0)
    nibabel.save(image, tmp_path / "b.nii")
    np.testing.assert_allclose(read_volume(tmp_path / "b.nii").affine, np.diag((-3, -3, 3, 1)), atol=1e-6)


def test_a_file_without_a_place_in_the_patient_keeps_its_spacing_alone(tmp_path):
    image = nibabel.Nifti1Image(coordinates(AFFINES["axial"])[0], None)
    image.header.set_zooms((0.5, 0.75, 2.0))
    nibabel.save(image, tmp_path / "a.nii")
    volume = read_volume(tmp_path / "a.nii")
    assert volume.space is None
    np.testing.assert_array_equal(volume.affine, np.diag((0.5, 0.75, 2.0, 1.0)))
    assert any("left and right are not known" in remark for remark in volume.remarks)
    assert any("no unit of length" in remark for remark in volume.remarks)


@pytest.mark.parametrize("unit, factor", [("meter", 1000.0), ("micron", 0.001)])
def test_other_units_become_millimeters(tmp_path, unit, factor):
    image = nibabel.Nifti1Image(coordinates(AFFINES["axial"])[0], ras(AFFINES["axial"]))
    image.header.set_xyzt_units(unit)
    nibabel.save(image, tmp_path / "a.nii")
    volume = read_volume(tmp_path / "a.nii")
    np.testing.assert_allclose(volume.affine, np.diag((*[factor] * 3, 1)) @ AFFINES["axial"], rtol=1e-6)
    assert volume.unit == "mm"


@pytest.mark.parametrize("slope, intercept, seen", [
    (2.5, -1024.0, (2.5, -1024.0)), (0.0, 7.0, (1.0, 0.0)), (np.nan, np.nan, (1.0, 0.0)), (2.0, np.nan, (2.0, 0.0)),
])  # fmt: skip
def test_scale(tmp_path, slope, intercept, seen):
    path = saved(tmp_path / "a.nii", coordinates(AFFINES["axial"])[0], AFFINES["axial"])
    content = bytearray(path.read_bytes())
    content[112:120] = np.array((slope, intercept), "<f4").tobytes()
    path.write_bytes(content)
    volume = read_volume(path)
    assert (volume.slope, volume.intercept) == seen
    if seen != (2.0, 0.0):  # nibabel refuses an intercept of NaN
        judged = np.asarray(nibabel.load(path).dataobj, dtype=np.float64)
        np.testing.assert_allclose(volume.physical(volume.voxels).transpose(2, 1, 0), judged)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_a_frame_of_a_series_in_time(tmp_path, suffix):
    values = np.arange(2 * 3 * 4 * 5, dtype=np.int16).reshape(2, 3, 4, 5)
    path = saved(tmp_path / f"a{suffix}", values, AFFINES["axial"])
    for frame in (None, 1, 3, 5):
        volume = read_volume(path, frame=frame)
        assert volume.frames == 5
        np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values[..., (frame or 1) - 1])
    assert "5 time points; time point 3 was read" in read_volume(path, frame=3).remarks[0]
    for frame in (0, 6):
        with pytest.raises(RleSplatError, match=r"no volume .* from 1 to 5"):
            read_volume(path, frame=frame)


def _packed_in_members(path, content: bytes):
    path.write_bytes(b"".join(gzip.compress(content[at : at + 500]) for at in range(0, len(content), 500)))


@pytest.mark.parametrize("in_members", [False, True])
def test_frames_in_turn_are_unpacked_once_each(tmp_path, monkeypatch, in_members):
    values = np.random.default_rng(1).integers(-999, 999, (9, 8, 7, 5), dtype=np.int16)
    path, size = saved(tmp_path / "a.nii.gz", values, AFFINES["axial"]), values[..., 0].nbytes
    if in_members:
        _packed_in_members(path, gzip.decompress(path.read_bytes()))
    skipped, skip_steps = [], streaming.skip_steps

    def recorded(path, source, count, doing):
        skipped.append(count)
        return skip_steps(path, source, count, doing)

    def read(frame, expected):
        found = read_volume(path, frame=frame).voxels.transpose(2, 1, 0)
        np.testing.assert_array_equal(found, expected[..., frame - 1])

    monkeypatch.setattr(streaming, "skip_steps", recorded)
    for frame in (1, 2, 3, 5, 2, 4, 1, 5):
        read(frame, values)
    assert skipped == [352, 0, 0, size, 0, 0, 352, 0]
    path = saved(path, values[::-1], AFFINES["axial"])  # another file of the same name: nothing of the first
    for frame in (4, 5):
        read(frame, values[::-1])
    assert skipped[-2:] == [352 + 3 * size, 0]


@pytest.mark.parametrize("values, dtype", [
    ((-5, 7), "int16"), ((-5, 1 << 40), "float32"), ((0, (1 << 33) + 1), "float64"),
])  # fmt: skip
def test_numbers_of_64_bits(tmp_path, values, dtype):
    kind = np.int64 if values[0] < 0 else np.uint64
    array = np.resize(np.array(values, dtype=kind), (2, 3, 4))
    path = tmp_path / "a.nii"
    nibabel.save(nibabel.Nifti1Image(array, np.eye(4), dtype=kind), path)
    volume = read_volume(path)
    assert volume.voxels.dtype.name == dtype
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), array)


@pytest.mark.parametrize("given", [".hdr", ".img"])
def test_analyze_in_two_files(tmp_path, given):
    values = coordinates(AFFINES["axial"])[0]
    image = nibabel.AnalyzeImage(values, np.diag((1.0, 2.0, 3.0, 1.0)))
    nibabel.save(image, tmp_path / "a.img")
    volume = read_volume(tmp_path / f"a{given}")
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values)
    assert volume.space is None and volume.spacing.tolist() == [1.0, 2.0, 3.0]
    (tmp_path / ("a.hdr" if given == ".img" else "a.img")).unlink()
    with pytest.raises(RleSplatError, match="beside it, which is not there"):
        read_volume(tmp_path / f"a{given}")


def test_content_decides_and_not_the_name(tmp_path):
    path = saved(tmp_path / "a.nii.gz", coordinates(AFFINES["axial"])[0], AFFINES["axial"])
    for name in ("scan", "scan.raw", "scan.dcm"):
        path = path.rename(tmp_path / name)
        assert format_of(path).name == "NIfTI"
        assert read_volume(path).space == PATIENT
    plain = tmp_path / "b.nii.gz"
    plain.write_bytes(gzip.decompress(path.read_bytes()))
    assert read_volume(plain).key == read_volume(path).key


def bad_files(tmp_path):
    """Beside those of ``bad_files.BAD``."""
    values, affine = coordinates(AFFINES["axial"])[0], AFFINES["axial"]
    made = {name: saved(tmp_path / f"{name}.nii", values, affine) for name in ("type", "offset")}
    content = made["type"].read_bytes()
    damaged = bytearray(gzip.compress(content, mtime=0))
    damaged[-8] ^= 1
    (tmp_path / "sum.nii.gz").write_bytes(damaged)
    yield tmp_path / "sum.nii.gz", r"damaged gzip"

    def changed(name, at, data):
        fresh = bytearray(content)
        fresh[at : at + len(data)] = data
        made[name].write_bytes(fresh)
        return made[name]

    yield changed("type", 70, np.array((999,), "<i2").tobytes()), "number type 999 does not exist"
    yield changed("offset", 108, np.array((np.nan,), "<f4").tobytes()), "begin at byte nan"
    yield saved(tmp_path / "complex.nii", values.astype(np.complex64), affine), "complex numbers.*magnitude"
    yield saved(tmp_path / "flat.nii", values[:, :, :1], affine), r"single picture \(9 x 7 x 1 voxels\)"


def test_each_bad_file_gets_its_sentence(tmp_path):
    count = 0
    for path, words in bad_files(tmp_path):
        with pytest.raises(RleSplatError, match=words) as refusal:
            read_volume(path)
        assert "\n" not in str(refusal.value) and str(refusal.value).endswith("."), path.name
        count += 1
    assert count == 5


def table(*labels):
    """A label table as TotalSegmentator writes it, as a header extension."""
    rows = "".join(
        f'<Label Key="{key}" Red="{r}" Green="{g}" Blue="{b}" Alpha="1"><![CDATA[{name}]]></Label>'
        for key, name, (r, g, b) in labels
    )
    text = f'<?xml version="1.0"?><CaretExtension><VolumeInformation Index="0"><LabelTable>{rows}</LabelTable>'
    return nibabel.nifti1.Nifti1Extension(0, (text + "</VolumeInformation></CaretExtension>").encode())


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_names_of_labels_come_from_the_label_table(tmp_path, suffix):
    image = nibabel.Nifti1Image(np.ones((3, 4, 5), np.uint8), np.eye(4))
    image.header.extensions.append(table((1, "spleen", (1.0, 0.0, 0.5)), (7, "kidney & co", (0.0, 0.0, 0.0))))
    nibabel.save(image, tmp_path / f"a{suffix}")
    first, second = read_volume(tmp_path / f"a{suffix}").named_labels
    assert (first.label, first.name, second.label, second.name) == (1, "spleen", 7, "kidney & co")
    np.testing.assert_allclose(first.color, (1.0, 0.0, 0.21404114), rtol=1e-6)  # sRGB 0.5, IEC 61966-2-1


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_what_is_written_nibabel_reads_to_the_bit(tmp_path, dtype, suffix):
    voxels = (np.arange(5 * 4 * 3) * 3 % 127).reshape(5, 4, 3).astype(dtype)
    volume = Volume(voxels, AFFINES["sheared"], slope=0.5, intercept=-1024.0, value_unit="HU", space=PATIENT)
    options = write_volume(volume, tmp_path / f"a{suffix}")
    judge = nibabel.load(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(judge.affine, ras(volume.affine), rtol=1e-5)
    np.testing.assert_array_equal(judge.dataobj.get_unscaled().transpose(2, 1, 0), voxels)
    assert judge.get_data_dtype() == dtype and (judge.dataobj.slope, judge.dataobj.inter) == (0.5, -1024.0)
    assert judge.header["qform_code"] == 0  # a qform holds no shear
    again = read_volume(tmp_path / f"a{suffix}", **options)
    np.testing.assert_array_equal(again.voxels, voxels)
    assert (again.slope, again.intercept, again.value_unit) == (0.5, -1024.0, "HU")
    np.testing.assert_allclose(again.affine, volume.affine, rtol=1e-6)


def test_an_affine_without_shear_goes_into_the_qform_too(tmp_path):
    volume = Volume(np.zeros((3, 4, 5), np.uint8), AFFINES["oblique"], space=PATIENT)
    write_volume(volume, tmp_path / "a.nii")
    judge = nibabel.load(tmp_path / "a.nii")
    np.testing.assert_allclose(judge.get_qform(coded=True)[0], ras(volume.affine), atol=1e-4)


@pytest.mark.parametrize("name", [name for name in AFFINES if name != "sheared"])  # ITK reads no shear
def test_itk_which_prefers_the_qform_reads_the_same_place(tmp_path, name):
    itk = pytest.importorskip("SimpleITK")
    values = coordinates(AFFINES[name])[0]
    volume = Volume(np.ascontiguousarray(values.T), AFFINES[name], space=PATIENT)
    write_volume(volume, tmp_path / "a.nii.gz")
    image = itk.ReadImage(str(tmp_path / "a.nii.gz"))
    np.testing.assert_allclose(affine_by_itk(image), volume.affine, rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(itk.GetArrayFromImage(image), volume.voxels)


def test_a_volume_without_a_place_is_written_without_one(tmp_path):
    write_volume(Volume(np.zeros((3, 4, 5), np.uint8), np.diag((1.0, 2.0, 3.0, 1.0))), tmp_path / "a.nii")
    judge = nibabel.load(tmp_path / "a.nii").header
    assert judge["sform_code"] == judge["qform_code"] == 0 and judge.get_zooms() == (1.0, 2.0, 3.0)


def test_an_axis_beyond_the_first_version_makes_the_second(tmp_path):
    volume = Volume(np.zeros((2, 2, 32768), np.uint8), rotation(10, 1), space=PATIENT)
    write_volume(volume, tmp_path / "a.nii")
    assert isinstance(nibabel.load(tmp_path / "a.nii"), nibabel.Nifti2Image)
    assert read_volume(tmp_path / "a.nii").shape_xyz == (32768, 2, 2)


def test_the_real_head(data):
    path = data / "t1_head_188x256x190_uint8.nii.gz"
    volume, judge = read_volume(path), nibabel.load(path)
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), judge.dataobj.get_unscaled())
    np.testing.assert_allclose(volume.affine, ras(judge.affine), rtol=1e-7)
    assert axis_letters(volume.affine) == ("R", "A", "S") == nibabel.aff2axcodes(judge.affine)
