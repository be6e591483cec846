"""Rules of the layout: imports between rooms, modules that stay unloaded, texts of the friction law, bundled scenes."""

import ast
import dataclasses
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
import yaml

from tcc_sim.later_rooms import CALLED, from_later_room
from tcc_sim.model.groups import TABULATED
from tcc_sim.model.parameters import DEFAULTS, QUANTITIES
from tcc_sim.model.quantity import PROFILES
from tcc_sim.scene import Operation, load_scene, parse_scene

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "tcc_sim"
MODULES = sorted(PACKAGE.rglob("*.py"))
ORDER = ["errors", "background", "later_rooms", "topics", "result", "shown_units", "model", "trajectory",
         "parameter_file", "tables", "friction_table", "scene", "messages", "compiling", "polynomials", "solvers",
         "recording", "analysis", "plant", "sweeps", "estimation", "output", "fmu", "views", "nodes", "testing",
         "replay", "functions", "cli", "study.exponents", "study.continuation", "study.basins", "study.views",
         "study.paper", "study.benchmarks", "study.cli", "__main__"]
"""A part imports only from itself and from parts before it; so the core, which is all but the study, imports nothing of
the study.
"""

ROS = ["nodes", "testing"]
DRAWINGS = ["views", "study.views", "study.paper.drawings", "study.paper.branch_panels", "study.paper.histories",
            "study.benchmarks.report_drawings"]
ROOMS = {
    "numba": ["compiling"], "llvmlite": ["compiling"],
    "scipy": ["tables", "solvers", "analysis", "sweeps", "estimation", "study", "model.friction_curve"],
    "pandas": ["replay"], "pyarrow": ["tables"], "asammdf": ["tables"],
    "distributed": ["sweeps.executors"], "dask": ["sweeps.executors"],
    "mcap": ["recording"], "zstandard": ["recording"], "lz4": ["recording"],
    "yaml": ["parameter_file", "scene", "recording", "messages", "study.paper"],
    "rclpy": [*ROS, "study.benchmarks.pacing_benchmark"], "rcl_interfaces": ROS, "builtin_interfaces": ROS,
    "std_msgs": ROS, "sensor_msgs": ROS, "std_srvs": ROS, "diagnostic_msgs": ROS, "rosgraph_msgs": ROS,
    "ament_index_python": ROS,
    "rerun": ["views"], "matplotlib": DRAWINGS, "cycler": DRAWINGS, "argparse": ["cli", "study.cli"],
}
"""Rooms that may import an optional or slow package."""

MEASURING = "study.cli.measuring"
"""Module that may import `study.benchmarks`."""

HEAVY = ["numpy", "numba", "scipy", "yaml", "mcap", "zstandard", "lz4", "rclpy", "rerun", "matplotlib", "distributed",
         "tqdm"]
GROWING = ["analysis.stream.RunCycles", "study.benchmarks.precision_report.StudiedScene",
           "study.continuation.branch.Branch", "study.continuation.motions.Motions",
           "study.paper.branches_behind.StableMotions", "study.paper.evidence.Evidence", "recording.contents.Contents",
           "recording.mcap_file.FileSummary",
           "recording.records.RecordStream", "recording.stamps._Run", "recording.stamps.StampCounter"]
"""Dataclasses that are not frozen."""
PROTOCOLS = {"add_arguments", "into", "main", "run", "Settings", "solve"}
"""Names that every module of a kind has: verbs, pictures, programs, solvers, the settings of a room."""

MOST_TEXTS = 7
TEXTS = {
    "model/friction.py": "at slip speeds, for everything but the series",
    "solvers/series.py": "along series of the motion",
    "study/benchmarks/references.py": "independent: SciPy",
    "study/benchmarks/peers.py rates_for_c": "independent: LSODA",
    "study/benchmarks/peers.py xppaut_file": "independent: XPPAUT",
    "study/benchmarks/cvode.c": "independent: CVODE",
}
"""Texts of the friction law: files, or functions and classes in them."""
OTHERS = {
    "analysis/loop_verdict.py _oscillating": "growth of swings",
    "compiling/unrolled.py exp": "the exponential of staged code",
    "estimation/curve.py _seen_in_slip": "columns of a least-squares fit, linear in the amplitudes",
    "estimation/linearise.py linearise": "dead time",
    "estimation/linearise.py _about_constant": "a mode over an engine cycle",
    "estimation/multiple_shooting.py MultipleShooting": "steps of a logarithm",
    "estimation/slip_loop.py _Loop": "dead time and lag of a controller",
    "model/actuator.py": "the actuator's lag",
    "model/friction_curve.py": "columns of a least-squares fit, linear in the amplitudes",
    "model/pure_slip.py": "modes of the linear part",
    "output/tables.py friction_formula": "the formula in a report",
    "solvers/law_changes.py": "rules of derivatives: dF = F dx, dT = (1 - T^2) dx",
    "solvers/law_on.py": "the exponential of staged code, limited",
    "solvers/shared_collocation.py growth": "a power of an error",
    "solvers/smoothed/setup.py of_tolerance": "a power of a tolerance",
    "solvers/torques.py load_on_approach": "the actuator's lag",
    "study/benchmarks/report_drawings.py _chart": "a logarithmic axis",
    "study/exponents.py change_of_averages": "the weight of a mean",
    "study/paper/errata.py transient": "modes of the linear part",
}
"""Everything else with such a function: files, or functions and classes in them."""
FUNCTIONS = {"exp", "exp2", "expm1", "tanh", "sinh", "cosh", "logaddexp", "exponential", "hyperbolic", "decayed"}
IN_TEXT = re.compile(r"\b(?:exp|expm1|tanh|sinh|cosh)\(")
ADVICE = ("evaluates an exponential or a hyperbolic tangent. The friction law has its text at slip speeds in "
          "model/friction.py and along series in `motion` of solvers/series.py: call these, or run them on other "
          "numbers by solvers/law_on.py. What is not the friction law has a row of OTHERS")
"""The advice to whoever writes an eighth text."""


def name_of(path: Path) -> str:
    """Dotted name below tcc_sim; empty for its __init__."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def tree_of(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text())


@cache
def imports_of(path: Path) -> list[tuple[int, str]]:
    """Line and absolute dotted name of every import, function-local and type-checking ones included."""
    values = []
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            values += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} is a relative import"
            values += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "import_module":
            word = node.args[0]
            if isinstance(word, ast.Constant):
                values.append((node.lineno, str(word.value)))
            elif isinstance(word, ast.JoinedStr) and isinstance(word.values[0], ast.Constant):
                values.append((node.lineno, str(word.values[0].value) + "?"))
    return values


def test_independent_solutions_import_no_solver() -> None:
    imported = [name for _, name in imports_of(PACKAGE / "study" / "benchmarks" / "references.py")]
    assert not [name for name in imported if name.startswith(("tcc_sim.solvers", "tcc_sim.model.friction"))]


def test_what_is_worked_out_cannot_be_changed() -> None:
    """Every dataclass is frozen, except those that grow and are returned only when complete."""
    values = []
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                words = [ast.unparse(word) for word in node.decorator_list]
                if any(word.startswith("dataclass") and "frozen=True" not in word for word in words):
                    values.append(f"{name_of(path)}.{node.name}")
    assert sorted(values) == sorted(GROWING)


parts = pytest.mark.parametrize("part", ["", *ORDER], ids=lambda part: part or "tcc_sim")
"""Every file is in one of them, the package's own in none."""


def part_of(name: str) -> str:
    """The part of a dotted name below tcc_sim."""
    first, *rest = name.split(".")
    return f"study.{rest[0]}" if first == "study" and rest else first


def imports_in(part: str) -> list[tuple[str, str, str]]:
    """Module, line and imported name of every import of a part."""
    paths = [path for path in MODULES if part_of(name_of(path)) == part]
    assert paths, f"there is no part {part}"
    return [(name_of(path), f"{path}:{line}", imported) for path in paths for line, imported in imports_of(path)]


def test_every_file_is_of_a_part() -> None:
    assert {part_of(name_of(path)) for path in MODULES} == {"", "study", *ORDER}


@parts
def test_a_part_imports_only_from_parts_before_it(part: str) -> None:
    for _, place, imported in imports_in(part) if part else []:
        package, *rest = imported.split(".")
        if package == "tcc_sim" and rest != ["__version__"]:
            of = part_of(".".join(rest))
            assert of in ORDER, f"{place} imports {imported}, a part that ORDER does not know"
            later = ORDER.index(of) > ORDER.index(part)
            assert not later, f"{place}: {part} imports {imported}, which comes after it"


def test_the_core_names_the_study_in_one_table() -> None:
    """The package's own names, the verbs and `later_rooms` are the only places."""
    named = {name_of(path) for path in MODULES if "tcc_sim.study" in path.read_text()}
    assert {name for name in named if part_of(name).partition(".")[0] != "study"} == {"", "cli", "later_rooms"}


def test_every_call_into_a_later_room_has_its_function() -> None:
    for name in CALLED:
        assert callable(from_later_room(name)), name


def test_no_module_imports_itself_through_others() -> None:
    """Function-local imports and those for types count too."""
    names, reached = {name_of(path) for path in MODULES}, {}
    for path in MODULES:
        words = [word.removeprefix("tcc_sim.") for _, word in imports_of(path) if not word.endswith("?")]
        reached[name_of(path)] = {word if word in names else word.rpartition(".")[0] for word in words} - {""}
    for middle in reached:
        for each in reached.values():
            if middle in each:
                each |= reached[middle]
    assert {name for name, each in reached.items() if name in each} == set()


@parts
def test_what_is_heavy_or_optional_is_imported_in_its_room_only(part: str) -> None:
    for module, place, imported in imports_in(part):
        room = ROOMS.get(imported.split(".")[0])
        assert room is None or any(module == r or module.startswith(r + ".")
                                   for r in room), f"{place} imports {imported}"


@pytest.mark.parametrize("part", ["study.continuation", "study.basins"])
def test_orbits_and_basins_know_the_solvers_through_one_adapter_each(part: str) -> None:
    for module, place, imported in imports_in(part):
        assert module == f"{part}.driveline" or not imported.startswith("tcc_sim.solvers"), place


@parts
def test_what_is_measured_is_for_one_module_of_verbs_only(part: str) -> None:
    for module, place, imported in imports_in(part) if part != "study.benchmarks" else []:
        assert module == MEASURING or not imported.startswith("tcc_sim.study.benchmarks"), place


def loaded_by(statement: str) -> set[str]:
    """Heavy packages that a fresh interpreter has loaded after a statement."""
    code = f"import sys; before = set(sys.modules); {statement}; print(*set(sys.modules) - before)"
    words = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True,
                           check=True).stdout.split()
    return {word.split(".")[0] for word in words} & set(HEAVY)


def test_importing_the_package_loads_nothing_heavy() -> None:
    assert loaded_by("import tcc_sim") == set()


def test_the_list_of_scenes_loads_what_it_needs_only() -> None:
    silent = "out, sys.stdout = sys.stdout, io.StringIO()"
    assert loaded_by(f"import io, tcc_sim.cli; {silent}; tcc_sim.cli.main(['scenes']); sys.stdout = out") <= {"yaml"}


def test_no_parser_needs_an_optional_package() -> None:
    code = ("import sys\n"
            "for name in ('rclpy', 'rerun', 'matplotlib', 'distributed'): sys.modules[name] = None\n"
            "from tcc_sim.cli import build_parser; build_parser()")
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)


def test_every_module_says_what_it_is_for() -> None:
    for path in MODULES:
        assert ast.get_docstring(tree_of(path)), f"{path} has no docstring"


def test_a_name_means_one_thing() -> None:
    """A public function or class is defined once; the two engines share names of their parts."""
    meanings: dict[str, set[str]] = {}
    for path in MODULES:
        of = "solvers.engine" if {"smoothed", "event_driven"} & set(path.parts) else name_of(path)
        for node in tree_of(path).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                meanings.setdefault(node.name, set()).add(of)
    assert {name: each for name, each in meanings.items() if len(each) > 1 and name not in PROTOCOLS} == {}


def test_test_modules_have_names_of_their_own() -> None:
    names = [path.name for path in (ROOT / "test").rglob("test_*.py")]
    assert len(names) == len(set(names))
    assert not list((ROOT / "test").rglob("__init__.py"))


def test_every_key_says_what_it_means() -> None:
    for key, quantity in QUANTITIES.items():
        assert quantity.description, key
        assert quantity.choices or quantity.low > -float("inf"), f"{key} has no range"


def keys_in(path: Path) -> dict[str, object]:
    """The dotted keys of a parameter file, read without this package."""
    (node,) = yaml.safe_load(path.read_text()).values()
    by_name: dict[str, object] = {}
    for name, value in node["ros__parameters"].items():
        by_name |= {f"{name}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {name: value}
    return by_name


def without_effect(keys: dict[str, object]) -> set[str]:
    """Keys without an effect, which a scene may omit."""
    free = {key for key, value in DEFAULTS.items() if value == ()}
    free |= {key for key in PROFILES if f"{key}_times" in keys}
    free |= set(TABULATED) if "friction.slip_speeds" in keys else set()
    free |= {"pressure.time_constant", "pressure.delay", "pressure.rate_limit"}  # Without them there is no actuator.
    for group in ("engine", "pressure"):
        if keys[f"{group}.source"] == "harmonic":
            free |= {f"{group}.fallback"}
    if keys["engine.source"] == "topic" and keys["engine.fallback"] == "mean":
        free |= {"engine.torque_amplitude"}
    if keys["pressure.source"] == "topic" and keys["pressure.fallback"] == "mean":
        free |= {"pressure.amplitude", "pressure.frequency_ratio", "pressure.phase"}
    if keys.get("pressure.amplitude") == 0.0:
        free |= {"pressure.frequency_ratio", "pressure.phase"}
    return free


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda p: p.name)
def test_a_bundled_scene_is_complete_and_comes_back_from_its_own_text(path: Path) -> None:
    keys = keys_in(path)
    assert set(QUANTITIES) - without_effect(keys) <= set(keys)
    scene = load_scene(path.stem)
    assert scene.description
    again = parse_scene(scene.text(), scene.name)
    assert again == scene
    assert again.text() == scene.text()
    for key, value in keys.items():
        value = tuple(value) if isinstance(value, list) else value
        holder, name = (getattr(scene.system, key.split(".")[0]),
                        key.split(".")[1]) if "." in key else (scene.operation, key)
        assert getattr(holder, name) == value
        # ROS 2 gives a parameter the type that the file shows, and a double must not look like an integer.
        for each in value if isinstance(value, tuple) else (value,):
            assert isinstance(each, (float, str, bool)) or isinstance(getattr(holder, name), int), f"{key}: {value}"


def test_installed_files_and_versions_agree() -> None:
    from tcc_sim import __version__

    text = (ROOT / "package.xml").read_text()
    assert f"<version>{__version__}</version>" in text
    keys = re.findall(r"<exec_depend>(.*?)</exec_depend>", text)
    assert len(keys) == len(set(keys))
    messages = {line.split(".")[0] for path in (PACKAGE / "nodes").glob("*.py") for _, line in imports_of(path)}
    assert {name for name in messages if name.endswith(("_msgs", "_srvs", "_interfaces"))
            or name == "rclpy"} <= set(keys)


def test_node_options_say_what_they_mean() -> None:
    for item in dataclasses.fields(Operation):
        assert item.metadata["quantity"].description, item.name


def evaluates(source: ast.AST) -> bool:
    """Return whether a piece of source has one of FUNCTIONS of a real argument, or prints one."""
    for part in ast.walk(source):
        if isinstance(part, ast.Call):
            called = part.func.attr if isinstance(part.func, ast.Attribute) else getattr(part.func, "id", "")
            turns = any(isinstance(n, ast.Constant) and isinstance(n.value, complex) for n in ast.walk(part))
            if called in FUNCTIONS and not turns:
                return True
        if isinstance(part, ast.JoinedStr) and any(
                IN_TEXT.search(str(n.value)) for n in part.values if isinstance(n, ast.Constant)):
            return True
    return False


@cache
def found_texts() -> list[tuple[str, str]]:
    """Return files, and functions or classes in them, with one of FUNCTIONS; "" for the rest of a file."""
    python = [(path.relative_to(PACKAGE).as_posix(), getattr(node, "name", ""))
              for path in MODULES for node in ast.parse(path.read_text()).body if evaluates(node)]
    c = [(path.relative_to(PACKAGE).as_posix(), "") for path in PACKAGE.rglob("*.[ch]")
         if IN_TEXT.search(re.sub(r"/[*].*?[*]/", "", path.read_text(), flags=re.DOTALL))]
    return python + c


def test_the_friction_law_has_few_texts() -> None:
    for file, name in found_texts():
        assert {file, f"{file} {name}"} & {*TEXTS, *OTHERS}, f"tcc_sim/{file}: {name or 'the module'} {ADVICE}"
    assert len(TEXTS) <= MOST_TEXTS


def test_every_row_is_of_something() -> None:
    names = {row for file, name in found_texts() for row in (file, f"{file} {name}")}
    assert not {*TEXTS, *OTHERS} - names


def test_an_eighth_text_would_be_seen() -> None:
    for text in ("def f(v):\n    return 1.0 + c * np.exp(-a * v)", "def f(v):\n    return math.tanh(sigma * v)",
                 "def f(v):\n    return f'{c}*exp(-{a}*abs(v))'", "x = [decayed(a, v) for a in rates]",
                 "def f(v, e, k):\n    exponential(-a, v, e, k)"):
        assert evaluates(ast.parse(text))
    assert not evaluates(ast.parse("np.exp(1j * phase)"))


ABOLISHED = {"Room", "found", "told", "beside", "asked", "own", "there", "rung", "rungs", "grip", "moves"}
"""Words that once were names of many things."""


def words_of_house() -> list[str]:
    """The words of the table in the contributing page."""
    page = (ROOT / ".github" / "internals" / "contributing.md").read_text()
    table = page.partition("## House words")[2].partition("## ")[0]
    return re.findall(r"^\| (?!word|---)(.+?) \|", table, re.MULTILINE)


@cache
def identifiers() -> frozenset[str]:
    """Names of variables, arguments, functions, classes, attributes and keywords of the package."""
    return frozenset(name for path in MODULES for node in ast.walk(tree_of(path))
                     for name in (getattr(node, field, None) for field in ("id", "arg", "attr", "name"))
                     if isinstance(name, str))


def test_the_page_for_contributors_has_the_words_of_the_house() -> None:
    words = words_of_house()
    assert 20 <= len(words) <= 25
    parts = {part.lower() for name in identifiers() for part in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)}
    rooms = {part for path in MODULES for part in path.relative_to(PACKAGE).with_suffix("").parts}
    parts |= {part for name in rooms for part in name.split("_")}
    assert [word for word in words if not any({one, one + "s"} & parts for one in word.split()[:1])] == []


def test_no_name_is_a_word_that_names_nothing() -> None:
    """Also in fields of records, which are strings."""
    assert identifiers() & ABOLISHED == set()
    fields = {node.value for path in MODULES if "solvers" in path.parts for node in ast.walk(tree_of(path))
              if isinstance(node, ast.Constant)}
    assert fields & ABOLISHED == set()
