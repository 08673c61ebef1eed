"""Everything a picture depends on, and the picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from reprlib import repr as short

import numpy as np

from .camera import Camera
from .checks import as_color, as_matrix, identity, is_finite_number, positive
from .clip import Clip
from .errors import RleSplatError
from .further_volumes import Labels
from .mist import Mist

# What a pixel shows of its ray: see effects/ray_values.py.
MODE_TEXTS = {
    "composite": "emission and absorption, front to back",
    "xray": "absorption alone, bone bright",
    "mip": "the largest value, as the transfer function shows it",
    "minip": "the smallest value",
    "average": "the mean value",
}
MODES = tuple(MODE_TEXTS)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera and the volume are at one time: their matrices to the world, (4, 4)."""

    camera_matrix: np.ndarray
    volume_matrix: np.ndarray

    def __post_init__(self):
        for name in ("camera_matrix", "volume_matrix"):
            object.__setattr__(self, name, as_matrix(getattr(self, name), f"A pose's {name}"))


def checked_crop(crop, width: int, height: int) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) of a crop of a frame, or a RleSplatError when it is none."""
    sides = tuple(crop) if np.iterable(crop) else ()
    whole = len(sides) == 4 and all(isinstance(side, (int, np.integer)) for side in sides)
    if not (whole and 0 <= sides[0] < sides[2] <= width and 0 <= sides[1] < sides[3] <= height):
        raise RleSplatError(
            f"A crop must be four whole numbers of pixels, left, top, right and bottom, with left < right within 0 to "
            f"{width} and top < bottom within 0 to {height}, not {crop!r}."
        )
    return tuple(int(side) for side in sides)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a picture depends on.

    A voxel index (x, y, z) is placed in the world by ``volume_matrix @ scale(scene_scale) @ volume.affine``.
    ``lights`` empty and ``headlight`` False means unlit colours.  ``background`` is scene-linear RGB.
    ``triangles`` are the meshes that stand in or around the volume, (n, 3, 3) float64 world coordinates:
    each ray is integrated only as far as the first of them.
    ``clips``: planes and boxes; what is left of the volume is what each of them keeps.
    ``volume_shadows``: whether lights that cast shadows cast them in the volume: its own, and those of the meshes.
    ``world``: scene-linear RGB radiance that comes from everywhere, None for none.  ``ambient_occlusion``: how much of
    the light from everywhere, the transfer function's ambient light with it, is taken away where the volume or a mesh
    hides the sky; 0 to 1.
    ``labels``: what each voxel belongs to, and what that looks like.  ``channels``: further volumes on the same grid,
    whose extinctions are added, and whose colours by extinction.
    ``crop``: (left, top, right, bottom), half-open, in pixels of the whole frame of ``width`` x ``height``, row 0 on
    top: only these are rendered, bit for bit as they are in the whole frame.  None for all of it.
    ``effects``: name of an effect -> whether it is forced on or off, whatever the rest of the scene calls for.
    ``motion``: Poses from when the shutter opens to when it closes, at equal steps of time; empty for a shutter of no
    time.  The camera's and the volume's own matrices are then those of what stays sharp: the depth.
    ``mode``: one of MODES, what a pixel shows of its ray; see ``effects.ray_values``.
    ``mist``: towards which colours fade with distance; None for clear air.
    ``reasons_off``: name of an effect -> why the scene was made without it, as words behind "off"; for reports alone.
    """

    volume: object
    transfer_function: object
    camera: Camera
    width: int = 512
    height: int = 512
    volume_matrix: np.ndarray = field(default_factory=identity)
    scene_scale: float = 1.0
    lights: tuple = ()
    headlight: bool = True
    background: tuple | None = None
    triangles: np.ndarray | None = None
    crop: tuple | None = None
    effects: dict[str, bool] = field(default_factory=dict)
    motion: tuple = ()
    clips: tuple = ()
    mode: str = "composite"
    mist: Mist | None = None
    volume_shadows: bool = False
    world: tuple | None = None
    ambient_occlusion: float = 0.0
    labels: Labels | None = None
    channels: tuple = ()
    reasons_off: dict[str, str] = field(default_factory=dict)

    def __post_init__(self):
        if self.mode not in MODES:
            raise RleSplatError(f"There is no mode called {short(self.mode)}; choose {', '.join(MODES)}.")
        if not (self.mist is None or isinstance(self.mist, Mist)):
            raise RleSplatError("The scene's mist must be a Mist, or None for clear air.")
        object.__setattr__(self, "volume_matrix", as_matrix(self.volume_matrix, "The volume's matrix"))
        object.__setattr__(self, "scene_scale", positive(self.scene_scale, "The scene scale"))
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not 1 <= value <= 65536:
                raise RleSplatError(f"The image's {name} must be a whole number from 1 to 65536, not {value!r}.")
            object.__setattr__(self, name, int(value))
        if self.crop is not None:
            object.__setattr__(self, "crop", checked_crop(self.crop, self.width, self.height))
        if not (isinstance(self.effects, dict) and all(isinstance(on, bool) for on in self.effects.values())):
            raise RleSplatError("The scene's effects must name effects, each with true for on or false for off.")
        if len(self.motion) == 1:
            raise RleSplatError("Motion takes two poses or more, from when the shutter opens to when it closes.")
        if not (isinstance(self.clips, tuple) and all(isinstance(clip, Clip) for clip in self.clips)):
            raise RleSplatError("The scene's clips must be a tuple of Clip, planes and boxes.")
        if self.world is not None:
            object.__setattr__(self, "world", as_color(self.world, "The world's light"))
        if not (is_finite_number(self.ambient_occlusion) and 0.0 <= self.ambient_occlusion <= 1.0):
            raise RleSplatError("The strength of ambient occlusion must be a number from 0 to 1.")
        if self.labels is not None:
            self._check_grid(self.labels.volume, "label volume")
        for channel in self.channels:
            self._check_grid(channel.volume, "channel")

    def _check_grid(self, other, what: str) -> None:
        mine, others = (" x ".join(map(str, one.shape_xyz)) for one in (self.volume, other))
        if mine != others:
            raise RleSplatError(
                f"The {what} has {others} voxels and the volume {mine}; give one that is on the volume's own grid."
            )

    @property
    def region(self) -> tuple[int, int, int, int]:
        """The pixels that are rendered, (left, top, right, bottom): the crop, or the whole frame."""
        return self.crop or (0, 0, self.width, self.height)

    @property
    def index_to_world(self) -> np.ndarray:
        """(4, 4) float64: voxel index (x, y, z, 1) to world."""
        scale = np.diag((self.scene_scale, self.scene_scale, self.scene_scale, 1.0))
        return self.volume_matrix @ scale @ self.volume.affine


@dataclass(frozen=True, eq=False)
class Rendering:
    """A finished picture, row 0 on top: the scene's crop, or its whole frame.

    ``rgba``: (H, W, 4) float32, scene-linear, premultiplied, without the background.
    ``depth``: (H, W) float32, planar distance along the camera's axis in world units at which the
    transmittance falls below one half, ``NO_DEPTH`` where it never does.  ``report``: JSON-ready dict.
    """

    rgba: np.ndarray
    depth: np.ndarray
    report: dict


NO_DEPTH = 1e10
