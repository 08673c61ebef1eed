"""VolPack, the shear-warp renderer by Lacroute and Levoy, with the same camera, transfer function and size.

It uses the shared library of Debian's package libvolpack1 if that is installed.  VolPack runs on one thread, composites
classified voxels slice by slice with one sheet pixel per voxel and bilinear filtering, and warps the sheet.  Voxel
opacities and pictures have 8 bits, and rays are parallel.  It interpolates classified voxels, so its truth is T1.

The calls are described in its manual pages.  These conventions were found with single voxels: the volume's longest side
spans the unit cube; voxel i of n lies at i - n / 2; pixel i shows the point i pixels from the picture's edge; the first
row is the lowest; smaller z is in front; opacities are corrected for oblique rays as if voxels were cubes.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache

import numpy as np

from rle_splat.classify.classification import classify
from rle_splat.scene import RleSplatError, Scene
from rle_splat.view.projection import depth_row, world_to_pixel
from rle_splat.volume.gradient import unit_normals

from .frames import seconds
from .spent import Spent

LIBRARY, PACKAGE = "libvolpack.so.1", "libvolpack1"
try:
    _library = ctypes.CDLL(LIBRARY)
    _library.vpCreateContext.restype = ctypes.c_void_p
    _library.vpGetErrorString.restype = ctypes.c_char_p
    VOLPACK_PROBLEM = ""
except OSError as problem:
    _library = None
    VOLPACK_PROBLEM = str(problem)

HALF = 0.5 / 255.0  # half a step of its 8 bits; added to opacities, which it truncates, so that they are rounded
# Opacity above which a voxel is kept, and opacity at which a pixel is terminated.
SUGGESTED = (0.05, 0.95)  # suggested by its manual pages
ALL_VOXELS = (HALF, 1.0 - 2.0**-10)  # all voxels that are visible with 8 bits, and the termination of Quality.paper()

# From volpack.h.
MIN_VOXEL_OPACITY, MAX_RAY_OPACITY, RGBA = 1014, 1043, 5004
VIEW, PROJECT = 1, 2
NORMALS = 7924  # number of codes of a normal; code 0 means no normal

# A voxel's fields; the first is an index into the table of colors, the second into the weights of its materials.
VOXEL = np.dtype([("color", np.uint16), ("weight", np.uint8), ("unused", np.uint8), ("opacity", np.uint16)])
FIELDS = ("color", "weight", "opacity")
LARGEST_OPACITY = 65535
WEIGHTS = 256  # number of values of a shaded voxel
OTHERS = np.array(((1, 2), (0, 2), (0, 1)))  # the axes other than x, y and z
FACE = 128  # directions along a side of the cube by which normals are coded: closer than the codes are


class VolpackCaster:
    """One volume and transfer function, those of ``scene``, in VolPack, for drawing any number of views.

    ``shaded`` is by the headlight only; ``thresholds`` are SUGGESTED or ALL_VOXELS.  ``classify_ms`` are milliseconds
    of classifying and run-length encoding along all three axes, known after the first ``draw``; they do not include
    normals, which are those of the truths.
    """

    def __init__(self, scene: Scene, shaded: bool, thresholds=SUGGESTED):
        volume, tf = scene.volume, scene.transfer_function
        self._shade = tf.shade if shaded else None
        seen = classify(volume, tf, scene.index_to_world)
        self._opacity_distance = seen.opacity_distance
        row, n_y = np.repeat(np.arange(len(seen.row_start) - 1), np.diff(seen.row_start)), volume.shape_xyz[1]
        at = row // n_y, row % n_y, seen.column.astype(np.int64)
        self._voxels = np.zeros(volume.voxels.shape, VOXEL)
        self._voxels["opacity"][at] = np.rint(LARGEST_OPACITY * seen.opacity)
        codes, own = _values(volume, tf, volume.voxels[at], WEIGHTS if self._shade else LARGEST_OPACITY + 1)
        if self._shade:
            normals = unit_normals(volume, seen.row_start, seen.column, scene.index_to_world)
            self._voxels["color"][at], self._voxels["weight"][at] = _coded(normals), codes
            # Materials that throw light back as red, green and blue, and as highlights.
            self._weights = np.column_stack((own, np.ones(len(own))))[:, : 4 if self._shade.specular else 3]
            self._colors = np.zeros((NORMALS, self._weights.shape[1], 3))
        else:
            self._voxels["color"][at] = codes
            self._weights, self._colors = np.ones((1, 1)), 255.0 * own[:, None]  # one material, of no weight
        self._weights, self._colors = (np.ascontiguousarray(t, np.float32) for t in (self._weights, self._colors))
        self._opacities = np.zeros(LARGEST_OPACITY + 1, np.float32)
        self._context = ctypes.c_void_p(_library.vpCreateContext())
        self._describe(thresholds)
        self._exponent, self.classify_ms = None, None

    def draw(self, scene: Scene, repeats: int = 1) -> tuple[np.ndarray, Spent]:
        """Draw an orthographic view: premultiplied float32 (height, width, 4), row 0 on top, and its time, the least.

        Its frame is vpRenderClassifiedVolume, which composites and warps; the whole has the table of lit colors, too.
        Raises RleSplatError in perspective.
        """
        if scene.camera.type != "ORTHO":
            raise RleSplatError("VolPack supports only parallel rays; use an orthographic camera.")
        ahead = depth_row(scene.camera)[:3]
        voxels = np.linalg.norm(np.linalg.solve(scene.index_to_world[:3, :3], ahead))  # along a world length of a ray
        self._classify(1.0 / (voxels * self._opacity_distance))
        image = np.zeros((scene.height, scene.width, 4), np.uint8)
        spent = []
        for _ in range(repeats + 1):
            began = seconds()
            if self._shade:
                self._light(ahead)
            self._call("vpCurrentMatrix", VIEW)
            self._call("vpSetMatrix", self._to_clip(scene))
            self._call("vpSetImage", image, scene.width, scene.height, 4 * scene.width, RGBA)
            ready = seconds()
            self._call("vpRenderClassifiedVolume")
            done = seconds()
            spent.append(Spent(1e3 * (done - began), 1e3 * (done - ready)))
        return image[::-1].astype(np.float32) / 255.0, min(spent[1:])  # the first one allocates the sheet

    def close(self) -> None:
        """Free VolPack's memory."""
        _library.vpDestroyContext(self._context)

    def _call(self, name, *arguments) -> None:
        """Call a function of VolPack with the context; arrays are passed by address and floats as doubles."""
        passed = [_passed(argument) for argument in arguments]
        error = getattr(_library, name)(self._context, *passed)
        if error:
            raise RleSplatError(f"VolPack's {name} failed: {_library.vpGetErrorString(error).decode()}.")

    def _describe(self, thresholds) -> None:
        nz, ny, nx = self._voxels.shape
        self._call("vpSetVolumeSize", nx, ny, nz)
        # Only the fields for shading, which come first, are stored in the run-length tables.
        self._call("vpSetVoxelSize", VOXEL.itemsize, len(FIELDS), 2 if self._shade else 1, 1)
        tables = dict(zip(FIELDS, (self._colors, self._weights, self._opacities)))
        for number, (name, table) in enumerate(tables.items()):
            kind, offset = VOXEL.fields[name]
            self._call("vpSetVoxelField", number, kind.itemsize, offset, len(table) - 1)
        self._call("vpSetRawVoxels", self._voxels, self._voxels.nbytes, *self._voxels.strides[::-1])
        self._call("vpSetClassifierTable", 0, FIELDS.index("opacity"), self._opacities, self._opacities.nbytes)
        lookups = [(FIELDS.index(name), tables[name], tables[name].nbytes) for name in ("color", "weight")]
        self._call("vpSetLookupShader", 3, self._colors.shape[1], *lookups[0], *lookups[1])
        self._call("vpSetd", MIN_VOXEL_OPACITY, thresholds[0] + HALF)
        self._call("vpSetd", MAX_RAY_OPACITY, thresholds[1])
        self._call("vpCurrentMatrix", PROJECT)
        self._call("vpIdentityMatrix")

    def _classify(self, exponent: float) -> None:
        """Classify and encode with opacities for ``exponent`` times their unit distance, unless that is done already.

        The exponent depends on the view only if voxels are not cubes.
        """
        if self._exponent is not None and np.isclose(exponent, self._exponent, rtol=1e-6):
            return
        codes = np.arange(len(self._opacities)) / LARGEST_OPACITY
        self._opacities[1:] = 1.0 - (1.0 - codes[1:]) ** exponent + HALF
        began = seconds()
        self._call("vpClassifyVolume")
        self.classify_ms, self._exponent = 1e3 * (seconds() - began), exponent

    def _light(self, ahead) -> None:
        """Fill the color table for a headlight that shines along ``ahead``, with the truths' shading of each normal."""
        shade, facing = self._shade, np.abs(_normals() @ ahead)
        matt = np.where(_normals().any(axis=1), shade.ambient + shade.diffuse * facing, 1.0)
        for channel in range(3):
            self._colors[:, channel, channel] = 255.0 * matt
        if shade.specular:
            self._colors[:, 3] = (255.0 * shade.specular * facing**shade.shininess)[:, None]

    def _to_clip(self, scene: Scene) -> np.ndarray:
        """(4, 4) float64: VolPack's unit cube to its window, -1 to 1 along each side, +z away from the viewer."""
        counts = np.array(self._voxels.shape[::-1], np.float64)
        to_index = np.eye(4)
        to_index[:3] = np.column_stack((counts.max() * np.eye(3), 0.5 * counts))
        one = np.eye(4)[3]
        column, row, _ = world_to_pixel(scene.camera, scene.width, scene.height)
        across, up = column - 0.5 * (1 + scene.width) * one, 0.5 * (scene.height - 1) * one - row
        sides = np.stack((across * 2.0 / scene.width, up * 2.0 / scene.height, depth_row(scene.camera), one))
        return sides @ scene.index_to_world @ to_index


def _passed(argument):
    if isinstance(argument, np.ndarray):
        return argument.ctypes.data_as(ctypes.c_void_p)
    return ctypes.c_double(argument) if isinstance(argument, float) else argument


def _values(volume, tf, stored, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(m,) codes of stored values, quantized to at most ``count`` levels; (n, 3) unshaded colors of the codes."""
    low, high = float(stored.min()), float(stored.max())
    step = (high - low) / (count - 1)
    if stored.dtype.kind in "iu":
        step = max(step, 1.0)
    codes = np.rint((stored - low) / (step or 1.0)).astype(np.uint16)
    return codes, tf.color_at(volume.physical(low + step * np.arange(int(codes.max()) + 1)))


@lru_cache
def _normals() -> np.ndarray:
    """(NORMALS, 3) float64 unit vectors; (0, 0, 0) for code 0."""
    found = np.zeros((NORMALS, 3))
    for code, normal in enumerate(found):
        parts = [ctypes.c_double() for _ in normal]
        _library.vpNormal(code, *map(ctypes.byref, parts))
        normal[:] = [part.value for part in parts]
    return found


@lru_cache
def _codes() -> np.ndarray:
    """(3, 2, FACE, FACE) codes of the directions through the cells of a cube's faces.

    The indices are the axis, the side (negative, positive), and the cell along the other two axes.
    """
    places = (np.arange(FACE) + 0.5) * 2.0 / FACE - 1.0
    ways = np.empty((3, 2, FACE, FACE, 3))
    for axis, others in enumerate(OTHERS):
        ways[axis, ..., axis] = np.array((-1.0, 1.0))[:, None, None]
        ways[axis, ..., others[0]], ways[axis, ..., others[1]] = places[:, None], places
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    codes = [_library.vpNormalIndex(*map(ctypes.c_double, way)) for way in ways.reshape(-1, 3)]
    return np.array(codes, np.uint16).reshape(ways.shape[:-1])


def _coded(normals) -> np.ndarray:
    """(m,) codes of (m, 3) unit vectors; (0, 0, 0) has code 0."""
    axis = np.abs(normals).argmax(axis=1)
    longest = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0]
    others = np.take_along_axis(normals, OTHERS[axis], axis=1) / np.where(longest, np.abs(longest), 1.0)[:, None]
    cells = np.clip(0.5 * FACE * (others + 1.0), 0, FACE - 1).astype(np.int64)
    return np.where(longest, _codes()[axis, (longest > 0.0).astype(int), cells[:, 0], cells[:, 1]], 0)
