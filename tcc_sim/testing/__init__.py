"""Test kit for controllers: a driveline in lock-step as a pytest fixture, with optional faults and sensors."""
