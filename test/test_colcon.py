"""The package as colcon builds and tests it, where colcon is installed; `.ci/run` installs it and runs more of the
tests.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NEEDED = ("colcon_core", "colcon_ros", "colcon_python_setup_py", "colcon_test_result", "setuptools")
MISSING = [name for name in NEEDED if importlib.util.find_spec(name) is None]
PARTS = ("tcc_sim", "test", "config", "resource")
TESTS = ("test/test_scenes.py", "test/model", "test/solvers/test_scalar.py")


@pytest.mark.skipif(bool(MISSING), reason=f"colcon is not installed here ({', '.join(MISSING)}); .ci/run installs it")
def test_the_package_that_colcon_built_passes_colcon_test(tmp_path: Path) -> None:
    source = tmp_path / "src" / "tcc_sim"
    for part in PARTS:
        shutil.copytree(ROOT / part, source / part, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ROOT.iterdir():
        if file.is_file() and not file.name.startswith("."):
            shutil.copy(file, source / file.name)
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTEST_XDIST_WORKER")}

    def colcon(*words: str) -> str:
        ended = subprocess.run([sys.executable, "-m", "colcon", *words], cwd=tmp_path, env=environment,
                               capture_output=True,
                               text=True, timeout=300, check=False)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    assert "1 package finished" in colcon("build", "--event-handlers", "console_direct-")
    assert (tmp_path / "install/tcc_sim/lib/tcc_sim/driveline_node").is_file()
    assert (tmp_path / "install/tcc_sim/share/tcc_sim/config/fig02.yaml").is_file()
    colcon("test", "--event-handlers", "console_direct-", "--return-code-on-test-failure", "--pytest-args", *TESTS)
    summary = colcon("test-result")
    assert "0 errors, 0 failures" in summary
    assert int(summary.split("Summary: ")[1].split()[0]) > 50
