"""The real-time tick in C, and around it a co-simulation FMU: sources and a binary that need neither Python nor ROS."""
