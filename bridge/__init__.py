"""Translation between Blender's data and the renderer's plain data: the layer between operators and ``rle_splat``."""

# Imported first: it sets the cache folder of compiled kernels, which kernel modules read on import.
from . import paths

# isort: split
from . import handlers, live, translations
from .data import preferences, properties
from .live import letters
from .look import own_presets, previews, thumbnails
from .volumes import segments, source_paths

__all__ = [
    "handlers", "letters", "live", "own_presets", "paths", "preferences", "previews",
    "properties", "register", "segments", "source_paths", "thumbnails", "translations",
    "unregister",
]


def register():
    translations.register()
    preferences.register()
    properties.register()
    previews.register()
    segments.register()  # before source_paths, whose handler makes paths relative
    source_paths.register()
    handlers.register()
    letters.register()
    live.register()
    own_presets.register()
    thumbnails.register()


def unregister():
    thumbnails.unregister()
    own_presets.unregister()
    live.unregister()
    letters.unregister()
    handlers.unregister()
    source_paths.unregister()
    segments.unregister()
    previews.unregister()
    properties.unregister()
    preferences.unregister()
    translations.unregister()
