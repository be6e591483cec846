"""The executables of the nodes (driveline_node, recorder_node, ...) for `ros2 run`, the path and `python -m`: start,
signals, callbacks and end of a node's process.

`--help` and `--version` need no ROS 2; without ROS 2 a node ends with one line.

A node's process blocks SIGINT, SIGTERM and SIGHUP before it imports NumPy, Numba and rclpy; its threads inherit this,
and one thread waits for a signal. While the process starts (imports, ROS 2, compiling), no data has to be saved, and a
signal ends it at once with status 0. After `end_in_order` a signal sets `end_requested`, which the node checks several
times a second to end by itself. Its ROS 2 context stays valid until then.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError, TccError, missing_package, one_line

if TYPE_CHECKING:
    from rclpy import InitContextManager
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions

LOOK = 0.25
"""Longest time between two checks for a signal, s."""
ACKNOWLEDGED_WITHIN, SOON = 5.0, 0.1
"""Longest real time to wait at the end for subscribers to acknowledge the last messages, and time after which the wait
is logged, s. Fast DDS asks for acknowledgements and repairs lost datagrams every 3 s.
"""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
end_requested = threading.Event()
"""Set by the first signal after `end_in_order`."""
_turn = threading.Lock()
"""Lock of `_phase`."""
_phase = ""
_INTERRUPTED = threading.Event()
"""Set when Ctrl-C was pressed in a command."""
_PURPOSES = {
    "driveline": "Run the driveline in real time: publish states, subscribe to engine torque and actuation pressure.",
    "recorder": "Record every topic of the driveline into a bag (MCAP) that survives a kill.",
    "slip_controller": "Answer the driveline's states with a pressure that holds a mean slip speed.",
    "commander": "Answer the driveline's states with harmonic engine torque and pressure.",
}
Made = TypeVar("Made")
N = TypeVar("N", bound="Node")


def run(name: str) -> int:
    """Run a node's `main` and end the process with its exit status."""
    take()
    from tcc_sim.output.terminal import open_streams

    open_streams()
    return end(status_of(name))


def status_of(name: str) -> int:
    """Run a node's `main` by the words of the command line, and return its exit status."""
    from tcc_sim.nodes.children import require_ros

    status = 1
    try:
        text = _text_for(name, sys.argv[1:])
        if text is None:
            require_ros()
            status = import_module(f"tcc_sim.nodes.{name}").main()
        else:
            sys.stdout.write(text)
            status = 0
    except (TccError, OSError) as error:
        sys.stderr.write(f"{_command_of(name)}: {error}\n")
        status = 2 if isinstance(error, InputError) else 1
    except Exception as error:
        missing = missing_package(error) if isinstance(error, ModuleNotFoundError) else None
        if missing is None:
            sys.excepthook(*sys.exc_info())
        else:
            sys.stderr.write(f"{_command_of(name)}: {missing}\n")
    return status


def _text_for(name: str, words: list[str]) -> str | None:
    """Return the text for --help or --version, or None; refuse unknown words before --ros-args by InputError."""
    options, to_ros = [], False
    for word in words:
        to_ros = word != "--" if to_ros else word == "--ros-args"
        if not to_ros and word != "--":
            options.append(word)
    if "--version" in options:
        return f"tcc_sim {code_version()}\n"
    if {"-h", "--help"} & set(options):
        return _help(name)
    if options:
        after = " ".join(["--ros-args", *(word for word in words if word not in ("--", "--ros-args"))])
        raise InputError(f"{options[0]} is not an option; options are --help and --version, and words for ROS 2 follow "
                         f"--ros-args: {_command_of(name)} {after}")
    return None


def _command_of(name: str) -> str:
    return name if name == "commander" else f"{name}_node"


def _help(name: str) -> str:
    from tcc_sim.nodes.parameters import OPTIONS
    from tcc_sim.output.terminal import terminal_width, wrapped
    from tcc_sim.scene import NODE_SCENE

    meanings = {key: quantity.described for key, quantity in OPTIONS[name].quantities().items()}
    if name == "driveline":
        meanings = {"scene": f"bundled name or file ({NODE_SCENE})", **meanings,
                    "driveline.*, friction.*, clutch.*, engine.*, pressure.*, initial.*": "the keys of a scene"}
    lines = [f"usage: {_command_of(name)} [--help] [--version] [--ros-args WORD ...]", "", _PURPOSES[name], "",
             "words after --ros-args: -p NAME:=VALUE, --params-file FILE, -r __ns:=/NAME", "", "parameters:",
             *(f"  {key}: {meaning}" for key, meaning in meanings.items())]
    return wrapped("\n".join(lines) + "\n", terminal_width() or 80)


def take() -> None:
    """Let a signal end the process at once with status 0; a node's process calls this first.

    A program that only imports the nodes does not call it and keeps its own handlers. SIGHUP stays ignored if it was,
    as under nohup.
    """
    global _phase
    if _phase or threading.current_thread() is not threading.main_thread():
        return
    _phase = "starting"
    numbers = [n for n in ENDING if n != signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    for number in numbers:
        signal.signal(number, signal.SIG_DFL)
    threading.Thread(target=_wait, args=(numbers,), name="signals", daemon=True).start()


def _wait(numbers: list[signal.Signals]) -> None:
    """Wait for signals: end the process during its start, set `end_requested` afterwards."""
    while True:
        signal.sigwait(numbers)
        with _turn:
            if _phase == "starting":
                os._exit(0)
        end_requested.set()


def end_in_order() -> None:
    """Let a signal set `end_requested` from now on, so that the node ends by itself."""
    global _phase
    with _turn:
        _phase = _phase and "running"


def end(status: int) -> NoReturn:
    """End the process with `status`; a node's process calls this last.

    The interpreter is not shut down: this would take up to a second on a busy machine, saves nothing, and could crash a
    thread that still compiles.
    """
    end_in_order()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            status = status or 1
    os._exit(status)


def left_to_the_system(create: Callable[[], Made]) -> Made:
    """Call `create` while signals have their default effect: the middleware may block the interpreter for minutes.

    `create` runs in another thread, so that threads of the middleware start with the node's signals blocked.
    """
    from tcc_sim.background import begun

    if threading.current_thread() is not threading.main_thread():
        return create()
    unblocked = threading.Event()

    def work() -> Made:
        unblocked.wait()
        return create()

    with _handled(signal.SIG_DFL):
        outcome, thread = begun(work, "creation")
        mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        try:
            unblocked.set()
            thread.join()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    return outcome.result()


@contextmanager
def deferred() -> Iterator[None]:
    """Delay the KeyboardInterrupt of a command: a signal during the `with` block takes effect after it."""
    came: list[signal.Signals] = []
    with _handled(lambda number, _: came.append(signal.Signals(number))) as handlers:
        yield
    if came:
        handlers[came[0]](came[0], None)


@contextmanager
def _handled(handler: Any) -> Iterator[dict[signal.Signals, Any]]:
    """Replace the process's Python handlers for the duration of a `with` block, and yield the replaced handlers."""
    mine = threading.current_thread() is threading.main_thread()
    handlers = {n: previous for n in ENDING if mine and callable(previous := signal.getsignal(n))}
    for number in handlers:
        signal.signal(number, handler)
    try:
        yield handlers
    finally:
        for number, previous in handlers.items():
            signal.signal(number, previous)


def created(create: Callable[[], N]) -> N:
    """Create a node after cleaning shared memory; a signal meanwhile ends the process.

    Raises InputError: ROS 2 refuses the node, for example if two topics are remapped to one name. Raises TccError:
    another process has left shared memory of this domain unfinished.
    """
    import rclpy

    from tcc_sim.nodes.shared_memory import clear

    clear(rclpy.get_default_context().get_domain_id())
    try:
        return left_to_the_system(create)
    except RuntimeError as error:
        raise InputError(f"ROS 2 refuses the node: {' '.join(str(error).split())}") from None


def initialised(words: list[str], signals: SignalHandlerOptions | None = None) -> InitContextManager:
    """Initialise ROS 2, for a `with` block; raise InputError if it refuses the words, or can write no log."""
    import rclpy

    try:
        return rclpy.init(args=words, signal_handler_options=signals)
    except RuntimeError as error:
        raise InputError(f"ROS 2 does not start: {' '.join(str(error).split())}") from None


@contextmanager
def _running(words: list[str], create: Callable[[], N]) -> Iterator[N]:
    """Initialise ROS 2 with the words of a command line, and create a node for the duration of a `with` block.

    Raises InputError: ROS 2 refuses the parameter file, the words or the node.
    """
    from rclpy.signals import SignalHandlerOptions

    for option, file in pairwise(words):
        if option == "--params-file":
            try:
                with open(file, "rb") as stream:
                    stream.read(1)
            except OSError as error:
                raise InputError(f"--params-file {file}: {error.strerror}") from None
    with initialised(words, SignalHandlerOptions.NO):
        node = created(create)
        try:
            yield node
        finally:
            node.destroy_node()


def run_node(create: Callable[[], N], body: Callable[[N], int]) -> int:
    """Initialise ROS, create the node, run `body` with it, and return the exit status; errors as in `_running`.

    SIGINT, SIGTERM and SIGHUP end the process at once until `body` calls `end_in_order`. After that call a signal makes
    `Spinner.once` raise ExternalShutdownException, and the status is 0.
    """
    from rclpy.executors import ExternalShutdownException

    try:
        with _running(sys.argv, create) as node:
            return body(node)
    except ExternalShutdownException:
        return 0


def deliver(node: Node, flush: Callable[[], bool] = lambda: True) -> None:
    """Wait until the subscribers have received all messages of a node that ends, at most ACKNOWLEDGED_WITHIN.

    A publisher that is destroyed earlier takes back the messages that a busy subscriber has not received.

    flush : function that sends waiting messages and returns whether none is left
    """
    from rclpy.duration import Duration

    began = time.monotonic()
    with suppress(RuntimeError):  # Some middleware does not acknowledge, and a context may have been shut down.
        for limit in (SOON, ACKNOWLEDGED_WITHIN):
            while not (sent := flush()) and time.monotonic() < began + limit:
                time.sleep(0.1 * SOON)
            late = [publisher.topic_name for publisher in node.publishers if not publisher.wait_for_all_acked(
                Duration(seconds=max(0.0, began + limit - time.monotonic())))]
            if sent and not late:
                return
            if limit == SOON:
                node.get_logger().info(f"waits until subscribers have received the last messages of {', '.join(late)}")
        node.get_logger().warning(f"subscribers have not received the last messages of {', '.join(late)} within "
                                  f"{ACKNOWLEDGED_WITHIN:g} s")


@contextmanager
def node_of_command(name: str, namespace: str) -> Iterator[Node]:
    """Create the node of a command for the duration of a `with` block; Ctrl-C raises KeyboardInterrupt.

    Raises InputError: the namespace is not valid.
    """
    import rclpy
    from rclpy.exceptions import NameValidationException

    def create() -> Node:
        try:
            return rclpy.create_node(name, namespace=namespace, enable_rosout=False, start_parameter_services=False)
        except (ValueError, NameValidationException) as error:
            raise InputError(f"--namespace {namespace!r} is not a namespace: {str(error).splitlines()[0]}") from None

    with _running([], create) as node, ExitStack() as stack:
        before = signal.getsignal(signal.SIGINT)
        if before is signal.default_int_handler and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, _interrupt)
            stack.callback(signal.signal, signal.SIGINT, before)
        yield node


def _interrupt(number: int, frame: object) -> None:
    _INTERRUPTED.set()
    raise KeyboardInterrupt


class Throttle:
    """Logger of warnings at most once a second for each subject.

    clock : function that returns real time, s
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._clock = node, clock
        self._logged: dict[str, tuple[int, float]] = {}

    def warn(self, what: str, sentence: str, count: int | None = None) -> None:
        """Log a warning about `what`, with a `count` only if it has grown since the last one."""
        before, when = self._logged.get(what, (0, -1.0))
        now = self._clock()
        if (count is None or count > before) and now - when >= 1.0:
            self._logged[what] = count or 0, now
            self._node.get_logger().warning(sentence if count is None else f"{sentence} ({count} so far)")

    def once(self, what: str, sentence: str) -> None:
        """Log a warning about `what` the first time."""
        if what not in self._logged:
            self.warn(what, sentence)


class Spinner:
    """Executor of a node's callbacks; it logs exceptions of callbacks, and the node continues.

    Raises ExternalShutdownException: the context has been shut down.

    busy : whether the node answers every state; at 1 kHz rclpy's EventsExecutor takes half of the processor time
    """

    def __init__(self, node: Node, busy: bool = False) -> None:
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        self._throttle, self._failed = Throttle(node), 0
        kind: Any = SingleThreadedExecutor
        if busy:
            with suppress(ImportError):  # The rclpy of Jazzy has none.
                from rclpy.experimental import EventsExecutor

                kind = EventsExecutor
        with deferred():  # A partly built executor prints a traceback when it is destroyed.
            if not node.context.ok():
                raise ExternalShutdownException
            self._executor = kind(context=node.context)
            self._executor.add_node(node)

    def once(self, seconds: float = LOOK) -> None:
        """Run one callback that is ready within `seconds`.

        Raises ExternalShutdownException: a signal has asked the node to end, or the context has been shut down.
        """
        from rclpy.executors import ExternalShutdownException

        if end_requested.is_set():
            raise ExternalShutdownException
        try:
            self._executor.spin_once(timeout_sec=seconds)
        except ExternalShutdownException:
            raise
        except Exception as error:
            if _INTERRUPTED.is_set():  # rclpy's conversions turn a KeyboardInterrupt into another error.
                raise KeyboardInterrupt from error
            # rclpy raises errors of decoding messages here.
            self._failed += 1
            self._throttle.warn("callbacks", "a message or request could not be handled: "
                                f"{type(error).__name__}: {one_line(str(error))}", self._failed)


def answer(node: Node, sentence: str) -> NoReturn:
    """Log a sentence, and run the callbacks of a node that answers every state until a signal comes."""
    end_in_order()
    node.get_logger().info(sentence)
    spinner = Spinner(node, busy=True)
    while True:
        spinner.once()


driveline_node = partial(run, "driveline")
recorder_node = partial(run, "recorder")
slip_controller_node = partial(run, "slip_controller")
commander = partial(run, "commander")
