import tcc_sim
from my_clutch.law import HoldSlip


def test_the_law_holds_its_target():
    law = HoldSlip(target=20.0)
    run = tcc_sim.closed_loop("controlled", lambda reading: law.update(reading.slip_speed), seconds=3.0)
    assert abs(run.slip_speed[-1000:].mean() - 20.0) < 0.5
    assert run.refused == 0
