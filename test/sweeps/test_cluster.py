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

from tcc_sim.errors import InputError, WorkersLost
from tcc_sim.model.parameters import System, replace
from tcc_sim.sweeps.executors import cluster, each_done, in_time
from tcc_sim.sweeps.gains import gain_map
from tcc_sim.sweeps.sweep import Curve, Plan, sweep, sweep_curves

distributed = pytest.importorskip("distributed")


def started(*words: str) -> subprocess.Popen[bytes]:
    """A Dask process in a separate session."""
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen([sys.executable, "-m", "distributed.cli." + words[0], *words[1:]], env=environment,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def test_a_cluster_without_workers_and_one_whose_processes_die(tmp_path, refused):
    """Without workers the command is refused; a killed worker loses nothing; without the last one, or with a dead
    scheduler, the work ends.
    """
    file = tmp_path / "scheduler.json"
    quiet = ["--no-dashboard", "--scheduler-file", str(file)]
    processes = [started("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *quiet)]

    def worker(k: int) -> subprocess.Popen[bytes]:
        return started("dask_worker", "--nworkers", "1", "--nthreads", "1", "--no-nanny", "--local-directory",
                       str(tmp_path / str(k)), *quiet)

    def lost(victim: subprocess.Popen[bytes]) -> None:
        """Kill a process once the first result has come."""
        tasks = iter(range(1000))
        with cluster(address, patience=0.5) as (executor, attendance):
            results = each_done(attendance, lambda: next(tasks, None), lambda task: executor.submit(pow, task, 2))
            next(results)
            victim.kill()
            with pytest.raises(WorkersLost):
                list(results)

    try:
        with distributed.Client(scheduler_file=str(file), timeout=120, set_as_default=False) as client:
            address = client.scheduler.address
            assert address in refused("sweep", "chaos", "--over", "engine.frequency=100:160:4", "--out", "o.jsonl",
                                      "--dask", address)
            processes += [worker(k) for k in range(2)]
            client.wait_for_workers(2, timeout=120)
        system = replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.285,
                                    "pressure.mean": 225e3, "pressure.amplitude": 0.0})
        values, points = tuple(np.linspace(40.0, 160.0, 48).tolist()), []

        def tick(point) -> None:
            points.append(point)
            if len(points) == 12:
                processes[1].kill()

        far, = sweep_curves([Curve(system, "engine.frequency", values)], Plan(cycles=100), dask=address,
                            out=tmp_path / "far.jsonl", tick=tick)
        assert processes[1].wait(120) == -signal.SIGKILL
        near = sweep(system, "engine.frequency", values, Plan(cycles=100))
        for one, other in zip(far.records, near.records):
            assert {**one, "elapsed_s": 0.0} == {**other, "elapsed_s": 0.0}
        (tmp_path / "law.py").write_text("def law(gain):\n    return lambda state: 80e3 + gain * state.slip_speed\n")
        maps = [gain_map("controlled", f"{tmp_path / 'law.py'}:law", {"gain": [500.0, 2000.0]}, 20.0, 0.3, **where)
                for where in ({"dask": address}, {"jobs": 1})]
        for name, column in maps[0].columns().items():
            np.testing.assert_array_equal(column, maps[1].columns()[name])
        lost(processes[2])  # The last worker; the scheduler would wait for another one.
        with distributed.Client(address, timeout=120, set_as_default=False) as client:
            processes.append(worker(2))
            client.wait_for_workers(1, timeout=120)
        lost(processes[0])
    finally:
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.parametrize("address", [
    "tcp://127.0.0.1:{port}", "127.0.0.1:{port}", "tcp://no-such-host.invalid:8786", "tcp://127.0.0.1",
    "tcp://127.0.0.1:99999", "", "tcp://a b:1", "ftp://h:1", "h:0", "h:65536", "h:123456", "h", "tcp://h:1/x",
    "tcp://:1"])
def test_an_unreachable_scheduler_is_one_line_and_nothing_is_written(address, refused):
    """Nothing listens at a port that was closed just now; `.invalid` never resolves (RFC 2606)."""
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    line = refused("sweep", "slip", "--over", "engine.torque_amplitude=1:2:2", "--out", "out.jsonl", "--dask",
                   address.format(port=port))
    assert "--dask" in line
    assert ("answers" in line) == ("{port}" in address or "invalid" in address)


def test_a_port_that_is_no_scheduler_is_given_up_in_time() -> None:
    """It accepts the connection and never answers."""
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        with (pytest.raises(InputError, match="--dask"),
              cluster(f"tcp://127.0.0.1:{silent.getsockname()[1]}", connect=0.4)):
            pass


def test_a_function_that_does_not_come_back_is_not_waited_for() -> None:
    never = threading.Event()
    with pytest.raises(TimeoutError):
        in_time(time.monotonic() + 0.01, never.wait)
    never.set()
    assert in_time(time.monotonic() + 60.0, lambda: 3) == 3
