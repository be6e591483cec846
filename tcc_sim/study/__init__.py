"""Rooms for those who study motions and methods: branches, basins, the paper, benchmarks.

The rooms outside of this one are the core: they run, record, replay, judge, identify and export, and import nothing of
the study. `later_rooms` names the few functions of it that the core calls.
"""
