"""The viewer for a browser: served on the loopback address until the end of the `with` block."""

from __future__ import annotations

import socket
import sys
import urllib.parse
import urllib.request
from pathlib import Path

import pytest

from tcc_sim.nodes.children import ADDRESS, web_viewer

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
    with web_viewer() as (address, url):
        page = urllib.parse.urlsplit(address)
        assert urllib.parse.parse_qs(page.query) == {"url": [url]}
        data = urllib.parse.urlsplit(url)
        assert (page.hostname, data.hostname, data.path) == (ADDRESS, ADDRESS, "/proxy")
        assert listening(page.port) == listening(data.port) == {"0100007F"}
        with urllib.request.urlopen(address, timeout=60) as answer:
            assert b"Rerun" in answer.read()
        stream = rerun.RecordingStream("tcc_sim")
        stream.connect_grpc(url)
        stream.log("slip/speed", rerun.Scalars(20.0))
        stream.flush(timeout_sec=60.0)
        stream.disconnect()
    for port in (page.port, data.port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((ADDRESS, port), 10.0)
