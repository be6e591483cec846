"""What is written for people and programs: replays, tables, files of samples, reports. Nothing here reads a command line."""
