"""The paper's physics: parameters, friction laws, equations of motion, closed forms. No time stepping, files or ROS."""
