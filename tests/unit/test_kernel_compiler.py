"""Compiling a kernel does nothing twice and nothing that it does not need, and changes nothing that it computes.

Counted, not timed: what numba is made to compile, and what it is asked.
"""

import gc
import math
from collections import Counter
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.runtime.jit import compiled, inner_loop, kernel

try:
    import resource
except ImportError:  # Windows
    resource = None

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from numba.core import analysis, event
from numba.core.compiler import Compiler, Flags
from numba.core.cpu import CPUContext
from numba.core.postproc import PostProcessor
from numba.core.typing.context import BaseContext
from numba.extending import overload

from rle_splat.runtime import kernel_cache, kernel_compiler


@pytest.fixture(autouse=True)
def nothing_on_disk(monkeypatch, tmp_path):
    """What was compiled when the tests ran before is compiled again."""
    monkeypatch.setattr(kernel_cache._Folder, "path", str(tmp_path))


@contextmanager
def compiled_functions():
    """The names of all functions that are compiled in here, numba's own among them."""
    names = []

    class Listener(event.Listener):
        def on_start(self, happened):
            names.append(happened.data["dispatcher"].py_func.__name__)

        def on_end(self, happened):
            pass

    with event.install_listener("numba:compile", Listener()):
        yield names


def test_small_functions_of_python_are_written_out_not_compiled_by_themselves():
    @kernel
    def ends(a, b, count):
        scratch = np.empty(count, np.float32)
        table = np.empty((count, 2), a.dtype)
        for i in range(count):
            scratch[i] = min(a[i], b[i])
            table[i, 0] = max(a[i], b[i])
            table[i, 1] = int(a[i] * b[i])
        return scratch, table

    with compiled_functions() as names:
        least, table = ends(np.array([1.5, -2.5]), np.array([2, -3]), 2)
    assert names == ["ends"]
    assert least.dtype == np.float32 and table.dtype == np.float64
    assert least.tolist() == [1.5, -3.0] and table.tolist() == [[2.0, 3.0], [-2.5, 7.0]]


@pytest.mark.parametrize("a", (1.0, -0.0, 0.0, math.nan, 3.0))
@pytest.mark.parametrize("b", (1.0, -0.0, 0.0, math.nan, -math.inf))
def test_least_and_most_are_as_pythons_own_choose(a, b):
    assert np.array(_ends(a, b)).tobytes() == np.array((min(a, b), max(a, b))).tobytes()


@kernel(exact=True)
def _ends(a, b):
    return min(a, b), max(a, b)


def test_least_of_three_is_still_compiled_by_numba():
    @kernel
    def least(a, b, c):
        return min(a, b, c)

    assert least(3, 1, 2) == 1


def test_memory_for_scratch_that_cannot_be_had_is_an_error():
    @kernel
    def fill(count):
        return np.empty(count, np.float64).size

    assert fill(3) == 3
    with pytest.raises(MemoryError):
        fill(2**57)


def test_pythons_collector_rests_while_a_kernel_is_compiled():
    runs = []
    enabled = gc.isenabled()

    @kernel
    def sums(values):
        total = values[0] * 2.0
        for value in values:
            total += value
        return total

    @kernel
    def refused(values):
        return values.no_such_thing

    gc.enable()
    gc.callbacks.append(lambda phase, about: runs.append(phase))
    try:
        gc.collect()
        runs.clear()
        sums.compile("float64(float64[::1])")
        assert runs.count("start") == 0 and gc.isenabled()  # nor is all that was made looked through when it is over
        with pytest.raises(Exception, match="no_such_thing"):
            refused(np.ones(3))
        assert gc.isenabled()
        gc.disable()
        sums.compile("float64(float32[::1])")
        assert not gc.isenabled()
    finally:
        gc.callbacks.pop()
        (gc.enable if enabled else gc.disable)()


def test_no_type_is_looked_up_twice(monkeypatch):
    asked = Counter()
    look_up = BaseContext.resolve_function_type

    def counted(context, function, arguments, named):
        asked[str(function), arguments] += 1
        return look_up(context, function, arguments, named)

    monkeypatch.setattr(BaseContext, "resolve_function_type", counted)
    monkeypatch.setattr(kernel_compiler._RememberedTypes, "_answers", {})  # whatever was compiled before

    @kernel
    def polynomial(x, out):
        for i in range(x.size):
            a, b = x[i], x[i] * x[i]
            out[i] = a * b + b * a + a * a * b * b + a + b + a + b

    polynomial(np.arange(3.0), np.empty(3))
    assert asked and set(asked.values()) == {1}


def test_what_a_kernel_is_given_by_overloads_has_its_own_options():
    def plus_product(a, b):
        return a + a * b

    @overload(plus_product)
    def plus_product_of_floats(a, b):
        return lambda a, b: a + a * b

    @kernel
    def contracted(a, b):
        return plus_product(a, b)

    @kernel(exact=True)
    def exact(a, b):
        return plus_product(a, b)

    @kernel
    def contracted_again(a, b):
        return plus_product(a, b)

    for compiled_one, has in ((contracted, True), (exact, False), (contracted_again, True)):
        compiled_one(1.0, 2.0)
        (text,) = compiled_one.inspect_llvm().values()
        assert ("fadd nsz arcp contract" in text) == has


def test_an_inner_loop_is_only_ever_linked_in():
    @inner_loop
    def doubled(x):
        return 2.0 * x

    @kernel
    def quadrupled(x):
        return doubled(doubled(x))

    with compiled_functions() as names:
        assert quadrupled(3.0) == 12.0
    assert sorted(names) == ["doubled", "quadrupled"]


def test_where_variables_end_is_looked_for_once(monkeypatch):
    looked = []
    dead_maps = analysis.compute_dead_maps

    def counted(*arguments):
        looked.append(arguments)
        return dead_maps(*arguments)

    monkeypatch.setattr(analysis, "compute_dead_maps", counted)
    ordinary = PostProcessor.run

    @kernel
    def halves(values):
        for i in range(values.size):
            values[i] *= 0.5 if values[i] > 1.0 else 2.0
        return values

    assert halves(np.array([4.0, 1.0])).tolist() == [2.0, 2.0]
    assert len(looked) == 1 and PostProcessor.run is ordinary


def test_registries_are_not_looked_through_for_kernels_within_kernels(monkeypatch):
    looked = []
    load = CPUContext.load_additional_registries

    def noted(context):
        looked.append(context)
        load(context)

    monkeypatch.setattr(CPUContext, "load_additional_registries", noted)

    @kernel
    def alone(x):
        return min(x, 2.0)

    @inner_loop
    def least(x):
        return min(x, 3.0)

    @inner_loop
    def most(x):
        return max(least(x), 1.0)

    @kernel
    def between(x):
        return int(most(x)) + least(x)

    assert alone(1.0) == 1.0  # whatever was imported since
    looked.clear()
    assert alone(np.float32(1.0)) == 1.0
    once = len(looked)
    looked.clear()
    assert between(2.5) == 4.5
    assert len(looked) == once and BaseContext.refresh.__module__ == BaseContext.__module__


def _costliest_call(depth: int, of: int = 100) -> float:
    """Page faults for each of ``of`` calls, at that depth of all up to ``depth`` below here where they are most."""
    faults = []

    def nothing():
        return None

    def further(left):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(of):
            nothing()
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
        if left:
            further(left - 1)

    further(depth)
    return max(faults) / of


@pytest.mark.skipif(resource is None, reason="this system does not count page faults")
def test_no_call_within_the_compiler_asks_the_system_for_memory(monkeypatch):
    if _costliest_call(300) < 1.0:
        pytest.skip("this Python keeps the memory of calls")
    monkeypatch.setattr(Compiler, "compile_extra", lambda *about: _costliest_call(300))

    class Bare(kernel_compiler.KernelCompiler):
        def __init__(self):
            self.state = SimpleNamespace(flags=Flags())

    assert Bare().compile_extra(None) < 0.5
