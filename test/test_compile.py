"""Compiling from several threads."""

import time
from concurrent.futures import ThreadPoolExecutor

import numba

from sma_sim.solver.compile import Compiler


def test_threads_do_not_take_each_others_cache_folder(tmp_path, monkeypatch):
    """numba's cache folder is a setting of the whole process: compilers at work at once must not see each other's."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    compilers = [Compiler(f'key{k}') for k in range(8)]
    seen = []

    def build(compiler):
        before = numba.config.CACHE_DIR
        time.sleep(0.01)
        seen.append({before, numba.config.CACHE_DIR, str(compiler.folder)})

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda compiler: compiler._cached(lambda: build(compiler)), compilers))
    assert len(seen) == 8 and all(len(one) == 1 for one in seen)
    assert numba.config.CACHE_DIR not in {str(compiler.folder) for compiler in compilers}
