"""The classes that Blender registers."""


def classes_of(modules) -> list:
    """The operators, panels, menus and the like that modules define, in their order."""
    return [cls for module in modules for name, cls in vars(module).items()
            if name.startswith("RLE_SPLAT_") and cls.__module__ == module.__name__]  # fmt: skip
