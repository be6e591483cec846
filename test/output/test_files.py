"""Outputs: whole or not at all, over regular files only, through no link, and early refusals."""

from __future__ import annotations

import errno
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from tcc_sim.errors import InputError
from tcc_sim.output.files import draft, new_directory, new_file, write_json

SIMULATE = ["simulate", "minimal", "--cycles", "2", "--discard", "0", "--solver", "fixed_step"]


def special(folder: Path) -> dict[str, Path]:
    """One path of each kind that is no regular file."""
    os.mkfifo(folder / "pipe")
    (folder / "mine").write_text("mine")
    (folder / "link").symlink_to(folder / "mine")
    (folder / "dangling").symlink_to(folder / "nowhere")
    (folder / "folder").mkdir()
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(folder / "socket"))
    server.close()
    names = ("pipe", "link", "dangling", "folder", "socket")
    return {name: folder / name for name in names} | {"device": Path("/dev/null")}


def written(path: Path, meanwhile: Callable[[], object]) -> None:
    """Write a file, and have something happen before it is done."""
    with draft(path) as part:
        part.write_text("new")
        meanwhile()


@pytest.mark.parametrize("force", [False, True])
def test_only_a_regular_file_is_ever_replaced(tmp_path: Path, force: bool) -> None:
    for path in special(tmp_path).values():
        before = path.lstat()
        with pytest.raises(InputError, match="is a "):
            new_file(path, force)
        with pytest.raises(InputError, match="is a "), draft(path):
            pytest.fail("nothing is begun")
        assert (path.lstat().st_ino, path.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert (tmp_path / "mine").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["dangling", "folder", "link", "mine", "pipe", "socket"]


def test_a_link_put_in_the_way_is_neither_followed_nor_replaced(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    path = tmp_path / "run.json"
    with pytest.raises(InputError, match="symbolic link"):
        written(path, lambda: path.symlink_to(tmp_path / "secret"))
    assert (tmp_path / "secret").read_text() == "secret"
    path.unlink()
    with pytest.raises(InputError, match="appeared"):
        written(path, lambda: path.write_text("of somebody else"))
    assert path.read_text() == "of somebody else"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.json", "secret"]


def test_drafts_have_names_that_nobody_knows_before_and_a_folder_of_their_own(tmp_path: Path) -> None:
    places = set()
    for number in range(3):
        with draft(tmp_path / f"{number}.json") as part:
            assert part.name == f"{number}.json"
            assert part.parent.parent == tmp_path
            assert stat.S_IMODE(part.parent.stat().st_mode) == 0o700
            assert str(os.getpid()) not in part.parent.name
            part.write_text("{}")
            places.add(part.parent.name.split(".", 2)[2])
    assert len(places) == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == ["0.json", "1.json", "2.json"]


def test_the_mode_is_that_of_any_new_file(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_json(tmp_path / "x.json", {})
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "x.json").stat().st_mode) == 0o640


def test_what_fails_leaves_nothing_and_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError):
        written(path, lambda: 1 / 0)
    assert path.read_text() == "old"
    write_json(path, {"a": 1})
    assert path.read_text() == '{\n "a": 1\n}\n'
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]


@pytest.mark.parametrize("make", [new_file, new_directory])
@pytest.mark.parametrize(("name", "words"), [
    ("x" * 256, "too long"), ("é" * 128, "too long"), ("y" * 300 + "/x.json", "too long"),
    ("/".join(["z" * 200] * 25), "too long"), ("a\0b", "NUL")])
def test_a_name_that_cannot_be_is_refused_at_once(tmp_path: Path, make, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make(tmp_path / name)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_said_with_the_name_that_the_user_gave(number: int, tmp_path: Path) -> None:
    def write(error: OSError) -> None:
        with draft(tmp_path / "mine.json") as part:
            part.write_text("half")
            raise error

    with pytest.raises(OSError, match=r"mine\.json") as caught:
        write(OSError(number, os.strerror(number)))
    assert (caught.value.errno, caught.value.filename) == (number, str(tmp_path / "mine.json"))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match=os.strerror(errno.EIO)) as other:
        write(OSError(errno.EIO, os.strerror(errno.EIO)))  # Of something else that is read meanwhile.
    assert other.value.filename is None
    with pytest.raises(OSError, match=r"'/proc/mine\.json'"):  # Nobody can create a file there.
        write_json(Path("/proc/mine.json"), {})
