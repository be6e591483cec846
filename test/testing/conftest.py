"""The example is a separate project; test_example.py runs its tests."""

collect_ignore = ["example"]
