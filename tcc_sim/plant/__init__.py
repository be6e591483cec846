"""The driveline solved tick by tick, its sensors and the example controller, without ROS."""
