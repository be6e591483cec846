from rclpy.parameter import Parameter

from my_clutch.timed import TimedController


def test_a_timer_of_5_ms_holds_the_target(driveline):
    plant = driveline("controlled")
    plant.add(TimedController(parameter_overrides=[Parameter("use_sim_time", value=True)]))
    run = plant.run(seconds=2.4, target=20.0)
    assert abs(run.slip_speed[-1000:].mean() - 20.0) < 0.5
    assert run.tracking.verdict == "settled"
