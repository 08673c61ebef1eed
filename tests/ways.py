"""The two ways to compute: the kernels and the reference implementations in numpy.  Fixtures for them: conftest.py."""

import pytest

from rle_splat.runtime.jit import use_reference

WAYS = ("numba", "numpy")
# For tests with the fixture ``way`` that have no kernels to compile.
NUMPY = pytest.mark.parametrize("way", ("numpy",), indirect=True)

EVERY_TYPE = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")
RARE_TYPES = ("int8", "uint32")  # stored types whose kernels no zip brings; int32 stands for them in every run
# Each type in each way, but for the kernels of RARE_TYPES.
BY_TYPE = [(dtype, way) for way in WAYS for dtype in EVERY_TYPE if way == "numpy" or dtype not in RARE_TYPES]


def by(way: str):
    """Context manager: one of WAYS does the work."""
    return use_reference(way == "numpy")


def both(make, ways=WAYS) -> list:
    """What ``make()`` returns in each way."""
    found = []
    for way in ways:
        with by(way):
            found.append(make())
    return found


def compile_here() -> dict[str, str]:
    """Environment variables with which a process compiles for this processor, whatever kernels the package brings."""
    from llvmlite.binding import get_host_cpu_name
    from numba.core.codegen import get_host_cpu_features

    return {"NUMBA_CPU_NAME": get_host_cpu_name(), "NUMBA_CPU_FEATURES": get_host_cpu_features()}
