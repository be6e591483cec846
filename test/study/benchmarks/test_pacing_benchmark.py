"""The pacing benchmark with made-up loops and clocks: stretches, their figures, the trials and what is put together."""

import threading
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

pacing = pytest.importorskip("tcc_sim.study.benchmarks.pacing_benchmark", reason="ROS 2 is not installed")


def test_figures_of_a_loop_by_hand():
    """Two stretches: percentiles of all latenesses, late ticks of all ticks, processor time of all time."""
    loop = pacing.Stretches()
    late = [np.arange(1.0, 61.0), np.arange(61.0, 101.0)]
    loop.pacers = [SimpleNamespace(latenesses=lambda x=x: x, late_ticks=n, ticks=len(x)) for n, x in enumerate(late)]
    loop.cpu, loop.wall = 1.0, 4.0
    assert loop.figures("bare_") == pytest.approx({
        "bare_lateness_p50_s": 50.5, "bare_lateness_p99_s": 99.01, "bare_lateness_max_s": 100.0,
        "bare_late_share": 0.01, "bare_cpu_fraction": 0.25})
    given = {p.name: p.value for p in pacing.Settings(50, (2, 3), True).parameters()}
    assert given == {"thread_priority": 50, "lock_memory": True, "cpu_affinity": [2, 3]}
    assert {p.name: p.value for p in pacing.Settings().parameters()} == {"thread_priority": 0, "lock_memory": False}
    names, settings, slacks, leads = zip(*pacing._trials())
    core = settings[4].cpu_affinity
    assert len(core) == 1
    assert names == ("nothing asked for", "timer slack 1 ns", "slack, awake ahead", "slack, thread_priority 50",
                     f"slack, cpu_affinity [{core[0]}]", "slack, lock_memory", "all of these")
    assert settings == (*[pacing.Settings()] * 3, pacing.Settings(50), pacing.Settings(0, core), pacing.Settings(
        lock_memory=True), pacing.Settings(50, core, True))
    assert slacks == (50_000, *[pacing.TIMER_SLACK_NS] * 6)
    assert [lead > 0.0 for lead in leads] == [False, False, True, False, False, False, True]


class Ticks(pacing.Pacer):
    """A pacer of made-up latenesses."""

    def tick(self, *late):
        self._recent[:len(late)], self.ticks, self.late_ticks = late, len(late), sum(x > 1e-3 for x in late)


def test_both_loops_run_by_turns(monkeypatch):
    """Twelve seconds at 1 kHz in stretches of at most 5 s; the bare loop sleeps until its deadlines."""
    ran, done = [], []
    monkeypatch.setattr(pacing, "Pacer", Ticks)
    monkeypatch.setattr(pacing, "_node_stretch", lambda node, *task: ran.append((node, *task)))
    monkeypatch.setattr(pacing, "_bare_stretch", lambda *task: ran.append(("bare", task[0], task[1], task[2])))
    sides = pacing._alternated("node", 1000.0, 12.0, done.append, "settings")
    assert [(run[0], run[2]) for run in ran] == [(name, x) for x in (5.0, 5.0, 2.0) for name in ("node", "bare")]
    assert [run[3] for run in ran[1::2]] == ["settings"] * 3
    assert [[run[1] for run in ran[k::2]] for k in (0, 1)] == [side.pacers for side in sides]
    assert [len(run[1]._recent) for run in ran] == [7600] * 4 + [3100] * 2
    assert {run[1].period_ns for run in ran} == {1e6}
    assert [run[1]._lead_limit for run in ran] == [pytest.approx(1e9 * pacing.LEAD), 0.0] * 3
    assert done == pytest.approx([2.5 / 12, 5 / 12, 7.5 / 12, 10 / 12, 11 / 12, 1.0])


def test_processor_time_and_time_of_a_stretch(monkeypatch):
    clock = SimpleNamespace(monotonic=iter([10.0, 14.0, 20.0, 21.0]).__next__,
                            process_time=iter([1.0, 2.0, 2.0, 2.5]).__next__)
    monkeypatch.setattr(pacing, "time", clock)
    loop, ran = pacing.Stretches(), []
    for name in ("one", "two"):
        loop.run(name, lambda: ran.append(1))
    assert (loop.pacers, loop.cpu, loop.wall, ran) == (["one", "two"], 1.5, 5.0, [1, 1])


@pytest.mark.parametrize("locked", [True, False])
def test_a_trial_has_its_figures_and_refusals(locked, monkeypatch):
    asked, released = [], []
    monkeypatch.setattr(pacing, "Pacer", Ticks)
    monkeypatch.setattr(pacing, "release_memory", lambda: released.append(1))

    def stretch(pacer, *task):
        asked.append((len(pacer._recent), pacer.period_ns, pacer._lead_limit, *task))
        pacer.tick(1e-4, 2e-4, 3e-3)
        return ["no right"]

    monkeypatch.setattr(pacing, "_bare_stretch", stretch)
    settings = pacing.Settings(lock_memory=locked)
    trial = pacing._trial(500.0, 0.4, "a name", settings, 7, 2e-5)
    assert asked == [(400, 2e6, pytest.approx(2e4), 0.4, settings, 7)]
    assert (trial.name, trial.refused, released) == ("a name", ["no right"], [1] * locked)
    assert (trial.lateness_p50_s, trial.lateness_max_s, trial.late_share) == (2e-4, 3e-3, pytest.approx(1 / 3))


def test_the_bare_loop_waits_until_it_is_stopped():
    prepared, waits, here = [], [], threading.current_thread()
    pacer = SimpleNamespace(anchor=lambda: waits.append("anchor"), wait=lambda ended: waits.append(ended()))
    settings = SimpleNamespace(prepare=lambda slack: prepared.append((slack, threading.current_thread())) or ["no"])
    assert pacing._bare_stretch(pacer, 0.0, settings, 9) == ["no"]
    assert prepared[0][0] == 9
    assert prepared[0][1] is not here
    assert waits[:2] == ["anchor", False]
    pacing._bare_stretch(pacer, 0.0, settings)
    assert prepared[-1][0] == pacing.TIMER_SLACK_NS


def test_the_node_runs_for_its_stretch_and_pauses(monkeypatch):
    """Its housekeeping is done every tenth of a second."""
    said, slept = [], []
    times = iter([0.0, 0.0, 0.125, 0.25, 0.375])
    monkeypatch.setattr(pacing, "time", SimpleNamespace(monotonic=times.__next__, sleep=slept.append))
    loop = SimpleNamespace(pacer=None, request=lambda run: run())
    loop.pause = lambda paused: said.append((paused, loop.pacer))
    node = SimpleNamespace(loop=loop, housekeeping=lambda: said.append("kept"))
    pacing._node_stretch(node, "pacer", 0.3125)
    assert said == [(False, "pacer"), *["kept"] * 3, (True, "pacer")]
    assert slept == [0.1, 0.1, 0.0625]


@pytest.mark.parametrize(("recorder", "duration", "trial"), [(True, 10.0, 1.0), (False, 1.0, 0.2)])
def test_figures_of_both_loops_are_put_together(recorder, duration, trial, monkeypatch):
    """Drift is the largest of either sign; a recorder is waited for and stopped."""
    asked, parameters, said = [], {}, []
    node_side, bare_side = pacing.Stretches(), pacing.Stretches()
    for side, ticks in ((node_side, (3, 4)), (bare_side, (5,))):
        side.cpu, side.wall = 1.0, 2.0
        side.pacers = [SimpleNamespace(latenesses=lambda n=n: np.ones(n), ticks=n, late_ticks=1, missed_ticks=n - 2,
                                       drift=0.5 if n == 3 else -0.75) for n in ticks]
    loop = SimpleNamespace(clock_started=SimpleNamespace(wait=lambda limit: not recorder), request=lambda run: run(),
                           pause=lambda paused: said.append(f"paused {paused}"), plant=SimpleNamespace(
                               general_ready=SimpleNamespace(wait=lambda limit: said.append("compiled"))))

    def node(parameter_overrides):
        parameters.update({item.name: item.value for item in parameter_overrides})
        return SimpleNamespace(get_logger=lambda: SimpleNamespace(set_level=lambda level: None), loop=loop,
                               start=lambda: said.append("started"), destroy_node=lambda: said.append("destroyed"))

    for name, value in {
            "PrivateEnvironment": lambda: SimpleNamespace(values={}, close=lambda: said.append("closed")),
            "sys": SimpleNamespace(setswitchinterval=lambda interval: None),
            "rclpy": SimpleNamespace(init=lambda args: nullcontext()), "DrivelineNode": node,
            "created": lambda create: create(), "_trials": lambda: [("a", "b", 1, 0.5)],
            "NodeProcess": lambda name, *more: SimpleNamespace(check=lambda: said.append(f"checked {name}"),
                                                               stop=lambda: said.append(f"stopped {name}")),
            "_trial": lambda *task: asked.append(task) or "trial",
            "_alternated": lambda node, *task: asked.append(task) or (node_side, bare_side)}.items():
        monkeypatch.setattr(pacing, name, value)
    progress = object()
    figures = pacing.measure(500.0, duration, progress, recorder, pacing.Settings(lock_memory=True))
    assert asked == [(500.0, trial, "a", "b", 1, 0.5), (500.0, duration, progress, pacing.Settings(lock_memory=True))]
    assert parameters == {"scene": "fig02", "rate": 500.0, "thread_priority": 0, "lock_memory": True,
                          "wait_for_subscribers": int(recorder)}
    assert said == ["started", *["checked recorder"] * recorder, "paused True", "compiled", "destroyed",
                    *["stopped recorder"] * recorder, "closed"]
    assert (figures.rate, figures.ticks, figures.missed_ticks, figures.drift_s) == (500.0, 7, 3, -0.75)
    assert (figures.late_share, figures.bare_late_share, figures.settings) == (2 / 7, 0.2, ["trial"])
