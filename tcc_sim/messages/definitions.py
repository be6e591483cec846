"""Message definitions and type hashes: from the installed ROS 2, or from copies of the few that this package needs."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tcc_sim.errors import InputError

CARRIED: dict[str, tuple[str, str]] = {
    "builtin_interfaces/msg/Time": (
        "int32 sec\nuint32 nanosec\n",
        "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
    "std_msgs/msg/Header": (
        "builtin_interfaces/Time stamp\nstring frame_id\n",
        "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
    "std_msgs/msg/Float64": (
        "float64 data\n",
        "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"),
    "std_msgs/msg/MultiArrayDimension": (
        "string label\nuint32 size\nuint32 stride\n",
        "RIHS01_5e773a60a4c7fc8a54985f307c7837aa2994252a126c301957a24e31282c9cbe"),
    "std_msgs/msg/MultiArrayLayout": (
        "MultiArrayDimension[] dim\nuint32 data_offset\n",
        "RIHS01_4c66e6f78e740ac103a94cf63259f968e48c617e7699e829b63c21a5cb50dac6"),
    "std_msgs/msg/Float64MultiArray": (
        "MultiArrayLayout layout\nfloat64[] data\n",
        "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f"),
    "std_msgs/msg/String": (
        "string data\n",
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
    "std_msgs/msg/Int8": (
        "int8 data\n",
        "RIHS01_26525065a403d972cb672f0777e333f0c799ad444ae5fcd79e43d1e73bd0f440"),
    "sensor_msgs/msg/FluidPressure": (
        "std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance\n",
        "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32"),
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"),
}
"""Fields (without comments) and RIHS01 hash by type, so that recordings can be written without ROS 2."""

_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


@dataclass(frozen=True)
class Definition:
    """Definition of a message type for an MCAP schema: text (ros2msg) with every type it needs, and RIHS01 hash, empty
    if it is not available.
    """

    text: str
    type_hash: str


def definition(type_name: str) -> Definition:
    """Return the definition of `type_name` (package/msg/Name) with its dependencies in the order of their first use;
    InputError for a name that is no message type, or whose definition is not available.
    """
    text, names = "", [type_name]
    for name in names:  # The list grows.
        own = installed_text(name, ".msg")
        if own is None and name not in CARRIED:
            raise InputError(f"the definition of {name} is not installed")
        own = CARRIED[name][0] if own is None else own
        package, _, short = name.split("/")
        text += own if name == type_name else f"\n{'=' * 80}\nMSG: {package}/{short}\n{own}"
        names += [one for one in dict.fromkeys(_dependencies(name, own)) if one not in names]
    for entry in json.loads(installed_text(type_name, ".json") or "{}").get("type_hashes", []):
        if entry.get("type_name") == type_name:
            return Definition(text, str(entry["hash_string"]))
    return Definition(text, CARRIED.get(type_name, ("", ""))[1])


def type_parts(type_name: str) -> tuple[str, str]:
    """Return package and short name of `package/msg/Name`; InputError for a name of another form."""
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise InputError(f"{type_name!r} is not a message type; it must be like std_msgs/msg/Float64")
    return match[1], match[2]


def installed_text(type_name: str, suffix: str) -> str | None:
    """Return the installed file that defines the type, or None; a sourced workspace precedes the PyPI wheels."""
    package, short = type_parts(type_name)
    for prefix in filter(None, [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]):
        path = Path(prefix, "share", package, "msg", f"{short}{suffix}")
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def _dependencies(type_name: str, text: str) -> Iterator[str]:
    """Iterate over the message types in the fields of `text`, as package/msg/Name."""
    package = type_name.split("/")[0]
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if len(words) < 2:
            continue
        name = re.split(r"[\[<]", words[0])[0]
        parts = name.split("/")
        if len(parts) > 1 or name[:1].isupper():  # Names of primitive types, which constants have, are lower-case.
            yield f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}"
