"""Rules of the layout: imports between rooms, modules that stay unloaded, texts of the friction law, bundled scenes."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml

from tcc_sim.later_rooms import CALLED, from_later_room
from tcc_sim.scene import load_scene, parse_scene

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "tcc_sim"
MODULES = sorted(PACKAGE.rglob("*.py"))
ORDER = ["errors", "code_version", "background", "later_rooms", "topics", "result", "shown_units", "model",
         "trajectory", "parameter_file", "tables", "scene", "messages", "compiling", "polynomials",
         "solvers", "recording", "analysis.repetition", "analysis.steady", "analysis.measured",
         "analysis.loop", "plant", "sweeps", "output", "fmi", "views", "nodes", "testing", "replay", "estimation",
         "functions", "cli", "study.continuation", "study.basins", "study.views", "study.paper", "study.benchmarks",
         "study.cli", "types", "__main__"]
"""A part imports only from itself and from parts before it; so the core, which is all but the study, imports nothing of
the study.
"""

ROS = ["nodes", "testing"]
DRAWINGS = ["views", "study.views", "study.paper.drawings", "study.benchmarks.report_drawings"]
ROOMS = {
    "numba": ["compiling"], "llvmlite": ["compiling"],
    "scipy": ["tables", "solvers", "analysis", "sweeps", "estimation", "study", "model.friction_curve"],
    "pandas": ["replay"], "pyarrow": ["tables"], "asammdf": ["tables"], "nptdms": ["tables"],
    "distributed": ["sweeps.executors"], "dask": ["sweeps.executors"],
    "mcap": ["recording"], "rosbags": ["recording"], "zstandard": ["recording"], "lz4": ["recording"],
    "yaml": ["parameter_file", "scene", "recording", "messages", "study.paper"],
    "rclpy": [*ROS, "study.benchmarks.pacing_benchmark"], "rcl_interfaces": ROS, "builtin_interfaces": ROS,
    "std_msgs": ROS, "sensor_msgs": ROS, "std_srvs": ROS, "diagnostic_msgs": ROS, "rosgraph_msgs": ROS,
    "ament_index_python": ROS,
    "rerun": ["views"], "matplotlib": DRAWINGS, "cycler": DRAWINGS, "argparse": ["cli", "study.cli"],
}
"""Rooms that may import an optional or slow package."""


HEAVY = ["numpy", "numba", "scipy", "yaml", "mcap", "zstandard", "lz4", "rclpy", "rerun", "matplotlib", "distributed",
         "tqdm"]

OWN = re.compile(r"\b_[a-z]\w*")


def name_of(path: Path) -> str:
    """Dotted name below tcc_sim; empty for its __init__."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Every statement in a file, and what holds statements; no expression, since these are most of a tree."""
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, name, ()) if not isinstance(node, ast.expr) else ():
            yield inner
            yield from statements(inner)


@cache
def imports_of(path: Path) -> list[tuple[int, str]]:
    """Line and absolute dotted name of every import, function-local and type-checking ones included."""
    values, text = [], path.read_text()
    tree = ast.parse(text)
    for node in ast.walk(tree) if "import_module" in text else statements(tree):
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


def part_of(name: str) -> str:
    """The part of a dotted name below tcc_sim."""
    first, *rest = name.split(".")
    return f"{first}.{rest[0]}" if first in ("study", "analysis") and rest else first


def imports_in(part: str) -> list[tuple[str, str, str]]:
    """Module, line and imported name of every import of a part."""
    paths = [path for path in MODULES if part_of(name_of(path)) == part]
    assert paths, f"there is no part {part}"
    return [(name_of(path), f"{path}:{line}", imported) for path in paths for line, imported in imports_of(path)]


def test_every_file_is_of_a_part() -> None:
    assert {part_of(name_of(path)) for path in MODULES} == {"", "study", "analysis", *ORDER}


def test_a_part_imports_only_from_parts_before_it() -> None:
    for part, (_, place, imported) in [(each, row) for each in ORDER for row in imports_in(each)]:
        package, *rest = imported.split(".")
        if package == "tcc_sim" and rest != ["__version__"]:
            of = part_of(".".join(rest))
            assert of in ORDER, f"{place} imports {imported}, a part that ORDER does not know"
            later = ORDER.index(of) > ORDER.index(part)
            assert not later, f"{place}: {part} imports {imported}, which comes after it"


def test_the_core_names_the_study_in_one_table() -> None:
    """The package's own names and types, the verbs and `later_rooms` are the only places."""
    named = {name_of(path) for path in MODULES if "tcc_sim.study" in path.read_text()}
    assert {name for name in named if part_of(name).partition(".")[0] != "study"} == {"", "cli", "later_rooms", "types"}


def test_every_call_into_a_later_room_has_its_function() -> None:
    for name in CALLED:
        assert callable(from_later_room(name)), name


def test_no_module_imports_itself_through_others() -> None:
    """Function-local imports and those for types count too."""
    names, reached = {name_of(path) for path in MODULES}, {}
    for path in MODULES:
        words = [word.removeprefix("tcc_sim.") for _, word in imports_of(path)
                 if word.startswith("tcc_sim") and not word.endswith("?")]
        reached[name_of(path)] = {word if word in names else word.rpartition(".")[0] for word in words} - {""}
    for middle in reached:
        for each in reached.values():
            if middle in each:
                each |= reached[middle]
    assert {name for name, each in reached.items() if name in each} == set()


def test_what_is_heavy_or_optional_is_imported_in_its_room_only() -> None:
    for module, place, imported in (row for part in ["", *ORDER] for row in imports_in(part)):
        room = ROOMS.get(imported.split(".")[0])
        assert room is None or any(module == r or module.startswith(r + ".")
                                   for r in room), f"{place} imports {imported}"


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


def keys_in(path: Path) -> dict[str, object]:
    """The dotted keys of a parameter file, read without this package."""
    (node,) = yaml.safe_load(path.read_text()).values()
    by_name: dict[str, object] = {}
    for name, value in node["ros__parameters"].items():
        by_name |= {f"{name}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {name: value}
    return by_name


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda p: p.name)
def test_a_bundled_scene_comes_back_from_its_own_text(path: Path) -> None:
    keys = keys_in(path)
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


def broken_rules(path: Path) -> Iterator[str]:
    """Places where a test enters by a private name of the package or patches the package."""
    ours: set[str] = set()
    nodes = list(ast.walk(ast.parse(path.read_text())))
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("tcc_sim"):
            ours |= {alias.asname or alias.name for alias in node.names}
            yield from (f"{path.name}:{node.lineno} imports {alias.name}" for alias in node.names
                        if OWN.fullmatch(alias.name))
        elif isinstance(node, ast.Import):
            ours |= {alias.asname or "tcc_sim" for alias in node.names if alias.name.startswith("tcc_sim")}
    for node in nodes:
        if isinstance(node, ast.Attribute) and OWN.fullmatch(node.attr) and not node.attr.startswith("_repr_"):
            root = node.value
            while isinstance(root, ast.Attribute):
                root = root.value
            if isinstance(root, ast.Name) and root.id in ours:
                yield f"{path.name}:{node.lineno} uses {ast.unparse(node)}"
        elif isinstance(node, ast.Call) and node.args and getattr(node.func, "attr", "") == "setattr":
            first = node.args[0]
            text = str(first.value) if isinstance(first, ast.Constant) else ast.unparse(first)
            if text.split(".")[0] in ours | {"tcc_sim"}:
                yield f"{path.name}:{node.lineno} patches {text}"


def test_tests_enter_from_outside() -> None:
    """A test imports no private name of the package and replaces none of its functions."""
    files = [path for path in sorted((ROOT / "test").rglob("*.py")) if re.search(r"\b_[a-z]|setattr", path.read_text())]
    assert [line for path in files for line in broken_rules(path)] == []
