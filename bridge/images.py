"""Pictures of ours as Blender images: float, scene-linear, premultiplied.

This is the one place where rows are turned over: ours run from the top, Blender's from the bottom.
"""

from __future__ import annotations

import bpy
import numpy as np

# Custom properties of an image of ours: what it holds, and the id of the scene whose picture it is.
MARK, OWNER = "rle_splat_kind", "rle_splat_owner"


def ensure_image(wanted, name: str, width: int, height: int, *, depth: bool = False):
    """A float image of this size: ``wanted`` itself, blank where its size had to change, or a new one when it is None.

    Color images are "Linear Rec.709" with premultiplied alpha, depth images "Non-Color".
    """
    image = wanted
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=depth)
    # Setting either of these, even to what it was, makes Blender read the stored pixels again: before the size, and
    # only where it differs.
    alpha_mode, color_space = ("NONE", "Non-Color") if depth else ("PREMUL", "Linear Rec.709")
    if image.alpha_mode != alpha_mode:
        image.alpha_mode = alpha_mode
    if image.colorspace_settings.name != color_space:
        image.colorspace_settings.name = color_space
    if tuple(image.size) != (width, height):  # of none, where its file is gone
        # Not scaled: an image that Blender 5.2 read from a file keeps that file's display window when it is, and the
        # compositor then shifts it by half the difference.
        image.generated_color = (0.0, 0.0, 0.0, 0.0)
        image.source = "GENERATED"
        image.use_generated_float = True
        image.generated_width, image.generated_height = width, height
    image[MARK] = "depth" if depth else "color"
    return image


def owned_by(image, scene) -> bool:
    """Whether an image is a picture of this scene's."""
    return image is not None and bool(scene.rle_splat.scene_id) and image.get(OWNER) == scene.rle_splat.scene_id


def write_color(image, rgba: np.ndarray) -> None:
    """Put (H, W, 4) premultiplied scene-linear float, row 0 on top, into an image of the same size."""
    _write(image, rgba)


def write_numbers(image, numbers: np.ndarray) -> None:
    """Put (H, W) numbers, row 0 on top, into an image of the same size, as opaque gray."""
    gray = np.empty((*numbers.shape, 4), dtype=np.float32)
    gray[..., :3] = numbers[..., np.newaxis]
    gray[..., 3] = 1.0
    _write(image, gray)


def read(image) -> np.ndarray:
    """(H, W, 4) float32, row 0 on top: an image's pixels as they are."""
    width, height = image.size
    flat = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)[::-1].copy()


def copy_of(image):
    """A new image of ours with the same pixels.  (Blender's own copy has none that were not saved.)"""
    copy = ensure_image(None, image.name, *image.size, depth=image[MARK] == "depth")
    _write(copy, read(image))
    return copy


def clear(image) -> None:
    """Make every pixel transparent black, so that nothing stale is shown."""
    width, height = image.size
    _write(image, np.zeros((height, width, 4), dtype=np.float32))


def write_file(image, path: str) -> None:
    """Move the pixels to a 32-bit EXR file at ``path``, which the image then shows.  Raises RuntimeError or OSError.

    Blender converts what it saves to the file's color space, and so changes color pixels.  A copy that counts as
    plain numbers is not converted: its file holds the pixels bit for bit.
    """
    width, height = image.size
    numbers = bpy.data.images.new(image.name, width, height, alpha=True, float_buffer=True, is_data=True)
    try:
        numbers.alpha_mode = "CHANNEL_PACKED"
        _write(numbers, read(image))
        numbers.filepath_raw = path
        numbers.file_format = "OPEN_EXR"
        numbers.save()
    finally:
        bpy.data.images.remove(numbers)
    if image.packed_file is not None:
        image.unpack(method="REMOVE")
    image.filepath_raw = path
    if image.source != "FILE":
        image.source = "FILE"
    image.reload()


def _write(image, pixels: np.ndarray) -> None:
    flipped = np.ascontiguousarray(pixels[::-1], dtype=np.float32)
    image.pixels.foreach_set(flipped.ravel())
    image.update()
