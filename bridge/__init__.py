"""Translation between Blender's data and the renderer's plain data: the layer between operators and ``rle_splat``."""

# Imported first: it sets the cache folder of compiled kernels, which kernel modules read on import.
from . import paths  # noqa: F401

# isort: split
from . import live, translations
from .data import preferences, properties
from .live import bars, letters
from .look import own_presets, previews, thumbnails
from .loop import events

REGISTERED = (
    translations, preferences, properties, previews, events, letters.HANDLERS, bars.HANDLERS, live, own_presets,
    thumbnails,
)  # fmt: skip


def register():
    for one in REGISTERED:
        one.register()


def unregister():
    for one in reversed(REGISTERED):
        one.unregister()
