"""Encoding that nodes and recordings share: CDR and message definitions, free of ROS and of MCAP."""
