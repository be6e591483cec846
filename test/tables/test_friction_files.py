"""Friction tables in the forms that tribometers write: each gives the law that made it, or a line refuses it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene, parse_assignments

V = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])
RPM = 30.0 / math.pi


def law(v):
    return 0.1 + 0.03 * np.exp(-0.2 * np.abs(v))


UP = np.column_stack([V, law(V)])
BOTH = np.concatenate([UP, -UP[1:]])
TWICE = np.concatenate([UP + np.array([0.0, 0.002]), UP[::-1] - np.array([0.0, 0.002])])
PLAIN = "slip_speed,coefficient"
NAMED = {"friction.table_columns": "slip_speed=n_rel:rpm,coefficient=mu"}


def text(rows, head=PLAIN, form="{:.12g},{:.12g}"):
    return head + "\n" + "\n".join(form.format(*row) for row in rows) + "\n"


FORMS = {  # Text of the file, further keys, and a speed below which the coefficient is that of this speed.
    "plain": (text(UP), {}, 0.0), "from fast to slow": (text(UP[::-1]), {}, 0.0),
    "unsorted": (text(UP[[3, 0, 8, 1, 5, 2, 7, 4, 6]]), {}, 0.0), "up and down": (text(TWICE), {}, 0.0),
    "up and down, not repeated": (text(np.concatenate([UP, UP[::-1] * [[1.1, 1.0]]])[:12]), {}, 0.0),
    "both directions": (text(BOTH), {}, 0.0), "both directions, amounts": (text(np.abs(BOTH) * np.sign(
        BOTH[:, :1] + 0.1) ** [[1, 0]]), {}, 0.0), "backwards alone": (text(-UP), {}, 0.0),
    "no row at 0": (text(UP[1:]), {}, 0.5), "no row at 0, both directions": (text(np.delete(BOTH, 0, 0)), {}, 0.5),
    "empty cells": (text(UP) + "3,\n,0.2\n,\n", {}, 0.0), "n/a": (text(UP) + "3,n/a\nNaN,NaN\n", {}, 0.0),
    "more columns": (text(UP, f"load,{PLAIN},T", "100,{:.12g},{:.12g},80"), {}, 0.0),
    "percent": (text(UP * [1.0, 100.0], "slip_speed,coefficient [%]"), {}, 0.0),
    "rpm": (text(UP * [RPM, 1.0], "slip_speed [rpm],coefficient"), {}, 0.0),
    "names of its own": (text(UP * [RPM, 1.0], "n_rel,mu"), NAMED, 0.0),
    "names and units": (text(UP * [RPM, 1.0], "mu0,n_rel [1/min],mu [-]", "0,{:.12g},{:.12g}"), NAMED, 0.0),
    "German": (text(UP, "Versuch 7\nslip_speed;coefficient\nrad/s;-", "{:.12g};{:.12g}").replace(".", ","), {}, 0.0),
    "tabs": (text(UP, "slip_speed\tcoefficient", "{:.12g}\t{:.12g}"), {}, 0.0)}


@pytest.mark.parametrize("name", FORMS)
def test_every_form_gives_the_law_that_made_it(tmp_path, name):
    content, more, slowest = FORMS[name]
    (tmp_path / "mu.csv").write_text(content)
    scene = load_scene("minimal").with_values(parse_assignments(
        [f"friction.table={tmp_path / 'mu.csv'}", *(f"{key}={value}" for key, value in more.items())]))
    friction = scene.system.friction
    v = np.array(friction.slip_speeds)
    assert v[0] == 0.0
    assert (np.diff(v) > 0.0).all()
    tolerance = 0.005 if name == "up and down, not repeated" else 1e-9
    assert friction.coefficients == pytest.approx(law(np.maximum(v, slowest)), abs=tolerance)
    assert {0.0, *V[slowest <= V]} <= {float(f"{x:.6g}") for x in v}


@pytest.mark.parametrize(("content", "more", "words"), [
    (text(BOTH * [[1.0, -1.0]]), {}, ["row 2", "-0.127", "0.5"]), (text([*UP, (-1.0, 0.1), (2.0, -0.1)]), {}, ["row"]),
    (text(UP[5:]), {}, ["8", "10%", "6.4"]), (text([*UP, (4.0, 0.09)]), {}, ["row 5", "0.113", "4 rad/s", "5%"]),
    ("slip_speed,coefficient\n1,\n,0.1\n", {}, ["mu.csv"]), (text(UP, "n_rel,mu"), {}, ["n_rel", "table_columns"]),
    (text(UP), NAMED, ["n_rel", "slip_speed", "table_columns"]),
    (text(UP), {"friction.table_columns": "speed=n_rel"}, ["speed", "table_columns"]),
    (text(UP[:2]), {}, ["2", "3"]), (text([(0.0, 0.0), *UP[1:]]), {}, ["friction.coefficients", "0"])])
def test_other_files_are_refused(tmp_path, content, more, words, refused):
    (tmp_path / "mu.csv").write_text(content)
    keys = {"friction.table": tmp_path / "mu.csv", **more}
    line = refused("explain", "minimal", *(part for key, value in keys.items() for part in ("--set", f"{key}={value}")))
    assert all(word in line for word in words), line


def test_a_scene_file_names_its_table_and_columns(tmp_path):
    (tmp_path / "mu.csv").write_text(FORMS["names of its own"][0])
    scene = tmp_path / "own.yaml"
    table = f"    friction:\n      table: mu.csv\n      table_columns: {NAMED['friction.table_columns']}\n"
    scene.write_text(f"/**:\n  ros__parameters:\n{table}")
    assert load_scene(scene).system.friction.coefficients == pytest.approx(law(V))
    assert main(["explain", str(scene)]) == 0
    scene.write_text(scene.read_text().replace("      table: mu.csv\n", ""))
    with pytest.raises(InputError, match=r"friction\.table_columns"):
        load_scene(scene)
