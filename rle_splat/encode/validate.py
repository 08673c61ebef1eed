"""Validation of stored tables before any kernel reads them: kernels have no bounds checks.

Every check of tables works on whole arrays. The first failed check gives the error message.
"""

import math
from typing import NamedTuple

import numpy as np

from ..classify.limits import BRIGHTEST
from ..scene import MODELS, RECORDS, RleSplatError, as_matrix
from ..volume.axes import AXES, AXIS_NAMES
from ..volume.volume import PATIENT, STORED_TYPES
from .members import COUNTS, LIGHT_MODEL, ORDER_OF, ROWS, RUNS, SURFACE
from .records import SCALES, TYPES, WORDS, record_bytes
from .scalars import OWN_TYPES
from .tables import run_type

MOST = 1e37  # bound of any number in the voxel data: above the densest and brightest, and within float32
MOST_COLOR = 2.0 * BRIGHTEST  # of any channel; twice, because short records are rounded
OF_VOXELS = {"pre": ("records",), "post": ("scalars", SURFACE)}  # classification -> tables of voxels
NEEDED = {"pre": ("records",), "post": ("scalars",)}


class Values(NamedTuple):
    """What post-classified tables say of the volume's values.

    Attributes
    ----------
    dtype : numpy.dtype
        Of the volume's voxels.
    slope, intercept : float
        See Volume.
    ends : (float, float)
        Smallest and largest stored value that is splatted.
    center : float
        What was taken from stored values.
    light_matrix : (4, 4) ndarray of float64 or None
        Voxel index to the world in which the lights and the codes of normals are; None where it is not stored.
    """

    dtype: np.dtype
    slope: float
    intercept: float
    ends: tuple
    center: float
    light_matrix: np.ndarray | None


def _require(good, what: str) -> None:
    """ValueError unless ``good``."""
    if not good:
        raise ValueError(what)


def _is_number(value, above: float = -math.inf) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and value > above


def _is_count(value, least: int = 0) -> bool:
    return type(value) is int and value >= least


def check_header(header: dict) -> dict:
    """Check what the header says of the volume; raises one of DAMAGE, or RleSplatError.

    Returns
    -------
    dict
        ``shape_xyz``, ``model``, ``record``, ``affine``, ``unit``, ``unit_length``, ``transfer_function``,
        ``lighting``, ``source``, ``remarks`` and ``space`` as in StoredVolume, and ``axes``, a tuple of numbers.
    """
    shape, names, space = header["shape_xyz"], header["axes"], header.get("space")  # older files have no space
    _require(
        isinstance(shape, list) and len(shape) == 3 and all(_is_count(n, 1) for n in shape),
        "its shape is not three whole numbers",
    )
    _require(
        isinstance(names, list) and names and set(map(str, names)) <= set(AXIS_NAMES), "it names no principal axis"
    )
    _require(header["model"] in MODELS, "there is no model of that name")
    _require(header["record"] in RECORDS, "its voxel records have an unknown size")
    _require(_is_number(header["unit_length"], 0.0), "its unit length is not a positive number")
    _require(
        isinstance(header["unit"], str) and isinstance(header["source"], str), "its unit or its source is not text"
    )
    remarks = header["remarks"]
    _require(isinstance(remarks, list) and all(isinstance(one, str) for one in remarks), "its notes are not texts")
    _require(space in (None, PATIENT), "its space is unknown")
    for name in ("transfer_function", "lighting"):
        _require(isinstance(header[name], (dict, type(None))), f"its {name.replace('_', ' ')} is not a JSON object")
    kept = ("model", "record", "unit", "transfer_function", "lighting", "source")
    return {
        **{name: header[name] for name in kept}, "space": space, "shape_xyz": tuple(shape), "remarks": tuple(remarks),
        "axes": tuple(axis for axis in AXES if AXIS_NAMES[axis] in names),
        "affine": as_matrix(header["affine"], "its affine"), "unit_length": float(header["unit_length"]),
    }  # fmt: skip


def check_color(brightest) -> float:
    """The largest channel of any color, checked."""
    _require(0.0 <= brightest <= MOST_COLOR, f"its colors are brighter than {BRIGHTEST:g}, where white is 1")
    return float(brightest)


def check_layout(header: dict, facts: dict) -> dict:
    """Check that the tables have the types that kernels take, and that all chunks have entries for all
    scanlines and voxels; raises one of DAMAGE.

    Parameters
    ----------
    facts : dict
        See ``check_header``.

    Returns
    -------
    dict
        Name of a table -> dtype and words of an entry, see ``members.words_of_entry``.
    """
    (nx, ny, nz), record, chunks = facts["shape_xyz"], facts["record"], header["slabs"]
    classification = header["classification"]
    ends = [planes for planes, _ in chunks]
    in_order = all(_is_count(end, 1) for end in ends) and ends == sorted(set(ends))
    _require(in_order and ends[-1] == nz, "its chunks do not fill the volume")
    allowed = {
        COUNTS: {("u4", 2, 0)}, RUNS: {(np.dtype(run_type((nx, ny, 1))).str[1:], 0, 0)},
        "records": {(np.dtype(TYPES[record]).str[1:], math.prod(WORDS[record]), 0)},
        "scalars": {(kind, 0, 0) for kind in ("u1", "i1", "u2", "i2", "f4")},
        SURFACE: {("i2", 3, 0)},
    }  # fmt: skip
    found = {name: tuple(entry) for name, entry in header["dtypes"].items()}
    for order in {ORDER_OF[axis] for axis in facts["axes"]}:
        of_voxels = [name for name in OF_VOXELS[classification] if f"{order}.{name}" in found]
        _require(set(NEEDED[classification]) <= set(of_voxels), f"it lacks tables of {order}")
        first, visible = 0, 0
        for end, sizes in chunks:
            entries = {
                name: _entries(sizes, f"{order}.{name}", found, allowed[name]) for name in (COUNTS, RUNS, *of_voxels)
            }
            scanlines, voxels = (ny if order == ROWS else nx) * (end - first), {entries[name] for name in of_voxels}
            _require(entries[COUNTS] == scanlines, f"{order}.{COUNTS} does not have an entry for each scanline")
            _require(len(voxels) == 1, f"a table of {order} does not have an entry for each voxel")
            first, visible = end, visible + voxels.pop()
        _require(visible == header["visible"], "its number of visible voxels is another one")
    return found


def _entries(sizes: dict, table: str, found: dict, allowed: set) -> int:
    """Entries of a chunk in a table; ``sizes``: name -> bytes and checksum."""
    _require(found[table] in allowed, f"{table} has a type that cannot be rendered")
    kind, words, _ = found[table]
    count, size = sizes[table][0], np.dtype(kind).itemsize * max(words, 1)
    _require(_is_count(count) and count % size == 0, f"{table} is cut within an entry")
    return count // size


def check_values(header: dict, dtypes: dict) -> Values:
    """What the header of post-classified tables says of the volume's values, checked; raises one of DAMAGE."""
    kind, light, ends = header["stored_type"], header["light"], header["ends"]
    _require(kind in STORED_TYPES, "there is no such type of voxels")
    scalar = {np.dtype(entry[0]) for name, entry in dtypes.items() if name.endswith(".scalars")}
    _require(scalar == {np.dtype(kind if kind in OWN_TYPES else np.float32)}, "its scalars have another type")
    slope, intercept, center = (header[name] for name in ("slope", "intercept", "center"))
    _require(all(_is_number(one) for one in (slope, intercept, center, *ends)) and slope, "its values are not numbers")
    _require(len(ends) == 2 and ends[0] <= ends[1], "its values are not in order")
    has_codes = any(name.endswith(f".{SURFACE}") for name in dtypes)
    _require(has_codes == (light is not None), "its light is not described")
    _require(light is None or light["model"] == LIGHT_MODEL, "its light is of a model that is unknown")
    return Values(
        np.dtype(kind), float(slope), float(intercept), tuple(map(float, ends)), float(center),
        None if light is None else as_matrix(light["index_to_world"], "the matrix of its light"),
    )  # fmt: skip


def _table_error(axis, what: str) -> RleSplatError:
    """The error for a damaged table."""
    return RleSplatError(
        f"The run-length tables of principal axis {AXIS_NAMES[axis]} are damaged: {what}; encode the volume again."
    )


def check_runs(axis, counts, runs, width: int) -> None:
    """Check the runs of scanlines; RleSplatError if they are not as RunLengthVolume describes them.

    Parameters
    ----------
    axis : int
        Principal axis, for messages.
    counts : (n_slices, n_scanlines, 2) ndarray of uint32
        Runs and voxels of each scanline, in the order of the runs.
    runs : (n_runs,) ndarray
        As in RunLengthVolume.
    width : int
        Voxels of a scanline.
    """
    of_runs, of_voxels = counts.reshape(-1, 2).astype(np.int64).T
    filled = of_runs > 0
    lengths, visible = of_runs[filled], np.zeros(len(of_runs), np.int64)
    if lengths.sum() != len(runs) or (lengths < 2).any():
        raise _table_error(axis, "the counts of runs do not fit the runs")
    if len(runs):
        starts = np.cumsum(lengths) - lengths
        in_line = np.arange(len(runs)) - np.repeat(starts, lengths)
        if (runs[in_line > 0] == 0).any():
            raise _table_error(axis, "a run other than the first of a scanline has length zero")
        if (np.add.reduceat(runs, starts, dtype=np.int64) != width).any():
            raise _table_error(axis, f"the runs of a scanline do not sum to its {width} voxels")
        visible[filled] = np.add.reduceat(np.where(in_line % 2 == 1, runs, 0), starts, dtype=np.int64)
    if not np.array_equal(visible, of_voxels):
        raise _table_error(axis, "the counts of voxels do not fit the runs")


def check_records(axis, voxel_data, decoding) -> None:
    """Check that the voxel data have scales if they are codes, and are finite and not negative."""
    is_coded = record_bytes(voxel_data) != 16
    if is_coded != (decoding is not None) or (is_coded and (decoding.dtype, decoding.shape) != (np.float32, (SCALES,))):
        raise _table_error(axis, "the scales of the voxel data do not fit its records")
    numbers = decoding if is_coded else voxel_data
    # One pass each and no copy: NaN fails both comparisons. Codes are valid whatever their bits.
    if numbers.size and not (numbers.min() >= 0.0 and numbers.max() <= MOST):
        raise _table_error(axis, "the voxel data hold a value that is negative, not finite or too large")


def check_scalars(axis, scalars) -> None:
    """Check that the scalars of post-classified voxels are finite."""
    if scalars.dtype.kind == "f" and not np.isfinite(scalars).all():
        raise _table_error(axis, "the scalars hold a value that is not finite")
