"""A small picture of a volume with a transfer function, from the front."""

import hashlib
from dataclasses import replace

import numpy as np

from ..classify.transfer_function import Shade, TransferFunction
from ..scene import Quality, Scene
from ..scene.color import to_display
from ..scene.further_volumes import CORNERS
from ..view.turntable import turntable
from ..volume.volume import Volume
from .render import render_steps
from .stage_cache import StageCache

SIDE = 128  # pixels
VOXELS = 128  # along the longest side of the volume that it is made from
ROOM = 1.02  # height of the view over what is seen of the volume
FLAT, ASIDE = 0.4, 50.0  # a volume flatter than this is seen from so many degrees above or aside, else from the front
BEHIND, BEHIND_BLACK = 0.012, 0.8  # scene-linear gray behind the volume, and behind one whose highest values are black
KIND = "3"  # of pictures; another one for each change that makes old pictures wrong
# An unshaded function of one color is for projections (the preset "gray"); composited, it would be a flat shape.  Its
# opacities are brought down to at most this optical depth over the longest side.
DEPTH = 3.0
# Kernels of unshaded functions and of those without a highlight are not prepared ahead (``prepare``).  With a highlight
# too faint to be seen their pictures are the same.
FAINT = 1e-4


def thumbnail_key(volume: Volume, function: TransferFunction, segments: Volume | None = None) -> str:
    """Hash of all that a thumbnail depends on.

    Parameters
    ----------
    volume : Volume
        The whole one.
    function : TransferFunction
        In its values.
    segments : Volume, optional
        The label map without whose rest the volume is shown.
    """
    beside = () if segments is None else (segments.key,)
    parts = (KIND, SIDE, VOXELS, volume.key, volume.space, function.key, *beside)
    return hashlib.blake2b(repr(parts).encode(), digest_size=16).hexdigest()


def thumbnail_steps(small: Volume, function: TransferFunction, spacing: float, cache: StageCache):
    """Generator of Progress: make a thumbnail.

    Parameters
    ----------
    small : Volume
        ``reduced_steps`` of the volume to VOXELS.
    function : TransferFunction
        In the volume's values.
    spacing : float
        The smallest spacing of the whole volume, to which opacities without a distance refer.
    cache : StageCache
        Shared by thumbnails of one volume.

    Returns
    -------
    (SIDE, SIDE, 3) ndarray of uint8
        sRGB, row 0 at the top.
    """
    camera, matrix = _front(small)
    behind = BEHIND if function.shade is not None or any(function.color[-1][1:]) else BEHIND_BLACK
    flat = behind == BEHIND and function.shade is None and len({tuple(rgb) for _, *rgb in function.color}) == 1
    shade = function.shade or Shade(1.0, 0.0, FAINT, 1.0)
    function = replace(
        function,
        shade=replace(shade, specular=max(shade.specular, FAINT)),
        opacity_unit_distance=function.opacity_unit_distance or spacing,
    )
    if flat:
        opacity = tuple((value, -alpha * np.expm1(-DEPTH)) for value, alpha in function.opacity)
        longest = float((np.array(small.shape_xyz) * small.spacing).max())
        function = replace(function, opacity=opacity, opacity_unit_distance=longest)
    scene = Scene(small, function, camera, SIDE, SIDE, matrix)
    # On one thread no kernel waits for a second core: beside other work that took 15 ms of each, 180 in place of 40 ms.
    quality = Quality.preset("draft", name="thumbnail", threads=1)
    rendering = yield from render_steps(scene, quality, cache=cache, refuse_empty_view=False)
    rgb = rendering.rgba[..., :3] + behind * (1.0 - rendering.rgba[..., 3:])
    return np.rint(255.0 * to_display(rgb)).astype(np.uint8)


def _front(volume: Volume):
    """The camera that sees a volume from the front, filling the picture, and the volume's matrix."""
    width, height = _measure_box(volume, *turntable(volume))
    angles = dict(azimuth=ASIDE * (width < FLAT * height), elevation=ASIDE * (height < FLAT * width))
    seen = max(_measure_box(volume, *turntable(volume, **angles)))
    longest = float((np.array(volume.shape_xyz) * volume.spacing).max())
    return turntable(volume, fit=ROOM * seen / longest, **angles)


def _measure_box(volume: Volume, camera, matrix) -> np.ndarray:
    """(2,) float64: width and height of the box of voxels as a camera sees it."""
    corners = CORNERS * np.array(volume.shape_xyz) - 0.5
    world = corners @ (matrix @ volume.affine)[:3, :3].T
    return np.ptp(world @ camera.matrix_world[:3, :2], axis=0)
