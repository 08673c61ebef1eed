"""OME-Zarr 0.4 and 0.5: a folder of chunks with a pyramid of levels; chunks by zarr, metadata read here.

The package zarr and its codecs are optional: they are not in the extension.
"""

import json
import math
import os
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from ..runtime.memory import available_bytes, bytes_text
from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.volume import Volume
from . import header
from .channel_colors import color_of, hex_colors
from .format import Head
from .streaming import allocate, grid_text, plain_name, storable_steps

SUFFIXES = (".zarr", "zarr.json", ".zattrs")  # of a folder, and of the files in it that may be chosen instead
METADATA = {"zarr.json": "0.5", ".zattrs": "0.4"}  # the file that describes an image -> version of OME-Zarr
MOST_METADATA = 1 << 24  # bytes of such a file
SPACE = ("z", "y", "x")
PLURALS = {"micrometer": "um", "millimeter": "mm", "nanometer": "nm", "meter": "m", "centimeter": "cm"}
ANGSTROM = 1e-7  # millimeters
SHARE = 0.25  # of the free memory that the voxels of a level may take: its tables want as much again, and more
QUICK_VOXELS = 1 << 24  # of the finest level that ``info`` reads


@dataclass(frozen=True)
class Pyramid:
    """What the metadata of an image say.

    Attributes
    ----------
    path : Path
        Its folder.
    axes : tuple of str
        Names of the axes of every level, such as ("t", "c", "z", "y", "x").
    units : tuple of str or None
        Unit of each axis.
    levels : tuple of str
        Path of each level inside the folder, the finest first.
    scales, offsets : tuple of (axes,) tuple of float
        Of each level: length of a voxel and place of the first one's center along each axis, in its unit.
    colors : tuple of (3,) tuple or None
        sRGB color of each channel, as far as it is stated.
    """

    path: Path
    axes: tuple
    units: tuple
    levels: tuple
    scales: tuple
    offsets: tuple
    colors: tuple = ()


def recognizes_ome_zarr(head: Head) -> bool:
    """Whether a file is the one that describes an OME-Zarr image."""
    return head.path.name in METADATA and b'"multiscales"' in head.content


def reads_ome_zarr_folder(path: Path) -> bool:
    """Whether a folder is a Zarr group."""
    return any((Path(path) / name).is_file() for name in (*METADATA, ".zgroup"))


def read_ome_zarr_steps(path, level=None, frame=None, scratch=None, quick=False):
    """Generator of Progress: read one level of an OME-Zarr image; return the Volume.

    Parameters
    ----------
    path : str or Path
        The folder of the image, or the file in it that describes it.
    level : int or None
        Of the pyramid, 0 for the finest; None for the finest one whose voxels take at most SHARE of the free memory.
    frame : int or None
        From 1, where there are several times or channels; channels are counted first.
    scratch : str or Path or None
        A file to be made for the voxels, which are then mapped; None for memory.
    quick : bool
        Without ``level``, choose the finest level of at most QUICK_VOXELS voxels instead.

    Returns
    -------
    Volume
        Its ``levels`` name the shapes of all levels.

    Raises
    ------
    RleSplatError
        If zarr is not installed, or the image is damaged, of another kind, or a chunk cannot be read.
    """
    path = Path(path)
    path = path.parent if path.name in METADATA else path
    yield Progress(0.0, f"reading {path.name}")
    pyramid = read_pyramid(path)
    arrays = _open(pyramid)
    shapes = [_shape_of(path, pyramid, array) for array in arrays]
    header.check_grid(path, shapes[0])
    dtype = header.check_kind(path, np.dtype(arrays[0].dtype)).newbyteorder("=")
    sizes = [math.prod(shape) * dtype.itemsize for shape in shapes]
    if level is not None and not 0 <= level < len(arrays):
        raise RleSplatError(f"There is no level {level}: {path.name} has {len(arrays)}; give one from 0.")
    chosen = _choose(shapes, sizes, quick) if level is None else int(level)
    array, shape = arrays[chosen], shapes[chosen]
    lengths = dict(zip(pyramid.axes, array.shape))
    others = {name: lengths[name] for name in header.put_time_first(name for name in pyramid.axes if name not in SPACE)}
    frames = math.prod(others.values())
    number = header.check_frame(path, frame, frames)
    several = [{"t": "time", "c": "channel"}.get(name, name) for name, n in others.items() if n > 1]
    differ_in = " and ".join(several) or "time"
    affine, unit, remarks = _geometry(pyramid, chosen)
    remarks += _level_remarks(shapes, sizes, chosen, level, quick)
    place = header.place_of_frame(number, others)
    voxels = yield from _voxel_steps(path, pyramid, array, shape, dtype, place, scratch)
    return Volume(
        voxels=voxels, affine=affine, unit=unit, name=plain_name(path), frames=frames, frame_axis=differ_in,
        remarks=(*remarks, *header.frame_remark(number, frames, differ_in)), levels=tuple(shapes),
        color=color_of(place.get("c", 0), others.get("c", 1), pyramid.colors),
    )  # fmt: skip


# --- metadata -------------------------------------------------------------------------------------------------------


def read_pyramid(path: Path) -> Pyramid:
    """Read and check the metadata of an image; RleSplatError if they are of another kind, or damaged."""
    facts = _metadata(path)
    images = facts.get("multiscales")
    if "plate" in facts or "well" in facts or (not images and "bioformats2raw.layout" in facts):
        raise RleSplatError(f"{path.name} holds several images; give the folder of one of them, such as {path.name}/0.")
    try:
        image = images[0]
        axes = [axis if isinstance(axis, dict) else {"name": axis} for axis in image["axes"]]
        names = tuple(str(axis["name"]).lower() for axis in axes)
        units = tuple(axis.get("unit") for axis in axes)
        levels = tuple(str(one["path"]) for one in image["datasets"])
        shared = image.get("coordinateTransformations", ())
        placed = [_place(len(names), one.get("coordinateTransformations", ()), shared) for one in image["datasets"]]
    except (TypeError, KeyError, IndexError, ValueError, AttributeError):
        raise _not_an_image(path) from None
    if not levels or names[-3:] != SPACE or len(set(names)) != len(names):
        raise RleSplatError(
            f"The axes of {path.name} are {', '.join(names) or 'not named'}; an OME-Zarr volume has z, y and x as its "
            "last ones."
        )
    for name in levels:
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise header.damage_error(path, f"the level {name!r} lies outside of it")
    channels = facts.get("omero", {}).get("channels", ()) if isinstance(facts.get("omero"), dict) else ()
    colors = hex_colors(one.get("color") for one in channels if isinstance(one, dict))
    return Pyramid(path, names, units, levels, *zip(*placed), colors)


def _metadata(path: Path) -> dict:
    """The attributes of a group that describe an image."""
    for name in METADATA:
        file = path / name
        if not file.is_file():
            continue
        try:
            with open(file, "rb") as stream:
                facts = json.loads(stream.read(MOST_METADATA))
        except OSError as problem:
            raise RleSplatError(f"Cannot read {file}: {problem.strerror}; check its permissions.") from None
        except ValueError:
            raise header.damage_error(file, "it is not JSON") from None
        try:
            return dict(facts.get("attributes", {}).get("ome", {}) if name == "zarr.json" else facts)
        except (AttributeError, TypeError, ValueError):
            break
    raise _not_an_image(path)


def _not_an_image(path: Path) -> RleSplatError:
    """The error for a Zarr folder without the metadata of an image."""
    return RleSplatError(
        f"{path.name} is a Zarr folder without the description of an OME-Zarr image (0.4 or 0.5); give the folder of "
        "the image itself."
    )


def _place(count: int, own, shared) -> tuple[tuple, tuple]:
    """Scale and offset of each axis, from the transformations of a level, and those of all levels after them."""
    scale, offset = np.ones(count), np.zeros(count)
    for step in (*own, *shared):
        kind = step["type"]
        if kind == "scale":
            factor = np.array(step["scale"], np.float64).reshape(count)
            scale, offset = factor * scale, factor * offset
        elif kind == "translation":
            offset = offset + np.array(step["translation"], np.float64).reshape(count)
        elif kind != "identity":
            raise ValueError(kind)
    return tuple(scale), tuple(offset)


def _geometry(pyramid: Pyramid, level: int):
    """The affine of a level: spacing and offset along x, y, z; returns (affine, unit, remarks)."""
    names = [_short(unit) for unit in pyramid.units[-3:]]
    millimeters = {**header.MILLIMETERS, "angstrom": ANGSTROM}  # in which axes of different units are all given
    known = [name for name in names if name in millimeters]
    remarks = () if len(known) == 3 else ("The file states no unit of length for some axes; mm is assumed.",)
    unit = "mm" if len(known) < 3 or len(set(known)) > 1 or known[0] == "angstrom" else known[0]
    factors = [1.0 if name == unit or name not in known else millimeters[name] for name in names]
    lengths = [scale * factor for scale, factor in zip(pyramid.scales[level][-3:], factors)]
    spacing, odd = header.sensible_spacing(lengths[::-1])
    affine = np.diag((*spacing, 1.0))
    offset = [place * factor for place, factor in zip(pyramid.offsets[level][-3:], factors)][::-1]
    affine[:3, 3] = np.where(np.isfinite(offset), offset, 0.0)
    return affine, unit, (*remarks, *odd, "The file does not say where the patient's left and right are.")


def _short(unit) -> str:
    """Unit of length as the readers name it."""
    return PLURALS.get(str(unit).lower(), str(unit).lower())


def _shape_of(path: Path, pyramid: Pyramid, array) -> tuple:
    """(nx, ny, nz) of a level."""
    shape = tuple(array.shape)
    if len(shape) != len(pyramid.axes) or not all(1 <= n for n in shape):
        raise header.damage_error(path, f"a level of {len(shape)} axes does not fit its {len(pyramid.axes)}")
    return shape[:-4:-1]


def _choose(shapes, sizes, quick: bool) -> int:
    """The finest level that fits; the coarsest where none does."""
    most = SHARE * available_bytes()
    for level, (shape, size) in enumerate(zip(shapes, sizes)):
        if size <= most and not (quick and math.prod(shape) > QUICK_VOXELS):
            return level
    return len(sizes) - 1


def _level_remarks(shapes, sizes, chosen: int, wanted: int | None, quick: bool) -> tuple:
    """The remark on a level that is not the finest."""
    if chosen == 0:
        return ()
    finest = f"{' x '.join(map(str, shapes[0]))} voxels, {bytes_text(sizes[0])}"
    if wanted is not None:
        return (f"Level {chosen} of the pyramid was read; the finest has {finest}.",)
    why = "to answer at once" if quick else "the finest that fits into memory"
    return (f"Level {chosen} of the pyramid was read, {why}; the finest has {finest}. The level can be given.",)


# --- chunks ---------------------------------------------------------------------------------------------------------


@contextmanager
def _library(path: Path, what: str):
    """Context manager around zarr, which fails on damaged data with exceptions of every kind."""
    try:
        yield
    except (RleSplatError, MemoryError):
        raise
    except PermissionError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem.strerror}; check its permissions.") from None
    except Exception as problem:
        raise RleSplatError(f"{what} of {path.name} is damaged or cut short; copy the folder again.") from problem


def _open(pyramid: Pyramid) -> list:
    """The arrays of all levels."""
    try:
        zarr = import_module("zarr")
    except ImportError:
        raise RleSplatError(
            f"{pyramid.path.name} is an OME-Zarr image, which needs the package zarr; install it into this Python "
            "(python -m pip install zarr), or write the volume as NRRD elsewhere with rle-splat convert."
        ) from None
    arrays = []
    for name in pyramid.levels:
        with _library(pyramid.path, f"Level {name!r}"):
            arrays.append(zarr.open_array(str(pyramid.path / name), mode="r"))
    return arrays


def _voxel_steps(path: Path, pyramid: Pyramid, array, shape, dtype, frame: dict, scratch):
    """Generator of Progress: the voxels of a frame, which has an index along each further axis, of a level."""
    doing = f"reading {path.name} ({grid_text(shape, dtype)})"
    voxels = allocate(path, shape, dtype) if scratch is None else _in_file(scratch, shape, dtype)
    index = tuple(frame[name] for name in pyramid.axes if name not in SPACE)
    planes, rows, _ = tuple(array.chunks)[-3:]
    _, ny, nz = shape
    for z in range(0, nz, planes):
        for y in range(0, ny, rows):  # a row of chunks at a time
            yield Progress((z + planes * y / ny) / (nz + planes), doing)
            place = slice(z, min(z + planes, nz)), slice(y, min(y + rows, ny))
            with _library(path, "A chunk"):
                voxels[place] = array[(*index, *place, slice(None))]
    if scratch is not None:
        voxels.flush()
        voxels = np.asarray(voxels)
    return (yield from storable_steps(voxels, doing))


def _in_file(scratch, shape, dtype) -> np.ndarray:
    """A mapped file of zeros for voxels."""
    try:
        with open(scratch, "wb") as file:
            size = math.prod(shape) * dtype.itemsize
            if hasattr(os, "posix_fallocate"):  # a mapped file with holes kills the process when the disk is full
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
        return np.memmap(scratch, dtype=dtype, mode="r+", shape=tuple(shape)[::-1])
    except OSError as problem:
        raise RleSplatError(f"Cannot write {scratch}: {problem.strerror}; choose another place.") from None
