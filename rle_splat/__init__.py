"""RLE Splat: volumes of measured data splatted through run-length encoded slices into sheet buffers.

The names below are all a script needs.  They are looked up when first used, so that a command that only reads a
header never waits for the renderer's compiled kernels to load.
"""

from importlib import import_module

# One table: public name -> the module that holds it.
_HOME = {
    "Camera": "scene",
    "Cancelled": "scene",
    "Light": "scene",
    "Quality": "scene",
    "Rendering": "scene",
    "RleSplatError": "scene",
    "Scene": "scene",
    "Volume": "volume.volume",
    "TransferFunction": "classify.transfer_function",
    "default_transfer_function": "classify.default",
    "preset": "classify.presets",
    "fit_preset": "classify.presets",
    "read_volume": "read.formats",
    "classify": "classify.classification",
    "shade": "classify.shading",
    "encode": "encode.encode",
    "decode": "encode.decode",
    "render": "render",
    "render_steps": "render",
    "turntable": "view.turntable",
}

__all__ = sorted(_HOME)


def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted({*globals(), *__all__})
