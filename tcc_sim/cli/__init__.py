"""The command `tcc-sim`: modules of verbs (`VERBS`), imported when a verb is used.

A verb is a function whose options follow from its signature and docstring and from those of library functions
(`options.command`); its docstring has its purpose, an example, the printed lines and the files too.
`arguments.words` is the command line, which JSON files name. Exit status: 0 done; 2 wrong input, one line on standard
error and no file; 1 any other failure; 130 interrupted.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import errno
import os
import signal
import sys
from contextlib import suppress
from contextvars import copy_context
from importlib import import_module
from keyword import iskeyword
from typing import Any, NoReturn

from tcc_sim import __version__
from tcc_sim.cli.options import VerbFunction, reader, rows_of, syntax_of
from tcc_sim.errors import InputError, TccError, missing_package, one_line
from tcc_sim.output.terminal import open_streams, terminal_width, wrapped
from tcc_sim.shown_units import show_in

GROUPS = {"demonstration": "demo", "scenes": "scenes explain", "steady states": "simulate sweep linearise",
          "recordings": "analyse recover import identify", "running nodes": "watch control", "pictures": "plot",
          "other programs": "fmu", "motions and methods": "continue basins", "the paper": "figure claims",
          "measurements of the program": "precision stability realtime"}
"""Verbs by purpose, in the order of `tcc-sim --help`."""
_MODULES = {
    "tcc_sim.cli.nodes": "demo watch control", "tcc_sim.cli.files": "scenes explain fmu recover import plot",
    "tcc_sim.cli.sweep": "sweep", "tcc_sim.cli.runs": "simulate analyse",
    "tcc_sim.cli.estimation": "linearise identify", "tcc_sim.study.cli.motions": "continue basins",
    "tcc_sim.study.cli.paper": "figure claims", "tcc_sim.study.cli.measuring": "precision stability realtime"}
VERBS = {verb: module for module, verbs in _MODULES.items() for verb in verbs.split()}
"""Module of every verb, which has a function of the verb's name, with an underscore after a Python keyword."""
HELP = "example", "prints", "writes", "takes"
"""Rows of a verb's docstring that stand at the end of its help."""


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line."""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        """Read every option of type int or float by `reader`."""
        super().__init__(*args, **keywords)
        self.register("type", int, reader(int, "a whole number"))
        self.register("type", float, reader(float, "a number"))

    def error(self, message: str) -> NoReturn:
        """Print the message on one line and exit with status 2."""
        self.exit(2, f"{self.prog}: {one_line(message)}\n")


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command, with the options of `verb` alone, whose module is imported, or of all verbs."""
    parser = _Parser(prog="tcc-sim",
                     description="A slipping torque converter clutch driveline, in real time and offline.",
                     epilog=None if verb else _verbs_by_purpose(),
                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"tcc-sim {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for name in [verb] if verb in VERBS else [] if verb == "" else VERBS:
        docstring = _docstring_of(name)
        text = "\n".join(f"{f'{key}:':<10}{'tcc-sim ' * (key == 'example')}{meaning}"
                         for key, meaning in rows_of(docstring).items() if key in HELP)
        command_of(name).add_arguments(verbs.add_parser(
            name, description=wrapped(docstring.partition("\n")[0], terminal_width()),
            epilog=wrapped(text, terminal_width()), formatter_class=argparse.RawDescriptionHelpFormatter))
    return parser


def _docstring_of(verb: str) -> str:
    """Return the docstring of a verb, whose module is not imported."""
    return ast.get_docstring(syntax_of(f"{VERBS[verb]}:{_function_of(verb)}")) or ""


def _verbs_by_purpose() -> str:
    """Return every verb with its purpose below the title of its group, no wider than the terminal."""
    width, lines = max(map(len, VERBS)), []
    for title, verbs in GROUPS.items():
        lines.append(f"{title}:")
        for verb in verbs.split():
            purpose = _docstring_of(verb).partition("\n")[0].removesuffix(".")
            lines.append(f"  {verb:<{width}}  {purpose[0].lower()}{purpose[1:]}")
    lines += ["", "tcc-sim VERB --help shows an example and the options of a verb."]
    return wrapped("\n".join(lines), terminal_width())


def main(argv: list[str] | None = None) -> int:
    """Run one verb and return the exit status; without `argv`, an interrupted program ends here at once.

    The units and the style that the verb selects end with it.
    """
    open_streams()
    if argv is None and signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    status = copy_context().run(_status_of, sys.argv[1:] if argv is None else argv)
    if argv is None and status == 130:
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(status)  # A normal exit would wait for threads that still compile or solve.
    return status


def _status_of(words: list[str]) -> int:
    """Run one verb, print the error if it fails, and return the exit status."""
    try:
        verb = next((word for word in words if not word.startswith("-")), "")
        if verb and verb not in VERBS:
            near = difflib.get_close_matches(verb[:100], list(VERBS), n=1, cutoff=0.5)
            raise InputError(f"{verb} is not a verb; " + (f"did you mean {near[0]}?" if near else "see tcc-sim --help"))
        arguments = build_parser(verb).parse_args(words, argparse.Namespace(words=words))
        show_in(getattr(arguments, "units", None) or "rad", 1.0)
        if "tcc_sim.views.style" in sys.modules or getattr(arguments, "style", None) is not None:
            import_module("tcc_sim.views.style").use_file(getattr(arguments, "style", None))
        status: int = command_of(arguments.verb)(arguments)
        sys.stdout.flush()
        return status
    except SystemExit as stop:
        return int(stop.code or 0)
    except TccError as error:
        print(f"tcc-sim: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except ModuleNotFoundError as error:
        missing = missing_package(error)
        if missing is None:
            raise
        print(f"tcc-sim: {missing}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        reason = one_line(f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}")
        print(f"tcc-sim: {reason}", file=sys.stderr)
        return 2 if error.errno in (errno.ENAMETOOLONG, errno.ENOTDIR) else 1
    except KeyboardInterrupt as stop:
        print(f"tcc-sim: {str(stop) or 'interrupted'}", file=sys.stderr)
        return 130


def command_of(verb: str) -> VerbFunction:
    """Return the function of a verb."""
    found: VerbFunction = getattr(import_module(VERBS[verb]), _function_of(verb))
    return found


def _function_of(verb: str) -> str:
    return f"{verb}_" if iskeyword(verb) else verb
