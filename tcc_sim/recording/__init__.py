"""Recordings: writing, reading and recovering rosbag2 bags in MCAP files; the only place that imports mcap."""
