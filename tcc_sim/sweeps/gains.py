"""Maps of a control law over its parameters: settling and peak of many closed loops, without ROS."""

from __future__ import annotations

import functools
import itertools
import os
import pickle
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tcc_sim.analysis.loop.tracking import Limits, Tracking, checked_limits, target_steps
from tcc_sim.errors import InputError, TccError, one_line
from tcc_sim.model.quantity import MOST_VALUES
from tcc_sim.plant.closed_loop import closed_loop
from tcc_sim.result import Result, as_lists, json_of, names_in, reported, reporting, result_class
from tcc_sim.scene import Scene, SceneLike, as_scene
from tcc_sim.sweeps.executors import cluster, each_done, each_in_a_process
from tcc_sim.sweeps.progress import progress_bar

COLUMNS = [name for name in names_in(Tracking) if name not in ("limits", "verdict_why")]
"""Figures of a loop that are columns of a table."""


@result_class
class GainPoint:
    """One closed loop of a map."""

    tracking: Tracking = reported("figures of the loop", spread=True, of=(Tracking,))
    refused: int = reported("refused commands")


@result_class(repr=False)
class GainMap(Result):
    """Closed loops of a control law at many values of one of its parameters or scene keys, or of two."""

    law: str = reported("the law, as FILE.py:NAME or by its name")
    key: str = reported("parameter of the law, or scene key", name="over")
    values: tuple[float, ...] = reported("its values", "{over}")
    second_key: str | None = reported("second one; null without", name="second_over")
    second_values: tuple[float, ...] | None = reported("its values", "{second_over}")
    target: tuple[tuple[float, float], ...] = reported(
        "times and target slip speeds from then on", "s, rad/s", name="targets")
    duration: float = reported("simulated time of each loop", "s")
    points: list[GainPoint]
    seconds: float = reported("computing time of the whole map", "s", name="wall_s")

    def _text(self) -> str:
        settled = sum(point.tracking.settled for point in self.points)
        second = f" and {self.second_key}" if self.second_key else ""
        return f"GainMap of {self.law} over {self.key}{second}: {len(self.points)} loops, {settled} settled"

    @reporting(
        "figures per value in lists, with two keys in lists of lists, rows: second key", spread=True, listed=True,
        of=(GainPoint,))
    def lists(self) -> dict[str, list[Any]]:
        n = len(self.values)
        flat = json_of(as_lists(self.points, GainPoint))
        return flat if self.second_key is None else {
            name: [list(row) for row in itertools.zip_longest(*[iter(each)] * n)] for name, each in flat.items()}

    def columns(self) -> dict[str, Any]:
        """Return values of keys and figures of all loops, (n,) each; unknown ones are NaN or empty.

        A figure that has the name of a key has `tracking_` in front.
        """
        n, others = len(self.values), self.second_values or (0.0,)
        keys = {self.key: np.tile(self.values, len(others))}
        if self.second_key:
            keys = {self.second_key: np.repeat(others, n), **keys}
        rows = [{**vars(point.tracking), "refused": point.refused} for point in self.points]
        return {**keys, **{f"tracking_{name}" if name in keys else name: np.array(
            [("" if name == "verdict" else np.nan) if row[name] is None else row[name] for row in rows])
            for name in (*COLUMNS, "refused")}}


@dataclass(frozen=True)
class LawFile:
    """Factory of laws in a Python file, with its text, so that other processes and machines need no file."""

    path: str
    name: str
    text: str

    def __str__(self) -> str:
        return f"{Path(self.path).name}:{self.name}"


def _factory_of(law: LawFile | Callable[..., Any]) -> Callable[..., Any]:
    return _executed(law) if isinstance(law, LawFile) else law


@functools.cache
def _executed(law: LawFile) -> Callable[..., Any]:
    """Return the class or function that a file defines. Modules beside the file are found after all others.

    Raises InputError: the file has none of this name, or does not run.
    """
    module = ModuleType(f"{law.path} of a map of gains")  # A name that no import statement finds.
    module.__file__ = law.path
    sys.modules[module.__name__] = module  # Where dataclasses look their annotations up.
    if (folder := str(Path(law.path).parent)) not in sys.path:
        sys.path.append(folder)
    try:
        exec(compile(law.text, law.path, "exec"), vars(module))  # noqa: S102
    except (Exception, SystemExit) as error:
        raise InputError(f"{law.path} does not run: {type(error).__name__}: {one_line(str(error))}") from error
    found: Callable[..., Any] | None = getattr(module, law.name, None)
    if found is None or not callable(found):
        raise InputError(f"{law.path} has no class or function {law.name}")
    return found


def law_in(text: str) -> LawFile:
    """Return the factory of laws that FILE.py:NAME names.

    Raises InputError: the text has another form, or the file cannot be read.
    """
    path, colon, name = text.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"law is {text!r}; it must be FILE.py:NAME, a class or a function in a Python file")
    try:
        return LawFile(os.path.realpath(path), name, Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or one_line(str(error))
        raise InputError(f"the law's file {path} cannot be read: {reason}") from None


def _loop(scene: Scene, law: LawFile | Callable[..., Any], target: Mapping[float, float], seconds: float,
          limits: Limits | None, values: Mapping[str, float]) -> GainPoint:
    """Run and judge the loop at some values: keys with a dot are those of the scene."""
    scene = scene.with_values({key: value for key, value in values.items() if "." in key})
    text = ", ".join(f"{key} {value:g}" for key, value in values.items())
    try:
        made = _factory_of(law)(**{key: value for key, value in values.items() if "." not in key})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # The number of refused commands stands in the result.
            run = closed_loop(scene, made, seconds, scene.operation.rate)
    except InputError as error:
        raise InputError(f"with {text}: {error}") from None
    except (Exception, SystemExit) as error:
        raise TccError(f"the law failed with {text}: {type(error).__name__}: {one_line(str(error))}") from error
    return GainPoint(run.tracking_of(target, limits=limits), run.refused)


def gain_map(scene: SceneLike, law: str | Callable[..., Any], over: Mapping[str, Sequence[float]],
             target: float | Mapping[float, float], duration: float = 3.0, *, limits: Limits | None = None,
             jobs: int | None = None, dask: str | None = None, progress: bool = False) -> GainMap:
    """Run a control law in closed loop at every value of one of its parameters, or of two, and judge each loop.

    Parameters
    ----------
    scene : a scene or a system, its name or its file; its `rate` is that of the law
    law : class or function that takes the parameters as keywords and returns a law of `closed_loop`, or FILE.py:NAME
    over : values by parameter, one or two; a key with a dot is one of the scene
    target : slip speed to hold, rad/s, or slip speeds by the time, s, from which each holds
    duration : simulated time of each loop, s
    limits : smallest and largest pressure that the law commands, Pa
    jobs : number of processes (default: all cores for FILE.py:NAME, else one)
    dask : address of a Dask scheduler, whose workers run the loops
    progress : whether progress is shown

    Raises
    ------
    InputError
        A wrong key or value, a law that cannot be found, takes no such parameter or cannot be sent to processes.
    TccError
        The law failed; the message has the values.

    Examples
    --------
    >>> def proportional(gain):
    ...     return lambda reading: 80e3 + gain * (reading.slip_speed - 20.0)
    >>> result = gain_map("controlled", proportional, {"gain": [500.0, 2000.0]}, target=20.0, duration=0.5)
    >>> result
    <GainMap of proportional over gain: 2 loops, 0 settled>
    """
    began = time.perf_counter()
    steps = target_steps(target)
    scene, made_by = as_scene(scene), law_in(law) if isinstance(law, str) else law
    targets = dict(zip(steps.t.tolist(), steps.values.tolist()))
    loop = functools.partial(_loop, scene, made_by, targets, duration, checked_limits(limits))
    keys = list(over)
    if not 1 <= len(keys) <= 2:
        raise InputError(f"a map of {len(keys)} keys is not possible; give one or two")
    values = [tuple(map(float, over[key])) for key in keys]
    places = [dict(zip(keys, place[::-1])) for place in itertools.product(*values[::-1])]
    if not 1 <= len(places) <= MOST_VALUES:
        raise InputError(f"the map has {len(places)} loops; it must have 1 to {MOST_VALUES}")
    _check(scene, _factory_of(made_by), keys, places)
    if dask is not None:
        points = _on_cluster(loop, places, dask, progress)
    else:
        jobs = jobs if jobs is not None or isinstance(law, str) else 1
        if jobs != 1:
            try:
                pickle.dumps(loop)
            except Exception:  # Various exceptions say so.
                raise InputError("the law cannot be sent to other processes; give it as FILE.py:NAME, or "
                                 "jobs=1") from None
        points = each_in_a_process(loop, places, jobs, "loop", progress)
    name = str(made_by) if isinstance(made_by, LawFile) else getattr(law, "__name__", type(law).__name__)
    second_key, second_values = (keys[1], values[1]) if len(keys) > 1 else (None, None)
    return GainMap(name, keys[0], values[0], second_key, second_values, tuple(targets.items()), duration, points,
                   time.perf_counter() - began)


def _check(scene: Scene, factory: Callable[..., Any], keys: Sequence[str],
           places: Sequence[Mapping[str, float]]) -> None:
    """Raise InputError if the law does not take the parameters, or the scene not the values."""
    given = [key for key in keys if "." not in key]
    try:
        signature(factory).bind(**dict.fromkeys(given))
    except TypeError as error:
        raise InputError(f"the law takes {signature(factory)}, not {', '.join(given) or 'nothing'}: {error}") from None
    except ValueError:
        pass  # A builtin without a signature, which fails when it is called.
    for place in places:
        scene.with_values({key: value for key, value in place.items() if "." in key})


def _on_cluster(loop: Callable[[Mapping[str, float]], GainPoint], places: Sequence[Mapping[str, float]], dask: str,
                progress: bool) -> list[GainPoint]:
    with cluster(dask) as (executor, attendance), progress_bar("loop", len(places), shown=progress) as bar:
        left, points = iter(range(len(places))), dict[int, GainPoint]()
        for place, point in each_done(attendance, lambda: next(left, None),
                                      lambda k: executor.submit(loop, places[k])):
            points[place] = point
            bar.update()
    return [points[k] for k in range(len(places))]
