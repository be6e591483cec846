"""The packages: an sdist with everything for its tests, a wheel that works by itself, and metadata."""

import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from configparser import ConfigParser
from pathlib import Path

import pytest
import yaml

from tcc_sim import __version__, errors
from tcc_sim.compiling.compiled import not_to_ship

ROOT = Path(__file__).resolve().parent.parent
CONFIGURATION = ConfigParser()
CONFIGURATION.read(ROOT / "setup.cfg")


STAND_IN = """
import sys
from pathlib import Path
folder = Path(sys.argv[1])
folder.mkdir(parents=True)
(folder / "kernel-1-2").write_bytes(b"code")
"""
"""Compiles nothing, in the place of `ahead.py`, which takes half a minute."""


def build(folder, steps, without="", stand_in=STAND_IN):
    """Standard error of `setuptools.build_meta`, run in a copy of the tree with the setuptools that is installed."""
    pytest.importorskip("setuptools", minversion="68")
    source = folder / "source"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(
        "__pycache__", ".git", ".venv", "build", "dist", "install", "log", "*.egg-info", ".*_cache", ".hypothesis",
        "shipped"))
    (source / "tcc_sim" / "study" / "cli" / "ahead.py").write_text(stand_in)
    code = ("import sys; from setuptools import build_meta as b; folder = sys.argv[1]; steps = sys.argv[2:]\n"
            "for step in steps: getattr(b, step)(folder)")  # building changes sys.argv
    ended = subprocess.run([sys.executable, "-c", code, str(folder), *steps], cwd=source, capture_output=True,
                           text=True, check=False, env={**os.environ, "TCC_SIM_KERNELS": without})
    assert ended.returncode == 0, ended.stderr[-2000:]
    return ended.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sdist and wheel."""
    folder = tmp_path_factory.mktemp("built")
    build(folder, ["build_sdist", "build_wheel"])
    sdist, = folder.glob("*.tar.gz")
    wheel, = folder.glob("*.whl")
    return sdist, wheel


SHIPPED = "tcc_sim/compiling/shipped/kernel-1-2"
LEVEL_HERE = pytest.mark.skipif(bool(not_to_ship()), reason="no kernels are compiled ahead here")


@LEVEL_HERE
def test_the_wheel_has_the_kernels_and_names_the_platform_and_the_sdist_has_none(built):
    sdist, wheel = built
    with zipfile.ZipFile(wheel) as file:
        assert file.read(SHIPPED) == b"code"
        assert [name for name in file.namelist() if name.startswith("tcc_sim/compiling/shipped")] == [SHIPPED]
    assert wheel.name.endswith(f"-linux_{platform.machine()}.whl")
    with tarfile.open(sdist) as file:
        assert not [name for name in file.getnames() if "shipped" in name]


def test_the_sdist_holds_every_file_of_package_tests_and_scenes(built):
    with tarfile.open(built[0]) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    wanted = {str(path.relative_to(ROOT)) for part in ("tcc_sim", "test", "config", "resource", ".ci", ".github")
              for path in (ROOT / part).rglob("*")
              if path.is_file() and not {"__pycache__", "pictures", "shipped"} & set(path.parts)}
    wanted |= {"setup.py", "setup.cfg", "pyproject.toml", "package.xml", "README.md", "LICENSE", "CHANGELOG.rst",
               "CITATION.cff"}
    assert wanted - names == set()
    assert "test/conftest.py" in wanted


def test_the_metadata_name_every_extra(built):
    with zipfile.ZipFile(built[1]) as file:
        name, = (n for n in file.namelist() if n.endswith("METADATA"))
        head = file.read(name).decode().partition("\n\n")[0]
    assert "example.org" not in head + (ROOT / "package.xml").read_text()
    assert set(CONFIGURATION["options.extras_require"]) == set(re.findall(r"Provides-Extra: (\S+)", head))
    assert "Project-URL: Repository" in head


def test_the_wheel_finds_its_scenes_outside_the_checkout(built, tmp_path):
    site = tmp_path / "lib" / "site-packages"
    with zipfile.ZipFile(built[1]) as file:
        for name in file.namelist():
            inside = re.sub(r"^tcc_sim-[^/]+\.data/data/", "../../", name)
            target = (site / inside).resolve()
            target.parent.mkdir(parents=True, exist_ok=True)
            if not name.endswith("/"):
                target.write_bytes(file.read(name))
    code = ("import sys; sys.path.insert(0, sys.argv[1]); import tcc_sim; from tcc_sim.scene import bundled_scenes\n"
            "print(tcc_sim.__file__); print(*bundled_scenes())")
    ended = subprocess.run([sys.executable, "-c", code, str(site)], cwd=tmp_path, capture_output=True, text=True,
                           check=False,
                           env={"PATH": "", "HOME": str(Path.home())})
    assert ended.returncode == 0, ended.stderr
    where, scenes = ended.stdout.splitlines()
    assert where.startswith(str(site))
    assert scenes.split() == sorted(path.stem for path in (ROOT / "config").glob("*.yaml"))


@LEVEL_HERE
def test_an_editable_installation_has_the_kernels_beside_the_source_from_an_earlier_build_too(tmp_path):
    only_in_build = STAND_IN.replace("folder =", "assert 'build' in sys.argv[1]\nfolder =")
    build(tmp_path, ["build_wheel", "build_editable"], stand_in=only_in_build)
    assert (tmp_path / "source" / SHIPPED).read_bytes() == b"code"


@pytest.mark.parametrize("reason", ["absent", "other", "none", "processor"])
def test_without_its_numba_a_wheel_is_pure_and_a_line_gives_the_reason(tmp_path, monkeypatch, reason):
    without, said = "", "the build has no package numba"
    if reason == "none":
        without, said = "none", "TCC_SIM_KERNELS is none"
    elif reason == "processor":
        monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64-v2")
        said = "the build's processor is not x86-64-v3"
    else:  # A package that hides the installed one.
        hiding = tmp_path / "hiding" / "numba"
        hiding.mkdir(parents=True)
        (hiding / "__init__.py").write_text("raise ModuleNotFoundError(name='numba')")
        if reason == "other":
            (hiding / "_version.py").write_text('{"version": "0.58.1"}')
            said = ("Numba 0.58.1 is installed, and kernels need 0.62 to 0.68; python3 -m pip install "
                    "'numba>=0.62,<0.69' brings one")
        else:
            monkeypatch.setenv("NO_NUMBA", "1")
            (tmp_path / "hiding" / "sitecustomize.py").write_text(
                "import importlib.util as u\nfind = u.find_spec\n"
                "u.find_spec = lambda name, *more: None if name == 'numba' else find(name, *more)\n")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path / "hiding"))
    line = f"tcc_sim: built without kernels, so first runs compile them: {said}\n"
    if reason != "none":
        code = ("import setuptools; from distutils.core import run_setup\n"
                "print(bool(run_setup('setup.py', script_args=['--dry-run'], stop_after='config').has_ext_modules()))")
        ended = subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=ROOT, capture_output=True, text=True,
                               check=True, env={**os.environ, "TCC_SIM_KERNELS": without})
        assert (ended.stdout, line in ended.stderr) == ("False\n", True)
    else:
        assert line in build(tmp_path, ["build_wheel"], without)
        wheel, = tmp_path.glob("*.whl")
        assert wheel.name.endswith("-py3-none-any.whl")
        with zipfile.ZipFile(wheel) as file:
            assert SHIPPED not in file.namelist()


@LEVEL_HERE
def test_a_failure_to_compile_ahead_leaves_a_package_that_works(tmp_path):
    build(tmp_path, ["build_wheel"], stand_in="raise SystemExit(1)")
    wheel, = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        assert "tcc_sim/__init__.py" in file.namelist()


def test_the_page_on_installation_lists_every_extra_and_the_contents_of_all():
    extras = CONFIGURATION["options.extras_require"]
    rows = dict(re.findall(r"^\| `\[(\w+)\]` \| (.*) \|$", (ROOT / ".github/guide/start.md").read_text(), re.MULTILINE))
    assert rows.keys() == extras.keys()
    held, = re.findall(r"tcc_sim\[(.*)\]", extras["all"])
    assert re.findall(r"`\[(\w+)\]`", rows["all"]) == held.split(",")


def test_the_citation_has_the_version():
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == __version__


def test_an_absent_package_is_asked_for_in_the_versions_that_are_allowed():
    wanted = {re.split(">=", requirement)[0]: requirement
              for requirement in CONFIGURATION["options"]["install_requires"].split()}
    assert set(errors.REQUIRED.values()) == wanted.keys()
    for module, package in errors.REQUIRED.items():
        sentence = str(errors.missing_package(ModuleNotFoundError(name=f"{module}.part")))
        assert f"package {package} " in sentence
        assert "<" not in wanted[package] or f"'{wanted[package]}'" in sentence
    assert errors.missing_package(ModuleNotFoundError(name="tcc_sim.nonsense")) is None


def test_pip_and_both_ways_of_colcon_read_the_same_metadata(tmp_path):
    """`colcon build --symlink-install` sees setup.py, setup.cfg and the package alone, in a folder of links."""
    for item in ("setup.py", "setup.cfg", "tcc_sim", "config", "resource", "package.xml"):
        (tmp_path / item).symlink_to(ROOT / item)
    code = ("import setuptools; from distutils.core import run_setup\n"
            "found = run_setup('setup.py', script_args=['--dry-run'], stop_after='config')\n"
            "print(found.get_name(), found.get_version(), found.python_requires, len(found.packages),"
            " found.entry_points)")
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=tmp_path, capture_output=True, text=True,
                           check=True)
    name, version, python, packages, points = ended.stdout.split(" ", 4)
    assert (name, version, python) == ("tcc_sim", __version__, ">=3.10")
    assert int(packages) == sum(1 for _ in (ROOT / "tcc_sim").rglob("__init__.py"))
    assert {"driveline_node", "recorder_node"} <= set(re.findall(r"(\w+_node) =", points))
