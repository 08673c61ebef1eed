"""Files of transfer functions: our JSON, presets of 3D Slicer, color maps of niivue and FSL.

The content tells them apart: XML begins with ``<``, JSON with ``{`` and has keys of its own, the rest is text.
"""

from dataclasses import replace
from os import PathLike
from pathlib import Path

from ..runtime.steps import drain
from ..scene import RleSplatError, read_json
from ..volume.volume import Volume
from .color_maps import read_niivue, read_rows
from .foreign import FileFunction
from .presets import MAXIMUM, RELATIVE, fit_steps
from .slicer_files import read_mrml, read_vp, read_vp_json
from .transfer_function import TransferFunction

WHAT = "the transfer function"
SUFFIXES = (".json", ".xml", ".mrml", ".vp", ".cmap")  # for choosing a file
MOST_BYTES = 1 << 26  # a scene of Slicer's may list many nodes; a scan chosen by mistake is larger


def read_transfer_functions(path: str | PathLike) -> tuple[FileFunction, ...]:
    """Read all transfer functions of a file.

    Parameters
    ----------
    path : str or Path
        A transfer function of RLE Splat, presets of 3D Slicer, or a color map of niivue or FSL.

    Returns
    -------
    tuple of FileFunction
        At least one, their names all different.  A function of the unit "relative" or "maximum" has to go
        through ``fit_function``.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or is no file of transfer functions.
    """
    path = Path(path)
    what, name = f"{WHAT[0].upper()}{WHAT[1:]} {path}", path.name.partition(".")[0]
    content = _content(path)
    if content.startswith(b"<"):
        return _name_apart(read_mrml(content, what))
    if content.startswith(b"{") or path.suffix.lower() == ".json":
        return _name_apart(_read_mapping(read_json(path, WHAT), name, what))
    try:
        lines = content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise RleSplatError(f"{what} is not text; choose a transfer function or a color map.") from None
    read = read_vp if path.suffix.lower() == ".vp" else read_rows
    return tuple(read(lines, name, what))


def _content(path: Path) -> bytes:
    """The bytes of a file, without a mark of the byte order or blanks before them."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RleSplatError(f"{path} is too large to be a transfer function; choose another file.")
        return path.read_bytes().removeprefix(b"\xef\xbb\xbf").lstrip()
    except OSError as problem:
        raise RleSplatError(f"Cannot read {WHAT} {path}: {problem.strerror or problem}; check the path.") from None


def _read_mapping(mapping, name: str, what: str) -> list[FileFunction]:
    if isinstance(mapping, dict) and "volumeProperties" in mapping:
        return read_vp_json(mapping, name, what)
    if isinstance(mapping, dict) and "R" in mapping:
        return read_niivue(mapping, name, what)
    return [FileFunction(TransferFunction.from_json(mapping))]


def _name_apart(found: list[FileFunction]) -> tuple[FileFunction, ...]:
    """The same, with numbers behind names that occur before or are empty; a single one keeps its own."""
    if len(found) == 1:
        return tuple(found)
    names: list[str] = []
    for i, one in enumerate(found, start=1):
        name = one.function.name or f"{i}"
        while name in names:
            name = f"{name} {i}"
        names.append(name)
    return tuple(replace(one, function=replace(one.function, name=name)) for one, name in zip(found, names))


def choose_function(found: tuple[FileFunction, ...], name: str | None, path, option: str) -> FileFunction:
    """One of the transfer functions of a file.

    Parameters
    ----------
    found : tuple of FileFunction
    name : str or None
        None takes the only one.
    path : str or Path
        Of the file, for messages.
    option : str
        How a user names one, for messages.

    Raises
    ------
    RleSplatError
        If there are several and none is named, or none has the name; the message lists them.
    """
    names = [one.function.name for one in found]
    if name is None:
        if len(found) == 1:
            return found[0]
        raise RleSplatError(
            f"{path} holds {len(found)} transfer functions; name one of them with {option}: {', '.join(names)}."
        )
    if name not in names:
        raise RleSplatError(f"{path} has no transfer function {name!r}; choose one of {', '.join(names)}.")
    return found[names.index(name)]


def fit_function(function: TransferFunction, volume: Volume) -> TransferFunction:
    """Move a transfer function to the values of a volume, if its points are relative.

    Parameters
    ----------
    function : TransferFunction
        Points of the unit "relative" are from 0 to 1, over the values of a volume; those of "maximum" are shares of the
        largest value.
    volume : Volume
        The scan that it is to show.

    Returns
    -------
    TransferFunction
        In the unit of the volume's values; any other function as it is.
    """
    return drain(fit_steps(function, volume))[0] if function.unit in (RELATIVE, MAXIMUM) else function
