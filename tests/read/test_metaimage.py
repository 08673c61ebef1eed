"""MetaImage, written and judged by SimpleITK."""

import os
import zlib

import numpy as np
import pytest

from rle_splat.read.formats import format_of, read_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.orientation import axis_letters
from rle_splat.volume.volume import PATIENT

from .judges import affine_by_itk
from .phantoms import AFFINES, LEAST_ERROR, coordinates, worst_error

SimpleITK = pytest.importorskip("SimpleITK")  # not in the benchmarks' environment

ORTHOGONAL = [name for name in AFFINES if name != "sheared"]  # ITK writes no other
HEADER = ("ObjectType = Image\nNDims = 3\nDimSize = 9 7 5\nElementSpacing = 1 2 3\nElementType = MET_SHORT\n"
          "ElementByteOrderMSB = False\n")  # fmt: skip


def saved(path, values, affine, packed=False):
    """A file by SimpleITK of values (x, y, z)."""
    image = SimpleITK.GetImageFromArray(np.ascontiguousarray(values.T))
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetDirection((affine[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    SimpleITK.WriteImage(image, str(path), useCompression=packed)
    return path


@pytest.mark.parametrize("suffix", [".mha", ".mhd"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", ORTHOGONAL)
def test_every_voxel_lies_where_its_value_says(tmp_path, name, packed, suffix):
    values = coordinates(AFFINES[name])
    paths = [saved(tmp_path / f"{i}{suffix}", v, AFFINES[name], packed) for i, v in enumerate(values)]
    volumes = [read_volume(path) for path in paths]
    assert worst_error(volumes) <= LEAST_ERROR
    assert all(volume.space == PATIENT for volume in volumes)
    np.testing.assert_allclose(volumes[0].affine, affine_by_itk(SimpleITK.ReadImage(str(paths[0]))), atol=1e-6)


def test_a_sheared_matrix_is_kept(tmp_path):
    affine = AFFINES["sheared"]
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    rows = " ".join(repr(float(x)) for x in (affine[:3, :3] / spacing).T.ravel())
    text = HEADER.replace("1 2 3", " ".join(map(repr, spacing.tolist())))
    volumes = []
    for i, values in enumerate(coordinates(affine)):
        extra = f"TransformMatrix = {rows}\nOffset = -4 6 -20\nAnatomicalOrientation = RAI\nElementDataFile = LOCAL\n"
        (tmp_path / f"{i}.mha").write_bytes((text + extra).encode() + values.T.tobytes())
        volumes.append(read_volume(tmp_path / f"{i}.mha"))
    assert worst_error(volumes) <= LEAST_ERROR


@pytest.mark.parametrize("field", ["LIST", "s%02d.raw 3 7 1"])
def test_slices_in_files_of_their_own(tmp_path, field):
    values = coordinates(AFFINES["axial"])[2]
    names = [f"s{n:02d}.raw" for n in range(3, 8)]
    for k, name in enumerate(names):
        (tmp_path / name).write_bytes(values[:, :, k].T.tobytes())
    listed = names if field == "LIST" else []
    (tmp_path / "a.mhd").write_text(HEADER + "\n".join([f"ElementDataFile = {field}", *listed]) + "\n")
    volume = read_volume(tmp_path / "a.mhd")
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values)
    np.testing.assert_array_equal(
        volume.voxels, SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(tmp_path / "a.mhd")))
    )
    assert volume.space is None and volume.spacing.tolist() == [1.0, 2.0, 3.0]
    (tmp_path / names[2]).unlink()
    with pytest.raises(RleSplatError, match=r"needs s05\.raw beside it"):
        read_volume(tmp_path / "a.mhd")


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_a_name_beyond_ascii(tmp_path, encoding):
    values = coordinates(AFFINES["axial"])[0]
    (tmp_path / "sch\u00e4del.raw").write_bytes(values.T.tobytes())
    (tmp_path / "a.mhd").write_bytes(f"{HEADER}ElementDataFile = sch\u00e4del.raw\n".encode(encoding))
    np.testing.assert_array_equal(read_volume(tmp_path / "a.mhd").voxels.transpose(2, 1, 0), values)


@pytest.mark.parametrize("name", ["../other/a.raw", "below/../../other/a.raw", "{}/other/a.raw"])
def test_a_file_elsewhere_is_refused(tmp_path, name):
    """A header that was sent by someone must not read what its receiver has."""
    for folder in ("other", "scan/below"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "a.raw").write_bytes(coordinates(AFFINES["axial"])[0].tobytes())
    header = tmp_path / "scan" / "a.mhd"
    for field, listed in ((name, ""), ("LIST", f"{name}\n")):
        header.write_text(f"{HEADER}ElementDataFile = {field}\n{listed}".format(tmp_path))
        with pytest.raises(RleSplatError, match=r"a\.mhd names .*other.a\.raw, which is outside its folder; move"):
            read_volume(header)
    header.write_text(f"{HEADER}ElementDataFile = /other\0/a.raw\n")
    cut = "is outside its folder" if os.name == "nt" else "beside it, which is not there"  # Python cuts the name there
    with pytest.raises(RleSplatError, match=cut):
        read_volume(header)
    for name in ("below/a.raw", "../scan/below/a.raw", tmp_path / "scan/below/a.raw"):
        header.write_text(f"{HEADER}ElementDataFile = {name}\n")
        assert read_volume(header).shape_xyz == (9, 7, 5)


@pytest.mark.skipif(os.name == "nt", reason="Windows needs a right to make links")
def test_a_file_in_the_folder_has_that_folders_other_name(tmp_path):
    (tmp_path / "scan").mkdir()
    (tmp_path / "link").symlink_to("scan")
    (tmp_path / "scan" / "a.raw").write_bytes(coordinates(AFFINES["axial"])[0].tobytes())
    for one, other in (("scan", "link"), ("link", "scan")):
        (tmp_path / "scan" / "a.mhd").write_text(f"{HEADER}ElementDataFile = {tmp_path / one / 'a.raw'}\n")
        assert read_volume(tmp_path / other / "a.mhd").shape_xyz == (9, 7, 5)


@pytest.mark.parametrize("skip", [11, -1])
def test_a_header_in_the_data_file(tmp_path, skip):
    values = coordinates(AFFINES["axial"])[0]
    (tmp_path / "a.dat").write_bytes(b"some header" + values.T.tobytes())
    (tmp_path / "a.mhd").write_text(HEADER + f"HeaderSize = {skip}\nElementDataFile = a.dat\n")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.mhd").voxels.transpose(2, 1, 0), values)


@pytest.mark.parametrize("name", [
    "MET_CHAR", "MET_UCHAR", "MET_SHORT", "MET_USHORT", "MET_INT", "MET_UINT", "MET_LONG", "MET_ULONG",
    "MET_LONG_LONG", "MET_ULONG_LONG", "MET_FLOAT", "MET_DOUBLE",
])  # fmt: skip
@pytest.mark.parametrize("msb", ["True", "False"])
def test_types_are_as_wide_as_itk_reads_them(tmp_path, name, msb):
    text = HEADER.replace("MET_SHORT", name).replace("False", msb)
    path = tmp_path / "a.mha"
    path.write_bytes((text + "ElementDataFile = LOCAL\n").encode() + bytes(range(63)) * 40)
    judged = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))
    np.testing.assert_array_equal(read_volume(path).voxels, judged.astype(read_volume(path).voxels.dtype))


def test_frames_and_channels(tmp_path):
    values = np.arange(4 * 5 * 7 * 9, dtype=np.int16).reshape(4, 5, 7, 9)
    text = HEADER.replace("NDims = 3", "NDims = 4").replace("9 7 5", "9 7 5 4").replace("1 2 3", "1 2 3 1")
    (tmp_path / "a.mha").write_bytes((text + "ElementDataFile = LOCAL\n").encode() + values.tobytes())
    side_by_side = np.ascontiguousarray(np.moveaxis(values, 0, 3))
    text = HEADER + "ElementNumberOfChannels = 4\nElementDataFile = LOCAL\n"
    (tmp_path / "b.mha").write_bytes(text.encode() + side_by_side.tobytes())
    for frame in (1, 3):
        for name, words in (("a.mha", "time points"), ("b.mha", "differ in channel")):
            volume = read_volume(tmp_path / name, frame=frame)
            np.testing.assert_array_equal(volume.voxels, values[frame - 1])
            assert words in volume.remarks[0] and volume.frames == 4


BAD = {
    r"breaks off: 600 of 630 bytes": HEADER, "breaks off": HEADER.replace("9 7 5", "60000 60000 60000"),
    "DimSize should be": HEADER.replace("9 7 5", "nine"), "says 9 x 0 x 5": HEADER.replace("9 7 5", "9 0 5"),
    "single picture": HEADER.replace("9 7 5", "9 7 1"), "MET_OTHER": HEADER.replace("MET_SHORT", "MET_OTHER"),
    "are colors": HEADER.replace("MET_SHORT", "MET_UCHAR") + "ElementNumberOfChannels = 3\n",
    "are text": HEADER + "BinaryData = False\n", "elementspacing should be": HEADER.replace("1 2 3", "1 b 3"),
    "singular": HEADER + "TransformMatrix = 1 0 0 1 0 0 0 0 1\n", "does not end": HEADER + "a line of no field\n",
    "not a MetaImage": HEADER.replace("Image", "Tube"),
}  # fmt: skip


@pytest.mark.parametrize("words", BAD)
def test_each_bad_file_gets_its_sentence(tmp_path, words):
    (tmp_path / "a.mha").write_bytes((BAD[words] + "ElementDataFile = LOCAL\n").encode() + bytes(600))
    with pytest.raises(RleSplatError, match=words) as refusal:
        read_volume(tmp_path / "a.mha")
    assert "\n" not in str(refusal.value)


def test_a_packed_file_cut_short(tmp_path):
    packed = zlib.compress(bytes(630), 0)
    text = HEADER + "CompressedData = True\nElementDataFile = LOCAL\n"
    (tmp_path / "a.mha").write_bytes(text.encode() + packed[:400])
    with pytest.raises(RleSplatError, match=r"breaks off: \d+ of 630 bytes"):
        read_volume(tmp_path / "a.mha")
    damaged = bytearray(packed)
    damaged[100] ^= 1
    (tmp_path / "a.mha").write_bytes(text.encode() + damaged)
    with pytest.raises(RleSplatError, match="damaged"):
        read_volume(tmp_path / "a.mha")


def test_the_real_chest(data):
    path = data / "ct_chest_256x256x133_uint8.mha"
    volume, image = read_volume(path), SimpleITK.ReadImage(str(path))
    assert format_of(path).name == "MetaImage"
    np.testing.assert_array_equal(volume.voxels, SimpleITK.GetArrayFromImage(image))
    np.testing.assert_allclose(volume.affine, affine_by_itk(image), atol=1e-6)
    assert axis_letters(volume.affine) == ("L", "A", "I")  # AnatomicalOrientation RPS: where they come from
