"""RLE Splat: splatting of run-length encoded volumes with sheet buffers.

``__init__.pyi`` lists the scripting interface. Each name is imported when it is first used, so a command that only
reads a file header does not load the compiled kernels.
"""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

# Public name -> module that defines it, from lines "from .MODULE import NAME as NAME".
_LINES = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
_HOME = {words[-1]: words[1] for words in map(str.split, _LINES) if words[:1] == ["from"]}
__all__ = list(_HOME)


def __getattr__(name):
    if name == "__version__":
        value = import_module(".runtime.cache_folder", __name__).RELEASE
    elif name in _HOME:
        value = getattr(import_module(_HOME[name], __name__), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
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
