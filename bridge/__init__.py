"""Translation between Blender's data and the renderer's plain data: the layer between operators and ``rle_splat``."""

# Imported first: it sets the cache folder of compiled kernels, which kernel modules read on import.
from . import paths  # noqa: F401

# isort: split
from . import live, translations
from .data import preferences, properties
from .live import bars, letters
from .look import own_presets, previews, thumbnails
from .loop import events


def register():
    translations.register()
    preferences.register()
    properties.register()
    previews.register()
    events.register()
    letters.HANDLERS.register()
    bars.HANDLERS.register()
    live.register()
    own_presets.register()
    thumbnails.register()


def unregister():
    thumbnails.unregister()
    own_presets.unregister()
    live.unregister()
    bars.HANDLERS.unregister()
    letters.HANDLERS.unregister()
    events.unregister()
    previews.unregister()
    properties.unregister()
    preferences.unregister()
    translations.unregister()
