"""The packages: an sdist with everything for its tests, a wheel that works by itself, and metadata."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
import yaml

if sys.version_info >= (3, 11):
    import tomllib as toml
else:
    import tomli as toml

from tcc_sim import __version__

ROOT = Path(__file__).resolve().parent.parent
PROJECT = toml.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sdist and wheel, made in a copy of the tree with the setuptools that is installed."""
    pytest.importorskip("setuptools", minversion="70")
    folder = tmp_path_factory.mktemp("built")
    source = folder / "source"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(
        "__pycache__", ".git", ".venv", "build", "dist", "install", "log", "*.egg-info", ".*_cache", ".hypothesis"))
    code = ("import sys; from setuptools import build_meta as b; folder = sys.argv[1]\n"
            "b.build_sdist(folder); b.build_wheel(folder)")  # building changes sys.argv
    ended = subprocess.run([sys.executable, "-c", code, str(folder)], cwd=source, capture_output=True, text=True,
                           check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]
    sdist, = folder.glob("*.tar.gz")
    wheel, = folder.glob("*.whl")
    return sdist, wheel


def test_the_sdist_holds_every_file_of_package_tests_and_scenes(built):
    with tarfile.open(built[0]) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    wanted = {str(path.relative_to(ROOT)) for part in ("tcc_sim", "test", "config", "resource", ".ci", ".github")
              for path in (ROOT / part).rglob("*")
              if path.is_file() and not {"__pycache__", "pictures"} & set(path.parts)}
    wanted |= {"setup.py", "setup.cfg", "pyproject.toml", "package.xml", "README.md", "LICENSE", "CHANGELOG.rst",
               "CITATION.cff"}
    assert wanted - names == set()
    assert "test/conftest.py" in wanted


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


def test_the_metadata_are_whole_and_hold_no_placeholder(built):
    with zipfile.ZipFile(built[1]) as file:
        name, = (n for n in file.namelist() if n.endswith("METADATA"))
        text = file.read(name).decode()
    head = text.partition("\n\n")[0]
    assert "example.org" not in head
    assert "example.org" not in (ROOT / "package.xml").read_text()
    assert head.count("Classifier: ") >= 8
    assert "Keywords: " in head
    extras = {"ros", "view", "cluster", "table", "test", "all"}
    assert extras == set(re.findall(r"Provides-Extra: (\S+)", head))
    assert "Requires-Dist: tcc_sim[cluster,ros,table,view]; extra == \"all\"" in head
    assert "Project-URL: Repository" in head


def test_the_paper_is_cited_as_its_copy_prints_it():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == __version__
    paper, = cited["references"]
    assert [author["family-names"] for author in paper["authors"]] == ["Duan", "Singh"]
    assert paper["title"].startswith("Influence of harmonically varying normal load on steady-state behavior of a 2dof")
    assert paper.keys() == {"type", "title", "authors"}  # The copy prints no journal, volume, year or DOI.


def test_every_requirement_has_a_floor_that_can_be_tested():
    extras = PROJECT["optional-dependencies"]
    for requirement in [*PROJECT["dependencies"], *extras["view"], *extras["cluster"], *extras["table"]]:
        assert re.fullmatch(r"[A-Za-z0-9_.-]+>=[0-9.]+(,<[0-9.]+)?", requirement), requirement
