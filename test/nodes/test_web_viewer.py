"""The viewer for a browser: served on the loopback address until the end of the `with` block."""

from __future__ import annotations

import socket
import sys
import urllib.parse
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import pytest

from tcc_sim.errors import TccError
from tcc_sim.nodes import web_viewer as module
from tcc_sim.nodes.web_viewer import ADDRESS, web_viewer

pytest.importorskip("rerun", reason="rerun-sdk is not installed")
import rerun


def listening(port: int) -> set[str]:
    """Addresses, in the kernel's notation, with a listener on a TCP port."""
    lines = [line.split() for name in ("tcp", "tcp6")
             for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return {words[1].partition(":")[0] for words in lines
            if words[3] == "0A" and int(words[1].rpartition(":")[2], 16) == port}


@pytest.mark.skipif(sys.platform != "linux", reason="listeners are read from /proc")
def test_a_page_and_its_data_are_served_on_the_loopback_address_alone() -> None:
    with web_viewer() as viewer:
        page = urllib.parse.urlsplit(viewer.page)
        assert urllib.parse.parse_qs(page.query) == {"url": [viewer.url]}
        data = urllib.parse.urlsplit(viewer.url)
        assert (page.hostname, data.hostname, data.path) == (ADDRESS, ADDRESS, "/proxy")
        assert listening(page.port) == listening(data.port) == {"0100007F"}
        with urllib.request.urlopen(viewer.page, timeout=60) as answer:
            assert b"Rerun" in answer.read()
        stream = rerun.RecordingStream("tcc_sim")
        stream.connect_grpc(viewer.url)
        stream.log("slip/speed", rerun.Scalars(20.0))
        stream.flush(timeout_sec=60.0)
        stream.disconnect()
    for port in (page.port, data.port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((ADDRESS, port), 10.0)


def test_a_port_that_is_taken_is_not_asked_for() -> None:
    with socket.socket() as taken:
        taken.bind((ADDRESS, 0))
        port = taken.getsockname()[1]
        other = module._free_port(port)
        assert other not in (0, port)
    assert module._free_port(port) == port


def test_the_program_is_that_of_the_package_else_the_one_on_the_path(monkeypatch: pytest.MonkeyPatch,
                                                                     tmp_path: Path) -> None:
    for spec, on_path, found in ((SimpleNamespace(submodule_search_locations=[tmp_path / "no", tmp_path]), None,
                                  str(tmp_path / "rerun")), (None, "/bin/rerun", "/bin/rerun"), (None, None, None),
                                 (SimpleNamespace(submodule_search_locations=None), "/bin/rerun", "/bin/rerun")):
        (tmp_path / "rerun").touch()
        monkeypatch.setattr(module.importlib.util, "find_spec", lambda name, spec=spec: spec)
        monkeypatch.setattr(module.shutil, "which", lambda name, on_path=on_path: on_path)
        if found is not None:
            assert module._program() == found
        else:
            with pytest.raises(TccError, match=r"^the program rerun, which comes with rerun-sdk, is not installed$"):
                module._program()
