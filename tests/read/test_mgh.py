"""MGH and MGZ, written and judged by nibabel."""

import nibabel
import numpy as np
import pytest

from rle_splat.read.formats import format_of, read_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import PATIENT

from .phantoms import AFFINES, LEAST_ERROR, coordinates, ras, worst_error


def saved(path, values, affine):
    nibabel.save(nibabel.freesurfer.MGHImage(values, ras(affine)), path)
    return path


@pytest.mark.parametrize("suffix", [".mgh", ".mgz"])
@pytest.mark.parametrize("name", [name for name in AFFINES if name != "sheared"])  # nibabel writes no shear
def test_every_voxel_lies_where_its_value_says(tmp_path, name, suffix):
    paths = [saved(tmp_path / f"{i}{suffix}", v, AFFINES[name]) for i, v in enumerate(coordinates(AFFINES[name]))]
    volumes = [read_volume(path) for path in paths]
    assert worst_error(volumes) <= LEAST_ERROR
    assert all(volume.space == PATIENT for volume in volumes)
    np.testing.assert_allclose(ras(volumes[0].affine), nibabel.load(paths[0]).affine, atol=1e-4)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "int32", "float32"])
def test_types_and_frames(tmp_path, dtype):
    values = (np.arange(3 * 4 * 5 * 6) % 200).reshape(3, 4, 5, 6).astype(dtype)
    path = saved(tmp_path / "a.mgz", values, AFFINES["axial"])
    for frame in (1, 5):
        volume = read_volume(path, frame=frame)
        np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values[..., frame - 1])
        assert volume.voxels.dtype == {"int32": "uint8"}.get(dtype, dtype) and volume.frames == 6


def test_directions_that_are_not_given(tmp_path):
    path = saved(tmp_path / "a.mgh", coordinates(AFFINES["axial"])[0], AFFINES["axial"])
    content = bytearray(path.read_bytes())
    content[28:30] = b"\0\0"
    path.write_bytes(content)
    volume = read_volume(path)
    assert volume.space is None and any("left and right are not known" in remark for remark in volume.remarks)
    np.testing.assert_allclose(volume.spacing, (0.8, 0.8, 2.5), rtol=1e-6)


def test_bad_files_get_their_sentences(tmp_path):
    path = saved(tmp_path / "a.mgh", coordinates(AFFINES["axial"])[0], AFFINES["axial"])
    assert format_of(path.rename(tmp_path / "b.raw")).name == "MGH"
    content = (tmp_path / "b.raw").read_bytes()
    for name, changed, words in (
        ("cut.mgh", content[:800], r"breaks off: 516 of 630 bytes"), ("short.mgh", content[:50], "cut short"),
        ("type.mgh", content[:20] + b"\0\0\0\7" + content[24:], "type 7"),
        ("sizes.mgh", content[:4] + b"\xff\xff\xff\xff" + content[8:], "says -1 x 7 x 5 voxels"),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(changed)
        with pytest.raises(RleSplatError, match=words):
            read_volume(tmp_path / name)
