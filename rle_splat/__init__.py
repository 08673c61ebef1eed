"""RLE Splat: volumes of measured data splatted through run-length encoded slices into sheet buffers.

The names below are all a script needs.  They are looked up when first used, so that a command that only reads a
header never waits for the renderer's compiled kernels to load.
"""

import sys
from importlib import import_module
from types import ModuleType

# One table: public name -> (the module that holds it, its name there).
_HOME = {
    "Camera": ("scene", "Camera"),
    "Cancelled": ("scene", "Cancelled"),
    "Channel": ("scene", "Channel"),
    "Clip": ("scene", "Clip"),
    "Labels": ("scene", "Labels"),
    "Light": ("scene", "Light"),
    "Mist": ("scene", "Mist"),
    "Pose": ("scene", "Pose"),
    "Quality": ("scene", "Quality"),
    "Rendering": ("scene", "Rendering"),
    "RleSplatError": ("scene", "RleSplatError"),
    "Scene": ("scene", "Scene"),
    "Volume": ("volume.volume", "Volume"),
    "TransferFunction": ("classify.transfer_function", "TransferFunction"),
    "default_transfer_function": ("classify.default", "default_transfer_function"),
    "fit_preset": ("classify.presets", "fit_preset"),
    "preset": ("classify.presets", "preset"),
    "read_volume": ("read.formats", "read_volume"),
    "write_volume": ("read.formats", "write_volume"),
    "encode": ("pipeline.encode_scene", "encode_scene"),
    "encode_steps": ("pipeline.encode_scene", "encode_scene_steps"),
    "estimate_memory": ("pipeline.memory_estimate", "estimate"),
    "load_encoded": ("encode.store", "load"),
    "save_encoded": ("encode.store", "save"),
    "render": ("pipeline.render", "render"),
    "render_steps": ("pipeline.render", "render_steps"),
    "render_within": ("accuracy.planner.tolerance", "render_within"),
    "tolerance_steps": ("accuracy.planner.tolerance", "tolerance_steps"),
    "turntable": ("view.turntable", "turntable"),
}

__all__ = list(_HOME)


def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOME[name]
    value = getattr(import_module(f".{module}", __name__), attribute)
    globals()[name] = value
    return value


def __dir__():
    return sorted({*globals(), *__all__})


class _Facade(ModuleType):
    """This package, whose verbs ``render`` and ``encode`` are named as the rooms that they come from.

    Python sets a room as an attribute of its package when it is imported, which would hide the verb or not,
    depending on who imported what first; here the verb is always what the name means.
    """

    def __setattr__(self, name, value):
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Facade
