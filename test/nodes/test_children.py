"""What child processes are given, without starting any."""

from __future__ import annotations

import math

import pytest

from tcc_sim.errors import InputError
from tcc_sim.nodes import children


def test_that_a_node_compiles_is_passed_on_once(capsys: pytest.CaptureFixture[str]) -> None:
    class Driveline:
        """Compiles for three looks."""

        lines = ("[INFO] something else", "tcc-sim: compiling kernels for this kind of scene, about 9 s, once")
        looks = 0

        def has_said(self, text: str) -> bool:
            self.looks += 1
            return self.looks > 3

        def check(self) -> None:
            """It runs."""

    session = object.__new__(children.Session)
    session.driveline = session.recorder = Driveline()  # type: ignore[assignment]
    session.beside = []
    session._await_clock()
    assert capsys.readouterr().err == "tcc-sim: compiling kernels for this kind of scene, about 9 s, once\n"


@pytest.mark.parametrize(("rate", "taken"), [(1.0, True), (20000.0, True), (0.999, False), (20000.1, False), (5, False),
                                             ("fast", False), (math.nan, False)])
def test_the_commander_sends_at_a_rate_that_can_be(rate: object, taken: bool) -> None:
    commander = pytest.importorskip("tcc_sim.nodes.commander", exc_type=ImportError)

    class Taken(Exception):
        pass

    class Node:
        def declare_parameter(self, *_: object) -> object:
            return type("Parameter", (), {"value": rate})

        def create_publisher(self, *_: object) -> None:
            raise Taken

    with pytest.raises(Taken if taken else InputError):
        commander.send(Node())
