"""Volumes from images that SimpleITK or nibabel holds in memory."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.orientation import lps_from_ras
from ..volume.volume import PATIENT, Volume
from .formats import guess_unit
from .header import MILLIMETERS, sensible_spacing
from .kernel_type import narrow_steps
from .streaming import plain_name, storable_steps

if TYPE_CHECKING:
    import SimpleITK
    from nibabel.spatialimages import SpatialImage

DIMENSIONS = 3
DOING = "converting voxels"


def read_sitk(image: SimpleITK.Image, **about: Any) -> Volume:
    """Make a Volume of a SimpleITK image.

    Parameters
    ----------
    image : SimpleITK.Image
        Of three dimensions, with one real number per voxel. Its origin, spacing and directions are taken as millimeters
        of a patient (LPS), as ITK does.
    **about
        Fields of Volume that the image does not have, such as ``value_unit``, ``modality`` and ``name``. For an image
        that is not of a patient, such as of a microscope, give ``space=None``.

    Returns
    -------
    Volume
        A copy of the values, in types as those of ``read_volume``: 64-bit integers become float64 where 32 bits do not
        suffice. An image whose values look like HU, and without ``value_unit``, is taken as a CT.

    Raises
    ------
    RleSplatError
        If the image is of another kind, has two or four dimensions, or several numbers, complex numbers or LabelMap
        objects in place of voxels.
    """
    array_of = _sitk_array_function(image)
    shape, components = image.GetSize(), image.GetNumberOfComponentsPerPixel()
    _check_shape(shape, "image[:, :, :, 0]")
    if components != 1:
        raise RleSplatError(
            f"The image has {components} numbers per voxel; take one of them, such as by "
            "SimpleITK.VectorIndexSelectionCast(image, 0)."
        )
    kind = image.GetPixelIDTypeAsString()
    if kind.startswith("label"):  # of an image that SimpleITK makes no array of: it ends the process
        raise RleSplatError("The image is a LabelMap; convert it by SimpleITK.LabelMapToLabel(image).")
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    affine[:3, 3] = image.GetOrigin()
    return _volume_of(array_of(image), {"affine": affine, "space": PATIENT, **about})


def read_nibabel(image: SpatialImage, **about: Any) -> Volume:
    """Make a Volume of a nibabel image.

    Parameters
    ----------
    image : nibabel.spatialimages.SpatialImage
        Of three dimensions, with one real number per voxel. Its RAS coordinates become LPS millimeters, by the unit of
        length in its header.
    **about
        Fields of Volume that the image does not have, such as ``value_unit`` and ``modality``.

    Returns
    -------
    Volume
        The stored values with slope and intercept, in types as those of ``read_volume``: 64-bit integers become float64
        where 32 bits do not suffice. It may share memory with the image. An image without a coded place in the patient
        has ``space`` None and its spacing alone. One whose values look like HU, and without ``value_unit``, is taken as
        a CT.

    Raises
    ------
    RleSplatError
        If the image is of another kind, has two dimensions, several volumes, or colors or complex numbers as voxels.
    """
    if not all(hasattr(image, name) for name in ("dataobj", "affine", "header")):
        raise _kind_error("read_nibabel", "nibabel", image)
    _check_shape(_without_ones(image.shape), "image.slicer[..., 0]")
    stored, slope, intercept = _stored_values(image.dataobj)
    name = plain_name(image.get_filename()) if image.get_filename() else ""
    fields = {"name": name, "slope": slope, "intercept": intercept, **_nibabel_place(image), **about}
    return _volume_of(stored.reshape(image.shape[:DIMENSIONS]).T, fields)


def _volume_of(voxels: np.ndarray, fields: dict) -> Volume:
    """The Volume of an array (z, y, x) of any type of numbers; the array may be shared, and is not changed."""
    if voxels.dtype.names:
        raise RleSplatError("The image has colors as voxels; convert it to one number per voxel.")
    # Big-endian voxels are copied here: ``storable_steps`` would swap the bytes in the image.
    native = voxels.astype(voxels.dtype.newbyteorder("="), copy=not voxels.dtype.isnative)
    return guess_unit(drain(narrow_steps(Volume(drain(storable_steps(native, DOING)), **fields))))


def _sitk_array_function(image):
    """``GetArrayFromImage`` of the package that an image's class is of, so that SimpleITK is not imported here."""
    for kind in type(image).__mro__:
        for name in (kind.__module__, kind.__module__.partition(".")[0]):
            found = getattr(sys.modules.get(name), "GetArrayFromImage", None)
            if found is not None:
                return found
    raise _kind_error("read_sitk", "SimpleITK", image)


def _kind_error(function: str, package: str, image) -> RleSplatError:
    return RleSplatError(
        f"{function} needs an image of {package}, not a {type(image).__name__}; read_volume reads files, and Volume "
        "takes arrays."
    )


def _check_shape(shape, remedy: str) -> None:
    """RleSplatError for an image (x, y, z, ...) that has not three dimensions; ``remedy``: how to take a part."""
    if len(shape) < DIMENSIONS:
        raise RleSplatError(f"The image has {len(shape)} dimensions; a volume needs three.")
    if len(shape) > DIMENSIONS:
        raise RleSplatError(f"The image has {len(shape)} dimensions; take one volume of it, such as {remedy}.")


def _without_ones(shape) -> tuple:
    """A shape without axes of length 1 beyond the third, which NIfTI files often have."""
    while len(shape) > DIMENSIONS and shape[-1] == 1:
        shape = shape[:-1]
    return shape


def _stored_values(data) -> tuple[np.ndarray, float, float]:
    """Stored values, slope and intercept of nibabel's ``dataobj``; physical values where a file has several slopes."""
    # The data of AFNI's files have a ``scaling`` of their own, which is None or counts in place of the slope.
    if hasattr(data, "slope") and getattr(data, "scaling", None) is None:
        return np.asanyarray(data.get_unscaled()), float(data.slope), float(data.inter)
    return np.asanyarray(data), 1.0, 0.0


def _nibabel_place(image) -> dict:
    """Affine, space and remarks of a nibabel image."""
    header = image.header
    unit = header.get_xyzt_units()[0] if hasattr(header, "get_xyzt_units") else "mm"
    scale = MILLIMETERS.get(unit, 1.0)  # nibabel says "unknown" where millimeters are usual
    if _is_placed(image):
        return {"affine": lps_from_ras(np.diag((scale, scale, scale, 1.0)) @ image.affine), "space": PATIENT}
    spacing, remarks = sensible_spacing(header.get_zooms()[:DIMENSIONS])
    return {
        "affine": np.diag((*(scale * np.array(spacing)), 1.0)),
        "remarks": (*remarks, "The image does not say how it lies in the patient, so left and right are not known."),
    }


def _is_placed(image) -> bool:
    """Whether the affine of a nibabel image is that of a file, and not one that nibabel assumes."""
    codes = [getattr(image, name)(coded=True)[1] for name in ("get_sform", "get_qform") if hasattr(image, name)]
    if not codes:  # no NIfTI; ``default_x_flip`` is what Analyze has in place of directions
        return image.affine is not None and not hasattr(image.header, "default_x_flip")
    return image.affine is not None and any(codes)
