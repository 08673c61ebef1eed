"""OpenVDB files through Blender's own module: grids, transforms, backgrounds, round trips, and damaged files."""

import os
from pathlib import Path

import bpy
import numpy as np
import pytest

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402  (within reach only after the line above)

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[2] / "../shared/data")
ROTATED = np.array([[0.0, -2.0, 0.0, 5.0], [1.0, 0.0, 0.0, -6.0], [0.0, 0.0, 3.0, 7.0], [0.0, 0.0, 0.0, 1.0]])
MIRRORED = np.diag((-0.5, 1.0, 1.0, 1.0))
SHEARED = np.array([[1.0, 0.2, 0.0, 0.0], [0.0, 1.1, 0.3, 1.0], [0.0, 0.0, 0.9, 0.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture
def formats(core):
    return core("read.formats")


@pytest.fixture
def refusal(core):
    return core("scene").RleSplatError


def points_grid(kind, points, name="density", matrix=None, background=None):
    """A grid with the given {(i, j, k): value} and nothing else."""
    grid = kind() if background is None else kind(background)
    grid.name = name
    access = grid.getAccessor()
    for place, value in points.items():
        access.setValueOn(place, value)
    if matrix is not None:
        grid.transform = openvdb.createLinearTransform(matrix.T.tolist())  # row vectors
    return grid


def write(path, *grids):
    openvdb.write(str(path), grids=list(grids))
    return path


@pytest.mark.parametrize(
    "matrix", [np.eye(4), ROTATED, MIRRORED, SHEARED], ids=["plain", "rotated", "mirrored", "sheared"]
)
def test_the_active_box_and_one_voxel_more_at_its_place(formats, tmp_path, matrix):
    points = {(-3, 5, 10): 1.0, (1, 6, 12): 4.0}
    volume = formats.read_volume(write(tmp_path / "a.vdb", points_grid(openvdb.FloatGrid, points, matrix=matrix)))
    assert volume.shape_xyz == (5 + 2, 2 + 2, 3 + 2)
    assert volume.voxels.dtype == np.float32 and volume.voxels.flags.c_contiguous
    for (i, j, k), value in points.items():
        x, y, z = i + 4, j - 4, k - 9
        assert volume.voxels[z, y, x] == value
        np.testing.assert_allclose(volume.affine @ (x, y, z, 1), matrix @ (i, j, k, 1), atol=1e-12)
    assert np.count_nonzero(volume.voxels) == 2
    assert volume.unit == "world"


def test_the_background_fills_the_border(formats, tmp_path):
    grid = points_grid(openvdb.FloatGrid, {(0, 0, 0): 1.0}, background=-7.5)
    volume = formats.read_volume(write(tmp_path / "a.vdb", grid))
    assert volume.background == -7.5
    assert (volume.voxels == -7.5).sum() == 26


@pytest.mark.parametrize(
    "kind, value, dtype",
    [("FloatGrid", 0.1, "float32"), ("DoubleGrid", 0.1, "float64"), ("Int32Grid", -70000, "float32"),
     ("Int64Grid", -70000, "float32"), ("Int64Grid", (1 << 40) + 1, "float64"), ("BoolGrid", True, "uint8")],
)  # fmt: skip
def test_every_kind_of_number(formats, tmp_path, kind, value, dtype):
    if not hasattr(openvdb, kind):
        pytest.skip(f"this openvdb module has no {kind}, as Debian's")
    volume = formats.read_volume(write(tmp_path / "a.vdb", points_grid(getattr(openvdb, kind), {(0, 0, 0): value})))
    assert volume.voxels.dtype == np.dtype(dtype)
    assert volume.voxels[1, 1, 1] == np.dtype(dtype).type(value)


def test_the_choice_among_several_grids(formats, refusal, tmp_path):
    grids = [
        points_grid(openvdb.Vec3SGrid, {(0, 0, 0): (1.0, 2.0, 3.0)}, "velocity"),
        points_grid(openvdb.FloatGrid, {(0, 0, 0): 2.0}, "heat"),
        points_grid(openvdb.FloatGrid, {(0, 0, 0): 3.0}, "density"),
    ]
    path = write(tmp_path / "a.vdb", *grids)
    volume = formats.read_volume(path)
    assert (volume.name, volume.voxels.max()) == ("density", 3.0)
    assert any("density, heat, velocity" in remark and "density was read" in remark for remark in volume.remarks)
    assert formats.read_volume(path, grid="heat").voxels.max() == 2.0
    with pytest.raises(refusal, match=r"no grid 'flame'.*heat \(float\)"):
        formats.read_volume(path, grid="flame")
    with pytest.raises(refusal, match="vec3s"):
        formats.read_volume(path, grid="velocity")
    assert formats.read_volume(write(tmp_path / "b.vdb", *grids[:2])).name == "heat"


def test_B61_every_grid_of_one_name_can_be_read(formats, refusal, tmp_path, capfd):
    """As OpenVDB calls them: the first by its name, the others by ``name[1]``, ``name[2]``."""
    grids = [points_grid(openvdb.FloatGrid, {(0, 0, 0): float(n)}, "density") for n in range(1, 13)]
    grids.insert(5, points_grid(openvdb.FloatGrid, {(0, 0, 0): 99.0}, "heat"))
    path = write(tmp_path / "a.vdb", *grids)
    capfd.readouterr()
    for grid, value, name in ((None, 1.0, "density"), ("density", 1.0, "density"), ("density[0]", 1.0, "density"),
                              ("density[1]", 2.0, "density[1]"), ("density[11]", 12.0, "density[11]"),
                              ("heat", 99.0, "heat")):  # fmt: skip
        volume = formats.read_volume(path, grid=grid)
        assert (volume.voxels.max(), volume.name) == (value, name)
        assert f"density[10], density[11], heat); {name} was read." in volume.remarks[0]
    assert "more than one grid" not in "".join(capfd.readouterr()), "OpenVDB warns where it is not told which"
    assert formats.read_volume(path, grid="density[1]").modality == "SMOKE"
    with pytest.raises(refusal, match=r"no grid 'density\[12\]'.*density \(float\), density\[1\] \(float\)"):
        formats.read_volume(path, grid="density[12]")


def test_a_bare_name_is_that_of_the_first_grid_of_numbers(formats, refusal, tmp_path):
    vectors = points_grid(openvdb.Vec3SGrid, {(0, 0, 0): (1.0, 2.0, 3.0)})
    path = write(tmp_path / "a.vdb", vectors, points_grid(openvdb.FloatGrid, {(0, 0, 0): 4.0}))
    for grid in (None, "density", "density[1]"):
        volume = formats.read_volume(path, grid=grid)
        assert (volume.voxels.max(), volume.name) == (4.0, "density[1]")
    with pytest.raises(refusal, match=r"'density\[0\]' holds vec3s.*density \(vec3s\), density\[1\] \(float\)"):
        formats.read_volume(path, grid="density[0]")


def test_a_name_that_ends_in_a_number_is_a_name(formats, tmp_path):
    grids = [points_grid(openvdb.FloatGrid, {(0, 0, 0): value}, name) for value, name in ((3.0, "a[1]"), (4.0, "a"))]
    path = write(tmp_path / "a.vdb", *grids)
    assert formats.read_volume(path, grid="a[1]").voxels.max() == 3.0


def test_the_command_line_reads_the_second_grid_of_a_name(core, tmp_path, capsys):
    grids = [points_grid(openvdb.FloatGrid, {(0, 0, 0): value}, "smoke") for value in (3.0, 4.0)]
    path = write(tmp_path / "a.vdb", *grids)
    main = core("cli.main").main
    assert main(["info", str(path), "--grid", "smoke[1]"]) == 0
    told = capsys.readouterr().out
    assert "The file holds 2 grids (smoke, smoke[1]); smoke[1] was read." in told and "0 to 4" in told
    assert main(["info", str(path), "--grid", "smoke[2]"]) == 2
    assert "has no grid 'smoke[2]'; its grids are: smoke (float), smoke[1] (float)." in capsys.readouterr().err


def test_grids_without_a_name_are_read_by_their_number(formats, tmp_path):
    path = write(tmp_path / "a.vdb", *(points_grid(openvdb.FloatGrid, {(0, 0, 0): v}, "") for v in (2.0, 3.0)))
    assert formats.read_volume(path).voxels.max() == formats.read_volume(path, grid="[0]").voxels.max() == 2.0
    assert formats.read_volume(path, grid="[1]").voxels.max() == 3.0


def test_a_grid_without_a_name_is_read(formats, tmp_path):
    path = write(tmp_path / "a.vdb", points_grid(openvdb.FloatGrid, {(0, 0, 0): 2.0}, ""))
    assert formats.read_volume(path).voxels.max() == 2.0


def test_files_without_anything_to_show(formats, refusal, tmp_path):
    vectors = points_grid(openvdb.Vec3SGrid, {(0, 0, 0): (1.0, 2.0, 3.0)}, "velocity")
    with pytest.raises(refusal, match=r"no numeric grid.*velocity"):
        formats.read_volume(write(tmp_path / "vectors.vdb", vectors))
    if hasattr(openvdb, "PointDataGrid"):
        with pytest.raises(refusal, match="no numeric grid"):
            formats.read_volume(write(tmp_path / "points.vdb", openvdb.PointDataGrid()))
    with pytest.raises(refusal, match="no active voxel"):
        formats.read_volume(write(tmp_path / "empty.vdb", points_grid(openvdb.FloatGrid, {})))
    with pytest.raises(refusal, match=r"no numeric grid.*are: none"):
        formats.read_volume(write(tmp_path / "nothing.vdb"))


def test_stray_voxels_far_apart_are_refused_before_memory_is_spent(formats, refusal, tmp_path):
    far = points_grid(openvdb.FloatGrid, {(0, 0, 0): 1.0, (100000, 100000, 100000): 1.0})
    with pytest.raises(refusal, match="GiB"):
        formats.read_volume(write(tmp_path / "far.vdb", far))


@pytest.fixture
def whole(tmp_path):
    """The bytes of a good file that fill several leaves with noise."""
    grid = openvdb.FloatGrid()
    grid.name = "density"
    grid.copyFromArray(np.random.default_rng(4).random((40, 40, 40), dtype=np.float32))
    return write(tmp_path / "whole.vdb", grid).read_bytes()


@pytest.mark.parametrize("left", [0, 4, 8, 11, 40, 70, 100, 130, 0.5, -200, -1])
def test_files_cut_off_anywhere(formats, refusal, tmp_path, whole, left):
    """Met by a look at the header: the library itself may throw anything, or end the process."""
    path = tmp_path / "bad.vdb"
    path.write_bytes(whole[: int(left * len(whole)) if 0 < left < 1 else left])
    with pytest.raises(refusal, match=r"not an OpenVDB file|bytes are too few"):
        formats.read_volume(path)


def test_other_files_under_the_name(formats, refusal, tmp_path, whole):
    path = tmp_path / "bad.vdb"
    for content in (b"something else entirely", whole[:20] + b"\xff" * (len(whole) - 20)):
        path.write_bytes(content)
        with pytest.raises(refusal, match=r"not an OpenVDB file|damaged"):
            formats.read_volume(path)


def test_damage_inside_the_voxels(formats, refusal, tmp_path, whole):
    if not hasattr(openvdb, "DoubleGrid"):
        pytest.skip("Debian's OpenVDB ends the whole process when compressed voxels are damaged")
    middle = len(whole) // 2
    path = tmp_path / "bad.vdb"
    path.write_bytes(whole[:middle] + b"\xff" * 3000 + whole[middle + 3000 :])
    with pytest.raises(refusal, match="damaged"):
        formats.read_volume(path)


def test_files_damaged_at_random(formats, refusal, tmp_path):
    """Cut, or up to three bytes changed, mostly where the file says how much there is of what: read, or a sentence."""
    if not hasattr(openvdb, "DoubleGrid"):
        pytest.skip("Debian's OpenVDB ends the whole process when compressed voxels are damaged")
    grid = openvdb.FloatGrid()
    grid.name = "density"
    grid.copyFromArray(np.random.default_rng(4).random((12, 12, 12), dtype=np.float32))
    whole = write(tmp_path / "whole.vdb", grid).read_bytes()
    path = tmp_path / "bad.vdb"
    refused = 0
    for seed in range(120):
        rng, content = np.random.default_rng(seed), bytearray(whole)
        kind = rng.integers(3)
        if kind == 0:
            del content[rng.integers(len(content)) :]
        else:
            for _ in range(rng.integers(1, 4)):
                content[rng.integers(len(content) if kind == 1 else 1200)] ^= int(rng.integers(1, 256))
        path.write_bytes(content)
        try:
            assert formats.read_volume(path).voxels.size < 1 << 24
        except refusal as problem:
            refused += 1
            assert str(problem).endswith(".") and "\n" not in str(problem)
    assert refused > 60


def test_a_tapered_frustum_is_refused(formats, refusal, tmp_path):
    grid = points_grid(openvdb.FloatGrid, {(0, 0, 0): 1.0, (5, 5, 5): 1.0})
    grid.transform = openvdb.createFrustumTransform((0, 0, 0), (10, 10, 10), 0.3, 5.0)
    with pytest.raises(refusal, match="frustum"):
        formats.read_volume(write(tmp_path / "a.vdb", grid))


def test_a_level_set_says_that_it_is_one(formats, core, tmp_path):
    grid = openvdb.createLevelSetSphere(radius=5.0)
    grid.name = "surface"
    volume = formats.read_volume(write(tmp_path / "a.vdb", grid))
    assert volume.value_unit == "signed distance"
    assert any("level set" in remark for remark in volume.remarks)
    assert volume.value_range[0] < 0.0 < volume.value_range[1]
    function, _ = core("classify.default").default_transfer_function(volume)
    middle = volume.voxels.shape[0] // 2
    alpha = function.alpha_at(volume.physical(volume.voxels[middle]))
    assert alpha[0, 0] == 0.0 and alpha[middle, middle] > 0.5


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"])
def test_written_volumes_come_back_at_their_place(formats, core, tmp_path, dtype):
    """Voxels that are not background keep value and place, whatever the type; the border is trimmed and regrown."""
    rng = np.random.default_rng(9)
    voxels = rng.integers(1, 100, (9, 5, 4)).astype(dtype)
    voxels[0] = 0  # the whole numbers here are exact as floats too, where the module has no DoubleGrid
    volume = core("volume.volume").Volume(
        voxels, ROTATED, slope=2.0, intercept=-1000.0, value_unit="HU", modality="CT", unit="mm"
    )
    options = formats.write_volume(volume, tmp_path / "out.vdb")
    again = formats.read_volume(tmp_path / "out.vdb", **options)
    assert (again.value_unit, again.unit, again.modality) == ("HU", "mm", "CT")
    assert again.background == -1000.0
    assert again.shape_xyz == (6, 7, 10)
    np.testing.assert_array_equal(again.voxels[1:-1, 1:-1, 1:-1], volume.physical(voxels[1:]))
    np.testing.assert_allclose(again.affine @ (1, 1, 1, 1), ROTATED @ (0, 0, 1, 1), atol=1e-12)


def test_a_module_without_doubles_rounds_and_says_so(formats, core, tmp_path, monkeypatch):
    vdb = core("read.vdb")
    volume = core("volume.volume").Volume(np.full((3, 3, 3), 1.0 / 3.0), np.eye(4))
    monkeypatch.delattr(openvdb, "DoubleGrid", raising=False)
    assert "rounded to float32" in vdb.remark_on_rounding(volume)
    formats.write_volume(volume, tmp_path / "out.vdb")
    assert formats.read_volume(tmp_path / "out.vdb").voxels[1, 1, 1] == np.float32(1.0 / 3.0)
    narrow = core("volume.volume").Volume(np.ones((3, 3, 3), np.uint8), np.eye(4))
    assert vdb.remark_on_rounding(narrow) is None


@pytest.mark.parametrize(
    "name, shape, spacing, remarks",
    [("smoke_fog.vdb", (113, 224, 114), (0.47619, 0.47619, 0.47619), 0),
     ("density_and_heat.vdb", (25, 25, 44), (0.7034, 0.7034, 0.7165), 1)],
)  # fmt: skip
def test_real_files(formats, core, name, shape, spacing, remarks):
    if not (DATA / name).exists():
        pytest.skip(f"needs {name} in ../shared/data or $RLE_SPLAT_DATA")
    volume = formats.read_volume(DATA / name)
    assert (volume.shape_xyz, volume.modality, len(volume.remarks)) == (shape, "SMOKE", remarks)
    np.testing.assert_allclose(volume.spacing, spacing, atol=1e-4)
    function, reason = core("classify.default").default_transfer_function(volume)
    assert "Smoke" in reason
    assert 0.05 < (function.alpha_at(volume.voxels) > 0.0).mean() < 0.3


def test_a_medium_too_small_for_openvdb_gives_a_sentence(core, refusal, tmp_path):
    made = core("read.vdb_medium").MediumFile(1.0)
    with pytest.raises(refusal, match="raise the scene scale"):
        made.save(tmp_path / "small.vdb", np.diag((1e-7, 1e-7, 1e-7, 1.0)))
