"""Texts of messages, refusals of names, absent packages, and work in the background."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from tcc_sim.background import awaited, begun
from tcc_sim.errors import (
    EXTRAS,
    BasinsInterrupted,
    InputError,
    MissingPackage,
    SweepInterrupted,
    WorkersLost,
    check_folder,
    check_suffix,
    counted,
    missing_package,
    one_line,
    printable,
    require,
)


def test_a_message_is_one_printable_line_of_bounded_length() -> None:
    assert one_line("a" * 1000) == "a" * 1000
    assert one_line("a" * 500 + "b" * 501) == "a" * 500 + " ... " + "b" * 500
    assert printable("plain \u00e9") == "plain \u00e9"
    assert printable("a\nb\x1b\u200b") == "a\\nb\\x1b\\u200b"
    assert str(InputError("a\nb")) == "a\\nb"
    assert (counted(0, "step"), counted(1, "step"), counted(2, "step"), counted(1, "branch"), counted(3, "branch")) == (
        "0 steps", "1 step", "2 steps", "1 branch", "3 branches")


def test_a_file_has_a_suffix_and_a_folder(tmp_path: Path) -> None:
    for suffixes, words in (([".a"], ".a"), ([".a", ".b"], ".a or .b"), ((".a", ".b", ".c"), ".a, .b or .c")):
        for suffix in suffixes:
            check_suffix(Path("x" + suffix), suffixes)
        for name in ("x.txt", "x", "x.A"):
            with pytest.raises(InputError) as caught:
                check_suffix(Path(name), suffixes, "--out ")
            assert str(caught.value) == f"--out {name} must end in {words}"
    check_folder(tmp_path / "a")
    with pytest.raises(InputError) as caught:
        check_folder(tmp_path / "a" / "b")
    assert str(caught.value) == f"{tmp_path / 'a' / 'b'}: there is no directory {tmp_path / 'a'}"


def test_an_absent_package_is_named_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    require("json", "anything")
    monkeypatch.setattr("tcc_sim.errors.importlib.util.find_spec", lambda module: None)
    for module, (package, extra) in EXTRAS.items():
        with pytest.raises(MissingPackage) as caught:
            require(module, "a picture")
        assert str(caught.value) == (f"a picture needs {package}, which is not installed; pip install "
                                     f"'tcc_sim[{extra}]' brings it")
    for name, package, wanted in (("yaml.reader", "PyYAML", "PyYAML"), ("scipy", "scipy", "scipy"),
                                  ("llvmlite.binding", "numba", "'numba>=0.62,<0.69'"),
                                  ("lz4", "lz4", "'mcap>=1.5,<2' lz4 zstandard"),
                                  ("zstandard", "zstandard", "'mcap>=1.5,<2' lz4 zstandard")):
        assert str(missing_package(ModuleNotFoundError(name=name))) == (
            f"the Python package {package} is not installed; python3 -m pip install {wanted} brings it "
            "(into a virtual environment made with --system-site-packages where pip refuses)")
    assert missing_package(ModuleNotFoundError(name="antigravity.more")) is None
    assert missing_package(ModuleNotFoundError("no name")) is None


def test_an_interrupted_computation_keeps_its_results() -> None:
    assert (str(WorkersLost("gone")), WorkersLost("gone").sweeps) == ("gone", [])
    assert (str(SweepInterrupted([1])), SweepInterrupted([1]).sweeps) == ("interrupted", [1])
    assert str(BasinsInterrupted()) == "interrupted"


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
