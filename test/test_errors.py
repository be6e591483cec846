"""Texts of messages, refusals of names, absent packages, and work in the background."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from tcc_sim.background import awaited, begun
from tcc_sim.errors import InputError, check_folder, check_suffix, counted, one_line, printable


def test_a_message_is_one_printable_line_of_bounded_length() -> None:
    assert one_line("a" * 1000) == "a" * 1000
    assert len(one_line("a" * 100_000)) < 1100
    assert printable("plain \u00e9") == "plain \u00e9"
    assert str(InputError("a\nb\x1b\u200b")).isprintable()
    assert [counted(n, "step") for n in (0, 1, 2)] == ["0 steps", "1 step", "2 steps"]


def test_a_file_has_a_suffix_and_a_folder(tmp_path: Path) -> None:
    for suffixes, words in (([".a"], ".a"), ([".a", ".b"], ".a or .b"), ((".a", ".b", ".c"), ".a, .b or .c")):
        for suffix in suffixes:
            check_suffix(Path("x" + suffix), suffixes)
        for name in ("x.txt", "x", "x.A"):
            with pytest.raises(InputError, match=f"--out {name} .*{words}"):
                check_suffix(Path(name), suffixes, "--out ")
    check_folder(tmp_path / "a")
    with pytest.raises(InputError, match=str(tmp_path / "a" / "b")):
        check_folder(tmp_path / "a" / "b")


def test_work_in_the_background_ends_with_its_result_or_its_error_and_keeps_no_process() -> None:
    release = threading.Event()
    outcome, thread = begun(lambda: release.wait(60.0), "a name")
    assert (thread.name, thread.daemon, outcome.done()) == ("a name", True, False)
    release.set()
    assert outcome.result(60.0) is True
    failed, _ = begun(lambda: {}["key"])
    assert isinstance(failed.exception(60.0), KeyError)
    worker: list[threading.Thread] = []
    assert awaited(lambda: worker.append(threading.current_thread()) or 7) == 7  # type: ignore[func-returns-value]
    assert worker[0] is not threading.main_thread()
    with pytest.raises(ZeroDivisionError):
        awaited(lambda: 1 / 0)
    inner, _ = begun(lambda: awaited(threading.current_thread) is threading.current_thread())
    assert inner.result(60.0) is True  # In another thread the work is done at once.
