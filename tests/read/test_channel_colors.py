"""Colors of the channels of one file: stated by OME, ImageJ or OME-Zarr, else by convention; and what follows."""

import json

import numpy as np
import pytest

from rle_splat.classify.default import default_transfer_function
from rle_splat.read.channel_colors import CONVENTION, color_of, ome_colors
from rle_splat.read.formats import read_volume
from rle_splat.volume.volume import Volume

VALUES = np.random.default_rng(0).integers(0, 900, (5, 3, 6, 7)).astype(np.uint16)  # z, channel, y, x


def signed(red: int, green: int, blue: int) -> int:
    """A color as OME writes it."""
    packed = red << 24 | green << 16 | blue << 8 | 255
    return packed - (1 << 32) if packed >= 1 << 31 else packed


@pytest.mark.parametrize(
    ("attributes", "color"),
    [
        (f'Color="{signed(255, 0, 0)}"', (1, 0, 0)), (f'Color="{signed(0, 128, 255)}"', (0, 128 / 255, 1)),
        ('Color="-1"', None), ("", None), ('EmissionWavelength="461" EmissionWavelengthUnit="nm"', (0, 0, 1)),
        ('Color="-1" EmissionWavelength="519.5"', (0, 1, 0)), ('EmissionWavelength="668"', (1, 0, 0)),
        ('EmissionWavelength="780"', (1, 0, 1)), (f'Color="{signed(0, 255, 0)}" EmissionWavelength="668"', (0, 1, 0)),
    ],
)  # fmt: skip
def test_what_ome_states(attributes: str, color):
    for prefix in ("", "OME:"):
        text = f'<{prefix}Pixels><{prefix}Channel ID="0" {attributes}><{prefix}LightPath/></{prefix}Channel>'
        assert ome_colors(text) == (color,)


def test_where_nothing_is_stated_the_convention_counts():
    assert color_of(0, 1, ((1, 0, 0),)) is None
    assert [color_of(i, 8) for i in range(8)] == [*CONVENTION, *CONVENTION[:2]]
    assert color_of(1, 2, ((0.5, 0.5, 0.5),) * 2) == CONVENTION[1]  # all the same
    assert color_of(1, 2, ((1, 0, 0), None)) == CONVENTION[1] and color_of(1, 2, ((1, 0, 0),)) == CONVENTION[1]
    assert color_of(0, 2, ((1, 0, 0), (0, 0.5, 0))) == (1, 0, 0)
    assert color_of(1, 2, ((1, 0, 0), (0, 0.5, 0))) == pytest.approx((0, 0.2140411, 0))


def test_tiff_files(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    tables = [np.outer(color, np.arange(256)).astype(np.uint8) for color in ((1, 0, 0), (0, 0, 1), (0, 1, 0))]
    colors = [signed(0, 0, 255), signed(255, 255, 0), signed(255, 0, 255)]
    cases = {
        "plain.tif": (dict(imagej=True, metadata={"axes": "ZCYX"}), CONVENTION[:3]),
        "imagej.tif": (dict(imagej=True, metadata={"axes": "ZCYX", "LUTs": tables}), ((1, 0, 0), (0, 0, 1), (0, 1, 0))),
        "named.ome.tif": (
            dict(ome=True, metadata={"axes": "ZCYX", "Channel": {"Color": colors}}), ((0, 0, 1), (1, 1, 0), (1, 0, 1)),
        ),
    }  # fmt: skip
    for name, (options, wanted) in cases.items():
        tifffile.imwrite(tmp_path / name, VALUES, photometric="minisblack", **options)
        volumes = [read_volume(tmp_path / name, frame=number) for number in (1, 2, 3)]
        assert [volume.color for volume in volumes] == list(wanted), name
        np.testing.assert_array_equal(volumes[1].voxels, VALUES[:, 1])
    tifffile.imwrite(tmp_path / "one.tif", VALUES[:, 0], imagej=True, metadata={"axes": "ZYX"})
    assert read_volume(tmp_path / "one.tif").color is None


def test_ome_zarr(tmp_path):
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(str(tmp_path / "a.zarr"), mode="w", zarr_format=2)
    array = root.create_array("0", shape=(2, 5, 6, 7), dtype="uint16")
    array[:] = np.moveaxis(VALUES[:, :2], 1, 0)
    scale = {"type": "scale", "scale": [1, 1, 1, 1]}
    axes = [{"name": name, "type": "channel" if name == "c" else "space"} for name in "czyx"]
    image = {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": [scale]}]}
    for channels, wanted in (
        ([{"color": "FF0000"}, {"color": "0000FF"}], [(1, 0, 0), (0, 0, 1)]),
        ([{"color": "red"}, {}], list(CONVENTION[:2])), ("damaged", list(CONVENTION[:2])),
    ):  # fmt: skip
        attributes = {"multiscales": [image], "omero": {"channels": channels}}
        (tmp_path / "a.zarr" / ".zattrs").write_text(json.dumps(attributes))
        assert [read_volume(tmp_path / "a.zarr", frame=number).color for number in (1, 2)] == wanted


def test_a_channel_is_first_shown_in_its_color():
    """Unshaded and translucent, with a window of its own values, whatever its name is."""
    voxels = np.random.default_rng(0).integers(0, 50, (20, 20, 20)).astype(np.uint16)
    voxels[5:12, 5:12, 5:12] += 3000
    functions = [
        default_transfer_function(Volume(voxels, np.eye(4), slope=slope, name="ct_head", color=(1.0, 0.0, 1.0)))[0]
        for slope in (1.0, 10.0)
    ]
    for function, slope in zip(functions, (1.0, 10.0)):
        assert function.shade is None
        np.testing.assert_allclose(function.color_at(np.array([0.0, 3000.0 * slope])), [(1, 0, 1)] * 2)
        assert function.alpha_at(np.array([40.0 * slope]))[0] == 0.0
        assert 0.1 < function.alpha_at([3040.0 * slope])[0] < 0.2
