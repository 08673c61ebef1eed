"""Our pictures as Blender images: float, scene-linear, premultiplied.

Our row 0 is the top of a picture, Blender's is the bottom.  This module is the only place that flips rows.
"""

import bpy
import numpy as np

# Custom properties of our images: the kind of content, and the id of the scene that owns the picture.
MARK, OWNER = "rle_splat_kind", "rle_splat_owner"
STRIPES = np.array(((1.0, 0.0, 0.6, 1.0), (0.02, 0.02, 0.02, 1.0)), dtype=np.float32)  # scene-linear, opaque
ACROSS = 32  # approximate number of stripes along the longer side


def ensure_image(wanted, name: str, width: int, height: int, *, depth: bool = False):
    """Create a float image, or resize an existing one.

    Parameters
    ----------
    wanted : bpy.types.Image or None
        The image to use; its pixels are cleared if its size changes.  None creates an image.
    depth : bool
        Whether the image holds numbers ("Non-Color") instead of colors ("Linear Rec.709", premultiplied alpha).
    """
    image = wanted
    if image is None:
        image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=depth)
    # Setting either of these, even to the same value, makes Blender reload the stored pixels.  So they are set only if
    # they differ, and before the size.
    alpha_mode, color_space = ("NONE", "Non-Color") if depth else ("PREMUL", "Linear Rec.709")
    if image.alpha_mode != alpha_mode:
        image.alpha_mode = alpha_mode
    if image.colorspace_settings.name != color_space:
        image.colorspace_settings.name = color_space
    if tuple(image.size) != (width, height):  # (0, 0) if its file is missing
        # Not image.scale: in Blender 5.2 a scaled image keeps the display window of its file, and the compositor then
        # shifts it by half the difference.
        image.generated_color = (0.0, 0.0, 0.0, 0.0)
        image.source = "GENERATED"
        image.use_generated_float = True
        image.generated_width, image.generated_height = width, height
    image[MARK] = "depth" if depth else "color"
    return image


def owned_by(image, scene) -> bool:
    """Whether an image is a picture of this scene."""
    return image is not None and bool(scene.rle_splat.scene_id) and image.get(OWNER) == scene.rle_splat.scene_id


def write_color(image, rgba: np.ndarray) -> None:
    """Write (height, width, 4) premultiplied scene-linear colors, row 0 on top, into an image of that size."""
    flipped = np.ascontiguousarray(rgba[::-1], dtype=np.float32)
    image.pixels.foreach_set(flipped.ravel())
    image.update()


def write_numbers(image, numbers: np.ndarray) -> None:
    """Write (height, width) numbers, row 0 on top, into an image of that size as opaque gray."""
    gray = np.empty((*numbers.shape, 4), dtype=np.float32)
    gray[..., :3] = numbers[..., np.newaxis]
    gray[..., 3] = 1.0
    write_color(image, gray)


def read(image) -> np.ndarray:
    """(height, width, 4) float32: the stored pixels of an image, row 0 on top."""
    width, height = image.size
    flat = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)[::-1].copy()


def copy_of(image):
    """A new image with the same pixels as one of ours; Blender's own copy loses unsaved pixels."""
    copy = ensure_image(None, image.name, *image.size, depth=image[MARK] == "depth")
    write_color(copy, read(image))
    return copy


def clear(image) -> None:
    """Make every pixel transparent black, so that no outdated picture is shown."""
    width, height = image.size
    write_color(image, np.zeros((height, width, 4), dtype=np.float32))


def save_exr(pixels: np.ndarray, path: str) -> None:
    """Write pixels to a 32-bit EXR file, through an image that exists for this alone.

    Blender converts saved colors to the color space of the file, which changes them.  So the image is marked as plain
    numbers, which are not converted: the file holds the same bits.

    Parameters
    ----------
    pixels : ndarray, shape (height, width, 4), float32
        Row 0 on top.

    Raises
    ------
    RuntimeError, OSError
        If Blender or the system cannot write the file.
    """
    height, width = pixels.shape[:2]
    numbers = bpy.data.images.new("RLE Splat", width, height, alpha=True, float_buffer=True, is_data=True)
    try:
        numbers.alpha_mode = "CHANNEL_PACKED"
        write_color(numbers, pixels)
        numbers.filepath_raw = path
        numbers.file_format = "OPEN_EXR"
        numbers.save()
    finally:
        bpy.data.images.remove(numbers)


def write_file(image, path: str) -> None:
    """Write an image to a 32-bit EXR file, with the same bits, and make it the image's source.

    Raises
    ------
    RuntimeError, OSError
        If Blender or the system cannot write the file.
    """
    save_exr(read(image), path)
    if image.packed_file is not None:
        image.unpack(method="REMOVE")
    image.filepath_raw = path
    if image.source != "FILE":
        image.source = "FILE"
    image.reload()


def placeholder(width: int, height: int) -> np.ndarray:
    """The picture of a frame that could not be rendered: opaque stripes that cannot be mistaken for a result.

    Returns
    -------
    ndarray, shape (height, width, 4), float32
        Premultiplied scene-linear colors.
    """
    thickness = max(1, max(width, height) // ACROSS)
    rows, columns = np.ogrid[:height, :width]
    return STRIPES[(rows + columns) // thickness % 2]
