"""`.rle` files and folders in Blender: volumes whose voxels are classified, lit and encoded already.

What decides their colors is part of the file.  So an encoded volume has no transfer function in the .blend, no
histogram and no voxel values; its object stores the transfer function as text, so that panels and scripts can read it.
"""

import json
import os
from dataclasses import replace

from ...rle_splat.classify.transfer_function import TransferFunction
from ...rle_splat.encode.folder import is_folder_form
from ...rle_splat.encode.members import HEADER
from ...rle_splat.encode.store import read_encoded
from ...rle_splat.read.formats import format_of
from ...rle_splat.runtime.steps import Progress
from ...rle_splat.scene import NO_RAYS, Quality, RleSplatError

SUFFIX = ".rle"
UNFINISHED = SUFFIX + ".unfinished"
STORED_VALUES = "Its colors and its light are stored in the .rle file; encode the volume again to change them"
NO_VALUES = "holds classified voxels and no values (.rle); import the scan itself"


def place_of(path: str) -> str:
    """The file or folder that a chosen path means: for the header of a folder of tables, the folder."""
    folder, name = os.path.split(path)
    return folder if name == HEADER and is_encoded(folder) else path


def is_encoded(path: str) -> bool:
    """Whether a path is a `.rle` file or a folder of tables, by its name or by what is in it."""
    name = os.path.normpath(path).lower()
    return name.endswith((SUFFIX, UNFINISHED)) or (is_folder_form(path) and format_of(path) is None)


def open_steps(path: str, options: dict):
    """Generator of Progress: open a `.rle` file or folder.

    Parameters
    ----------
    options : dict
        Keyword arguments of ``read_volume``, of which there must be none.

    Returns
    -------
    StoredVolume

    Raises
    ------
    RleSplatError
        If it cannot be opened, its transfer function is missing or wrong, or options are given.
    """
    yield Progress(0.0, f"Opening {os.path.basename(path)}")
    if options:
        name = next(iter(options)).replace("_", " ")
        raise RleSplatError(
            f"The option {name} does not apply to {os.path.basename(path)}, because a .rle file says all about itself; "
            "import it as a new volume."
        )
    stored = read_encoded(path)
    if stored.transfer_function is None:
        raise RleSplatError(f"{path} lacks its transfer function; encode the volume again.")
    TransferFunction.from_json(stored.transfer_function)
    return stored


def is_of(owner) -> bool:
    """Whether a volume object shows a `.rle` file or folder."""
    return bool(owner.rle_splat.stored_transfer)


def transfer_of(owner) -> TransferFunction:
    """The transfer function by which the voxels of an encoded volume object were classified."""
    return TransferFunction.from_json(json.loads(owner.rle_splat.stored_transfer))


def why_no_values(owner) -> str:
    """Why what needs values cannot be done with a volume object: a clause without a period; "" if it has them."""
    return f"{owner.name!r} {NO_VALUES}" if is_of(owner) else ""


def suited(quality: Quality, volume) -> Quality:
    """A quality with what an encoded volume decides: classification, model and voxel records.

    For a Volume it is the same quality.
    """
    if volume.holds_values:
        return quality
    own = dict(model=volume.model, record=volume.record)
    if volume.classification == "post":
        own["minification"] = "off"
    if volume.classification == quality.classification:
        return replace(quality, **own)
    if quality.is_preset:
        return Quality.preset(
            quality.name, volume.classification, threads=quality.threads, axis_fade=quality.axis_fade, **own
        )
    # A knob that only the other classification has takes its usual value.
    return replace(
        quality, classification=volume.classification, depth_rule=None, kernel="tent", rays=NO_RAYS,
        length_correction=True, **own)  # fmt: skip
