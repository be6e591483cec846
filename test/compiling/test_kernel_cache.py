"""Compiled code on disk: keyed by the source of all kernels, and used only if no other user can write it."""

from __future__ import annotations

import ast
import os
import shutil
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk

from tcc_sim.compiling import kernel_cache
from tcc_sim.compiling.compiled import Kernel, compiled, timed
from tcc_sim.compiling.kernel_cache import PACKAGE, ROOMS, load_or_build, source_digest
from tcc_sim.compiling.unrolled import Unrolled
from tcc_sim.solvers import fixed_step
from tcc_sim.solvers.terms import Terms

NAME, DAY = "room.kernel-0123", 86400.0
NEEDS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root may give files away")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the path of a cache that does not exist yet; the package prints its messages anew."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    printed = set(kernel_cache.announced)
    kernel_cache.announced.clear()
    kernel_cache.directory.cache_clear()
    yield tmp_path / "caches" / "tcc_sim"
    kernel_cache.directory.cache_clear()
    kernel_cache.announced.clear()
    kernel_cache.announced.update(printed)


def stored(content: bytes = b"code", name: str = NAME, shipped: Path = Path("/nowhere")) -> tuple[bytes, bool]:
    """Return the code under a name, after a fresh look at the directory, and whether it was made."""
    made: list[bytes] = []
    kernel_cache.directory.cache_clear()

    def make() -> bytes:
        made.append(content)
        return content

    return load_or_build(name, make, bytes.upper, shipped), bool(made)


def test_what_was_made_is_found_again_in_private_files(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert [stored(), stored(b"other"), stored(b"more", "room.other-4")] == [
        (b"CODE", True), (b"CODE", False), (b"MORE", True)]
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in cache.iterdir()} == {0o600}
    assert capsys.readouterr().err.count("\n") == 1  # All compilations of a process are announced once.


@pytest.fixture
def package(cache: Path, tmp_path: Path) -> Path:
    """Return a package's folder with one kernel; the private directory is empty."""
    folder = tmp_path / "shipped"
    folder.mkdir(mode=0o755)
    stored(b"shipped")
    (cache / NAME).rename(folder / NAME)
    (folder / NAME).chmod(0o644)
    return folder


FAULTS: dict[str, Callable[[Path], object]] = {
    "damaged": lambda path: path.write_bytes(path.read_bytes()[:2] + b"x" + path.read_bytes()[3:]),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:10]), "empty": lambda path: path.write_bytes(b""),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"x"), "group": lambda path: path.chmod(0o660),
    "others": lambda path: path.chmod(0o602), "foreign": lambda path: os.chown(path, 12345, 12345)}
"""Faults of a file with a kernel."""


@pytest.mark.parametrize("fault", [name if name != "foreign" else pytest.param(name, marks=NEEDS_ROOT)
                                   for name in FAULTS])
def test_a_file_at_fault_costs_one_line_and_is_made_anew(cache: Path, package: Path, fault: str,
                                                         capsys: pytest.CaptureFixture[str]) -> None:
    """One in the package stays there as it is."""
    kernel_cache.announced.add("compiling")
    capsys.readouterr()
    FAULTS[fault](package / NAME)
    bad = (package / NAME).read_bytes()
    assert [stored(shipped=package), stored(b"other")] == [(b"CODE", True), (b"CODE", False)]
    assert (capsys.readouterr().err.count("\n"), (package / NAME).read_bytes()) == (1, bad)
    kernel_cache.announced.discard("damage")
    FAULTS[fault](cache / NAME)
    assert [stored(b"more"), stored(b"other")] == [(b"MORE", True), (b"MORE", False)]
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("fault", ["group", "others", pytest.param("foreign", marks=NEEDS_ROOT)])
def test_no_directory_is_used_that_others_can_write_to(cache: Path, capsys: pytest.CaptureFixture[str],
                                                       fault: str) -> None:
    stored()
    cache.chmod(0o770 if fault == "group" else 0o702 if fault == "others" else 0o700)
    if fault == "foreign":
        os.chown(cache, 12345, 12345)
    before = cache.stat()
    assert [stored(b"own"), stored(b"own")] == [(b"OWN", True)] * 2
    assert str(cache) in capsys.readouterr().err
    assert (cache.stat().st_mode, cache.stat().st_uid) == (before.st_mode, before.st_uid)


@pytest.mark.parametrize("place", ["relative", "link", "file", "full"])
def test_where_nothing_can_be_kept_it_works_and_says_so_once(
        cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
        place: str) -> None:
    monkeypatch.chdir(tmp_path)
    kernel_cache.announced.add("compiling")
    if place == "relative":
        monkeypatch.setenv("NUMBA_CACHE_DIR", "numba")
    elif place == "link":
        cache.parent.mkdir()
        (tmp_path / "elsewhere").mkdir()
        cache.symlink_to(tmp_path / "elsewhere")
    elif place == "file":
        cache.parent.write_text("a file is in the way")
    with full_disk() if place == "full" else nullcontext():
        assert [stored(), stored()] == [(b"CODE", True)] * 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "numba").exists()
    assert not cache.exists() or not list(cache.iterdir())


def test_the_base_is_that_of_the_environment(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    stored()
    assert [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")] == [
        "numba", "numba/tcc_sim", f"numba/tcc_sim/{NAME}"]
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # Its specification says to ignore it.
    monkeypatch.setenv("HOME", str(tmp_path))
    stored()
    assert (tmp_path / ".cache" / "tcc_sim" / NAME).exists()


def test_what_nothing_has_used_for_30_days_is_removed_when_something_is_kept(cache: Path) -> None:
    """A kernel that is loaded counts as used from then on; other files stay."""
    now = time.time()
    for name in ("room.kept-1", "room.left-2", "room.younger-3"):
        stored(name=name)
    (cache / "room.left-4.rest_of_a_write").touch()
    (cache / "other.txt").touch()
    for path in cache.iterdir():
        os.utime(path, (now, now - (29.0 if "younger" in path.name else 31.0) * DAY))
    assert stored(name="room.kept-1") == (b"CODE", False)
    stored(name="room.new-5")
    assert {path.name for path in cache.iterdir()} == {"room.kept-1", "room.younger-3", "room.new-5", "other.txt"}


def test_a_process_killed_while_it_writes_leaves_nothing_that_is_loaded(cache: Path) -> None:
    def killed() -> bytes:
        os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
        return b"half"

    if not (child := os.fork()):
        load_or_build(NAME, killed, bytes.upper)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len([*cache.iterdir()]) == 1
    assert [stored(), stored()] == [(b"CODE", True), (b"CODE", False)]


def test_code_in_the_package_is_used_at_any_age_without_a_private_directory(package: Path, cache: Path) -> None:
    cache.rmdir()
    os.utime(package / NAME, (0.0, 0.0))
    assert stored(shipped=package) == (b"SHIPPED", False)
    package.chmod(0o775)  # As pip leaves folder and files where new ones are the group's.
    (package / NAME).chmod(0o664)
    assert stored(shipped=package) == (b"SHIPPED", False)
    assert not cache.exists()


def test_the_digest_is_that_of_the_text_of_the_rooms(tmp_path: Path) -> None:
    folder = tmp_path / "package"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("shipped", "__pycache__"))
    digests = {source_digest(folder)}
    assert digests == {source_digest()}
    for name in ("model/friction.py", "solvers/series.py", "trajectory.py", "compiling/linked.py"):
        path = folder / name
        path.write_text(path.read_text().replace("1", "2", 1))
        source_digest.cache_clear()
        digests.add(source_digest(folder))
    assert len(digests) == 5
    (folder / "errors.py").write_text("")
    (folder / "cli" / "sweep.py").unlink()
    (folder / "compiling" / "shipped").mkdir()
    source_digest.cache_clear()
    assert source_digest(folder) in digests


def test_kernels_reach_only_the_rooms_whose_text_counts() -> None:
    """Whatever a file with kernels imports from elsewhere in the package is a class or a function of no kernel."""
    inside = tuple(f"tcc_sim.{room.removesuffix('.py').replace('/', '.')}" for room in ROOMS)
    files = [path for path in sorted(PACKAGE.rglob("*.py")) if "compiling.compiled import" in path.read_text()]
    assert files
    for path in files:
        name = ".".join(("tcc_sim", *path.relative_to(PACKAGE).with_suffix("").parts))
        module = sys.modules.get(name)
        kernels = [item for item in vars(module).values() if isinstance(item, (Kernel, Unrolled))
                   and item.py_func.__module__ == name] if module else []
        if not kernels:
            continue
        assert name.startswith(inside)
        others = {alias.name for node in ast.walk(ast.parse(path.read_text()))
                  if isinstance(node, ast.ImportFrom) and str(node.module).startswith("tcc_sim.")
                  and not str(node.module).startswith(inside) for alias in node.names}
        assert not others & {used for kernel in kernels for used in kernel.py_func.__code__.co_names}, name


def test_a_name_on_disk_is_that_of_one_kind_of_one_kernel() -> None:
    """Of the types of the arguments, and the layout of an array."""
    kinds = [("d",), ("q",), ("d", "d"), ((tuple, ("d",)),), ((Terms, ("d",)),), ((Terms, ("d", "d")),),
             (np.dtype(float), 1, 0x401), (np.dtype(float), 1, 0x001), (np.dtype(float), 2, 0x401)]
    names = {kernel.file_name(kind) for kernel in (fixed_step.advance, fixed_step.tick) for kind in kinds}
    assert len(names) == 2 * len(kinds)
    assert all(name.startswith("fixed_step.") and len(name) < 100 for name in names)


def test_code_of_another_package_is_not_kept(cache: Path) -> None:
    @compiled
    def doubled(x: float) -> float:
        return 2.0 * x

    result, seconds = timed(doubled, 3.0)
    assert (result, 0.0 <= seconds < 1.0) == (6.0, True)
    assert not cache.exists()
