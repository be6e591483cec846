"""Results and kernels are the same on every processor of the level: the same bits whatever kernels OpenBLAS takes, and
whichever of its loops NumPy does.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numpy", "2", reason="the OpenBLAS of NumPy 1.23 changes the last bits of a fit")
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

SOLVES = """
import hashlib
import numpy as np
from tcc_sim.model.friction_curve import fit_curve
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve

def digest(*values):
    return hashlib.sha256(b"".join(np.ascontiguousarray(value).tobytes() for value in values)).hexdigest()[:16]

for name, changes in (("fig02", {}), ("chaos", {"friction.law": "set_valued"}), ("fresh_fluid", {}), ("tip_in", {})):
    run = solve(load_scene(name).with_values(changes), cycles=20)
    print(name, digest(run.t, run.slip_speed, run.plate_angle))
v = [5.0 * k for k in range(8)]
curve = fit_curve(tuple(v), tuple(0.13 - 0.03 * x / (x + 3.0) for x in v))
print(digest(curve.constant, curve.amplitudes, curve.rates, curve.error, curve.error_between))
"""
OTHER = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": " ".join(
    name for name in __cpu_dispatch__ if ("AVX512" in name or name == "X86_V4") and __cpu_features__[name])}
"""Has OpenBLAS take kernels without AVX, and NumPy no loops for processors beyond the level that this one has."""


def test_other_kernels_of_openblas_and_loops_of_numpy_change_no_bit_and_compile_nothing(tmp_path: Path) -> None:
    clean = {name: value for name, value in os.environ.items() if name not in OTHER}
    command, outcomes = [sys.executable, "-W", "ignore", "-c", SOLVES], []
    for changes in ({}, OTHER):
        done = subprocess.run(command, capture_output=True, text=True, check=True,
                              env={**clean, "NUMBA_CACHE_DIR": str(tmp_path), **changes})
        kept = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
        outcomes.append((done.stdout, kept, done.stderr if changes else ""))
    assert outcomes[1] == (*outcomes[0][:2], "")


def test_a_command_with_linear_algebra_writes_the_same_bits(tmp_path: Path) -> None:
    """Other kernels of OpenBLAS and other loops of NumPy write the file that those of this processor write."""
    words, written = "continue chaos --over friction.kinetic_coefficient=0.29:0.3", []
    for name, other in (("here", {}), ("there", OTHER)):
        done = subprocess.run([sys.executable, "-m", "tcc_sim", *words.split(), "--json", f"{name}.json"], cwd=tmp_path,
                              env={**os.environ, **other}, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        written.append(json.loads((tmp_path / f"{name}.json").read_text()))
        for differing in "command", "seconds":
            written[-1].pop(differing, None)
    assert written[0] == written[1]
