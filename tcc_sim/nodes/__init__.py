"""The ROS 2 nodes: thin shells around parts that know nothing of ROS; the only place that imports rclpy."""
