"""The driveline in real time, and what may control it: free of ROS."""
