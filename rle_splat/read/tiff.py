"""TIFF: stacks of pages, numbered files, OME-TIFF and ImageJ's stacks; pages by tifffile, LZW also by OpenImageIO."""

import logging
import math
import re
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.volume import Volume
from . import header
from .channel_colors import color_of, ome_colors
from .format import Head
from .layout import check_spacing
from .sequence import LISTED, join_numbers
from .streaming import EXPANSION, Part, allocate, grid_text, plain_name, storable_steps, voxel_steps

MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
SUFFIXES = (".tif", ".tiff")
DEPTH_AXES = "ZIQRHTC"  # the first of these that a series has is z; tifffile's letters
CHANNELS = "C"
COLORS = "S"  # samples of a pixel
TIME_AXES = ("T",)
MOST_FILES = 20_000
PHYSICAL = re.compile(r'\bPhysicalSize([XYZ])(Unit)?="([^"]*)"')
PIXELS = re.compile(r"<(?:\w+:)?Pixels\b[^>]*>")
IMAGE = re.compile(r"<(?:\w+:)?Image\b.*?</(?:\w+:)?Image>", re.DOTALL)


@dataclass(frozen=True)
class _TiffFacts:
    """What a file says beside its pages: spacing (x, y, z) or None, its unit, frames, remarks and a channel's color."""

    spacing: tuple | None = None
    unit: str | None = None
    frames: int = 1
    differ_in: str = "time"
    remarks: tuple = ()
    color: tuple | None = None


def recognizes_tiff(head: Head) -> bool:
    """Whether a file begins as a TIFF or BigTIFF file."""
    return head.stored.startswith(MAGICS)


def reads_tiff_folder(path: Path) -> bool:
    """Whether most files of a folder are TIFF files, by their names, and there are at least two."""
    files = [file for file in Path(path).iterdir() if file.is_file() and not file.name.startswith(".")]
    pages = [file for file in files if file.suffix.lower() in SUFFIXES]
    return len(pages) >= 2 and 2 * len(pages) > len(files)


def is_page(path) -> bool:
    """Whether a file is a TIFF file with one page of gray values, which is a slice of a stack and no volume.

    False for what ``read_tiff_steps`` refuses.
    """
    try:
        tifffile = header.library("tifffile", "tifffile", "TIFF")
        with _library(path), tifffile.TiffFile(path) as file:
            return _has_one_page(file)
    except RleSplatError:
        return False


def _has_one_page(file) -> bool:
    """Whether an open file holds one picture of gray values."""
    return len(file.pages) == 1 and len(file.series[0].shape) == 2


def _by_number(path: Path) -> list:
    """Sorting key by which a2 stands before a10."""
    return [int(word) if word.isdigit() else word for word in re.split(r"(\d+)", path.name.lower())]


def _number(path: Path) -> list[Path]:
    """The files of the stack that a file belongs to: those that differ from it in the last number of the name alone."""
    numbers = list(re.finditer(r"\d+", path.stem))
    if not numbers:
        return [path]
    begin, end = numbers[-1].span()
    alike = re.compile(re.escape(path.stem[:begin]) + r"\d+" + re.escape(path.stem[end:] + path.suffix), re.IGNORECASE)
    files = (file for file in path.parent.iterdir() if alike.fullmatch(file.name) and file.is_file())
    return sorted(files, key=_by_number)


@contextmanager
def _library(path):
    """Context manager around tifffile: any failure on damaged data becomes a sentence, and nothing is logged."""
    logger = logging.getLogger("tifffile")
    was, logger.disabled = logger.disabled, True
    try:
        yield
    except (RleSplatError, MemoryError):
        raise
    except Exception as problem:  # on damaged data the library fails with exceptions of every kind
        if isinstance(problem, OSError) and problem.errno is not None:
            raise RleSplatError(f"Cannot read {path}: {problem.strerror}; check the path.") from None
        raise header.damage_error(path, "it cannot be read as TIFF") from None
    finally:
        logger.disabled = was


def _decode(path, page, number: int) -> np.ndarray:
    """(ny, nx): the values of a page, the ``number``-th of its file."""
    size = page.parent.filehandle.size
    if sum(page.databytecounts) > size or page.nbytes > EXPANSION["zlib"] * size:
        raise header.damage_error(path, f"its page {number + 1} is larger than the file")
    try:
        return page.asarray()
    except ValueError as problem:
        if "imagecodecs" not in str(problem):
            raise
    return _by_openimageio(path, page, number)


def _by_openimageio(path, page, number: int) -> np.ndarray:
    """As ``_decode``, by the module that Blender includes; for compressions that need a package of their own."""
    try:
        import OpenImageIO
    except ImportError:
        raise RleSplatError(
            f"{Path(path).name} is compressed with {page.compression.name}, for which this Python has no decoder; save "
            "it without compression or with Deflate, read it in Blender, or install the package imagecodecs."
        ) from None
    source = OpenImageIO.ImageInput.open(str(path))
    values = None if source is None else source.read_image(number, 0, 0, 1, page.dtype.name)
    if values is None:
        raise header.damage_error(path, f"its page {number + 1} cannot be decoded")
    return np.asarray(values).reshape(page.shape)


def _one_file_steps(path: Path, file, frame: int | None):
    """Generator of Progress: the largest series of an open file; return (voxels, _TiffFacts)."""
    with _library(path):
        several = len(file.series)
        index, series = max(enumerate(file.series), key=lambda pair: math.prod(pair[1].shape))
        pages, axes = list(series.pages), series.axes
        spacing, unit = _spacing(file, index)
        stated = _colors(file, index)
    if not axes.endswith("YX") or COLORS in axes:
        raise RleSplatError(f"The pages of {path.name} are colors; export one number for each pixel.")
    lengths = dict(zip(axes[:-2], series.shape))
    longer = {axis: n for axis, n in lengths.items() if n > 1}
    depth = next((axis for axis in DEPTH_AXES if axis in longer), "")
    others = header.put_time_first(axis for axis in longer if axis != depth)
    frames = math.prod(longer[axis] for axis in others)
    shape = header.check_grid(path, (*series.shape[:-3:-1], longer.get(depth, 1)))
    dtype = header.check_kind(path, np.dtype(series.dtype))
    fixed = header.place_of_frame(header.check_frame(path, frame, frames), {axis: longer[axis] for axis in others})
    places = [[z if axis == depth else fixed.get(axis, 0) for axis in lengths] for z in range(shape[2])]
    numbers = [int(np.ravel_multi_index(place, list(lengths.values()))) for place in places]
    if series.dataoffset is not None and numbers[-1] - numbers[0] == shape[2] - 1:
        offset = series.dataoffset + numbers[0] * shape[0] * shape[1] * dtype.itemsize
        kind = dtype.newbyteorder(file.byteorder)
        voxels = yield from voxel_steps(path, shape, kind, [Part(path, offset)])
    elif len(pages) <= numbers[-1] or any(pages[number] is None for number in numbers):
        raise header.damage_error(path, f"it announces {math.prod(lengths.values())} pages, and some are missing")
    else:
        chosen = [(path, pages[number], number) for number in numbers]
        voxels = yield from _pages_steps(path, shape, dtype, chosen)
    remarks = () if several == 1 else (f"The file holds {several} stacks; the largest was read.",)
    if depth in TIME_AXES:
        remarks += ("The file says that its pages follow one another in time; they were taken as slices.",)
    kinds = ["time" if axis in TIME_AXES else "channel" for axis in others] or ["time"]
    differ_in = " and ".join(dict.fromkeys(kinds))
    color = color_of(fixed.get(CHANNELS, 0), longer.get(CHANNELS, 1) if CHANNELS in others else 1, stated)
    return voxels, _TiffFacts(spacing, unit, frames, differ_in, remarks, color)


def _pages_steps(path: Path, shape, dtype: np.dtype, pages):
    """Generator of Progress: decode (path, page, number) one after the other into voxels (nz, ny, nx)."""
    doing = f"reading {path.name} ({grid_text(shape, dtype)})"
    voxels = allocate(path, shape, dtype.newbyteorder("="))
    for z, (file, page, number) in enumerate(pages):
        yield Progress(z / shape[2], doing)
        with _library(file):
            voxels[z] = _decode(file, page, number)
    return (yield from storable_steps(voxels, doing))


def _files_steps(path: Path, files: list[Path], frame: int | None):
    """Generator of Progress: a stack of files with one page each; return (voxels, _TiffFacts)."""
    header.check_frame(path, frame, 1)
    tifffile = header.library("tifffile", "tifffile", "TIFF")
    if len(files) > MOST_FILES:
        raise RleSplatError(f"{path.name} holds {len(files)} files; a stack has at most {MOST_FILES}.")

    def pages():
        for file in files:
            with _library(file), tifffile.TiffFile(file) as opened_file:
                page = opened_file.pages[0]
                if (page.shape, page.dtype) != (first.shape, first.dtype):
                    raise RleSplatError(
                        f"The pages differ: {files[0].name} is {_page_text(first)}, and {file.name} is "
                        f"{_page_text(page)}; keep the files of one stack in the folder."
                    )
                yield file, page, 0

    with _library(files[0]), tifffile.TiffFile(files[0]) as opened_file:
        first = opened_file.pages[0]
        if len(first.shape) != 2:
            raise RleSplatError(f"The pages of {files[0].name} are colors; export one number for each pixel.")
    shape = header.check_grid(path, (*first.shape[::-1], len(files)))
    voxels = yield from _pages_steps(path, shape, header.check_kind(path, np.dtype(first.dtype)), pages())
    return voxels, _TiffFacts(remarks=_missing_remark(files))


def _missing_remark(files: list[Path]) -> tuple:
    """The remark on numbers that are missing among the files of a stack."""
    names = [_by_number(file) for file in files]
    columns = [column for column in zip(*names) if len(set(column)) > 1]
    if len(set(map(len, names))) > 1 or len(columns) != 1 or not all(isinstance(number, int) for number in columns[0]):
        return ()
    pairs = list(pairwise(sorted(columns[0])))
    step = math.gcd(*(b - a for a, b in pairs))
    gaps = list(islice((number for a, b in pairs for number in range(a + step, b, step)), LISTED + 1))
    if not gaps:
        return ()
    are = "number {} is" if len(gaps) == 1 else "numbers {} are"
    return (
        f"Between {files[0].name} and {files[-1].name} the {are.format(join_numbers(gaps))} missing, and the slices "
        "beside a gap were taken as neighbors; copy the missing files, or renumber the files if none is missing.",
    )


def _page_text(page) -> str:
    """Size and type of a page for a message."""
    return f"{' x '.join(map(str, page.shape[::-1]))} pixels of {page.dtype}"


def _spacing(file, index: int) -> tuple[tuple | None, str | None]:
    """Spacing (x, y, z) and unit of the ``index``-th series as OME or ImageJ state them; (None, None) without."""
    if file.is_ome and file.ome_metadata:
        images = PIXELS.findall(file.ome_metadata)
        found = PHYSICAL.findall(images[min(index, len(images) - 1)] if images else "")
        sizes = {axis: text for axis, is_unit, text in found if not is_unit}
        units = {axis: text for axis, is_unit, text in found if is_unit}
        if not sizes:
            return None, None
        lengths = []
        for axis in "XYZ":
            factor = header.MILLIMETERS.get(units.get(axis, "um"))
            lengths.append(1e3 * factor * float(sizes[axis]) if axis in sizes and factor else math.nan)
        return tuple(lengths), "um"
    facts = file.imagej_metadata or {}
    unit = str(facts.get("unit", "")).replace("\\u00B5", "u").lower()
    if unit not in header.MILLIMETERS:
        return None, None
    tags = file.pages[0].tags
    lengths = [facts.get("spacing", math.nan)]
    for name in ("YResolution", "XResolution"):
        over, under = tags[name].value if name in tags else (0, 1)
        lengths.append(under / over if over else math.nan)
    factor = 1e3 * header.MILLIMETERS[unit]
    return tuple(factor * float(length) for length in lengths[::-1]), "um"


def _colors(file, index: int) -> tuple:
    """sRGB colors of the channels of the ``index``-th series, as OME or ImageJ state them; () without."""
    if file.is_ome and file.ome_metadata:
        images = IMAGE.findall(file.ome_metadata)
        return ome_colors(images[min(index, len(images) - 1)]) if images else ()
    tables = (file.imagej_metadata or {}).get("LUTs") or ()
    return tuple(tuple((np.asarray(table).reshape(3, -1)[:, -1] / 255.0).tolist()) for table in tables)


def read_tiff_steps(path, frame=None, spacing=None, unit=None):
    """Generator of Progress: read a stack of TIFF pages; return the Volume.

    Parameters
    ----------
    path : str or Path
        A file with several pages; a folder of files with one page each, or any one of them, which are sorted by the
        numbers in their names.
    frame : int or None
        Of a file with several stacks (time points, channels), the number of one, from 1.
    spacing : (sx, sy, sz) or None
        Distance between voxel centers in ``unit``; None for what OME or ImageJ state, or 1 x 1 x 1 with a remark.
    unit : str or None
        None for micrometers if the file states lengths, else mm.

    Returns
    -------
    Volume
        Without patient space. The first row of a page has y = 0.

    Raises
    ------
    RleSplatError
        If the file is damaged, its pages differ, or they are colors.
    """
    tifffile = header.library("tifffile", "tifffile", "TIFF")
    path = Path(path)
    yield Progress(0.0, f"reading {path.name}")
    if path.is_dir():
        pages = (file for file in path.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file())
        files = sorted(pages, key=_by_number)
        voxels, facts = yield from _files_steps(path, files, frame)
    else:
        with ExitStack() as held:
            with _library(path):
                file = held.enter_context(tifffile.TiffFile(path))
                is_single = _has_one_page(file)
            files = _number(path) if is_single else []
            if len(files) > 1:
                voxels, facts = yield from _files_steps(path, files, frame)
            else:
                voxels, facts = yield from _one_file_steps(path, file, frame)
    remarks = facts.remarks
    if spacing is None and facts.spacing is not None:
        spacing, more = header.sensible_spacing(facts.spacing)
        unit, remarks = unit or facts.unit, remarks + more
    elif spacing is None:
        spacing = (1.0, 1.0, 1.0)
        remarks += (f"The file states no spacing; 1 × 1 × 1 {unit or 'mm'} is assumed.",)
    return Volume(
        voxels=voxels, affine=np.diag((*check_spacing(spacing), 1.0)), unit=unit or "mm", name=plain_name(path),
        frames=facts.frames, frame_axis=facts.differ_in, color=facts.color,
        remarks=remarks + header.frame_remark(frame or 1, facts.frames, facts.differ_in),
    )  # fmt: skip
