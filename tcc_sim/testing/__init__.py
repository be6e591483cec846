"""A test kit for those who write controllers: a driveline in lock-step as a pytest fixture, with faults on request."""
