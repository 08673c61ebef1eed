"""Compile kernels ahead: render tiny synthetic scenes whose kernels are those of default pictures.

A kernel is compiled once for each combination of argument types, when a picture first calls it, and kept on disk
(``runtime/kernel_cache``).  Which types a picture has follows from the voxels' type, the classification, the quality,
the lights, the projection and the principal axis, not from any size.  So a volume of 64 voxels a side calls for the
same kernels as a scan does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from ..classify.default import default_transfer_function
from ..classify.transfer_function import GradientOpacity
from ..runtime import jit
from ..runtime.steps import Progress, rescale
from ..scene import MODES, Channel, Classification, Clip, Labels, Light, Quality, QualityName, RleSplatError, Scene
from ..view.turntable import turntable
from ..volume.volume import Volume
from .render import render_steps

SIDE = 64  # voxels
WIDTH, HEIGHT = 32, 24  # pixels
# The stored types of most scans: CT is int16 or uint16, converted scans and phantoms are uint8, VDB grids float32.
STORED_TYPES = ("uint8", "int16", "uint16", "float32")
NOT_KEPT = (
    "Nothing is compiled, since it could not be stored: RLE_SPLAT_CACHE has to name a folder that can be "
    "written to, and numba has to be of the version that RLE Splat is made for."
)


@dataclass(frozen=True)
class SyntheticPicture:
    """One synthetic picture, made once for each stored type.

    ``first``, ``more``: seconds of processor time that its kernels took to compile in an empty cache, for the first of
    STORED_TYPES and, in the mean, for each other; the fractions of progress are shares of their sum.  ``scene``: see
    ``_scene``.
    """

    name: str
    first: float
    more: float
    quality: QualityName = "standard"
    classification: Classification = "post"
    scene: str = "headlight"
    azimuth: float = 0.0
    elevation: float = 0.0
    perspective: bool = False
    knobs: dict = field(default_factory=dict)

    def seconds(self, stored: str) -> float:
        return self.first if stored == STORED_TYPES[0] else self.more


# In the order in which users need them.  Sideways: the voxels' x is the principal axis, whose runs lie across rows.
PICTURES = (
    SyntheticPicture("orthographic", 36.6, 2.2),
    SyntheticPicture("perspective", 0.0, 0.0, perspective=True),
    SyntheticPicture("sideways", 3.0, 0.0, azimuth=90.0),
    SyntheticPicture("lights", 7.4, 0.0, scene="lights", perspective=True),
    SyntheticPicture("lights, draft", 0.7, 0.0, quality="draft", scene="lights"),
    SyntheticPicture("lights, traced", 2.1, 0.0, scene="lights", knobs={"exact_light": True}),
    SyntheticPicture("lights and meshes", 9.2, 0.0, scene="lights meshes", perspective=True),
    SyntheticPicture("hard walls", 25.5, 0.0, quality="fine"),
    SyntheticPicture("surfaces only", 1.9, 0.0, scene="surfaces"),
    SyntheticPicture("surfaces only, unlit", 13.3, 0.0, scene="unlit surfaces"),
    SyntheticPicture("surfaces only, X-ray", 12.8, 0.0, scene="surfaces xray"),
    SyntheticPicture("unlit", 0.0, 0.0, scene="unlit"),
    SyntheticPicture("hard walls, unlit", 15.7, 0.0, quality="fine", scene="unlit"),
    SyntheticPicture("clip objects", 1.7, 0.0, scene="clips"),
    SyntheticPicture("X-ray", 0.0, 0.0, scene="xray"),
    SyntheticPicture("maximum", 10.1, 0.0, scene="mip"),  # the other modes have the same kernels
    SyntheticPicture("labels", 40.0, 0.0, scene="labels", azimuth=90.0, perspective=True),
    SyntheticPicture("labels, unlit", 29.5, 0.0, scene="unlit labels"),
    SyntheticPicture("labels, hard walls", 3.8, 0.0, quality="fine", scene="labels"),
    SyntheticPicture("labels, hard walls, unlit", 2.4, 0.0, quality="fine", scene="unlit labels"),
    SyntheticPicture("labels, pre-classified", 15.9, 1.3, classification="pre", scene="labels"),
    SyntheticPicture("channels", 0.1, 0.0, scene="channels", azimuth=90.0, perspective=True),
    SyntheticPicture("channels, pre-classified", 0.1, 0.0, classification="pre", scene="channels"),
    SyntheticPicture("pre-classified", 0.3, 0.4, classification="pre"),
    SyntheticPicture("pre-classified, sideways", 3.5, 0.0, classification="pre", azimuth=90.0, perspective=True),
    SyntheticPicture("pre-classified, unlit", 0.9, 0.0, classification="pre", scene="unlit"),
    # Seen along all three principal axes at once.
    SyntheticPicture(
        "pre-classified, lights", 5.7, 0.0, classification="pre", scene="lights", azimuth=45.0, elevation=35.26,
        perspective=True,
    ),
    # Also the grid of a volume that meshes mirror (``medium_grid``).
    SyntheticPicture("pre-classified, lights and meshes", 2.2, 0.0, classification="pre", scene="lights meshes"),
    SyntheticPicture("pre-classified, surfaces only, X-ray", 0.0, 0.0, classification="pre", scene="surfaces xray"),
    SyntheticPicture("wide footprints", 10.9, 0.0, classification="pre", knobs={"kernel": "gaussian"}),
    SyntheticPicture("opacities", 6.8, 0.0, classification="pre", knobs={"model": "opacity"}),
    SyntheticPicture(
        "wide footprints, opacities", 9.4, 0.0, classification="pre", knobs={"kernel": "gaussian", "model": "opacity"}
    ),
    SyntheticPicture("short records", 0.3, 0.0, classification="pre", knobs={"record": 8}),
)  # fmt: skip


@dataclass(frozen=True)
class PreparedPart:
    """One picture's part of a preparation: how long it took, and the kernels that were new on disk after it, one that
    was compiled for several combinations of argument types as often."""

    picture: str
    seconds: float
    kernels: tuple[str, ...]


def prepare_steps():
    """Compile what default pictures need and is not on disk yet.

    Covered are pictures of volumes of STORED_TYPES, orthographic and in perspective, along each principal axis:

    - at the qualities "standard" and "draft", which classify after interpolation and have the same kernels: by the
      headlight; by lamps and the world's light, without shadows, and with shadows without and with meshes that hide the
      volume.
    - at "standard", by lamps with shadows that are traced, as "strict" does and pictures for a tolerance.
    - at "fine", whose kernels "standard" needs for rough media (``preset_plan``): by the headlight, with labels, with
      channels, and with both.
    - at "standard" and "draft", by the headlight: with gradient opacity; with clip objects; with labels; with channels;
      as an X-ray and in each other mode.
    - at "standard", "draft" and "fine", unshaded, also with labels, with channels and with gradient opacity.
    - at "standard" with the classification "pre": unshaded, by the headlight, by lights with shadows without and
      with meshes, with labels, with channels; with each footprint, model and record, and so as in the paper.

    Also covered are pictures of ``.rle`` files, and of any two of the effects above.  Not covered, and compiled when a
    picture first needs them: other stored types; some combinations of three and more effects.

    Yields
    ------
    Progress
        The fraction is a share of the time that an empty cache takes.

    Returns
    -------
    list of PreparedPart
        One entry for each picture and stored type.

    Raises
    ------
    RleSplatError
        Where numba cannot be loaded, or no kernel can be kept on disk.
    """
    jit.need_kernels("The preparation")
    if not jit.KERNELS.parent.is_dir():
        raise RleSplatError(NOT_KEPT)
    whole = sum(picture.seconds(stored) for picture in PICTURES for stored in STORED_TYPES)
    done, prepared = 0.0, []
    for picture in PICTURES:
        for stored in STORED_TYPES:
            name = f"{picture.name}, {stored}"
            began, before = perf_counter(), _on_disk()
            start, done = done, done + picture.seconds(stored)
            steps = picture_steps(picture, stored)
            yield from rescale(steps, start / whole, done / whole, f"Preparing kernels: {name}")
            new = sorted(file.name.partition("-")[0] for file in _on_disk() - before)
            prepared.append(PreparedPart(name, perf_counter() - began, tuple(new)))
    yield Progress(1.0, "Done")
    return prepared


def _on_disk() -> set[Path]:
    """Files of compiled kernels, one for each combination of argument types."""
    return set(jit.KERNELS.rglob("*.nbc"))


def picture_steps(picture: SyntheticPicture, stored: str):
    """Generator of Progress: one synthetic picture, on one thread."""
    # Another name keeps the preset's own knobs, whatever plan it would take for the ball.
    quality = Quality.preset(picture.quality, picture.classification, name="prepared", threads=1, **picture.knobs)
    scene = _scene(picture, _ball(stored))
    return render_steps(scene, quality)


def _ball(stored: str) -> Volume:
    """A soft ball, read-only as ``read_volume`` maps a file."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - 0.5 * (SIDE - 1)
    distance = np.sqrt(x * x + y * y + z * z) / (0.5 * SIDE)
    voxels = (250.0 * np.clip(1.2 - distance, 0.0, 1.0)).astype(stored)
    voxels.flags.writeable = False
    return Volume(voxels, np.eye(4))


def _scene(picture: SyntheticPicture, volume: Volume) -> Scene:
    """The ball before a turntable's camera.

    By the headlight, and as the words of ``picture.scene`` say: a mode; "unlit", without shading; "surfaces", with
    gradient opacity; "clips", cut by a box, a plane and the camera; "labels"; "channels", with itself as another one;
    "lights", a lamp that casts shadows and the world's light; "meshes", a triangle that cuts the ball, one of glass,
    and ambient occlusion, which they block at the nodes of its grid.
    """
    words = picture.scene.split()
    camera, matrix = turntable(volume, picture.azimuth, picture.elevation, perspective=picture.perspective)
    function, _ = default_transfer_function(volume)
    if "unlit" in words:
        function = replace(function, shade=None)
    if "surfaces" in words:
        function = replace(function, gradient_opacity=GradientOpacity(0.0, 1.0))
    scene = Scene(volume, function, camera, WIDTH, HEIGHT, matrix)
    for mode in set(words) & set(MODES):
        scene = replace(scene, mode=mode)
    if "clips" in words:
        box = np.diag((SIDE / 4.0, SIDE / 4.0, SIDE / 4.0, 1.0))
        middle = (scene.index_to_world @ (*3 * [SIDE / 2.0], 1.0))[:3]
        near = replace(camera, clip_start=float(np.linalg.norm(middle - camera.matrix_world[:3, 3])))
        scene = replace(scene, camera=near, clips=(Clip("box", box, "outside"), Clip("plane", np.eye(4))))
    if "labels" in words:
        half = Volume((volume.voxels > np.median(volume.voxels)).astype(np.uint8), volume.affine)
        scene = replace(scene, labels=Labels(half, {1: replace(function, color=((0.0, 1.0, 0.0, 0.0),))}))
    if "channels" in words:
        scene = replace(scene, channels=(Channel(volume, function),))
    if "lights" in words:
        beside = np.eye(4)
        beside[:3, 3] = (-SIDE, -SIDE, 2 * SIDE)
        lamp = Light("POINT", (1.0, 1.0, 1.0), float(SIDE**3), beside, radius=1.0)
        scene = replace(scene, headlight=False, lights=(lamp,), volume_shadows=True, world=(0.05, 0.05, 0.05))
    if "meshes" in words:
        corners = SIDE * np.array([[[0.0, 0.5, 0.0], [1.0, 0.5, 0.0], [0.0, 0.5, 1.0]]])
        pane = {"panes": corners + SIDE / 8.0, "pane_shares": np.array([[0.5, 0.8, 0.9, 1.0]])}
        scene = replace(scene, triangles=corners, ambient_occlusion=0.5, **pane)
    return scene
