"""Presets of the user: transfer function files in the folder of Blender's presets, which updates leave alone.

The names are known from the folder's listing, so that panels open no file.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ...rle_splat.classify.presets import fit_steps
from ...rle_splat.classify.transfer_function import TransferFunction
from ...rle_splat.runtime.steps import Progress, announce
from ...rle_splat.runtime.whole_files import whole_files
from ...rle_splat.scene import RleSplatError
from ..paths import is_reserved

PLACE = "presets/rle_splat"
SUFFIX = ".json"
REFUSED = '/\\:*?"<>|'  # in file names of one system or another
LONGEST = 80  # letters


@dataclass(frozen=True)
class OwnPreset:
    """A preset of the user.

    Attributes
    ----------
    name : str
        The file's name without suffix.
    stamp : tuple of int
        Size and time of the file, which change with its content.
    """

    name: str
    stamp: tuple[int, int]


_listed: dict[str, OwnPreset] = {}


def folder() -> Path:
    """The folder of the user's presets, which may not exist yet."""
    return Path(bpy.utils.user_resource("SCRIPTS", path=PLACE))


def listed() -> tuple[OwnPreset, ...]:
    """The presets by name, as ``look_again`` last found them."""
    return tuple(_listed[name] for name in sorted(_listed, key=str.casefold))


def look_again() -> None:
    """List the folder."""
    _listed.clear()
    try:
        with os.scandir(folder()) as entries:
            for entry in entries:
                stem, suffix = os.path.splitext(entry.name)
                if suffix.lower() == SUFFIX and entry.is_file():
                    state = entry.stat()
                    _listed[stem] = OwnPreset(stem, (state.st_size, state.st_mtime_ns))
    except OSError:
        return  # there is none yet, or it cannot be read


def register():
    look_again()


def unregister():
    _listed.clear()


def checked_name(name: str) -> str:
    """A name without blanks around it; RleSplatError if no file can have it."""
    name = name.strip()
    if not name:
        raise RleSplatError("A preset needs a name; type one.")
    if len(name) > LONGEST:
        raise RleSplatError(f"The name of a preset may have {LONGEST} letters, not {len(name)}; shorten it.")
    if name.startswith(".") or name.endswith(".") or any(c in REFUSED or not c.isprintable() for c in name):
        raise RleSplatError(f"The name of a preset may not have any of {' '.join(REFUSED)} or a period at an end.")
    if is_reserved(name):
        raise RleSplatError(f"No preset can be called {name}, because Windows has a device of this name; add a word.")
    return name


def usable_name(name: str) -> str:
    """A name that ``checked_name`` lets through, from one of another program."""
    kept = "".join("-" if c in REFUSED or not c.isprintable() else c for c in name).strip(". ")
    kept = kept[:LONGEST].strip(". ") or "Preset"
    return f"Preset {kept}" if is_reserved(kept) else kept


def is_known(name: str) -> bool:
    """Whether a preset of this name was listed; opens no file."""
    return name.strip().casefold() in map(str.casefold, _listed)


def taken(name: str) -> str:
    """The name of the preset that has the same file on some system; "" if there is none."""
    look_again()
    return next((one for one in _listed if one.casefold() == name.casefold()), "")


def save(name: str, function: TransferFunction, overwrite: bool = False) -> None:
    """Save a transfer function as a preset of the user.

    Raises
    ------
    RleSplatError
        If the name is empty or taken, or the file cannot be written.
    """
    name = checked_name(name)
    existing = taken(name)
    if existing and not overwrite:
        raise RleSplatError(f"There is already a user preset {existing!r}; choose another name, or replace it.")
    place = Path(bpy.utils.user_resource("SCRIPTS", path=PLACE, create=True))
    try:
        with whole_files([place / f"{existing or name}{SUFFIX}"]) as (part,):
            replace(function, name=name).save(part)
    except OSError as problem:
        why = f"Cannot write the preset {name!r}: {problem.strerror}; check the folder {place}."
        raise RleSplatError(why) from None
    look_again()


def save_all(functions, overwrite: bool = False) -> None:
    """Save transfer functions under their own names, with dashes for what file names cannot have.

    Raises
    ------
    RleSplatError
        If a name is taken, before any is saved, or a file cannot be written.
    """
    named: dict[str, TransferFunction] = {}
    for number, function in enumerate(functions, start=1):
        name = usable_name(function.name)
        while name.casefold() in map(str.casefold, named):  # which names in the file may become
            name = f"{name} {number}"
        named[name] = function
    clash = "" if overwrite else next(filter(None, map(taken, named)), "")
    if clash:
        raise RleSplatError(f"There is already a user preset {clash!r}; delete it, or replace those of the same name.")
    for name, function in named.items():
        save(name, function, overwrite)


def delete(name: str) -> None:
    """Delete a preset of the user; RleSplatError if there is none of this name, or it cannot be deleted."""
    try:
        _path_of(name).unlink()
    except OSError as problem:
        raise RleSplatError(f"Cannot delete the preset {name!r}: {problem.strerror}; delete its file.") from None
    finally:
        look_again()


def read(name: str) -> TransferFunction:
    """The transfer function of a preset of the user; RleSplatError if there is none of this name, or it is damaged."""
    function = TransferFunction.from_json(_path_of(name))
    return replace(function, name=function.name or name)


def _path_of(name: str) -> Path:
    if not taken(name):
        raise RleSplatError(f"There is no user preset {name!r}; choose another one.")
    return folder() / f"{taken(name)}{SUFFIX}"


def transfer_steps(name: str, volume):
    """Generator of Progress: the transfer function of a preset of the user, in the values of a volume.

    Returns
    -------
    function : TransferFunction
        As it was saved; if it was saved for another unit, or its points are relative, moved to the volume's values.
    reason : str
        A sentence if it was moved, or "".
    """
    function = read(name)
    yield Progress(0.0, "reading a preset")
    if function.unit is None or function.unit == volume.value_unit:
        return function, ""
    return (yield from announce(fit_steps(function, volume), 0.0, 1.0, "fitting a preset"))
