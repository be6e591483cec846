"""Many solves over scene keys: settled motions, points, sweeps, their file, executors, exponents. Draws nothing."""
