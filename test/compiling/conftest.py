"""A folder for compiled kernels of a test's own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tcc_sim.compiling import kernel_cache


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the path of a cache that does not exist yet; the package prints its messages anew."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    printed = set(kernel_cache.announced)
    kernel_cache.announced.clear()
    kernel_cache.directory.cache_clear()
    yield tmp_path / "caches" / "tcc_sim"
    kernel_cache.directory.cache_clear()
    kernel_cache.announced.clear()
    kernel_cache.announced.update(printed)
