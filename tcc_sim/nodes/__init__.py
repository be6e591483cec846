"""ROS 2 nodes: thin shells around parts without ROS; together with `testing` the only packages that import rclpy."""
