"""Scene keys take and refuse what the page on scenes states."""

from __future__ import annotations

import pytest
from ranges import Stated, check, of_page, shown

from tcc_sim.model.parameters import DEFAULTS, GROUPS, QUANTITIES, coerce

STATED = of_page("scenes")


def test_every_key_is_on_the_page() -> None:
    assert [*QUANTITIES] == [*STATED]


@pytest.mark.parametrize(("key", "stated"), STATED.items(), ids=STATED)
def test_a_key_takes_its_range_and_refuses_the_rest_by_a_sentence(key: str, stated: Stated) -> None:
    group, name = key.split(".")
    default = DEFAULTS[key]
    assert shown(default) == stated.default
    several = isinstance(default, tuple)
    kind = str if isinstance(default, str) else float
    check(key, stated.allowed, kind, lambda value: coerce(key, [value] if several else value))
    check(key, stated.allowed, kind, lambda value: GROUPS[group](**{name: (value,) if several else value}))
