"""Run the cells of a notebook in order, as a kernel does: python .ci/instruments/notebook.py FILE.ipynb."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path
from typing import Any


def shown_by(notebook: Path) -> tuple[dict[str, Any], list[Any]]:
    """The names after the last cell, and the value of the expression that ends each code cell."""
    names: dict[str, Any] = {}
    shown = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            *body, last = ast.parse("".join(cell["source"])).body
            assert isinstance(last, ast.Expr), f"{notebook.name}: a cell shows nothing"
            exec(compile(ast.Module(body, []), str(notebook), "exec"), names)
            shown.append(eval(compile(ast.Expression(last.value), str(notebook), "eval"), names))
    return names, shown


if __name__ == "__main__":
    for value in shown_by(Path(sys.argv[1]))[1]:
        print(type(value).__name__)
