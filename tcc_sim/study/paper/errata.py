"""Errata of the paper, from errata.yaml: their texts and numbers, and the page of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tcc_sim.output.tables import escape, text

TEXTS: Mapping[str, Any] = yaml.safe_load(Path(__file__).with_name("errata.yaml").read_text(encoding="utf-8"))
"""Errata in the order of the paper, values that it leaves open, with those taken here, and texts of the page."""


def errata_page() -> str:
    """Return the page of the errata with their numbers, of the right equations, and of the values left open."""
    return "\n".join([
        "# The paper's errata", "", TEXTS["page"].format(errata=len(TEXTS["errata"]), open=len(TEXTS["open"])),
        *map(erratum_line, TEXTS["errata"]), "", f"Derived again and found as printed: {escape(TEXTS['right'])}.", "",
        "## Left open by the paper", "",
        *(f"- {escape(what)}: {escape(here)}" for what, here in TEXTS["open"].items()),
        "", f"Figs. 4 to 18: {escape(_listed(TEXTS['speeds']))}"]) + "\n"


def erratum_line(erratum: Mapping[str, Any]) -> str:
    """Return one erratum as an entry of a list: both forms, the reason, and its numbers."""
    parts = {name.capitalize(): erratum[name] for name in ("printed", "right", "why")}
    parts["Numbers"] = _listed(erratum.get("numbers", {}))
    return " ".join([f"- **{escape(erratum['where'])}**", *(f"{name}: {escape(x)}." for name, x in parts.items() if x)])


def _listed(numbers: Mapping[str, Any]) -> str:
    return "; ".join(f"{name}: {text(value)}" for name, value in numbers.items())
