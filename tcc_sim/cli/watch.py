"""`tcc-sim watch`: show running nodes live in Rerun."""

from __future__ import annotations

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path

from tcc_sim.cli.arguments import add_namespace, new_file
from tcc_sim.cli.options import Form, command
from tcc_sim.output.terminal import say


@command(add_namespace, forms={"connect": Form("URL")})
def run(arguments: argparse.Namespace, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
        web: bool = False) -> int:
    """Watch until Ctrl-C or SIGTERM, and print the number of states shown and missed.

    Parameters
    ----------
    rrd : write a Rerun file; at 1 kHz the file grows by about 5 MB a minute, memory by half a MB
    spawn : start a viewer (the default)
    connect : send to a running viewer, rerun+http://HOST:PORT/proxy
    web : serve a viewer for a browser on this machine, and print its address
    """
    from tcc_sim.nodes.children import require_ros

    require_ros()
    if rrd is not None:
        new_file(rrd)
    from tcc_sim.nodes.watcher import watch
    from tcc_sim.nodes.web_viewer import web_viewer

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ExitStack() as stack:
        if web:
            viewer = stack.enter_context(web_viewer())
            say(f"viewer: {viewer.page}", flush=True)
            connect = viewer.url
        say(watch(arguments.namespace, lambda text: print(text, file=sys.stderr), web=web, file=rrd,
                  spawn=rrd is None and connect is None, url=connect))
    return 0
