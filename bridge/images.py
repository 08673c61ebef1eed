"""Pictures of ours as Blender images: float, scene-linear, premultiplied, packed into the .blend.

This is the one place where rows are turned over: ours run from the top, Blender's from the bottom.
"""

from __future__ import annotations

import bpy
import numpy as np

# Marks the images this add-on made, so that they are found again whatever they are called.
MARK = "rle_splat_kind"


def ensure_image(wanted, name: str, width: int, height: int, *, depth: bool = False):
    """A float image of this size: ``wanted`` itself (resized if need be), or a new one when it is None.

    Colour images are "Linear Rec.709" with premultiplied alpha, depth images "Non-Color".
    """
    image = wanted
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=depth)
    # Setting either of these, even to what it was, makes Blender read the packed pixels again: before the size, and
    # only where it differs.
    alpha_mode, color_space = ("NONE", "Non-Color") if depth else ("PREMUL", "Linear Rec.709")
    if image.alpha_mode != alpha_mode:
        image.alpha_mode = alpha_mode
    if image.colorspace_settings.name != color_space:
        image.colorspace_settings.name = color_space
    if image.size[0] == 0:
        # Its pixels are lost (unpacked, and the file is gone): start again under the same name and users.
        image.source = "GENERATED"
        image.use_generated_float = True
        image.generated_width, image.generated_height = width, height
    elif tuple(image.size) != (width, height):
        image.scale(width, height)
    image[MARK] = "depth" if depth else "color"
    return image


def write_color(image, rgba: np.ndarray) -> None:
    """Put (H, W, 4) premultiplied scene-linear float, row 0 on top, into an image of the same size."""
    _write(image, rgba)


def write_numbers(image, numbers: np.ndarray) -> None:
    """Put (H, W) numbers, row 0 on top, into an image of the same size, as opaque grey."""
    grey = np.empty((*numbers.shape, 4), dtype=np.float32)
    grey[..., :3] = numbers[..., np.newaxis]
    grey[..., 3] = 1.0
    _write(image, grey)


def read(image) -> np.ndarray:
    """(H, W, 4) float32, row 0 on top: an image's pixels as they are."""
    width, height = image.size
    flat = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)[::-1].copy()


def clear(image) -> None:
    """Make every pixel transparent black, so that nothing stale is shown."""
    width, height = image.size
    _write(image, np.zeros((height, width, 4), dtype=np.float32))


def pack(image) -> None:
    """Keep the pixels inside the .blend (as a 32-bit EXR, exact), so that they survive save and reload."""
    image.pack()


def pack_unsaved() -> None:
    """Pack every picture of ours that was written during a render, where packing has to wait."""
    for image in bpy.data.images:
        if MARK in image and image.is_dirty:
            image.pack()


def _write(image, pixels: np.ndarray) -> None:
    flipped = np.ascontiguousarray(pixels[::-1], dtype=np.float32)
    image.pixels.foreach_set(flipped.ravel())
    image.update()
