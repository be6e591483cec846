"""Write a rosbag2 bag: a new directory with MCAP files and metadata.yaml."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from tcc_sim.errors import RecordingError
from tcc_sim.messages.definitions import Definition
from tcc_sim.parameter_file import dumped
from tcc_sim.recording.mcap_file import MOST_CHUNKS, RELIABLE, FileSummary, McapFile, information

_PART = "_999999.mcap"


class BagWriter:
    """Writer of a rosbag2 bag: a new directory NAME with NAME_0.mcap, NAME_1.mcap, ... and, on closing, metadata.yaml;
    RecordingError if the directory exists or cannot be created, of which nothing is left behind.

    The writer holds the directory open and creates every file relative to it, so a directory that another recorder
    creates later under the same name is never mixed in. Each part can be read alone: it starts with the current scene
    and the latched messages, and ends with index and footer.

    Parameters
    ----------
    scene_text, version : the scene (YAML), and the code version that runs it (default: this one)
    max_duration : duration of a part by times of receipt, which may go back, s; 0 for no limit
    max_size : size in bytes above which a part that has messages ends; 0 for no limit
    max_chunks : largest number of chunks of a part, which bounds the memory for its index
    sync : whether to wait at the end of each part until files and directory are on the disk
    result : function that returns the content of a part's result record
    """

    def __init__(self, directory: Path, scene_text: str | None = None, version: str = "", *,
                 max_duration: float = 0.0, max_size: int = 0, max_chunks: int = MOST_CHUNKS, sync: bool = False,
                 result: Callable[[], Mapping[str, Any]] | None = None) -> None:
        self.directory = directory
        self._name = os.path.basename(os.path.realpath(directory))  # Path.resolve fails for a loop.
        self._duration_ns = round(max_duration * 1e9) if max_duration > 0.0 else math.inf
        self._size = max_size if max_size > 0 else math.inf
        self._max_chunks = max_chunks
        self._sync, self._result = sync, result
        self._done: list[FileSummary] = []
        self._scene: tuple[str, str, int] | None = None
        self._latched: dict[int, tuple[int, bytes, int]] = {}
        self._elapsed: dict[int, tuple[int, int]] = {}
        self._folder, made = -1, list[Path]()
        try:
            _make(directory, self._name, made)
            self._folder = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            self.file = McapFile(self._path(0), scene_text, version, self._folder)
            if scene_text is not None:
                self._scene = scene_text, version, 0
            if sync:
                os.fsync(self._folder)
                parent = os.open(directory.absolute().parent, os.O_RDONLY | os.O_DIRECTORY)
                try:
                    os.fsync(parent)
                finally:
                    os.close(parent)
        except BaseException:
            if self._folder >= 0:
                os.close(self._folder)
            for folder in reversed(made):
                with suppress(OSError):
                    folder.rmdir()
            raise

    def describe(self, scene_text: str, version: str = "", log_ns: int = 0) -> None:
        """Record the scene (YAML) that the following messages come from."""
        self.file.describe(scene_text, version, log_ns)
        self._scene = scene_text, version, log_ns

    def channel(self, topic: str, type_name: str, qos: Sequence[Mapping[str, Any]] = RELIABLE,
                schema: Definition | None = None, publisher: str = "", row: str = "") -> int:
        """Announce a topic, as `McapFile.channel`, and return its channel."""
        return self.file.channel(topic, type_name, qos, schema, publisher, row)

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes, sequence: int = 0,
              latched: bool = False) -> None:
        """Add one serialised message with its times of receipt and sending (ns) and its publisher's sequence number.

        Each later part begins with the last `latched` message of each channel, received at the start of the part.
        """
        file = self.file
        last, elapsed = self._elapsed.get(channel, (log_ns, 0))
        elapsed += max(0, log_ns - last)
        full = file.chunks and (file.size >= self._size or file.chunks >= self._max_chunks)
        if full or elapsed >= self._duration_ns:
            file, elapsed = self._split(), 0
            self._elapsed.clear()
            for number, (sent, content, count) in self._latched.items():
                if not latched or number != channel:
                    file.write(number, log_ns, sent, content, count)
        self._elapsed[channel] = log_ns, elapsed
        if latched:
            self._latched[channel] = publish_ns, data, sequence
        file.write(channel, log_ns, publish_ns, data, sequence)

    def unlatch(self, channel: int) -> None:
        """Do not repeat the last message of a channel in later parts, because its publisher is gone."""
        self._latched.pop(channel, None)

    def check(self) -> None:
        """Raise RecordingError if the directory or the open file was renamed or removed."""
        try:
            directory, held = os.stat(self.directory), os.fstat(self._folder)
        except OSError:
            pass
        else:
            if os.path.samestat(directory, held) and self.file.linked():
                return
        raise RecordingError(f"{self.directory} was renamed or removed while it was recorded to")

    def close(self, result: Mapping[str, Any] | None = None) -> None:
        """Close the last part and write metadata.yaml atomically, without overwriting an existing one."""
        self.file.close(result, self._sync)
        draft = f".{os.urandom(8).hex()}.part"
        file = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666, dir_fd=self._folder)
        try:
            with open(file, "w", encoding="utf-8") as stream:
                stream.write(dumped({"rosbag2_bagfile_information": information([*self._done, self.file.summary])}))
                if self._sync:
                    stream.flush()
                    os.fsync(file)
            try:
                os.link(draft, "metadata.yaml", src_dir_fd=self._folder, dst_dir_fd=self._folder)
            except OSError as error:
                if isinstance(error, FileExistsError) or "metadata.yaml" in os.listdir(self._folder):
                    name = self.directory / "metadata.yaml"
                    raise RecordingError(f"{name} exists already and is not overwritten") from None
                # The file system has no hard links.
                os.replace(draft, "metadata.yaml", src_dir_fd=self._folder, dst_dir_fd=self._folder)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(draft, dir_fd=self._folder)
            if self._sync:
                os.fsync(self._folder)
            self._release()

    def abandon(self) -> None:
        """Close the file without an index; it is readable up to the last flush."""
        self.file.abandon()
        self._release()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Delete the bag after an error, which is raised with the name of the directory if it names no file."""
        if error is not None:
            self.abandon()
            shutil.rmtree(self.directory, ignore_errors=True)
        if isinstance(error, OSError) and error.filename is None:
            raise OSError(error.errno, error.strerror, str(self.directory)) from None

    def _release(self) -> None:
        if self._folder >= 0:
            os.close(self._folder)
        self._folder = -1

    def _path(self, number: int) -> Path:
        return self.directory / f"{self._name}_{number}.mcap"

    def _split(self) -> McapFile:
        """End the part, and begin and return the next one with the same channels and the current scene."""
        # If the next file cannot be created, the current part is still open and can be closed in order.
        before, after = self.file, McapFile(self._path(len(self._done) + 1), folder=self._folder)
        try:
            before.close(self._result() if self._result is not None else None, self._sync)
        except BaseException:
            after.remove()
            raise
        self._done.append(before.summary)
        self.file = after
        if self._scene is not None:
            after.describe(*self._scene)
        for topic in before.summary.topics.values():
            after.channel(*topic)
        if self._sync:
            os.fsync(self._folder)
        return after


def _make(directory: Path, name: str, made: list[Path]) -> None:
    """Create a directory that must not exist, with its parents, and add the created ones to `made`, from outside; its
    files have its `name`.
    """
    try:
        if os.path.lexists(directory):
            raise FileExistsError
        longest = os.pathconf(next(folder for folder in directory.absolute().parents if folder.is_dir()), "PC_NAME_MAX")
        if len(os.fsencode(name + _PART)) > longest:
            raise RecordingError(f"the name {directory.name} is too long: {longest - len(_PART)} bytes are allowed, "
                                 "since the files in it are named after it")
        parents = [folder for folder in directory.absolute().parents if not folder.exists()]
        for folder in (*reversed(parents), directory):
            folder.mkdir()
            made.append(folder)
    except FileExistsError:
        raise RecordingError(f"{directory} exists already and is not overwritten") from None
    except OSError as error:
        raise RecordingError(f"{directory} cannot be created: {error.strerror}") from None
