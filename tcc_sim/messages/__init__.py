"""Message encoding shared by nodes and recordings: CDR and message definitions, without ROS or MCAP."""
