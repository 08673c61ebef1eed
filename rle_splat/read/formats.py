"""The table of volume formats, used by the command line, the import dialog and the docs.

To add a format, add a module and a row. The content of a file decides its format; the suffix decides where the
content does not tell.
"""

from collections.abc import Generator, Iterable
from dataclasses import replace
from itertools import count, islice
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from ..runtime.steps import Progress, drain
from ..runtime.whole_files import whole_file
from ..scene import RleSplatError
from ..scene.checks import check_first
from ..volume.hounsfield import looks_like_hounsfield
from ..volume.placement import place_volume
from ..volume.reduced import sample_steps
from ..volume.volume import Volume
from .dicom.discovery import find_pictures
from .dicom.reader import groups_in, read_dicom_steps, reads_dicom_folder, recognizes_dicom
from .dicom.refusals import no_images
from .dicom.titles import SeriesInfo, series_info
from .format import LEVEL, MEANING_OPTIONS, PLACE_OPTIONS, Format, head_of, refuse_pipe
from .header import CT_ASSUMED
from .kernel_type import narrow_steps
from .layout import check_scale, unreadable
from .masks import read_masks_steps, reads_mask_folder
from .metaimage import read_metaimage_steps, recognizes_metaimage
from .mgh import read_mgh_steps, recognizes_mgh
from .nifti import lost_in_nifti, read_nifti_steps, recognizes_nifti, write_nifti_steps
from .nrrd import lost_in_nrrd, read_nrrd_steps, recognizes_nrrd, write_nrrd_steps
from .ome_zarr import SUFFIXES as ZARR_SUFFIXES
from .ome_zarr import read_ome_zarr_steps, reads_ome_zarr_folder, recognizes_ome_zarr
from .raw import LAYOUT_OPTIONS, lost_in_raw, read_raw_steps, write_raw_steps
from .sequence import Sequence, sequence_of
from .tiff import SUFFIXES as TIFF_SUFFIXES
from .tiff import read_tiff_steps, reads_tiff_folder, recognizes_tiff
from .vdb import lost_in_vdb, read_vdb_steps, recognizes_vdb, write_vdb_steps

FORMATS = (
    Format(
        "raw", (".raw", ".raw.gz", ".bin", ".bin.gz", ".dat", ".dat.gz"),
        "bare voxels, x fastest, any number type and byte order, gzip if the name ends in .gz",
        (*LAYOUT_OPTIONS, "spacing", "unit"), read_raw_steps, write_steps=write_raw_steps, lost=lost_in_raw,
    ),
    Format(
        "OME-Zarr", ZARR_SUFFIXES, "OME-Zarr 0.4 and 0.5: one level of the pyramid of a folder; needs the package zarr",
        ("level", "frame", "scratch", "quick"), read_ome_zarr_steps, recognizes_ome_zarr, reads_ome_zarr_folder,
        is_dropped=False,
    ),
    Format(
        "DICOM", (".dcm", ".ima"), "a folder, any file of a series, a DICOMDIR or a multi-frame file",
        ("series", "series_key", "frame", "spacing"), read_dicom_steps, recognizes_dicom, reads_dicom_folder,
        names_volume=True,
    ),
    Format(
        "OpenVDB", (".vdb",), "one grid of numbers of an OpenVDB file, with its transform and background",
        ("grid",), read_vdb_steps, recognizes_vdb, write_steps=write_vdb_steps, lost=lost_in_vdb,
    ),
    Format(
        "NIfTI", (".nii", ".nii.gz"), "NIfTI-1 and -2, one file, with its place in the patient and its label table",
        ("frame",), read_nifti_steps, recognizes_nifti, write_steps=write_nifti_steps, lost=lost_in_nifti,
    ),
    Format(
        "Analyze", (".hdr", ".img", ".hdr.gz", ".img.gz"), "Analyze 7.5 and NIfTI in two files", ("frame",),
        read_nifti_steps, is_dropped=False,
    ),
    Format(
        "MGH", (".mgh", ".mgz"), "volumes of FreeSurfer, with their place in the patient",
        ("frame",), read_mgh_steps, recognizes_mgh,
    ),
    Format(
        "NRRD", (".nrrd", ".seg.nrrd", ".nhdr"),
        "NRRD in one file or several, with its place in the patient; Slicer's segmentations with their names",
        ("frame",), read_nrrd_steps, recognizes_nrrd, write_steps=write_nrrd_steps, lost=lost_in_nrrd,
    ),
    Format(
        "MetaImage", (".mha", ".mhd"), "MetaImage of ITK, in one file or several, with its place in the patient",
        ("frame",), read_metaimage_steps, recognizes_metaimage,
    ),
    Format(
        "masks", (), "a folder of NIfTI masks (TotalSegmentator), or of label maps that name their labels",
        (), read_masks_steps, reads_folder=reads_mask_folder,
    ),
    Format(
        "TIFF", TIFF_SUFFIXES, "stacks of pages or of numbered files, OME-TIFF, ImageJ; gray values alone",
        ("spacing", "frame", "unit"), read_tiff_steps, recognizes_tiff, reads_tiff_folder, is_dropped=False,
    ),
)  # fmt: skip
RAW = FORMATS[0]
ENCODED = ".rle"  # suffix of encoded voxels, a file or a folder, which are no volume to read
FILES_COUNTED = 20_000  # of a folder without images
OPTIONS = tuple(dict.fromkeys(name for entry in FORMATS for name in entry.all_options))


def suffixes(writable: bool = False) -> tuple:
    """All suffixes that can be read (or written, with ``writable``), in the table's order."""
    return tuple(dict.fromkeys(s for entry in FORMATS if entry.write_steps or not writable for s in entry.suffixes))


def format_named(path) -> Format | None:
    """The row with the longest suffix that ends the file's name; None if there is none."""
    name = Path(path).name.lower()
    fits = [(len(s), entry) for entry in FORMATS for s in entry.suffixes if name.endswith(s)]
    return max(fits, key=lambda pair: pair[0])[1] if fits else None


def format_of(path) -> Format | None:
    """The format of a file or folder: by its content if that tells, else by its suffix; None if neither tells."""
    path = Path(path)
    refuse_pipe(path)
    if path.is_dir():
        try:
            return next((entry for entry in FORMATS if entry.reads_folder and entry.reads_folder(path)), None)
        except OSError as problem:
            raise unreadable(path, problem) from None
    head = head_of(path)
    found = next((entry for entry in FORMATS if entry.recognizes and entry.recognizes(head)), None)
    return found or format_named(path)


def _choose(path: Path, given: dict) -> Format:
    """The format to read a path with, whose options apply; RleSplatError if there is none."""
    for name in given:
        if name not in OPTIONS:
            raise RleSplatError(f"There is no volume option {name!r}; use one of {', '.join(OPTIONS)}.")
    if not path.exists():
        raise RleSplatError(f"There is no file {path}; check the path.")
    chosen = format_of(path)
    if chosen is None and path.suffix.lower() == ENCODED and "shape" not in given:
        raise RleSplatError(
            f"{path.name} holds voxels that are classified already, and no values; give the volume that it was encoded "
            "from."
        )
    if chosen is None and path.is_dir():
        raise no_images(path, sum(1 for file in islice(path.rglob("*"), FILES_COUNTED) if file.is_file()))
    if "shape" in given and path.is_file() and format_named(path) in (None, RAW):
        chosen = RAW
    if chosen is None:
        raise RleSplatError(
            f"{path.name} has no suffix of a known format ({', '.join(suffixes())}); "
            "to read it as raw voxels, give its shape and dtype."
        )
    for name in given:
        if name not in chosen.all_options and name != "frame":  # of numbered files, see ``_number``
            raise RleSplatError(f"The option {name} does not apply to {chosen.name} files; leave it out.")
    return chosen


def read_steps(path: str | PathLike, **options: Any) -> Generator[Progress, None, Volume]:
    """Generator of Progress: read a volume as ``read_volume`` does, with the same options; return the Volume.

    The first step says how much memory the voxels take, before it is taken.
    """
    path = Path(path)
    given = {name: value for name, value in options.items() if value is not None}
    key = given.pop("series_key", None)  # of what was read before; another format has no use for it
    chosen = _choose(path, given)
    if key is not None and "series_key" in chosen.options:
        given["series_key"] = key
    numbered = None
    if "frame" in given and "frame" not in chosen.options:
        numbered = _number(path)
        path = numbered.file(given.pop("frame"))
    meaning = {name: given.pop(name) for name in MEANING_OPTIONS if name in given and name not in chosen.options}
    place = {name: given.pop(name) for name in PLACE_OPTIONS if name in given and name not in chosen.options}
    scale = {name: meaning.get(name, default) for name, default in (("slope", 1.0), ("intercept", 0.0))}
    checked = dict(zip(scale, check_scale(*scale.values())))
    level = 0 if LEVEL in chosen.options else int(given.pop(LEVEL, 0))
    volume = yield from chosen.read_steps(path, **given)
    changed = {name: checked.get(name, value) for name, value in meaning.items()}
    if numbered is not None:
        changed["frames"] = numbered.count
    if place:
        volume = place_volume(volume, **place)
    if level:
        volume = yield from sample_steps(volume, level)
    volume = yield from narrow_steps(volume)
    return guess_unit(replace(volume, **changed) if changed else volume)


def _number(path: Path) -> Sequence:
    """The numbered files that a file of one volume belongs to, for its frames; RleSplatError if it is alone."""
    found = sequence_of(path)
    if found is None:
        raise RleSplatError(
            f"{path.name} holds one volume, and no other file differs from it in a number alone, so there is no time "
            "point to choose."
        )
    return found


def guess_unit(volume: Volume) -> Volume:
    """The volume as CT in HU, with a remark, if its values look like it and nothing else is known of them."""
    if volume.value_unit is not None or volume.modality not in (None, "CT") or not looks_like_hounsfield(volume):
        return volume
    return replace(volume, value_unit="HU", modality="CT", remarks=(*volume.remarks, CT_ASSUMED))


def read_volume(
    path: str | PathLike,
    *,
    spacing: Iterable[float] | None = None,
    unit: str | None = None,
    orientation: str | None = None,
    flip: str | None = None,
    slope: float | None = None,
    intercept: float | None = None,
    value_unit: str | None = None,
    modality: str | None = None,
    frame: int | None = None,
    level: int | None = None,
    shape: Iterable[int] | None = None,
    dtype: str | None = None,
    byte_order: Literal["little", "big"] | None = None,
    header_bytes: int | None = None,
    grid: str | None = None,
    series: int | None = None,
    series_key: str | None = None,
    scratch: str | PathLike | None = None,
    quick: bool | None = None,
) -> Volume:
    """Read a volume.

    Parameters
    ----------
    path : str or Path
        A file or a folder. The format follows from the content, or else from the suffix. A file of an unknown format
        is read as raw voxels if ``shape`` is given.
    spacing : (3,) sequence of float, optional
        Distance between voxel centers along the voxel axes x, y, z, in the volume's unit. This and all further
        parameters that are left out or None have the value of the file.
    unit : str, optional
        Unit of lengths, such as "mm" or "um".
    orientation : str, optional
        The directions of a patient in which x, y and z grow, such as "LPS".
    flip : str, optional
        Voxel axes to mirror, such as "x" or "xz".
    slope, intercept : float, optional
        A value is slope * stored + intercept.
    value_unit : str, optional
        Unit of the values, such as "HU".
    modality : str, optional
        "CT", "MR", "PT", "RTDOSE", "XA" or "SMOKE".
    frame : int, optional
        Volume to read, starting at 1, of several in one file, the channels of a time point before the next time point,
        or in files such as smoke_0001.vdb.
    level : int, optional
        Of OME-Zarr the level of the pyramid, 0 for the finest, by default the finest that fits into memory. Of other
        formats every 2^level-th voxel along each axis is read, by default all.
    shape : (3,) sequence of int, optional
        Of raw voxels: numbers of voxels (nx, ny, nz).
    dtype : str, optional
        Of raw voxels: their type, such as "uint16".
    byte_order : {"little", "big"}, optional
        Of raw voxels, by default "little".
    header_bytes : int, optional
        Of raw voxels: bytes before the first voxel, by default 0.
    grid : str, optional
        Name of the grid to read from an OpenVDB file.
    series : int, optional
        Which series to read if a DICOM folder holds several, starting at 1; ``list_series`` lists them.
    series_key : str, optional
        The same by the ``Volume.series`` of one that was read before.
    scratch : str or Path, optional
        Of OME-Zarr: a file to which the voxels are written and from which they are mapped.
    quick : bool, optional
        Of OME-Zarr, without ``level``: whether to read the finest level of at most 2**24 voxels, in place of the
        finest one that fits in memory.

    Returns
    -------
    Volume
        Its voxels are uint8, int16, uint16 or float32 if one of these holds all stored values exactly, and the file is
        not mapped; else they have the file's type.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or an option does not apply to the format.
    """
    return drain(read_steps(**locals()))


def list_series(path: str | PathLike) -> tuple[SeriesInfo, ...]:
    """List the series of a DICOM study, to choose one of them for ``read_volume``. Only headers are read.

    Parameters
    ----------
    path : str or Path
        A file or a folder, as for ``read_volume``.

    Returns
    -------
    tuple of SeriesInfo
        Empty for other formats, and for DICOM files of segments.

    Raises
    ------
    RleSplatError
        If there is no such file or folder, or it holds no image.
    """
    path = Path(path)
    if _choose(path, {}).read_steps is not read_dicom_steps:
        return ()
    return tuple(map(series_info, groups_in(drain(find_pictures(path))), count(1)))


def write_steps(volume: Volume, path: str | PathLike) -> Generator[Progress, None, dict]:
    """Generator of Progress: write a volume as ``write_volume`` does; return the options to read it back."""
    path = Path(path)
    chosen = format_named(path)
    if chosen is None or chosen.write_steps is None:
        raise RleSplatError(
            f"{path.name} has no suffix of a writable format; end its name in {', '.join(suffixes(writable=True))}."
        )
    with whole_file(path) as unfinished:
        return (yield from chosen.write_steps(volume, unfinished))


def write_volume(volume: Volume, path: str | PathLike) -> dict:
    """Write a volume file.

    Parameters
    ----------
    volume : Volume
        What the file is to hold.
    path : str or Path
        The format follows from the suffix. The file appears under this name only when it is complete.

    Returns
    -------
    dict
        Options of ``read_volume`` that are needed to read the file back.

    Raises
    ------
    RleSplatError
        If the suffix is of no writable format or the file cannot be written.
    """
    check_first(volume, Volume, "write_volume(volume, path)")
    return drain(write_steps(volume, path))
