"""Compiled functions without machine code of their own: they become part of those that call them.

numba optimizes each function with all that it calls and makes machine code of it, and so does every function that calls
it: the innermost are compiled a dozen times. A fragment is only simplified; what Python calls is compiled once.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba._dynfunc
from llvmlite import binding
from numba.core import codegen, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from sma_sim.compiler.native_code_cache import NativeCodeCache

make_function: Any = numba._dynfunc.make_function
FRAGMENT, ENTRY = 1, 20  # work that is done when one of them is ready, in arbitrary units: their times are about 1 to 20
on_compiled: list[Callable[[int], None]] = []  # called with the work that was done
# Passes for parts of Python that the package's own functions do without.
NOT_NEEDED = (
    'WithLifting',
    'InlineClosureLikes',
    'RewriteSemanticConstants',
    'DeadBranchPrune',
    'GenericRewrites',
    'RewriteDynamicRaises',
    'MakeFunctionToJitFunction',
    'InlineInlinables',
    'FindLiterallyCalls',
    'LiteralUnroll',
    'LiteralPropagationSubPipelinePass',
    'InlineOverloads',
    'NopythonRewrites',
    'AnnotateTypes',
)
# Half of the optimizer's time is the search for the store that a load reads, in up to 100 instructions of each block.
binding.set_option('sma_sim', '-memdep-block-scan-limit=10')


class FragmentLibrary(codegen.JITCodeLibrary):
    """The code of one function, to be linked into its callers."""

    inlined = True

    def add_ir_module(self, ir_module: Any) -> None:
        """Take in the code, and say whether callers inline it."""
        for function in ir_module.functions:
            if not self.inlined and not function.is_declaration:
                function.attributes.add('noinline')
        super().add_ir_module(ir_module)

    def finalize(self) -> None:
        """Nothing more is added; neither optimized nor made into machine code."""
        self._finalized = True

    def own_module(self) -> Any:
        """A copy of this function's code, that a caller takes in if it needs it."""
        module = self._final_module.clone()
        for function in module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = 'linkonce_odr'
        return module

    def with_callees(self, seen: set[Any]) -> Iterator[Any]:
        """The modules of this function and of all that it calls, callers first."""
        seen.add(self)
        yield self.own_module()
        for library in self._linking_libraries:
            if library not in seen and isinstance(library, FragmentLibrary):
                yield from library.with_callees(seen)
            elif library not in seen:
                seen.add(library)
                yield library._get_module_for_linking().clone()

    def _get_module_for_linking(self) -> Any:
        first, *others = self.with_callees(set())
        for module in others:
            first.link_in(module)
        return first


@register_pass(mutates_CFG=True, analysis_only=False)
class FragmentLowering(NativeLowering):
    """Makes a fragment of a function whose types are known."""

    _name = 'fragment_lowering'

    def run_pass(self, state: Any) -> bool:
        """Lower; the function object that numba wants is an empty one."""
        library: Any = FragmentLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        library.inlined = bool(state.flags.forceinline)
        state.library, state.flags.no_compile = library, True
        super().run_pass(state)
        result = state['cr']
        described = result.fndesc
        empty = make_function(described.lookup_module(), described.qualname, '', 0, result.env, (library,))
        state.targetctx.insert_user_function(empty, described, [library])
        state['cr'] = result._replace(cfunc=empty)
        return True


class FragmentCompiler(CompilerBase):
    """numba's usual passes with another last one."""

    left_out: tuple[str, ...] = ()

    def define_pipelines(self) -> list[Any]:
        """The passes."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        needed = [(p, what) for p, what in passes.passes if p.__name__ not in self.left_out]
        passes.passes = [(FragmentLowering if p is NativeLowering else p, what) for p, what in needed]
        passes.finalize()
        return [passes]


class OwnFragmentCompiler(FragmentCompiler):
    """For functions of the package, which use a small part of Python."""

    left_out = NOT_NEEDED


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """The compiler makes millions of objects and keeps them: to look for garbage takes a twentieth of its time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class AnnouncingDispatcher(CPUDispatcher):
    """A function that says when it has been compiled."""

    work = 0

    def compile(self, sig: Any) -> Any:
        """As numba does it."""
        known = len(self.overloads)
        with without_garbage_collection():
            entry = super().compile(sig)
        if len(self.overloads) > known:
            for call in on_compiled:
                call(self.work)
        return entry


class Entry(AnnouncingDispatcher):
    """A function that Python calls."""

    work = ENTRY

    def enable_caching(self) -> None:
        """Keep the native code."""
        self._cache = NativeCodeCache(self.py_func)


class Fragment(AnnouncingDispatcher):
    """A function that other compiled functions can call, and Python cannot."""

    work = FRAGMENT

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """As numba does it, but a constant is a number as any other: no version of the function for it alone."""
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), kws)


def fragment(python: Callable[..., Any], inlined: bool) -> Any:
    """A fragment of a plain function; `inlined` wherever it is called, or nowhere."""
    options = {
        'nopython': True,
        'nogil': True,
        'error_model': 'numpy',
        'forceinline': inlined,
        '_nrt': False,  # no reference counts: our functions allocate nothing, and counting costs ten times the arithmetic
        'no_cpython_wrapper': True,
        'no_cfunc_wrapper': True,
    }
    compiler = OwnFragmentCompiler if str(python.__module__).startswith('sma_sim.') else FragmentCompiler
    return Fragment(python, targetoptions=options, pipeline_class=compiler)
