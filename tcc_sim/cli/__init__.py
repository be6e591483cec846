"""The command `tcc-sim`: one module per verb, and one for all that measure, imported when the verb is used.

A verb module has `add_arguments(parser)` and `run(arguments) -> int`; `arguments.words` is the command line, for the
JSON that says how it was made. Exit status: 0 done; 2 wrong input, one line on
standard error and nothing written; 1 anything else; 130 interrupted.
"""

from __future__ import annotations

import argparse
import difflib
import errno
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from keyword import iskeyword
from typing import NoReturn

from tcc_sim import __version__
from tcc_sim.errors import InputError, TccError, one_line
from tcc_sim.output.shown_units import show_in
from tcc_sim.output.terminal import open_streams, terminal_width, wrapped

GROUPS: dict[str, dict[str, str]] = {
    "the whole chain": {
        "demo": "run the whole chain on real ROS 2: nodes, a recording, its analysis, a Rerun file and a picture"},
    "scenes": {
        "scenes": "list the bundled scenes",
        "explain": "show what a scene builds and what it leaves out"},
    "steady states": {
        "simulate": "solve a scene and summarise its steady state",
        "sweep": "solve a scene at many values of one key",
        "continue": "follow periodic motions along a key, stable or not, with their bifurcations",
        "basins": "find attractors and their basins in a plane of two initial conditions",
        "linearise": "give the transfer function from pressure or engine torque about a settled motion"},
    "recordings": {
        "analyse": "summarise a recording, show it in Rerun, solve it again",
        "recover": "make a complete, indexed bag from a recording that was cut short or damaged",
        "identify": "find parameters of a scene in a recording or a table of measurements"},
    "running nodes": {
        "watch": "show running nodes live in Rerun",
        "control": "reset, pause, step, set parameters of running nodes and send them commands"},
    "pictures": {
        "plot": "draw the result that a command wrote to a .json or .npz file again"},
    "other programs": {
        "fmu": "write the real-time tick of a scene in C, as a co-simulation FMU"},
    "the paper": {
        "figure": "draw figures of the paper, with their numbers",
        "claims": "judge the claims of the paper"},
    "what is measured": {
        "precision": "measure error against run time of every solver",
        "stability": "try every engine on stiff and extreme scenes",
        "realtime": "measure the driveline node's pacing beside a bare absolute-deadline loop",
        "soak": "run driveline, recorder and commands for a long time: losses, memory, drift"},
}
"""Verbs with their lines of help, by what they are for, as `--help` shows them."""
VERBS: dict[str, str] = {name: text for verbs in GROUPS.values() for name, text in verbs.items()}
"""Every verb with its line of help; its module is `tcc_sim.cli.<verb>`, with an underscore after a Python keyword, and
`tcc_sim.cli.measuring` for what is measured.
"""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with status 2."""
        self.exit(2, f"{self.prog}: {one_line(message)}\n")


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """The parser of the command; only the module of `verb` is imported, or all of them where it is None."""
    parser = _Parser(prog="tcc-sim",
                     description="A slipping torque converter clutch driveline, in real time and offline.",
                     epilog=_verbs_by_purpose(), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"tcc-sim {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for name, text in VERBS.items():
        sub = verbs.add_parser(name, description=text[0].upper() + text[1:] + ".")
        if verb in (None, name):
            import_module(f"tcc_sim.cli.{module_of(name)}").add_arguments(sub)
    return parser


def _verbs_by_purpose() -> str:
    """Every verb with its line, under what it is for."""
    width = max(map(len, VERBS))
    lines = [line for title, verbs in GROUPS.items()
             for line in (f"{title}:", *(f"  {name:<{width}}  {text}" for name, text in verbs.items()))]
    return wrapped("\n".join(lines), terminal_width())


def _check_verb(words: list[str]) -> str:
    """The verb of a command line, empty for none; InputError names the nearest one where it does not exist."""
    verb = next((word for word in words if not word.startswith("-")), "")
    if verb and verb not in VERBS:
        near = difflib.get_close_matches(verb[:100], list(VERBS), n=1, cutoff=0.5)
        raise InputError(f"{verb} is not a verb" + (f"; did you mean {near[0]}?" if near else "; see tcc-sim --help"))
    return verb


def main(argv: list[str] | None = None) -> int:
    """Run one verb and give the exit status; as a program of its own it ends here where it is interrupted."""
    open_streams()
    if argv is None and signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    status = _status_of(sys.argv[1:] if argv is None else argv)
    if argv is None and status == 130:
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(status)  # A thread that still compiles or solves would be waited for, and what it does is lost.
    return status


def _status_of(words: list[str]) -> int:
    """Run one verb; the exit status, once what went wrong is said."""
    try:
        arguments = build_parser(_check_verb(words)).parse_args(words, argparse.Namespace(words=words))
        show_in(getattr(arguments, "units", "rad"))
        status: int = import_module(f"tcc_sim.cli.{module_of(arguments.verb)}").run(arguments)
        sys.stdout.flush()
        return status
    except SystemExit as stop:
        return int(stop.code or 0)
    except InputError as error:
        print(f"tcc-sim: {error}", file=sys.stderr)
        return 2
    except TccError as error:
        print(f"tcc-sim: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        reason = one_line(f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}")
        print(f"tcc-sim: {reason}", file=sys.stderr)
        return 2 if error.errno == errno.ENAMETOOLONG else 1
    except KeyboardInterrupt:
        print("tcc-sim: interrupted", file=sys.stderr)
        return 130


def module_of(verb: str) -> str:
    """The name of a verb's module."""
    return "measuring" if verb in GROUPS["what is measured"] else f"{verb}_" if iskeyword(verb) else verb
