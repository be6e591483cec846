from my_clutch.node import Controller


def test_the_node_holds_its_target_through_a_step_of_the_engine_torque(driveline):
    plant = driveline("controlled")
    plant.add(Controller())
    run = plant.run(seconds=1.2, target=20.0)
    assert run.tracking.verdict == "settled"
    assert run.tracking.overshoot < 6.0
    plant.change({"engine.mean_torque": 250.0})
    after = plant.run(seconds=1.2, target=20.0)
    assert after.tracking.peak_deviation < 15.0
    assert after.tracking.settling_time < 1.0
