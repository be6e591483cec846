"""A folder for compiled kernels of a test's own."""

import pytest
from kernels_on_disk import made

from tcc_sim.solvers.compiling import kernel_cache, linked


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty folder for caches that the package has not looked at yet; what it says is told again."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    said = set(kernel_cache.announced)
    kernel_cache.announced.clear()
    monkeypatch.syspath_prepend(str(tmp_path))
    kernel_cache.directory.cache_clear()
    code = linked.machine_code
    monkeypatch.setattr(linked, "machine_code", lambda part, arguments: made.append(part) or code(part, arguments))
    yield tmp_path / "caches" / "tcc_sim"
    kernel_cache.directory.cache_clear()
    kernel_cache.announced.clear()
    kernel_cache.announced.update(said)
