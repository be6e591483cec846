"""Cache of results of a system: by identity, of limited size, and safe for threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers.terms import RESULTS_KEPT, per_system


def test_a_result_is_worked_out_once_for_an_object_and_a_number():
    asked = []

    @per_system
    def doubled(system, rtol):
        asked.append((system, rtol))
        return system.engine.frequency * 2.0 + rtol

    one, equal = System(), System()
    assert doubled(one, 1.0) == doubled(one, 1.0) == doubled(equal, 1.0)
    assert doubled(one, 2.0) == doubled(one, 1.0) + 1.0
    assert [(system is one, rtol) for system, rtol in asked] == [(True, 1.0), (False, 1.0), (True, 2.0)]


def test_only_the_last_are_kept_and_threads_do_not_mix_them_up():
    asked = []

    @per_system
    def frequency(system):
        asked.append(system)
        return system.engine.frequency

    systems = [replace(System(), {"engine.frequency": 100.0 + k}) for k in range(3 * RESULTS_KEPT)]
    with ThreadPoolExecutor(4) as executor:
        assert list(executor.map(frequency, systems * 3)) == [system.engine.frequency for system in systems] * 3
    before = len(asked)
    assert frequency(systems[-1]) == systems[-1].engine.frequency
    assert len(asked) == before
    frequency(systems[0])
    assert len(asked) == before + 1
