"""Sweeps on a real Dask scheduler with worker processes that are killed, and addresses where none answers."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.sweeps.executors import cluster, in_time
from tcc_sim.sweeps.settings import Settings
from tcc_sim.sweeps.sweep import Plan, sweep

distributed = pytest.importorskip("distributed")


def started(*words: str) -> subprocess.Popen[bytes]:
    """A Dask process in a separate session."""
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen([sys.executable, "-m", "distributed.cli." + words[0], *words[1:]], env=environment,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def test_a_cluster_without_workers_and_one_whose_processes_die(tmp_path, monkeypatch, on_point, capsys):
    """One line says that there is nobody to work; a killed worker loses nothing; a dead scheduler ends the sweep, which
    can be resumed.
    """
    file, out = tmp_path / "scheduler.json", tmp_path / "out.jsonl"
    quiet = ["--no-dashboard", "--scheduler-file", str(file)]
    command = ["sweep", "chaos", "--over", "engine.frequency=100:160:40", "--cycles", "1000", "--out", str(out)]
    processes = [started("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *quiet)]
    try:
        with distributed.Client(scheduler_file=str(file), timeout=120, set_as_default=False) as client:
            address = client.scheduler.address
            assert main([*command, "--dask", address]) == 2
            assert "has no workers" in capsys.readouterr().err
            processes += [started("dask_worker", "--nworkers", "1", "--nthreads", "1", "--no-nanny",
                                  "--local-directory", str(tmp_path / str(k)), *quiet) for k in range(2)]
            client.wait_for_workers(2, timeout=120)
        system = replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.285,
                                    "pressure.mean": 225e3, "pressure.amplitude": 0.0})
        values = [float(x) for x in np.linspace(40.0, 160.0, 48)]
        monkeypatch.setattr("tcc_sim.sweeps.executors.DEFAULTS", Settings(look=0.01))  # Workers are asked for at once.
        on_point(lambda count: processes[1].kill() if count == 12 else None)
        far = sweep(system, "engine.frequency", values, Plan(cycles=100), dask=address, out=tmp_path / "far.jsonl")
        assert processes[1].wait(120) == -signal.SIGKILL
        near = sweep(system, "engine.frequency", values, Plan(cycles=100))
        for one, other in zip(far.records, near.records):
            assert {**one, "elapsed_s": 0.0} == {**other, "elapsed_s": 0.0}
        monkeypatch.setattr("tcc_sim.sweeps.executors.DEFAULTS", Settings(look=0.01, patience=0.5))
        on_point(lambda count: processes[0].kill())
        assert main([*command, "--dask", address]) == 1
        assert "resumes from" in capsys.readouterr().err
        assert len(out.read_text().splitlines()) > 1
    finally:
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.parametrize(("address", "words"), [
    ("tcp://127.0.0.1:{port}", "no Dask scheduler answers"), ("127.0.0.1:{port}", "no Dask scheduler answers"),
    ("tcp://no-such-host.invalid:8786", "no Dask scheduler answers"), ("tcp://127.0.0.1", "must be an address"),
    ("tcp://127.0.0.1:99999", "must be an address"), ("", "must be an address"), ("tcp://a b:1", "must be an address")])
def test_an_unreachable_scheduler_is_one_line_and_nothing_is_written(address, words, tmp_path, monkeypatch, capsys):
    """Nothing listens at a port that was closed just now; `.invalid` never resolves (RFC 2606)."""
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]

    def too_far(*words: object, **options: object) -> None:
        raise AssertionError("the scheduler was asked though nothing listens")

    monkeypatch.setattr(distributed, "Client", too_far)
    out = tmp_path / "out.jsonl"
    assert main(["sweep", "slip", "--over", "engine.torque_amplitude=1:2:2", "--dask", address.format(port=port),
                 "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert words in said
    assert not out.exists()


def test_a_port_that_is_no_scheduler_is_given_up_in_time() -> None:
    """It accepts the connection and never answers."""
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        with (pytest.raises(InputError, match="no Dask scheduler"),
              cluster(f"tcp://127.0.0.1:{silent.getsockname()[1]}", connect=0.4)):
            pass


def test_what_does_not_come_back_is_not_waited_for() -> None:
    never = threading.Event()
    with pytest.raises(TimeoutError):
        in_time(time.monotonic() + 0.01, never.wait)
    never.set()
    assert in_time(time.monotonic() + 60.0, lambda: 3) == 3
