"""Recordings in other programs: Rerun's command and the MCAP library for Node."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_bag_round_trip import TICK, columns, write

NODE_PROGRAM = """
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";
import { open } from "node:fs/promises";
const handle = await open(process.argv[2]);
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(handle), decompressHandlers: await loadDecompressHandlers() });
let count = 0;
for await (const message of reader.readMessages()) count += message.data.length > 0 ? 1 : 0;
const names = [];
for await (const record of reader.readMetadata()) names.push(record.name);
console.log(count, Number(reader.statistics.messageCount), reader.header.profile, names.join(","));
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write(tmp_path_factory.mktemp("foreign") / "run", columns(300), [n * TICK for n in range(300)])


def run(*words, **options):
    return subprocess.run(words, capture_output=True, text=True, timeout=120, **options)


def test_rerun_converts_and_verifies_a_recording(path, tmp_path):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if rerun is None:
        pytest.skip("rerun is not installed")
    if run(rerun, "mcap", "--help").returncode:
        pytest.skip("this rerun has no mcap command")
    converted = run(rerun, "mcap", "convert", str(path), "-o", str(tmp_path / "run.rrd"))
    assert converted.returncode == 0, converted.stderr
    assert run(rerun, "rrd", "verify", str(tmp_path / "run.rrd")).returncode == 0


def test_the_node_library_reads_index_messages_and_metadata(path, tmp_path):
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    try:
        installed = run("npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=0",
                        "--prefix",
                        str(tmp_path), "@mcap/core", "@mcap/nodejs", "@mcap/support")
    except subprocess.TimeoutExpired:
        pytest.skip("npm does not answer")
    if installed.returncode:
        pytest.skip("npm cannot install @mcap/core here")
    (tmp_path / "read.mjs").write_text(NODE_PROGRAM)
    found = run("node", str(tmp_path / "read.mjs"), str(path))
    assert found.stdout == "600 600 ros2 tcc_sim,tcc_sim_result,rosbag2\n", found.stderr
