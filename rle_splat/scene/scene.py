"""The scene, which holds everything that a picture depends on, and the rendered picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from reprlib import repr as short
from typing import TYPE_CHECKING, Literal

import numpy as np

from .camera import Camera
from .checks import Background, as_background, as_color, as_matrix, identity, is_finite_number, positive, refuse_array
from .clip import Clip
from .display import to_bytes
from .environment import Environment
from .errors import RleSplatError
from .further_volumes import Channel, Labels, is_same_grid
from .light import Light
from .mist import Mist
from .png import png_bytes

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction
    from ..volume.volume import Volume

# What a pixel shows of the values along its ray; see effects/ray_values.py. Shown in help texts and tooltips.
Mode = Literal["composite", "xray", "mip", "minip", "average"]
MODE_TEXTS: dict[Mode, str] = {
    "composite": "emission and absorption (front to back)",
    "xray": "absorption only (dense tissue is bright)",
    "mip": "largest value along the ray (in the colors of the transfer function)",
    "minip": "smallest value along the ray",
    "average": "mean value along the ray",
}
MODES = tuple(MODE_TEXTS)


@dataclass(frozen=True, eq=False)
class Pose:
    """Camera and volume matrices at one time within the exposure.

    Parameters
    ----------
    camera_matrix, volume_matrix : (4, 4) array_like
        Camera space and volume space to world space.
    """

    camera_matrix: np.ndarray
    volume_matrix: np.ndarray

    def __post_init__(self):
        for name in ("camera_matrix", "volume_matrix"):
            object.__setattr__(self, name, as_matrix(getattr(self, name), f"A pose's {name}"))


def check_crop(crop, width: int, height: int) -> tuple[int, int, int, int]:
    """Check a crop of a ``width`` x ``height`` frame; return (left, top, right, bottom) as ints."""
    sides = tuple(crop) if np.iterable(crop) else ()
    whole = len(sides) == 4 and all(isinstance(side, (int, np.integer)) for side in sides)
    if not (whole and 0 <= sides[0] < sides[2] <= width and 0 <= sides[1] < sides[3] <= height):
        raise RleSplatError(
            f"A crop must be four whole numbers of pixels: left, top, right, bottom, with 0 <= left < right <= {width} "
            f"and 0 <= top < bottom <= {height}, not {crop!r}."
        )
    return tuple(int(side) for side in sides)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that a picture depends on.

    Parameters
    ----------
    volume : Volume
        The scan; or a StoredVolume, which has no values.
    transfer_function : TransferFunction
        Opacity and color of the values.
    camera : Camera
        Where the picture is seen from.
    width, height : int
        Size of the whole frame in pixels.
    volume_matrix : (4, 4) array_like
        Matrix of the volume object in the world. A voxel index (x, y, z) has the world position
        ``volume_matrix @ scale(scene_scale) @ volume.affine``.
    scene_scale : float
        World units per unit of the volume.
    lights : tuple of Light
        Lights; without any, and without a headlight and a world, colors are not shaded.
    headlight : bool
        Whether a white parallel light shines along the camera's axis. Without any light, colors are not shaded.
    triangles : (n, 3, 3) ndarray of float64 or None
        Triangles of the meshes in or around the volume, in world coordinates. A ray ends at the first triangle.
    ray_ends : (height, width) ndarray of float32 or None
        Planar depth in world units at which the ray of each pixel of the whole frame ends, inf for one that does not,
        such as the depth that a viewport has drawn. Rays then end there and not at triangles, which only cast shadows.
    panes : (n, 3, 3) ndarray of float64 or None
        Triangles of glass, as ``triangles``. Rays go straight through them, and they cast no shadow.
    pane_shares : (n, 4) array_like of float or None
        Given with ``panes``, 0 to 1: the share of scene-linear red, green and blue that passes each of them, and of
        alpha, which is 1 for clear or colored glass and less for a surface that hides a part by itself.
    crop : (4,) tuple of int or None
        (left, top, right, bottom), half-open, in pixels of the whole frame, row 0 at the top. Only these pixels are
        rendered, bit-identical to those of the whole frame. None for the whole frame.
    effects : dict of str to bool
        Effects to force on (True) or off (False); all others are on if the scene needs them. Names: "mode", "gradient
        opacity", "shading", "lights", "headlight", "specular", "world light", "shadows", "ambient occlusion", "mesh
        occlusion", "glass", "clipping", "depth of field", "motion blur", "clip objects", "labels", "channels",
        "indirect light" and "mist".
    motion : tuple of Pose
        Poses at equal steps of time from the opening to the closing of the shutter; empty for no motion blur. The
        depth is that of the camera's and the volume's own matrices.
    clips : tuple of Clip
        Cutting objects; the part of the volume that all of them keep is shown.
    mode : {"composite", "xray", "mip", "minip", "average"}
        What a pixel shows of the values along its ray.
    mist : Mist or None
        Color that hides what is far away.
    antialias : bool
        Whether edges have no steps: the picture is the mean of four, each shifted by a part of a pixel.
    volume_shadows : bool
        Whether lights that cast shadows cast them in the volume: shadows of the volume itself and of the meshes.
    world : (3,) tuple of float or None
        Scene-linear RGB radiance that arrives from all directions; its mean where it differs by direction.
    environment : Environment or None
        How the world's radiance differs by direction; None for the same from all directions.
    ambient_occlusion : float
        Share, 0 to 1, of the light from all directions (the transfer function's ambient light included) that is
        removed where the volume or a mesh hides the sky.
    indirect_light : float
        *Scattering* in Blender. Amount, 0 to 1, of light that is scattered on its way from lights that cast shadows;
        ``post`` alone has it.
    labels : Labels or None
        Segments with looks of their own, or hidden.
    channels : tuple of Channel
        Further volumes on the same grid. Extinctions are added; colors are averaged by extinction, or added where the
        volumes have colors and no transfer function shades.

    Raises
    ------
    RleSplatError
        If a value is out of range, panes and their shares do not match, labels or a channel are on another grid, or a
        scene with ray ends has motion or depth of field.
    """

    volume: Volume
    transfer_function: TransferFunction
    camera: Camera
    width: int = 512
    height: int = 512
    volume_matrix: np.ndarray = field(default_factory=identity)
    scene_scale: float = 1.0
    lights: Sequence[Light] = ()
    headlight: bool = True
    triangles: np.ndarray | None = None
    ray_ends: np.ndarray | None = None
    panes: np.ndarray | None = None
    pane_shares: np.ndarray | None = None
    crop: tuple[int, int, int, int] | None = None
    effects: dict[str, bool] = field(default_factory=dict)
    motion: tuple[Pose, ...] = ()
    clips: Sequence[Clip] = ()
    mode: Mode = "composite"
    mist: Mist | None = None
    antialias: bool = False
    volume_shadows: bool = False
    world: Sequence[float] | None = None
    environment: Environment | None = None
    ambient_occlusion: float = 0.0
    indirect_light: float = 0.0
    labels: Labels | None = None
    channels: Sequence[Channel] = ()
    reasons_off: dict[str, str] = field(default_factory=dict)  # effect -> why it was left out, for reports alone

    def __post_init__(self):
        refuse_array(self.volume)
        if isinstance(self.transfer_function, str):
            raise RleSplatError(
                f"The scene's transfer function must be an object, not the name {short(self.transfer_function)}; "
                "fit_preset makes one of a name."
            )
        for name in ("transfer_function", "camera"):  # fit_preset and turntable return them with more
            if isinstance(getattr(self, name), tuple):
                raise RleSplatError(f"The scene's {name} must be one object, not a tuple; take the tuple's first part.")
        if self.mode not in MODES:
            raise RleSplatError(f"There is no mode called {short(self.mode)}; choose {', '.join(MODES)}.")
        if not (self.mist is None or isinstance(self.mist, Mist)):
            raise RleSplatError("The scene's mist must be a Mist, or None for no mist.")
        object.__setattr__(self, "volume_matrix", as_matrix(self.volume_matrix, "The volume's matrix"))
        object.__setattr__(self, "scene_scale", positive(self.scene_scale, "The scene scale"))
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not 1 <= value <= 65536:
                raise RleSplatError(f"The image's {name} must be a whole number from 1 to 65536, not {value!r}.")
            object.__setattr__(self, name, int(value))
        if not isinstance(self.antialias, bool):
            raise RleSplatError(f"antialias must be true or false, not {short(self.antialias)}.")
        if self.crop is not None:
            object.__setattr__(self, "crop", check_crop(self.crop, self.width, self.height))
        if not (isinstance(self.effects, dict) and all(isinstance(on, bool) for on in self.effects.values())):
            raise RleSplatError("The scene's effects must be a dict of effect names to true (on) or false (off).")
        if self.ray_ends is not None:
            self._check_ray_ends()
        if self.panes is not None or self.pane_shares is not None:
            self._check_panes()
        if len(self.motion) == 1:
            raise RleSplatError("Motion needs no pose or at least two, from the opening to the closing of the shutter.")
        for name, kind in (("clips", Clip), ("lights", Light), ("channels", Channel)):
            value = getattr(self, name)
            if not (isinstance(value, (tuple, list)) and all(isinstance(one, kind) for one in value)):
                raise RleSplatError(f"The scene's {name} must be a tuple of {kind.__name__} objects.")
            object.__setattr__(self, name, tuple(value))
        if self.world is not None:
            object.__setattr__(self, "world", as_color(self.world, "The world's light"))
        elif self.environment is not None:
            raise RleSplatError("A scene with an environment needs its mean radiance; give it as the scene's world.")
        for name in ("ambient_occlusion", "indirect_light"):
            value = getattr(self, name)
            if not (is_finite_number(value) and 0.0 <= value <= 1.0):
                named = name.replace("_", " ").capitalize()
                raise RleSplatError(f"{named} must be a number from 0 to 1, not {short(value)}.")
        if not isinstance(self.labels, Labels | None):
            raise RleSplatError(f"The scene's labels must be a Labels object, not a {type(self.labels).__name__}.")
        if self.labels is not None:
            self._check_grid(self.labels.volume, "label volume")
        for channel in self.channels:
            self._check_grid(channel.volume, "channel")

    def _check_ray_ends(self) -> None:
        shape = np.shape(self.ray_ends)
        if shape != (self.height, self.width):
            raise RleSplatError(
                f"The scene's ray ends must be a depth for each of its {self.height} x {self.width} pixels, not an "
                f"array of shape {shape}."
            )
        if self.motion or self.camera.aperture_radius > 0.0:
            raise RleSplatError(
                "Ray ends are the depths of one sharp view; leave motion and depth of field out, or give triangles."
            )

    def _check_panes(self) -> None:
        panes, shares = np.shape(self.panes), np.shape(self.pane_shares)
        if panes[1:] != (3, 3) or shares != (panes[0], 4):
            raise RleSplatError("The scene's panes must be triangles of shape (n, 3, 3), with shares of shape (n, 4).")
        held = np.asarray(self.pane_shares, np.float64)
        if not ((held >= 0.0) & (held <= 1.0)).all():
            raise RleSplatError("The shares of light that pass the scene's panes must be numbers from 0 to 1.")
        object.__setattr__(self, "pane_shares", held)

    def _check_grid(self, other, what: str) -> None:
        """Refuse a volume ``other`` whose grid has another shape or lies elsewhere.

        Where only one of them is of a patient, their places cannot be compared.
        """
        mine, others = (" x ".join(map(str, one.shape_xyz)) for one in (self.volume, other))
        if mine != others:
            raise RleSplatError(f"The {what} has {others} voxels and the volume has {mine}; give one on the same grid.")
        if self.volume.space == other.space and not is_same_grid(self.volume, other):
            raise RleSplatError(
                f"The {what} lies elsewhere than the volume, or its spacing differs; give one on the same grid, as "
                "read_labels does for label files."
            )

    def __repr__(self) -> str:
        return f"<Scene of {self.volume!r}, {self.width} x {self.height} pixels>"

    @property
    def shines(self) -> bool:
        """Whether anything lights the volume: a light, a headlight or a world that is not black."""
        return bool(self.lights) or self.headlight or any(self.world or ())

    @property
    def hides_volume(self) -> bool:
        """Whether anything in the scene may end rays: triangles, or depths at which they end."""
        return self.ray_ends is not None or (self.triangles is not None and len(self.triangles) > 0)

    @property
    def region(self) -> tuple[int, int, int, int]:
        """The pixels to render, (left, top, right, bottom): the crop, or the whole frame."""
        return self.crop or (0, 0, self.width, self.height)

    @cached_property
    def index_to_world(self) -> np.ndarray:
        """(4, 4) float64 read-only matrix from voxel index (x, y, z, 1) to world space."""
        scale = np.diag((self.scene_scale, self.scene_scale, self.scene_scale, 1.0))
        found = self.volume_matrix @ scale @ self.volume.affine
        found.flags.writeable = False
        return found


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendered picture: the scene's crop, or its whole frame; row 0 at the top.

    Attributes
    ----------
    rgba : (H, W, 4) ndarray of float32
        Scene-linear, premultiplied, without the background.
    depth : (H, W) ndarray of float32
        Planar distance along the camera's axis, in world units, at which the transmittance falls below one half;
        1e10 where it never does.
    report : dict
        What was rendered and how, as in docs/reference/json-formats.md#report; can be written as JSON.
    """

    rgba: np.ndarray
    depth: np.ndarray
    report: dict

    def to_srgb(self, background: Background = "transparent") -> np.ndarray:
        """The pixels for display, such as for Pillow or matplotlib.

        Parameters
        ----------
        background : {"white", "black", "transparent"} or (3,) sequence of float
            Below the picture; a color is scene-linear RGB.

        Returns
        -------
        ndarray of uint8
            In sRGB: (H, W, 3) over the background, or (H, W, 4) with straight alpha if it is transparent.
        """
        return to_bytes(self.rgba, as_background(background))

    def _repr_png_(self) -> bytes:
        """The picture in a notebook, transparent where nothing is."""
        return png_bytes(self.rgba)

    def __repr__(self) -> str:
        height, width = self.depth.shape
        return f"<Rendering of {width} x {height} pixels>"


NO_DEPTH = 1e10
