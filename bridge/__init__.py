"""Between Blender and the renderer's plain data.  Operators and panels are above, ``rle_splat`` is below."""

# First: it chooses the folder of compiled kernels before any kernel's module is imported.
from . import paths

# isort: split
from . import handlers, preferences, previews, properties, source_paths

__all__ = [
    "handlers", "paths", "preferences", "previews", "properties", "register", "source_paths", "unregister",
]


def register():
    preferences.register()
    properties.register()
    previews.register()
    source_paths.register()
    handlers.register()


def unregister():
    handlers.unregister()
    source_paths.unregister()
    previews.unregister()
    properties.unregister()
    preferences.unregister()
