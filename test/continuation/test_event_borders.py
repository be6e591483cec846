"""Kinds of change of the event sequence, and Den Hartog's oscillator as a map with saltation."""


import numpy as np
import pytest

from tcc_sim.continuation.problem import Margin
from tcc_sim.continuation.sliding import differ, kind_of_change, ring

NEAR = ({}, {})


def test_sequences_are_rings() -> None:
    assert ring("S+S") == ring("+S") == ring("+S+")
    assert not differ("S+S-S", "-S+S-")
    assert differ("S+S", "S+S+S")
    assert ring("") == ""
    assert ring("S") == "S"


@pytest.mark.parametrize(("before", "after", "kind"), [
    ("S", "S+S", "stick_border"), ("S-S+S", "S", "stick_border"),
    ("+", "+S+", "grazing_sliding"), ("S+S-", "S+S+S-", "adding_sliding"),
    ("S+-S", "S+S-S", "crossing_sliding"), ("S+S", "S+-S", "switching_sliding"),
    ("-", "-S-S-", "grazing_sliding"), ("+-", "+S-S", "crossing_sliding"),
])
def test_the_change_of_a_sequence_names_its_kind(before: str, after: str, kind: str) -> None:
    assert kind_of_change(before, after, NEAR) == kind
    assert kind_of_change(after, before, NEAR) == kind


def test_the_smallest_margin_decides_where_several_events_change() -> None:
    near = {name: Margin(size, np.zeros(2)) for name, size in (("grazing", 1e-9), ("arrival", 0.2), ("stick", 0.3))}
    assert kind_of_change("+S-", "+S-S+S-S+-", (near, {})) == "grazing_sliding"
