"""Settings of child processes, without starting any; a domain is used only if no other process of this machine does."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from tcc_sim.errors import TccError
from tcc_sim.nodes import children
from tcc_sim.nodes.children import DOMAINS, Domain, ports_in_use


def test_that_a_node_compiles_is_passed_on_once(capsys: pytest.CaptureFixture[str]) -> None:
    class Driveline:
        """Compiles during three checks."""

        lines = ("[INFO] something else", "tcc-sim: compiling kernels for this kind of scene, about 9 s, once")
        looks = 0

        def has_said(self, text: str) -> bool:
            self.looks += 1
            return self.looks > 3

        def check(self) -> None:
            """Do nothing."""

    session = object.__new__(children.Session)
    session.driveline = session.recorder = Driveline()  # type: ignore[assignment]
    session.beside = []
    session._await_clock()
    assert capsys.readouterr().err == "tcc-sim: compiling kernels for this kind of scene, about 9 s, once\n"


def test_no_two_have_the_same_domain_until_it_is_given_back() -> None:
    some = range(90, 98)
    mine: list[Domain] = []
    with pytest.raises(TccError, match="every ROS domain from 90 to 97 is in use on this machine"):
        mine.extend(Domain(some) for _ in range(9))
    assert len({one.number for one in mine}) == len(mine)
    assert mine
    assert {one.number for one in mine} <= set(some)
    mine[0].close()
    again = Domain(some)
    assert again.number == mine[0].number
    for one in (again, *mine):
        one.close()


def test_a_domain_with_a_participant_is_somebodys() -> None:
    """Every participant of a domain has bound a port of it."""
    claimed = Domain()
    claimed.close()
    one = [claimed.number]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("127.0.0.1", 7400 + 250 * claimed.number + 11))
        assert participant.getsockname()[1] in ports_in_use()
        with pytest.raises(TccError, match="in use on this machine; set ROS_DOMAIN_ID"):
            Domain(one)
    Domain(one).close()


def test_ports_are_those_of_both_tables(tmp_path: Path) -> None:
    head = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
    (tmp_path / "udp").write_text(head + "  12: 00000000:1CE8 00000000:0000 07 00000000:00000000 00:00000000\n")
    (tmp_path / "udp6").write_text(head + "   3: 00000000000000000000000000000000:D4EE 0:0 07\n")
    assert ports_in_use([tmp_path / name for name in ("udp", "udp6", "none")]) == {7400, 0xD4EE}


def test_domains_keep_clear_of_the_ephemeral_ports() -> None:
    assert (DOMAINS[0], 7400 + 250 * DOMAINS[-1]) >= (1, 32650)
    assert 7400 + 250 * DOMAINS[-1] < 32768
