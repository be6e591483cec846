"""The file of a sweep that takes points as they are done and from which the sweep can go on: JSON, one line a point.

The first line says which sweep it is. Numbers are written so that they are read back exactly, and a last line that was
cut short is dropped.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim import __version__
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import values_of
from tcc_sim.studies.point import Plan, plan_as_json

if TYPE_CHECKING:
    from tcc_sim.studies.sweep import Curve

FORMAT = "tcc_sim sweep_points 1"


class SweepFile:
    """An open file of a sweep; `stored` lists the points found in it as (curve, index, record).

    `said` is what the first line says besides what tells one sweep from another: scene and command.

    Raises
    ------
    InputError
        The path holds something else, or the points of another sweep.
    OSError
        It cannot be read or written.
    """

    def __init__(self, path: Path, curves: Sequence[Curve], plan: Plan, said: Mapping[str, Any] | None = None) -> None:
        self.stored: list[tuple[int, int, dict[str, Any]]] = []
        header = json.loads(json.dumps(_header(curves, plan)))
        head = {**header, **{key: value for key, value in (said or {}).items() if key not in header}}
        whole = self._read(path, header, [len(curve.values) for curve in curves]) if path.exists() else 0
        self._stream = path.open("ab")
        self._stream.truncate(whole)
        if not whole:
            self._write(head)

    def _read(self, path: Path, header: dict[str, Any], counts: list[int]) -> int:
        """Take the points of an existing file; returns the bytes that are whole lines."""
        if not path.is_file():
            raise InputError(f"{path}: not a file")
        whole = 0
        with path.open("rb") as stream:
            for number, line in enumerate(stream):
                if not line.endswith(b"\n"):
                    if number == 0:
                        raise InputError(f"{path}: not the file of a sweep; it is left as it is")
                    break
                try:
                    found = json.loads(line)
                except ValueError:
                    found = None
                if number == 0:
                    if not isinstance(found, dict) or found.get("format") != FORMAT:
                        raise InputError(f"{path}: not the file of a sweep; it is left as it is")
                    different = [k for k in header if found.get(k) != header[k]]
                    if different:
                        raise InputError(f"{path}: the file of another sweep ({', '.join(different)} differ); "
                                         "it is left as it is")
                else:
                    try:
                        c, i, record = int(found["curve"]), int(found["index"]), dict(found["record"])
                        inside = 0 <= c < len(counts) and 0 <= i < counts[c] and {"status", "final"} <= record.keys()
                    except (TypeError, KeyError, ValueError):
                        inside = False
                    if not inside:
                        raise InputError(f"{path}: line {number + 1} is damaged; the file is left as it is")
                    self.stored.append((c, i, record))
                whole += len(line)
        return whole

    def append(self, curve: int, index: int, record: dict[str, Any]) -> None:
        """Write one point and hand it to the operating system."""
        self._write({"curve": curve, "index": index, "record": record})

    def _write(self, line: dict[str, Any]) -> None:
        """One line."""
        self._stream.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _header(curves: Sequence[Curve], plan: Plan) -> dict[str, Any]:
    """What tells one sweep from another."""
    return {"format": FORMAT, "version": __version__, "plan": plan_as_json(plan),
            "curves": [{"over": c.key, "values": c.values, "scene": dict(values_of(c.system))} for c in curves]}
