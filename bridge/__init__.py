"""Between Blender and the renderer's plain data.  Operators and panels are above, ``rle_splat`` is below."""

# First: it chooses the folder of compiled kernels before any kernel's module is imported.
from . import paths

# isort: split
from . import handlers, kernel_preparation, preferences, previews, properties, source_paths

__all__ = [
    "handlers", "kernel_preparation", "paths", "preferences", "previews", "properties", "register", "source_paths",
    "unregister",
]


def register():
    preferences.register()
    properties.register()
    previews.register()
    source_paths.register()
    handlers.register()
    kernel_preparation.register()


def unregister():
    kernel_preparation.unregister()
    handlers.unregister()
    source_paths.unregister()
    previews.unregister()
    properties.unregister()
    preferences.unregister()
