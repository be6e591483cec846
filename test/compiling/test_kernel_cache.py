"""Compiled code on disk: keyed by the text that a kernel reaches, and used only if no other user can write it."""

from __future__ import annotations

import fcntl
import math
import os
import re
import signal
import stat
import sys
import threading
import time
from collections import namedtuple
from contextlib import nullcontext
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from full_disk import full_disk
from kernels_on_disk import CALLEE, CALLER, forget, hits, modules
from llvmlite import binding
from numba.core import compiler

from tcc_sim.compiling import compiled as compiled_module
from tcc_sim.compiling import kernel_cache, linked
from tcc_sim.compiling.compiled import Kernel, compiled, timed
from tcc_sim.compiling.kernel_cache import Dependencies
from tcc_sim.compiling.processor import NEEDED, Processor, processor
from tcc_sim.scene import system_of
from tcc_sim.solvers import fixed_step
from tcc_sim.solvers.terms import terms_of


def test_the_second_process_finds_what_the_first_compiled(cache, tmp_path, capsys):
    assert modules(tmp_path, name="again")(3.0) == 7.0
    kernel = modules(tmp_path, name="again")
    assert (kernel(3.0), hits(kernel)) == (7.0, 1)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in cache.iterdir()} == {0o600}
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("old", "new", "result", "value"), [
    ("GAIN = 2.0", "GAIN = 5.0", 0, 16.0), ("GAIN * x", "GAIN * x * x", 0, 19.0),
    ("UNUSED = 1.0", "UNUSED = 9.0", 1, 7.0), ("x + 1.0", "x + 9.0", 1, 7.0),
    ("times the gain", "by the gain\n    and more lines", 1, 7.0),
    ("'''A module", "# a comment\n'''A module", 1, 7.0)])
def test_what_a_kernel_reaches_counts_and_nothing_else(cache, tmp_path, old, new, result, value):
    modules(tmp_path, name=f"edited_{tmp_path.name}")(3.0)
    assert old in CALLEE
    kernel = modules(tmp_path, CALLEE.replace(old, new), name=f"edited_{tmp_path.name}")
    assert (kernel(3.0), hits(kernel)) == (value, result)


def damage(cache, kind):
    for path in cache.iterdir():
        data = path.read_bytes()
        if kind == "flipped":
            path.write_bytes(data[:len(data) // 2] + bytes([data[len(data) // 2] ^ 4]) + data[len(data) // 2 + 1:])
        elif kind == "cut":
            path.write_bytes(data[:40])
        elif kind == "empty":
            path.write_bytes(b"")
        else:
            path.unlink()
            path.mkdir()


@pytest.mark.parametrize("kind", ["flipped", "cut", "empty", "directory"])
def test_a_damaged_cache_costs_one_line_and_is_put_right(cache, tmp_path, capsys, kind):
    name = f"damaged_{kind}"
    modules(tmp_path, name=name)(3.0)
    damage(cache, kind)
    kernel = modules(tmp_path, name=name)
    assert (kernel(3.0), hits(kernel)) == (7.0, 0)
    assert capsys.readouterr().err.count("\n") == (2 if kind == "directory" else 1)  # Another if it cannot be stored.
    if kind != "directory":
        kernel = modules(tmp_path, name=name)
        assert (kernel(3.0), hits(kernel)) == (7.0, 1)


def plant(cache, folder):
    """Replace the code in the cache by other code with a valid checksum."""
    files = list(cache.iterdir())
    modules(folder, CALLEE.replace("GAIN = 2.0", "GAIN = 5.0"))(3.0)
    (other,) = set(cache.iterdir()) - set(files)
    for path in files:
        path.write_bytes(other.read_bytes())


def test_what_is_planted_would_run(cache, tmp_path):
    """Without the check of permissions."""
    modules(tmp_path, name="planted")(3.0)
    plant(cache, tmp_path)
    assert modules(tmp_path, name="planted")(3.0) == 16.0


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
@pytest.mark.parametrize("above", [False, True])
def test_no_directory_is_used_that_others_can_write_to_or_rename(cache, tmp_path, capsys, above, mode):
    modules(tmp_path, name=f"planted_{above}_{mode}")(3.0)
    plant(cache, tmp_path)
    place = cache.parent if above else cache
    place.chmod(mode)
    kernel_cache.directory.cache_clear()
    assert modules(tmp_path, name=f"planted_{above}_{mode}")(3.0) == 7.0
    assert ("others can write to " + (f"{cache.parent}\n" if above else "it")) in capsys.readouterr().err
    assert stat.S_IMODE(place.stat().st_mode) == mode


def test_a_sticky_folder_above_it_may_be_everybodys(cache):
    cache.parent.mkdir()
    cache.parent.chmod(0o1777)
    assert kernel_cache.directory() == cache


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give folders away")
@pytest.mark.parametrize("place", ["parent", "in a sticky folder"])
def test_no_folder_above_it_belongs_to_somebody_else(cache, tmp_path, monkeypatch, capsys, place):
    base = cache.parent
    if place == "in a sticky folder":
        base.mkdir()
        base.chmod(0o1777)
        base = base / "theirs"
        monkeypatch.setenv("XDG_CACHE_HOME", str(base))
    base.mkdir()
    os.chown(base, 12345, 12345)
    assert kernel_cache.directory() is None
    assert str(base if place == "parent" else cache.parent) in capsys.readouterr().err
    assert not (base / "tcc_sim").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give files away")
def test_what_belongs_to_somebody_else_is_not_used(cache, tmp_path, capsys):
    modules(tmp_path, name="foreign")(3.0)
    plant(cache, tmp_path)
    for path in cache.iterdir():
        os.chown(path, 12345, 12345)
    assert modules(tmp_path, name="foreign")(3.0) == 7.0
    assert "not a private file" in capsys.readouterr().err
    os.chown(cache, 12345, 12345)
    kernel_cache.announced.clear()
    kernel_cache.directory.cache_clear()
    assert modules(tmp_path, name="foreign")(3.0) == 7.0
    assert "belongs to somebody else" in capsys.readouterr().err


@pytest.mark.parametrize(("place", "words"), [
    ("relative", "which is not absolute"), ("link", "not a directory"), ("file", "without a cache"),
    ("full", "not kept")])
def test_where_nothing_can_be_kept_it_works_and_says_so_once(cache, tmp_path, monkeypatch, capsys, place, words):
    monkeypatch.chdir(tmp_path)
    if place == "relative":
        monkeypatch.setenv("NUMBA_CACHE_DIR", "numba")
    elif place == "link":
        cache.parent.mkdir()
        (tmp_path / "elsewhere").mkdir()
        cache.symlink_to(tmp_path / "elsewhere")
    elif place == "file":
        cache.parent.write_text("a file is in the way")
    for _ in range(2):
        kernel = modules(tmp_path, name=f"without_{place}")
        with full_disk() if place == "full" else nullcontext():
            assert kernel(3.0) == 7.0
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert words in err
    assert not (tmp_path / "numba").exists()
    assert not cache.exists() or not list(cache.iterdir())


def test_numba_cache_dir_is_the_base_and_no_more(cache, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    kernel_cache.directory.cache_clear()
    modules(tmp_path)(3.0)
    assert [path.name for path in (tmp_path / "numba").iterdir()] == ["tcc_sim"]
    assert len(list((tmp_path / "numba" / "tcc_sim").iterdir())) == 1  # The kernel, with its function.
    assert not cache.exists()


def test_no_base_that_is_not_absolute_and_no_home(cache, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    assert kernel_cache.directory() == tmp_path / ".cache" / "tcc_sim"
    kernel_cache.directory.cache_clear()

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    assert kernel_cache.directory() is None
    assert capsys.readouterr().err == (
        "tcc-sim: kernels are compiled without a cache: ~/.cache: Could not determine home directory.\n")


def test_every_compilation_of_a_second_is_announced(cache, capsys):
    for name, seconds, said in (("short", 0.9, ""), ("long", 7.0, "about 7 s"), ("other", 1.0, "about 1 s")):
        def make(name=name):
            assert stat.S_IMODE((cache / f"tmp.{name}").stat().st_mode) == 0o600  # The lock.
            return b"code"

        assert kernel_cache.load_or_build(name, lambda s=seconds: s, make, bytes.upper) == b"CODE"
        err = capsys.readouterr().err
        assert err == (f"tcc-sim: compiling kernels for this kind of scene, {said}, once\n" if said else "")
    assert kernel_cache.load_or_build("long", lambda: 7.0, lambda: b"another", bytes.upper) == b"CODE"
    assert capsys.readouterr().err == ""


def test_the_estimate_counts_what_is_left_to_do(cache, tmp_path):
    kernel = modules(tmp_path, name="estimated")
    function, called = kernel.py_func, kernel.py_func.__globals__["callee"].scaled.py_func
    size, inner = len(function.__code__.co_code) + len(called.__code__.co_code), len(called.__code__.co_code)
    assert kernel.dependencies.size == size
    assert kernel.seconds() == pytest.approx(7e-5 * size)
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(sys.modules, "numba")
        assert kernel.seconds() == pytest.approx(0.7 + 7e-5 * size)
    kernel.effort = 3.0
    assert kernel.seconds() == pytest.approx(13e-5 * size)
    kernel(3.0)
    forget()
    left = 3e-5 * size + max(0.0, 4e-5 * size - 12e-5 * inner)
    assert modules(tmp_path, name="estimated").seconds() == pytest.approx(left)


def lowered(kernel, *arguments):
    """Result of a kernel in a process that knows only what is on disk, names of functions lowered, and its file."""
    forget()
    names = []
    compile_core = compiler.CompilerBase._compile_core

    def noted(self):
        names.append(self.state.func_id.func_name)
        return compile_core(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiler.CompilerBase, "_compile_core", noted)
        out = kernel(*arguments)
    file = kernel_cache.directory() / kernel.file_name(next(iter(kernel.entries)))
    return out, names, kernel_cache._content(file)


SEVERAL = """
from tcc_sim.compiling.compiled import fast
@fast
def least(x):
    return min(x, 10.0) ** 2
@fast
def twice(x):
    return least(x) + least(2.0 * x)
@fast
def either(x, more):
    return least(x) if more is None else least(x) + more
@fast
def kernel(x, more):
    return either(x, more) + twice(x) - least(x)
"""


def test_another_kind_of_arguments_lowers_only_the_functions_that_differ(cache, tmp_path):
    def fresh():
        return modules(tmp_path, caller=SEVERAL, name=f"several_{tmp_path.name}")

    out, first, _ = lowered(fresh(), 1.0, None)
    assert (out, set(first) >= {"kernel", "either", "twice", "least"}) == (5.0, True)
    out, second, (with_functions, index) = lowered(fresh(), 1.0, 2.0)
    assert (out, second) == (7.0, ["kernel", "either"])
    for path in cache.iterdir():
        path.unlink()
    _, third, (without, other) = lowered(fresh(), 1.0, 2.0)
    assert (len(third) > 2, len(index), len(other)) == (True, 3, 5)
    assert with_functions[:index[""][1]] == without[:other[""][1]]  # The same machine code, to the last bit.


TWICE = """
from tcc_sim.compiling.compiled import compiled, fast
def weighted(x):
    return 0.1 * x * x + x
exact, fused = compiled(weighted), fast(weighted)
@compiled
def kernel(x, more):
    return exact(x) - fused(x) if more is None else fused(x) - more
"""


def test_a_function_with_two_sets_of_options_is_stored_twice(cache, tmp_path):
    def fresh():
        return modules(tmp_path, caller=TWICE, name=f"twice_{tmp_path.name}")

    def once(more):
        return lowered(fresh(), 1.7, more)[0]

    assert abs(once(None)) < 1e-15
    assert once(1.0) == once(1.0) == pytest.approx(0.989)
    stored = {name for name, path in kernel_cache.stored_functions().items() if name and path.parent == cache}
    assert len(stored) == 4  # Two kernels, each once, and two functions.


def test_stored_functions_that_do_not_fit_together_are_compiled_anew(cache, tmp_path, monkeypatch, capsys):
    lowered(modules(tmp_path, caller=SEVERAL, name=f"apart_{tmp_path.name}"), 1.0, None)
    whole = linked.LoweredStore._read.__func__

    def emptied(cls, content, context):
        function = whole(cls, content, context)
        function.library._final_module = function.library._shared_module = linked.binding.parse_assembly("")
        return function

    monkeypatch.setattr(linked.LoweredStore, "_read", classmethod(emptied))
    monkeypatch.setattr(linked.LoweredStore, "in_use", True)
    forget()
    out, _, _ = lowered(modules(tmp_path, caller=SEVERAL, name=f"apart_{tmp_path.name}"), 1.0, 2.0)
    assert out == 7.0
    assert "stored functions are of no use" in capsys.readouterr().err
    assert not linked.LoweredStore.in_use


def test_functions_that_are_damaged_are_compiled_anew(cache, tmp_path):
    lowered(modules(tmp_path, caller=SEVERAL, name=f"broken_{tmp_path.name}"), 1.0, None)
    damage(cache, "flipped")
    out, names, _ = lowered(modules(tmp_path, caller=SEVERAL, name=f"broken_{tmp_path.name}"), 1.0, 2.0)
    assert (out, "least" in names) == (7.0, True)


def test_functions_with_types_that_are_gone_are_compiled_anew(cache, tmp_path, monkeypatch):
    def gone(_content):
        raise ModuleNotFoundError

    lowered(modules(tmp_path, caller=SEVERAL, name=f"gone_{tmp_path.name}"), 1.0, None)
    monkeypatch.setattr(linked.pickle, "loads", gone)
    forget()
    out, names, _ = lowered(modules(tmp_path, caller=SEVERAL, name=f"gone_{tmp_path.name}"), 1.0, 2.0)
    assert (out, "least" in names) == (7.0, True)


def test_the_order_of_fields_is_part_of_a_kind():
    """Arguments are laid out by position, and the code of a function names only the field."""
    names = set()
    for fields in ("first second", "second first"):
        pair = namedtuple("Pair", fields)
        kernel = compiled(lambda x: x.first)
        words = []
        names.add(kernel.file_name(compiled_module._laid_out((pair(1.0, 2.0),), words)))
        assert kernel(pair(1.0, 2.0)) == (1.0 if fields.startswith("first") else 2.0)
    assert len(names) == 2


def test_closures_and_defaults_count():
    def scaled(gain):
        def kernel(x, offset=1.0):
            return gain * x + offset
        return kernel

    one, two = scaled(2.0), scaled(3.0)
    assert Dependencies(one).digest == Dependencies(scaled(2.0)).digest != Dependencies(two).digest
    one.__defaults__ = (2.0,)
    assert Dependencies(one).digest != Dependencies(scaled(2.0)).digest
    assert compiled(two)(1.0, 2.0) == 5.0


class Colour(Enum):
    RED = 1


def function_of(text, **names):
    """A function whose global names are these."""
    exec(f"out = {text}", names)
    return names["out"]


def reading(value):
    """A function that looks up a constant."""
    return function_of("lambda x: (VALUE, x)", VALUE=value)


@pytest.mark.parametrize(("value", "others"), [
    (1, [2, 1.0, True, "1", None]), (0.5, [0.25, np.float32(0.5)]), ("ab", ["ac", b"ab"]), (1j, [2j]),
    ((1, 2), [(1, 3), (1,), (1, 2, 3), [1, 2], ((1, 2),)]), (((1,), 2), [(1, (2,)), (1, 2)]),
    (np.array([1.0, 2.0]), [np.array([1.0, 2.5]), np.array([[1.0, 2.0]]), np.array([1, 2]), np.array([1.0])]),
    (np.dtype(float), [np.dtype(int)]), (math.sin, [math.cos]), (namedtuple("Two", "a b"), [namedtuple("Two", "b a")]),
    (Colour, [Enum("Colour", {"RED": 2}, module=__name__)]), ({1: 2}, [{1: 3}, {2: 2}]),
    (lambda x: x + 1, [lambda x: x + 2, lambda x: x - 1, lambda y: y + 1, lambda x, y=1: x + 1]),
    (lambda x: [lambda y: y + 1], [lambda x: [lambda y: y + 2]]),
    (compiled(abs_of := lambda x: abs(x)), [abs_of, compiled(abs_of, fastmath=True)])])
def test_what_a_constant_is_and_its_value_count(value, others):
    digest = Dependencies(reading(value)).digest
    assert digest == Dependencies(reading(value)).digest
    assert len({digest, *(Dependencies(reading(other)).digest for other in others)}) == 1 + len(others)


@pytest.mark.parametrize("value", [object(), threading.RLock(), {1: object()}, {1, 2}])
def test_a_key_holds_source_and_constants_and_nothing_else(value):
    with pytest.raises(TypeError, match="neither source nor a constant"):
        Dependencies(reading(value))


@pytest.mark.parametrize("kind", [lambda function: function, property, staticmethod, classmethod])
def test_methods_of_classes_in_the_package_count_for_staged_functions_run_them(kind):
    def digest(function, package="tcc_sim"):
        function.__module__ = f"{package}.any"
        made = type("Rule", (), {"__module__": function.__module__, "apply": kind(function), "NUMBER": 1.0})
        reached = Dependencies(reading(made))
        return reached.digest, reached.size

    one = digest(lambda self: self + 1.0)
    assert one == digest(lambda self: self + 1.0)
    other = digest(lambda self: self - 2.0)
    assert (one[0] != other[0], one[1]) == (True, other[1])
    assert digest(lambda self: self + 1.0, "outside") == digest(lambda self: self - 2.0, "outside")


def test_of_a_module_that_names_count_which_are_looked_up():
    """Of one outside the package only its numbers and kernels; a module that holds itself, and calls in a circle."""
    def digest(name="outside", names=(), **content):
        module = ModuleType(name)
        vars(module).update(content, itself=module)
        looked_up = ", ".join(f"module.{each}" for each in names)
        return Dependencies(function_of(f"lambda x: (module, {looked_up})", module=module)).digest

    names = ["a", "itself"]
    assert digest(names=names, a=1.0) == digest(names=names, a=1.0, b=2.0) != digest(names=names, a=1.5)
    assert digest(names=names, a=compiled(lambda x: x)) != digest(names=names, a=compiled(lambda x: -x))
    assert digest() != digest("other")
    two = function_of("lambda x: one(x)")
    one = two.__globals__["one"] = function_of("lambda x: two(x)", two=two)
    reached = Dependencies(one)
    assert reached.size == len(one.__code__.co_code) + len(two.__code__.co_code)
    assert reached.digest != Dependencies(one, "another compiler").digest


def test_the_first_process_alone_prints_and_only_where_it_can(monkeypatch, capsys):
    monkeypatch.setattr(kernel_cache, "announced", set())
    for _ in range(2):
        kernel_cache.print_once("kind", "a sentence\n")
    kernel_cache.print_once("other", "another")
    assert capsys.readouterr().err == "tcc-sim: a sentence\\n\ntcc-sim: another\n"
    with monkeypatch.context() as patch:
        patch.setattr(kernel_cache.multiprocessing, "parent_process", object)
        kernel_cache.print_once("child", "nothing")
    assert capsys.readouterr().err == ""
    for stream in (None, open(os.devnull)):  # noqa: SIM115  The second one takes no text.
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", stream)
            kernel_cache.print_once(str(stream), "nothing")
    for error, reason in ((FileNotFoundError(2, "No such file", "/a"), "/a: No such file"), (OSError("text"), "text"),
                          (ValueError("text"), "text"), (ValueError(), "ValueError")):
        assert kernel_cache._reason(error) == reason


@pytest.mark.parametrize(("named", "features", "host", "expected"), [
    ("", "", {}, ("x86-64-v3", "")), ("", "", {"avx2": False}, ("host", "-avx2")), ("skylake", "", {}, ("skylake", "")),
    ("", "+avx", {}, ("host", "+avx")), ("", "", {"triple": "aarch64-linux"}, ("host", "-all"))])
def test_kernels_are_for_the_level_where_the_processor_has_it(monkeypatch, named, features, host, expected):
    class Features(dict):
        def flatten(self):
            return expected[1]

    present = Features(dict.fromkeys(NEEDED, True) | dict.fromkeys(host, False))
    triple = host.get("triple", "x86_64-pc-linux")
    for name, value in (("process_triple", triple), ("host_cpu_features", present), ("host_cpu_name", "host")):
        monkeypatch.setattr(binding, f"get_{name}", lambda value=value: value)
    monkeypatch.setenv("NUMBA_CPU_NAME", named)
    monkeypatch.setenv("NUMBA_CPU_FEATURES", features)
    assert processor.__wrapped__() == (triple, *expected)


def test_some_versions_of_numba_are_linked_and_only_code_for_the_level_is_shipped(monkeypatch):
    for version, known in (("0.61.9", False), ("0.62.0", True), ("0.62.1rc1", True), ("0.68.3", True),
                           ("0.69.0", False), ("1.0.0", False)):
        monkeypatch.setattr(compiled_module, "_numba", lambda version=version: (version, ""))
        assert compiled_module.numba_supported() == known
    assert compiled_module.not_to_ship() == "the build has Numba 1.0.0, not one of 0.62 to 0.68"
    monkeypatch.setattr(compiled_module, "_numba", lambda: ("0.62.0", ""))
    for name, why in (("x86-64-v3", ""), ("generic", "the build's processor is not x86-64-v3")):
        monkeypatch.setattr(compiled_module, "processor", lambda name=name: Processor("", name, ""))
        assert compiled_module.not_to_ship() == why


def test_a_file_is_named_by_function_digest_and_kind_and_a_call_is_timed(monkeypatch):
    @compiled
    def doubled(x):
        return 2.0 * x

    assert timed(doubled, 3.0)[0] == 6.0
    clock = iter([10.0, 12.5])
    monkeypatch.setattr(compiled_module.time, "perf_counter", lambda: next(clock))
    assert timed(doubled, 4.0) == (8.0, 2.5)
    name = doubled.file_name(("d",))
    head = "test_kernel_cache.test_a_file_is_named_by_function_digest_and_kind_and_a_call_is"  # 80 letters.
    assert re.fullmatch(rf"{head}-{doubled.dependencies.digest[:24]}-[0-9a-f]{{16}}", name)
    assert name != doubled.file_name(("q",))


def test_what_nothing_has_used_for_30_days_is_removed_when_something_is_kept(cache, tmp_path):
    """A kernel that is loaded counts as used from then on."""
    now, day = time.time(), 86400.0
    assert modules(tmp_path, name="kept")(3.0) == 7.0
    first = set(cache.iterdir())
    assert modules(tmp_path, caller=CALLER + "\nX = 1\n", callee=CALLEE.replace("2.0", "3.0"))(3.0) == 10.0
    second = set(cache.iterdir()) - first
    for path in first | second:
        os.utime(path, (now, now - 31.0 * day))
    other = cache / "other.txt"
    other.touch()
    os.utime(other, (now, now - 90.0 * day))
    kernel = modules(tmp_path, name="kept")
    assert (kernel(3.0), hits(kernel)) == (7.0, 1)
    assert modules(tmp_path, callee=CALLEE.replace("2.0", "4.0"))(3.0) == 13.0
    left = set(cache.iterdir())
    assert first <= left
    assert not second & left
    assert other in left


@pytest.mark.parametrize(("name", "days"), [("a.b-1-2", 30), ("tmp5", 1), ("other.txt", None)])
def test_a_file_is_kept_for_some_days(tmp_path, name, days):
    file = tmp_path / name
    file.touch()
    os.utime(file, (0.0, 0.0))
    kernel_cache.remove_unused(tmp_path, 86400.0 * (days or 1000))
    assert file.exists()
    kernel_cache.remove_unused(tmp_path, 86400.0 * (days or 1000) + 0.1)
    assert file.exists() == (days is None)


def alone(kernel, killed=False):
    """A process, forked from this one, that calls a kernel; it may be killed before it has written the file."""
    child = os.fork()
    if not child:
        if killed:
            os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
        os._exit(kernel(3.0) != 7.0)
    return child


def test_two_processes_keep_one_kernel_at_once(cache, tmp_path):
    kernel = modules(tmp_path, name="twice")
    child = alone(kernel)
    assert kernel(3.0) == 7.0
    assert os.waitpid(child, 0)[1] == 0
    assert len(list(cache.iterdir())) == 1


def test_a_kernel_that_another_process_compiles_is_awaited_for_a_while(cache, tmp_path, monkeypatch):
    modules(tmp_path, name="awaited")(3.0)
    (made,) = cache.iterdir()
    content = made.read_bytes()

    def slept(_):
        made.write_bytes(content)
        made.chmod(0o600)
        fcntl.flock(lock, fcntl.LOCK_UN)

    monkeypatch.setattr(kernel_cache, "time", SimpleNamespace(**{**vars(time), "sleep": slept}))
    for limit, each in ((60.0, 1), (0.0, 0)):
        monkeypatch.setattr(kernel_cache, "WAITED", limit)
        made.unlink()
        with open(cache / f"tmp.{made.name}", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            kernel = modules(tmp_path, name="awaited")
            assert (kernel(3.0), hits(kernel)) == (7.0, each)
        assert list(cache.iterdir()) == [made]


def test_a_process_killed_while_it_writes_leaves_nothing_that_is_loaded(cache, tmp_path):
    child = alone(modules(tmp_path, name="killed"), killed=True)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    left, lock = sorted(cache.iterdir(), key=lambda path: path.name.startswith("tmp."))
    assert lock.name.startswith("tmp.")
    kernel = modules(tmp_path, name="killed")
    assert (kernel(3.0), hits(kernel)) == (7.0, 0)
    made_in = left.stat().st_mtime
    kernel_cache.remove_unused(cache, made_in + 0.9 * 86400.0)
    assert left.exists()
    kernel_cache.remove_unused(cache, made_in + 1.1 * 86400.0)
    assert not left.exists()
    kernel = modules(tmp_path, name="killed")
    assert (kernel(3.0), hits(kernel)) == (7.0, 1)


@pytest.fixture
def package(cache, tmp_path, monkeypatch):
    """Folder of a package's code that holds one kernel, `modules(..., name="shipped")`, whose sources are rewritten."""
    folder = tmp_path / "shipped"
    folder.mkdir(mode=0o755)
    assert modules(tmp_path, name="shipped")(3.0) == 7.0
    for path in cache.iterdir():
        path.rename(folder / path.name)
    monkeypatch.setattr(kernel_cache, "SHIPPED", folder)
    forget()
    return folder


def test_code_in_the_package_is_used_without_a_private_directory(package, cache, tmp_path, capsys):
    cache.rmdir()
    for path in package.iterdir():
        os.utime(path, (0.0, 0.0))  # The age is no part of the key.
    kernel = modules(tmp_path, name="shipped")
    assert (kernel(3.0), hits(kernel), cache.exists()) == (7.0, 1, False)
    changed = modules(tmp_path, CALLEE.replace("GAIN = 2.0", "GAIN = 5.0"), name="shipped")
    assert (changed(3.0), hits(changed)) == (16.0, 0)
    assert capsys.readouterr().err == ""
    assert len(list(package.iterdir())) == 1


@pytest.mark.parametrize(("fault", "reason"), [
    ("flipped", "is damaged"), ("cut", "is damaged"), ("empty", "is damaged"), ("writable", "is not a private file"),
    pytest.param("foreign", "is not a private file", marks=pytest.mark.skipif(os.geteuid() != 0, reason="needs root"))])
def test_foreign_and_damaged_code_in_the_package_is_refused_and_left_there(package, cache, tmp_path, capsys, fault,
                                                                            reason):
    if fault in ("flipped", "cut", "empty"):
        damage(package, fault)
    else:
        (other,) = package.iterdir()
        modules(tmp_path, CALLEE.replace("GAIN = 2.0", "GAIN = 5.0"))(3.0)
        (planted,) = cache.iterdir()
        other.write_bytes(planted.read_bytes())
        planted.unlink()
        other.chmod(0o666 if fault == "writable" else 0o644)
        os.chown(other, *((12345, 12345) if fault == "foreign" else (-1, -1)))
    kernel = modules(tmp_path, name="shipped")
    assert (kernel(3.0), hits(kernel)) == (7.0, 0)
    err = capsys.readouterr().err
    assert "since the code in the package is of no use: " in err
    assert reason in err
    assert len(list(package.iterdir())) == len(list(cache.iterdir())) == 1


def test_a_file_may_be_as_writable_as_the_source_beside_it(package, tmp_path, monkeypatch):
    source = tmp_path / "source.py"
    source.touch()
    source.chmod(0o664)  # As pip leaves both where new files are the group's.
    for path in package.iterdir():
        path.chmod(0o664)
    monkeypatch.setattr(kernel_cache, "__file__", str(source))
    kernel = modules(tmp_path, name="shipped")
    assert (kernel(3.0), hits(kernel)) == (7.0, 1)


@pytest.mark.parametrize("what", ["Numba", "processor"])
def test_the_key_names_numba_and_the_processor(cache, tmp_path, monkeypatch, what):
    def name():
        compiled_module._compiler.cache_clear()
        kernel = modules(tmp_path, name=f"keyed_{what}")
        return kernel.file_name(("d",))

    before = name()
    assert name() == before
    if what == "Numba":
        monkeypatch.setattr(compiled_module, "_numba", lambda: ("0.67.0", ""))
    else:
        monkeypatch.setattr(compiled_module, "processor", lambda: ("x86_64-unknown-linux-gnu", "x86-64-v2", ""))
    assert name() != before
    monkeypatch.undo()
    compiled_module._compiler.cache_clear()


def test_code_for_the_level_has_the_bits_of_code_for_this_processor(cache, monkeypatch):
    """A hundred ticks: the shipped code is for x86-64-v3."""
    host = Processor(binding.get_process_triple(), binding.get_host_cpu_name(),
                     binding.get_host_cpu_features().flatten())
    system, states = system_of("chaos"), []
    for target in (processor(), host):
        monkeypatch.setattr(linked, "processor", lambda target=target: target)
        linked._machine.cache_clear()
        forget()
        state = np.array([20.0, 0.1, 1.0])
        kernel = Kernel(fixed_step.advance.py_func, fixed_step.advance.options)
        monkeypatch.setattr(kernel_cache, "SHIPPED", Path("/nonexistent"))
        for path in cache.glob("*"):
            path.unlink()
        kernel(state, 0.0, 1e-5, 2000, terms_of(system), None, None)
        states.append(state.tobytes())
    linked._machine.cache_clear()
    assert states[0] == states[1]
