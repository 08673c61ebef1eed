"""numba's compiler for kernels that only other kernels call: left unfinished, for those to finish.

numba optimises every function by itself, turns it to machine code, and then does both again wherever it is linked in;
a loop three calls deep is finished four times.  What is only ever linked in needs none of the first three
(measured: 9.5 s in place of 12.2 until the first picture ever).  Such a function has no way in from Python.
"""

from __future__ import annotations

from numba import _dynfunc
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, LoweringPass, register_pass
from numba.core.typed_passes import NativeLowering, NopythonTypeInference


@register_pass(mutates_CFG=False, analysis_only=True)
class _BeginUnfinished(FunctionPass):
    """Give the function a library that is finished without being optimised or loaded."""

    _name = "rle_splat_begin_unfinished"

    def __init__(self):
        FunctionPass.__init__(self)

    def run_pass(self, state):
        library = state.targetctx.codegen().create_library(state.func_id.func_qualname)
        library.enable_object_caching()

        def leave():
            library._finalized = True

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
            about.lookup_module(), about.qualname.split(".")[-1], "An inner kernel.", nowhere, lowered.env,
            (state.library,),
        )
        state.targetctx.insert_user_function(handle, about, [state.library])
        state["cr"] = lowered._replace(cfunc=handle)
        return False


class InnerCompiler(Compiler):
    """numba's own passes, with the two above among them."""

    def define_pipelines(self):
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_BeginUnfinished, NopythonTypeInference)
        passes.add_pass_after(_MakeKnown, NativeLowering)
        passes.finalize()
        return [passes]
