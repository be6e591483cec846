"""Export of the real-time tick as a co-simulation FMU: C sources and a binary without Python and ROS."""
