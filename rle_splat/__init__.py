"""RLE Splat: splatting of run-length encoded volumes with sheet buffers.

The names in ``__all__`` are the scripting interface. Each name is imported when it is first used, so a command that
only reads a file header does not load the compiled kernels.
"""

import sys
from importlib import import_module
from types import ModuleType

# Public name -> (module that defines it, name in that module), by task, as docs/reference/python.md lists them.
_HOME = {
    # read and write
    "read_volume": ("read.formats", "read_volume"),
    "read_steps": ("read.formats", "read_steps"),
    "read_labels": ("read.labels", "read_labels"),
    "write_volume": ("read.formats", "write_volume"),
    "write_steps": ("read.formats", "write_steps"),
    "Volume": ("volume.volume", "Volume"),
    "NamedLabel": ("volume.volume", "NamedLabel"),
    # transfer functions
    "fit_preset": ("classify.presets", "fit_preset"),
    "preset": ("classify.presets", "preset"),
    "default_transfer_function": ("classify.default", "default_transfer_function"),
    "read_transfer_functions": ("classify.transfer_files", "read_transfer_functions"),
    "fit_function": ("classify.transfer_files", "fit_function"),
    "TransferFunction": ("classify.transfer_function", "TransferFunction"),
    "Shade": ("classify.transfer_function", "Shade"),
    "GradientOpacity": ("classify.transfer_function", "GradientOpacity"),
    "FileFunction": ("classify.foreign", "FileFunction"),
    # what is in the picture
    "Scene": ("scene", "Scene"),
    "turntable": ("view.turntable", "turntable"),
    "turntable_aim": ("view.turntable", "turntable_aim"),
    "look_at": ("view.look_at", "look_at"),
    "Camera": ("scene", "Camera"),
    "Light": ("scene", "Light"),
    "Environment": ("scene", "Environment"),
    "Mist": ("scene", "Mist"),
    "Clip": ("scene", "Clip"),
    "Labels": ("scene", "Labels"),
    "hide_table": ("segment.body", "hide_table"),
    "Channel": ("scene", "Channel"),
    "Pose": ("scene", "Pose"),
    # pictures
    "render": ("pipeline.render", "render"),
    "render_steps": ("pipeline.render", "render_steps"),
    "render_within": ("accuracy.planner.tolerance", "render_within"),
    "tolerance_steps": ("accuracy.planner.tolerance", "tolerance_steps"),
    "Quality": ("scene", "Quality"),
    "Rendering": ("scene", "Rendering"),
    "write_picture": ("cli.images", "write_picture"),
    "StageCache": ("pipeline.stage_cache", "StageCache"),
    "Progress": ("runtime.steps", "Progress"),
    "Cancelled": ("scene", "Cancelled"),
    "RleSplatError": ("scene", "RleSplatError"),
    # encoded volumes
    "encode": ("pipeline.encode_scene", "encode_scene"),
    "encode_steps": ("pipeline.encode_scene", "encode_scene_steps"),
    "encode_folder": ("pipeline.encode_folder", "encode_folder"),
    "save_encoded": ("encode.store", "save"),
    "load_encoded": ("encode.store", "load"),
    "StoredVolume": ("encode.stored", "StoredVolume"),
    "estimate_memory": ("pipeline.quick_estimate", "estimate"),
    "MemoryEstimate": ("pipeline.memory_estimate", "MemoryEstimate"),
}

__all__ = list(_HOME)
_HOME["__version__"] = ("runtime.cache_folder", "RELEASE")


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
    """Module class that keeps the functions ``render`` and ``encode`` from being hidden by modules of the same name.

    When Python imports a subpackage, it sets it as an attribute of the package. This class ignores the assignment for
    public names, so ``rle_splat.encode`` is always the function.
    """

    def __setattr__(self, name, value):
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Facade
