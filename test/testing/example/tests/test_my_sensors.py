from my_clutch.node import Controller


def test_it_holds_its_target_with_a_noisy_and_late_speed(driveline):
    plant = driveline("controlled")
    plant.add(Controller())
    plant.sensor("flywheel_speed", noise=0.5, quantum=0.1, seed=1)
    plant.sensor("joint_states", delay_ticks=5, drop=20)
    run = plant.run(seconds=1.2, target=20.0)
    assert run.tracking.verdict == "settled"
