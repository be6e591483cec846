"""A folder for compiled kernels of a test's own."""

import pytest
from kernels_on_disk import forget, lowered_functions, made

from tcc_sim.compiling import kernel_cache, linked


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return the path of an empty cache that the package has not used yet; it prints its messages anew."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    printed = set(kernel_cache.announced)
    kernel_cache.announced.clear()
    monkeypatch.syspath_prepend(str(tmp_path))
    new_functions, functions = lowered_functions()
    forget()
    code = linked.machine_code
    monkeypatch.setattr(linked, "machine_code", lambda function, arguments: made.append(function)
                        or code(function, arguments))
    yield tmp_path / "caches" / "tcc_sim"
    forget()
    kernel_cache.new_functions.update(new_functions)
    linked.LoweredStore._functions.update(functions)
    kernel_cache.announced.clear()
    kernel_cache.announced.update(printed)
