"""TIFF stacks, written by tifffile and Pillow and judged by Pillow."""

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageSequence

from rle_splat.read.formats import format_of, read_volume
from rle_splat.scene import RleSplatError

VALUES = (np.arange(5 * 7 * 9) * 37 % 60000).astype(np.uint16).reshape(5, 7, 9)  # z, y, x


def pages_by_pillow(path):
    with Image.open(path) as image:
        return np.array([np.asarray(page) for page in ImageSequence.Iterator(image)])


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_pages_in_order(tmp_path, compression, order):
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path, byteorder=order) as writer:
        for page in VALUES:
            writer.write(page, metadata=None, compression=compression)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.voxels, pages_by_pillow(path))
    np.testing.assert_array_equal(volume.voxels, VALUES)
    assert volume.voxels.dtype == np.uint16 and volume.space is None
    assert "states no spacing; 1 × 1 × 1 mm" in volume.remarks[-1]
    assert read_volume(path, spacing=(0.5, 0.5, 2.0), unit="um").spacing.tolist() == [0.5, 0.5, 2.0]


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float16", "uint32"])
def test_types(tmp_path, dtype):
    values = (VALUES % 100).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack")
    volume = read_volume(tmp_path / "a.tif")
    np.testing.assert_array_equal(volume.voxels, values)
    assert volume.voxels.dtype == {"float16": "float32", "uint32": "uint8"}.get(dtype, dtype)


def test_a_stack_of_imagej(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", VALUES, imagej=True, resolution=(4.0, 2.0),
        metadata={"axes": "ZYX", "spacing": 2.5, "unit": "um"},
    )  # fmt: skip
    volume = read_volume(tmp_path / "a.tif")
    np.testing.assert_array_equal(volume.voxels, VALUES)
    assert volume.unit == "um" and volume.spacing.tolist() == [0.25, 0.5, 2.5] and volume.remarks == ()


@pytest.mark.parametrize("axes", ["TZCYX", "TCZYX", "CTZYX", "CZTYX", "ZCTYX", "ZTCYX"])
def test_an_ome_stack_in_time_and_channels(tmp_path, axes):
    values = np.arange(3 * 5 * 2 * 7 * 9, dtype=np.uint16).reshape(3, 5, 2, 7, 9)
    facts = {"axes": axes, "PhysicalSizeX": 500, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 0.25, "PhysicalSizeZ": 2}
    stored = np.ascontiguousarray(values.transpose(["TZCYX".index(axis) for axis in axes]))
    tifffile.imwrite(tmp_path / "a.ome.tif", stored, ome=True, metadata=facts, compression="zlib")
    for frame in range(1, 7):
        volume = read_volume(tmp_path / "a.ome.tif", frame=frame)
        time, channel = divmod(frame - 1, 2)
        np.testing.assert_array_equal(volume.voxels, values[time, :, channel])
        assert volume.frames == 6 and volume.unit == "um"
        np.testing.assert_allclose(volume.spacing, (0.5, 0.25, 2.0), rtol=1e-12)
        assert "differ in time and channel; number" in volume.remarks[0]


def test_time_alone_is_frames(tmp_path):
    values = np.arange(3 * 5 * 7 * 9, dtype=np.uint16).reshape(3, 5, 7, 9)
    tifffile.imwrite(tmp_path / "a.tif", values, imagej=True, metadata={"axes": "TZYX"})
    volume = read_volume(tmp_path / "a.tif", frame=2)
    np.testing.assert_array_equal(volume.voxels, values[1])
    assert "3 time points; time point 2 was read" in volume.remarks[-1]


@pytest.mark.parametrize("given", ["", "s2.tif", "s10.tif"])
def test_numbered_files_stand_in_the_order_of_their_numbers(tmp_path, given):
    for number, page in zip((1, 2, 9, 10, 11), VALUES):
        tifffile.imwrite(tmp_path / f"s{number}.tif", page)
    (tmp_path / "notes.txt").write_text("no page")
    tifffile.imwrite(tmp_path / "s1.tiff", VALUES[0][:3]) if given else None  # another stack's
    volume = read_volume(tmp_path / given if given else tmp_path)
    np.testing.assert_array_equal(volume.voxels, VALUES)
    with pytest.raises(RleSplatError, match=r"no volume 2.*one volume only"):
        read_volume(tmp_path / given if given else tmp_path, frame=2)


@pytest.mark.parametrize(
    "numbers, gaps",
    [
        ((1, 2, 3, 7, 8), "the numbers 4, 5, 6 are missing"), ((1, 2, 3, 4, 6), "the number 5 is missing"),
        ((10, 20, 30, 40, 50), ""), ((1, 2, 3, 4, 10**9), "the numbers 5, 6, 7, 8"),
        ((1, 2, 3, 40, 50), "4, 5, 6, 7, 8, 9, 10, 11 and others are missing"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("name, of_a_file", [("s_{:02d}.tif", True), ("s_{:02d}.tif", False), ("z{}_c1.tif", False)])
def test_missing_numbers_are_named(tmp_path, numbers, gaps, name, of_a_file):
    for number, page in zip(numbers, VALUES):
        tifffile.imwrite(tmp_path / name.format(number), page)
    volume = read_volume(tmp_path / name.format(numbers[1]) if of_a_file else tmp_path)
    assert volume.shape_xyz == (9, 7, 5)
    assert any("missing" in remark for remark in volume.remarks) == bool(gaps)
    assert gaps in " ".join(volume.remarks)


@pytest.mark.parametrize("compression", ["packbits", "tiff_adobe_deflate"])
def test_pages_of_pillow(tmp_path, compression):
    pages = [Image.fromarray((page % 256).astype(np.uint8)) for page in VALUES]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:], compression=compression)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").voxels, VALUES % 256)


def test_content_decides(tmp_path):
    tifffile.imwrite(tmp_path / "a.raw", VALUES, photometric="minisblack")
    assert format_of(tmp_path / "a.raw").name == "TIFF"


def test_lzw_without_a_decoder_gets_its_sentence(tmp_path, monkeypatch):
    pages = [Image.fromarray((page % 256).astype(np.uint8)) for page in VALUES]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    monkeypatch.setitem(__import__("sys").modules, "OpenImageIO", None)
    with pytest.raises(RleSplatError, match=r"compressed with LZW.*save it without compression"):
        read_volume(tmp_path / "a.tif")


def bad_files(folder):
    tifffile.imwrite(folder / "one.tif", VALUES[0])
    yield "one.tif", "single picture"
    tifffile.imwrite(folder / "colors.tif", np.zeros((5, 7, 9, 3), np.uint8), photometric="rgb")
    yield "colors.tif", "are colors"
    tifffile.imwrite(folder / "planes.tif", np.zeros((3, 7, 9), np.uint8), photometric="rgb", planarconfig="separate")
    yield "planes.tif", "are colors"
    (folder / "broken.tif").write_bytes(b"II*\0" + b"\xff" * 50)
    yield "broken.tif", "header of broken.tif is damaged"
    tifffile.imwrite(folder / "cut.tif", VALUES, photometric="minisblack")
    (folder / "cut.tif").write_bytes((folder / "cut.tif").read_bytes()[:-100])
    yield "cut.tif", "damaged"
    (folder / "empty.tif").write_bytes(b"")
    yield "empty.tif", "damaged"
    (folder / "mixed").mkdir()
    tifffile.imwrite(folder / "mixed" / "1.tif", VALUES[0])
    tifffile.imwrite(folder / "mixed" / "2.tif", VALUES[0, :3])
    yield "mixed", r"pages differ: 1\.tif is 9 x 7 pixels of uint16, and 2\.tif is 9 x 3"
    tifffile.imwrite(folder / "complex.tif", VALUES.astype(np.complex64))
    yield "complex.tif", "complex numbers"


def test_each_bad_file_gets_its_sentence(tmp_path, capfd):
    for name, words in bad_files(tmp_path):
        with pytest.raises(RleSplatError, match=words) as refusal:
            read_volume(tmp_path / name)
        assert "\n" not in str(refusal.value), name
    assert capfd.readouterr() == ("", "")
