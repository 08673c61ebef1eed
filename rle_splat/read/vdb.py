"""Reader and writer of OpenVDB files, with the module ``openvdb`` of Blender (``pyopenvdb`` in older versions).

A numeric grid becomes a dense volume over the bounding box of its active voxels, dilated by one voxel of background.
The grid's transform places it in the file's world units.
"""

from collections import Counter
from pathlib import Path

import numpy as np

from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.volume import Volume
from .streaming import grid_text, storable_steps
from .vdb_header import MAGIC, check_header

NUMERIC = {"float": np.float32, "double": np.float64, "int32": np.int32, "int64": np.int64, "bool": np.bool_}
PREFERRED_GRID = "density"
SMOKE_GRIDS = ("density", "smoke", "heat", "temperature", "flame", "flames", "fuel")
WORLD_UNIT = "world"  # VDB files state no unit of length; Blender takes world units as meters
SIGNED_DISTANCE = "signed distance"  # value unit of a level set; negative inside
DENSE_LIMIT = 1 << 32  # bytes; 1024^3 floats. A few distant voxels could span any amount
FURTHEST = 1 << 30  # largest voxel index along an axis; OpenVDB uses 32-bit indices
CHUNK = 8  # slices copied at once, one leaf of the tree
LARGER_VOXELS = "export it again with larger voxels"
PROBE_INDICES = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
OPENVDB_PROBLEMS = (OSError, RuntimeError, LookupError, ValueError, TypeError)


def load_openvdb():
    """Import the OpenVDB module; raise a RleSplatError that says how to get it if it is missing."""
    try:
        import openvdb
    except ImportError:
        try:
            import pyopenvdb as openvdb
        except ImportError:
            raise RleSplatError(
                "OpenVDB files need the module openvdb, which Blender includes and this Python lacks; run this inside "
                "Blender (File > Import, or blender --background), install the package python3-openvdb of Debian or "
                "Ubuntu, or add the folder of Blender's Python modules to PYTHONPATH."
            ) from None
    return openvdb


def _labels(grids: list) -> list[str]:
    """Labels of ``grids``, which are in the file's order.

    A label is the grid's name; repeated names get a number from the second on (``smoke[1]``); grids without a name
    are ``[0]``, ``[1]``.
    """
    labels, before = [], Counter()
    for grid in grids:
        number = before[grid.name]
        labels.append(f"{grid.name}[{number}]" if number or not grid.name else grid.name)
        before[grid.name] += 1
    return labels


def _address(grids: list, i: int) -> str:
    """Name by which OpenVDB reads grid ``i``. Repeated names need a number, or OpenVDB prints a warning."""
    alike = [number for number, grid in enumerate(grids) if grid.name == grids[i].name]
    return f"{grids[i].name}[{alike.index(i)}]" if len(alike) > 1 else _labels(grids)[i]


def _metadata(openvdb, path) -> list:
    """Metadata of all grids of a file."""
    check_header(path)
    try:
        return list(openvdb.readAllGridMetadata(str(path)))
    except OPENVDB_PROBLEMS as problem:
        raise _damage_error(path, problem) from None


def _damage_error(path, problem) -> RleSplatError:
    """The error for a file on which OpenVDB raised the exception ``problem``."""
    reason = str(problem).strip().rstrip(".")
    return RleSplatError(
        f"{Path(path).name} is damaged or cannot be read by this version of OpenVDB ({reason}); copy or export it "
        "again."
    )


def _choose(grids: list, wanted: str | None, path) -> int:
    """Index of the grid to read: the wanted one, else ``density``, else the first numeric grid.

    A name without a number means the first numeric grid of that name; ``name[0]`` and ``name[1]`` select one.
    """
    labels = _labels(grids)
    numeric = [i for i, grid in enumerate(grids) if grid.valueTypeName in NUMERIC]
    there = ", ".join(f"{label} ({grid.valueTypeName})" for label, grid in zip(labels, grids)) or "none"
    if wanted is not None:
        found = [i for i, label in enumerate(labels) if wanted in (grids[i].name, label, _address(grids, i))]
        if not found:
            raise RleSplatError(f"{Path(path).name} has no grid {wanted!r}; its grids are: {there}.")
        named = [i for i in found if grids[i].name == wanted] or found
        i = next((i for i in named if i in numeric), named[0])
        if i not in numeric:
            raise RleSplatError(
                f"The grid {wanted!r} holds {grids[i].valueTypeName}, not one number per voxel; the grids are: {there}."
            )
        return i
    if not numeric:
        raise RleSplatError(f"{Path(path).name} has no numeric grid; its grids are: {there}; export a grid of numbers.")
    return next((i for i in numeric if grids[i].name == PREFERRED_GRID), numeric[0])


def _matrix(transform) -> np.ndarray:
    """(4, 4) matrix from grid index to world, from the images of the origin and the three unit indices."""
    origin, *tips = (np.array(transform.indexToWorld(index), dtype=np.float64) for index in PROBE_INDICES)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([tip - origin for tip in tips], axis=1)
    matrix[:3, 3] = origin
    return matrix


def recognizes_vdb(head) -> bool:
    """Whether a file begins as an OpenVDB file."""
    return head.stored.startswith(MAGIC)


def read_vdb_steps(path: str | Path, grid=None):
    """Generator of Progress: read one grid of an OpenVDB file; return the Volume.

    Parameters
    ----------
    grid : str or None
        Name of the grid; ``name[1]`` is the second grid of that name. None for ``density``, or the first numeric grid.

    Returns
    -------
    Volume
        Values of inactive voxels inside the box are kept as stored. int64 becomes int32 where it fits, else float64;
        bool becomes uint8.

    Raises
    ------
    RleSplatError
        If there is no such grid, it has no active voxel, its transform is not affine, or the file is damaged.
    """
    openvdb = load_openvdb()
    yield Progress(0.0, f"reading {Path(path).name}")
    grids = _metadata(openvdb, path)
    chosen = _choose(grids, grid, path)
    label = _labels(grids)[chosen]
    remarks = []
    if len(grids) > 1:
        names = ", ".join(_labels(grids))
        remarks.append(f"The file holds {len(grids)} grids ({names}); {label} was read.")
    try:
        source = openvdb.read(str(path), _address(grids, chosen))
        voxels, corner = yield from _dense_steps(source, label)
    except OPENVDB_PROBLEMS as problem:
        raise _damage_error(path, problem) from None
    except MemoryError:
        raise RleSplatError(
            f"The grid {label!r} does not fit into memory as a dense volume; {LARGER_VOXELS}."
        ) from None
    if not source.transform.isLinear:
        raise RleSplatError(f"The grid {label!r} has a frustum transform; resample it to a box of voxels first.")
    shift = np.eye(4)
    shift[:3, 3] = corner
    notes = dict(source.metadata)
    is_level_set = source.gridClass == "level set"
    if is_level_set:
        remarks.append(f"The grid {label} is a level set: its values are distances, negative inside.")
    smoky = source.gridClass == "fog volume" or source.name.lower() in SMOKE_GRIDS
    return Volume(
        voxels=voxels, affine=_matrix(source.transform) @ shift, unit=notes.get("length_unit") or WORLD_UNIT,
        value_unit=SIGNED_DISTANCE if is_level_set else notes.get("value_unit"),
        modality=notes.get("modality") or ("SMOKE" if smoky and not is_level_set else None),
        background=float(source.background), name=label, remarks=tuple(remarks),
    )  # fmt: skip


def _dense_steps(grid, label: str):
    """Generator of Progress: the active box dilated by one voxel.

    Returns the voxels (nz, ny, nx) and the grid index (x, y, z) of the first one.
    """
    low, high = (np.array(corner, dtype=np.int64) for corner in grid.evalActiveVoxelBoundingBox())
    if (high < low).any():
        raise RleSplatError(f"The grid {label!r} has no active voxel; choose another grid or export it again.")
    if max(abs(low).max(), abs(high).max()) > FURTHEST:
        raise RleSplatError(
            f"The grid {label!r} has voxels beyond index {FURTHEST}; it may be damaged: copy or export it again."
        )
    low, high = low - 1, high + 1
    nx, ny, nz = (int(n) for n in high - low + 1)
    kind = np.dtype(NUMERIC[grid.valueTypeName])
    needed = nx * ny * nz * kind.itemsize
    if needed > DENSE_LIMIT:
        raise RleSplatError(
            f"The active voxels of the grid {label!r} span {nx} x {ny} x {nz} voxels, {needed / 2**30:.1f} GiB as a "
            f"dense volume; the limit is {DENSE_LIMIT >> 30} GiB; {LARGER_VOXELS}."
        )
    refuse_beyond(needed, f"The {nx} x {ny} x {nz} voxels of the grid {label!r} need", LARGER_VOXELS)
    doing = f"reading the grid {label} ({grid_text((nx, ny, nz), kind)})"
    voxels = np.empty((nz, ny, nx), dtype=kind)
    for z in range(0, nz, CHUNK):  # OpenVDB fills C-ordered (x, y, z) arrays; transpose one chunk at a time
        chunk = np.zeros((nx, ny, min(CHUNK, nz - z)), dtype=kind)
        grid.copyToArray(chunk, ijk=(int(low[0]), int(low[1]), int(low[2]) + z))
        voxels[z : z + chunk.shape[2]] = chunk.transpose(2, 1, 0)
        yield Progress(z / nz, doing)
    return (yield from storable_steps(voxels, doing)), low


def _needs_double(volume: Volume) -> bool:
    """Whether the physical values need float64 to be exact."""
    exact_as_float = volume.voxels.dtype.itemsize <= 2 or volume.voxels.dtype == np.float32
    scaled = volume.slope != 1.0 or not float(volume.intercept).is_integer()
    return volume.voxels.dtype == np.float64 or not exact_as_float or (scaled and volume.voxels.dtype.kind != "f")


def remark_on_rounding(volume: Volume) -> str | None:
    """Sentence on what ``write_vdb`` rounds, or None. Some builds of OpenVDB's module (Debian's) lack DoubleGrid."""
    if not _needs_double(volume) or hasattr(load_openvdb(), "DoubleGrid"):
        return None
    return "Values were rounded to float32 (7 digits), because this OpenVDB module has no grid of doubles."


def lost_in_vdb(volume: Volume) -> list[str]:
    """Sentences on what an OpenVDB file does not store."""
    lost = ["Voxels with the background value are not stored, so the volume that is read back may be smaller."]
    if volume.slope != 1.0 or volume.intercept != 0.0:
        lost.append("Physical values were written; the stored values, slope and intercept are lost.")
    if volume.voxels.dtype.kind != "f":
        lost.append(f"The type {volume.voxels.dtype.name} is lost; a floating-point grid was written.")
    rounded = remark_on_rounding(volume)
    return lost + [rounded] if rounded else lost


def write_vdb_steps(volume: Volume, path: str | Path):
    """Generator of Progress: write one sparse grid ``density`` of physical values.

    Types of up to 16 bits and float32 are stored as float, other types as double. Where the OpenVDB module has no
    DoubleGrid, they are stored as float too; see ``remark_on_rounding``.

    Parameters
    ----------
    volume : Volume
        Voxels equal to its background, and NaN, are not stored, so the file's active box may be smaller than the
        volume.

    Returns
    -------
    dict
        Empty: no options are needed to read the file back.
    """
    openvdb = load_openvdb()
    double = _needs_double(volume) and hasattr(openvdb, "DoubleGrid")
    kind = np.float64 if double else np.float32
    grid = (openvdb.DoubleGrid if double else openvdb.FloatGrid)(float(volume.physical(volume.background)))
    grid.name = PREFERRED_GRID
    for z in range(0, volume.voxels.shape[0], CHUNK):
        values = volume.physical(volume.voxels[z : z + CHUNK]).astype(kind)
        # OpenVDB misreads an array that is not C-ordered, without an error.
        grid.copyFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)), ijk=(0, 0, z), tolerance=0)
        yield Progress(z / volume.voxels.shape[0], "writing voxels")
    grid.transform = openvdb.createLinearTransform(volume.affine.T.tolist())  # OpenVDB uses row vectors
    if volume.modality == "SMOKE":
        grid.gridClass = "fog volume"
    for name, note in (
        ("value_unit", volume.value_unit), ("length_unit", volume.unit), ("modality", volume.modality)
    ):  # fmt: skip
        if note:
            grid[name] = note
    try:
        openvdb.write(str(path), grids=[grid])
    except RuntimeError as problem:
        raise RleSplatError(f"Cannot write {path}: {problem}; choose another location.") from None
    return {}
