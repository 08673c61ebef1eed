"""numba's compiler as kernels need it: the same pictures, as quickly, from less compiling.

Most of what a first picture takes is numba's own Python: it looks for types again and again, walks each function for
what kernels do not have, compiles ``min`` and ``int`` as functions for each pair of types, and all the while Python's
collector looks through a million objects that stay.  Everything here leaves out such work.
"""

from __future__ import annotations

import builtins
import operator
from contextlib import contextmanager

import numpy
from numba import _dynfunc
from numba.core import cgutils, ir, types
from numba.core.base import BaseContext
from numba.core.compiler import Compiler, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import FunctionPass, LoweringPass, register_pass
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import NativeLowering, NopythonRewrites, NopythonTypeInference
from numba.core.typing.context import BaseContext as TypingContext
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from .interpreter import collector_paused, with_room
from .kernel_lowering import PlainLower

# Closures and expressions of whole arrays, which kernels do not have.
IDLE_PASSES = (InlineClosureLikes, NopythonRewrites)


@contextmanager
def _analysed_when_asked():
    """numba looks for what variables live where after each of its passes; only the last one's answers are used.

    Answers for all but generators are found when they are asked for; where variables end, which is what the last pass
    asks, at once.  numba's lock lets one thread compile at a time, so nobody else meets this.
    """
    at_once = PostProcessor.run

    def run(self, emit_dels=False, extend_lifetimes=False):
        function = self.func_ir
        if emit_dels or function.is_generator:
            at_once(self, emit_dels, extend_lifetimes)
            return
        function.blocks = canonicalize_cfg(function.blocks)
        function.variable_lifetime = VariableLifetime(function.blocks)
        function.generator_info = None

    PostProcessor.run = run
    try:
        yield
    finally:
        PostProcessor.run = at_once


_SIZES: dict = {}  # of registries, by what a context looks through each with, when it last did


@contextmanager
def _refreshed_where_grown():
    """numba looks through all its registries whenever a function or an intrinsic is begun; in here, through those
    alone that have grown since it last did."""
    if BaseContext.refresh.__module__ == __name__:  # a kernel that is compiled for another one
        yield
        return
    ordinary = [(of, of.refresh) for of in (BaseContext, TypingContext)]

    def where_grown(refresh):
        def run(context):
            sizes = {
                loader: sum(len(getattr(registry, kind)) for kind in loader.registry_items)
                for registry, loader in context._registries.items()
            }
            known = bool(sizes) and sizes.keys() <= _SIZES.keys()
            grown = [r for r, loader in context._registries.items() if sizes[loader] != _SIZES.get(loader)]
            _SIZES.update(sizes)  # as they are now, since looking through them may add to them
            if not known:
                refresh(context)
                return
            for registry in grown:
                context.install_registry(registry)
            if isinstance(context, BaseContext):
                context.typing_context.refresh()

        return run

    for of, refresh in ordinary:
        of.refresh = where_grown(refresh)
    try:
        yield
    finally:
        for of, refresh in ordinary:
            of.refresh = refresh


class _Options(Flags):
    """A kernel's options, which are compared, not by asking for them one by one, whenever a type is looked up."""

    NAMES = hash(tuple(sorted(Flags.options)))

    def __hash__(self):
        return self.NAMES  # as of numba's own, whose values may be anything

    def __eq__(self, other):
        return (type(other) is _Options and self._values == other._values) or super().__eq__(other)


class _RememberedTypes:
    """numba's typing context, with an answer for each question: inference asks each one about six times.

    What a function that is typed by overloads stands for is part of the answer, and depends on the options of the
    kernel that is being compiled, so these are part of the question.
    """

    _answers: dict = {}

    def __init__(self, context, options):
        self._context = context
        self._options = tuple((name, str(value)) for name, value in options.items())

    def __getattr__(self, name):
        return getattr(self._context, name)

    def resolve_function_type(self, function, arguments, named):
        if function is operator.getitem:
            function = self._context.resolve_value_type(function)
        if named or not isinstance(function, (types.Function, types.NumberClass, str)):
            return self._context.resolve_function_type(function, arguments, named)
        for options in (None, self._options):
            if (function, arguments, options) in self._answers:
                signature, means = self._answers[function, arguments, options]
                if means is not None:
                    function._impl_keys[signature.args] = means
                return signature
        signature = self._context.resolve_function_type(function, arguments, named)
        if signature is not None:
            means = function._impl_keys.get(signature.args) if isinstance(function, types.Function) else None
            options = None if means is None or means == function.typing_key else self._options
            self._answers[function, arguments, options] = (signature, means)
        return signature

    def resolve_static_getitem(self, value, index):
        remembering = self if type(index) is int else self._context
        return remembering.resolve_function_type("static_getitem", (value, index), ())

    def resolve_setitem(self, target, index, value):
        function = self._context.resolve_value_type(operator.setitem)
        return self.resolve_function_type(function, (target, index, value), {})


def _chosen(typing, a, b, comparison):
    """The second of two numbers where it compares so with the first, else the first, as Python's own functions do."""
    common = typing.unify_types(a, b)

    def generate(context, builder, signature, values):
        first, second = (
            context.cast(builder, value, kind, common) for value, kind in zip(values, (a, b), strict=True)
        )
        compare = context.get_function(comparison, types.boolean(common, common))
        return builder.select(compare(builder, (second, first)), second, first)

    return common(a, b), generate


@intrinsic
def _least(typing, a, b):
    return _chosen(typing, a, b, operator.lt)


@intrinsic
def _most(typing, a, b):
    return _chosen(typing, a, b, operator.gt)


@intrinsic
def _whole(typing, number):
    """A number without what is behind the point; whole ones keep their type."""
    kind = number if isinstance(number, types.Integer) else types.intp

    def generate(context, builder, signature, values):
        return context.cast(builder, values[0], number, kind)

    return kind(number), generate


@intrinsic
def _empty(typing, shape, kind):
    """``np.empty`` of a number or a tuple of numbers that are not negative, which fit into memory."""
    sizes = shape.types if isinstance(shape, types.BaseTuple) else (shape,)
    array_type = types.Array(kind.dtype, len(sizes), "C")

    def generate(context, builder, signature, values):
        given = cgutils.unpack_tuple(builder, values[0]) if isinstance(shape, types.BaseTuple) else values[:1]
        counts = [context.cast(builder, n, size, types.intp) for n, size in zip(given, sizes, strict=True)]
        element = context.get_data_type(array_type.dtype)
        itemsize = context.get_constant(types.intp, context.get_abi_sizeof(element))
        strides = [itemsize]
        for count in reversed(counts[1:]):
            strides.insert(0, builder.mul(strides[0], count))
        alignment = cgutils.int32_t(context.get_preferred_array_alignment(array_type.dtype))
        memory = context.nrt.meminfo_alloc_aligned(builder, builder.mul(strides[0], counts[0]), alignment)
        array = make_array(array_type)(context, builder)
        populate_array(
            array,
            data=builder.bitcast(context.nrt.meminfo_data(builder, memory), element.as_pointer()),
            shape=cgutils.pack_array(builder, counts),
            strides=cgutils.pack_array(builder, strides),
            itemsize=itemsize,
            meminfo=memory,
        )
        return array._getvalue()

    return array_type(shape, kind), generate


# What numba would compile as a function of its own for each combination of types and options: by the function that a
# kernel calls, how many arguments it has, and what to call in its place.
WRITTEN_OUT = {builtins.min: (2, _least), builtins.max: (2, _most), builtins.int: (1, _whole), numpy.empty: (2, _empty)}


@register_pass(mutates_CFG=False, analysis_only=False)
class _WriteOut(FunctionPass):
    """Put what WRITTEN_OUT says in place of Python's and numpy's own functions."""

    _name = "rle_splat_write_out"

    def __init__(self):
        FunctionPass.__init__(self)

    def run_pass(self, state):
        for block in state.func_ir.blocks.values():
            begun = {}  # names, and where they are given what they are
            for line in block.find_insts(ir.Assign):
                begun[line.target.name] = line
                call = line.value
                if not isinstance(call, ir.Expr) or call.op != "call" or call.func.name not in begun:
                    continue
                called = begun[call.func.name]
                for function, (arguments, instead) in WRITTEN_OUT.items():
                    if _is(function, called.value, begun) and len(call.args) == arguments and not call.kws:
                        called.value = ir.Global(function.__name__, instead, call.loc)
        return True


def _is(function, value, begun) -> bool:
    """Whether a value in a kernel is a function of Python's own, or one of numpy's as ``np.`` gives it."""
    if isinstance(value, ir.Global):
        return value.value is function
    owner = begun.get(value.value.name) if isinstance(value, ir.Expr) and value.op == "getattr" else None
    found = owner is not None and isinstance(owner.value, ir.Global) and owner.value.value is numpy
    return found and getattr(numpy, value.attr) is function


@register_pass(mutates_CFG=True, analysis_only=False)
class _PlainLowering(NativeLowering):
    _name = "rle_splat_plain_lowering"

    @property
    def lowering_class(self):
        return PlainLower


class KernelCompiler(Compiler):
    """numba's own passes but for the idle ones, with those above among them."""

    @with_room
    def compile_extra(self, func):
        self.state.flags = _Options(self.state.flags)
        with collector_paused(), _analysed_when_asked(), _refreshed_where_grown():
            return super().compile_extra(func)

    def define_pipelines(self):
        self.state.typingctx = _RememberedTypes(self.state.typingctx, self.state.flags.values())
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        kept = [(_PlainLowering if step is NativeLowering else step, why) for step, why in passes.passes]
        passes.passes = [(step, why) for step, why in kept if step not in IDLE_PASSES]
        passes.add_pass_after(_WriteOut, InlineInlinables)
        passes.finalize()
        return [passes]


# --- kernels that only other kernels call -----------------------------------------------------------------------


@register_pass(mutates_CFG=False, analysis_only=True)
class _BeginUnfinished(FunctionPass):
    """Give the function a library that is finished without being optimised or loaded.

    Nor is the function tidied up by itself before it is linked in (measured: 0.2 to 0.35 s of a first picture; frames
    take as long, and are the same to the bit).
    """

    _name = "rle_splat_begin_unfinished"

    def __init__(self):
        FunctionPass.__init__(self)

    def run_pass(self, state):
        library = state.targetctx.codegen().create_library(state.func_id.func_qualname)
        library.enable_object_caching()

        def leave():
            library._finalized = True

        library._optimize_functions = lambda module: None
        library._optimize_final_module = lambda: None
        library._finalize_final_module = leave
        state.library = library
        state.flags.no_compile = True
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _MakeKnown(LoweringPass):
    """Tell numba of the function, as it does of those that it loads, so that others can call it."""

    _name = "rle_splat_make_known"

    def __init__(self):
        LoweringPass.__init__(self)

    def run_pass(self, state):
        lowered = state["cr"]
        about = lowered.fndesc
        nowhere = 0  # there is no machine code to point to
        handle = _dynfunc.make_function(
            about.lookup_module(),
            about.qualname.split(".")[-1],
            "An inner kernel.",
            nowhere,
            lowered.env,
            (state.library,),
        )
        state.targetctx.insert_user_function(handle, about, [state.library])
        state["cr"] = lowered._replace(cfunc=handle)
        return False


class InnerCompiler(KernelCompiler):
    """For what is only ever linked into other kernels: left unfinished, for those to finish.

    numba optimises every function by itself, turns it to machine code, and then does both again wherever it is linked
    in; a loop three calls deep is finished four times.  What is only ever linked in needs none of the first three
    (measured: 9.5 s in place of 12.2 until the first picture ever).  Such a function has no way in from Python.
    """

    def define_pipelines(self):
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_BeginUnfinished, NopythonTypeInference)
        passes.add_pass_after(_MakeKnown, _PlainLowering)
        passes.finalize()
        return [passes]
