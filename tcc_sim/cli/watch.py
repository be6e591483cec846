"""`tcc-sim watch`: show running nodes live in Rerun."""

from __future__ import annotations

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path

from tcc_sim.cli.arguments import add_namespace, new_file
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the viewer or file, and the namespace of the nodes."""
    where = parser.add_argument_group("viewer or file").add_mutually_exclusive_group()
    where.add_argument("--rrd", type=Path, metavar="FILE", help="write a Rerun file; at 1 kHz the file grows by about "
                       "5 MB a minute, memory by half a MB")
    where.add_argument("--spawn", action="store_true", help="start a viewer (the default)")
    where.add_argument("--connect", metavar="URL", help="send to a running viewer, rerun+http://HOST:PORT/proxy")
    where.add_argument("--web", action="store_true",
                       help="serve a viewer for a browser on this machine, and print its address")
    add_namespace(parser)


def run(arguments: argparse.Namespace) -> int:
    """Watch until Ctrl-C or SIGTERM, and print the number of states shown and missed."""
    from tcc_sim.nodes.children import require_ros

    require_ros()
    if arguments.rrd is not None:
        new_file(arguments.rrd)
    from tcc_sim.nodes.watcher import watch
    from tcc_sim.nodes.web_viewer import web_viewer

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ExitStack() as stack:
        url = arguments.connect
        if arguments.web:
            viewer = stack.enter_context(web_viewer())
            say(f"viewer: {viewer.page}", flush=True)
            url = viewer.url
        spawn = arguments.rrd is None and url is None
        say(watch(arguments.namespace, lambda text: print(text, file=sys.stderr), web=arguments.web, file=arguments.rrd,
                  spawn=spawn, url=url))
    return 0
