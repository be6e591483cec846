import pytest

from my_clutch.node import Controller


@pytest.mark.parametrize("faults", [{"drop": 10}, {"delay": 5, "delay_ticks": 4}, {"duplicate": 3}, {"corrupt": 10}])
def test_it_holds_its_target_with_lost_late_doubled_or_corrupt_commands(driveline, faults):
    plant = driveline("controlled", faults=faults)
    plant.add(Controller())
    run = plant.run(seconds=1.2, target=20.0)
    assert run.tracking.verdict == "settled"
    assert run.refused == (120 if "corrupt" in faults else 0)
