"""Serve Rerun's viewer for a browser on this machine from a process on the loopback address, without rclpy."""

from __future__ import annotations

import importlib.util
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from tcc_sim.errors import TccError, require
from tcc_sim.nodes.children import ChildProcess

ADDRESS = "127.0.0.1"
"""Address of the viewer and its data; it is not reachable from the network."""
PAGE_PORT, DATA_PORT = 9090, 9876
"""Rerun's default ports, used if they are free."""
HOSTING, LISTENING = "Hosting a web-viewer", "Listening for gRPC connections"
"""Log lines of Rerun once it serves the page and accepts data."""


@dataclass(frozen=True)
class WebViewer:
    """A running viewer.

    page : address for a browser
    url : address for a stream of data
    """

    page: str
    url: str


@contextmanager
def web_viewer() -> Iterator[WebViewer]:
    """Serve Rerun's viewer on the loopback address for the duration of a `with` block.

    Raises MissingPackage: rerun-sdk is not installed. Raises TccError: Rerun does not start.
    """
    require("rerun", "Rerun")
    program = _program()
    page, data = _free_port(PAGE_PORT), _free_port(DATA_PORT)
    server = ChildProcess("rerun", [program, "--serve-web", "--bind", ADDRESS, "--port", str(data),
                                    "--web-viewer-port", str(page), "--hide-welcome-screen"], dict(os.environ))
    try:
        for line in (HOSTING, LISTENING):
            server.await_line(line)
        url = f"rerun+http://{ADDRESS}:{data}/proxy"
        yield WebViewer(f"http://{ADDRESS}:{page}/?url={quote(url, safe='')}", url)
    finally:
        server.kill()


def _program() -> str:
    """Return the viewer's program in rerun-sdk itself, since killing the script on the path would leave it running."""
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        if (Path(folder) / "rerun").is_file():
            return str(Path(folder) / "rerun")
    program = shutil.which("rerun")
    if program is None:
        raise TccError("the program rerun, which comes with rerun-sdk, is not installed")
    return program


def _free_port(wanted: int) -> int:
    for port in (wanted, 0):
        with socket.socket() as probe:
            try:
                probe.bind((ADDRESS, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise TccError(f"no port of {ADDRESS} is free")
