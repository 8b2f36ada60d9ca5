"""The controller of a world in Webots: a program of its own, since Webots' library can be the controller of one world once.

``python controller.py LIBRARY DESCRIPTOR``: connects to the Webots that WEBOTS_CONTROLLER_URL names, and answers requests
through the socket DESCRIPTOR. Nothing but the standard library is imported. Messages are a letter and, where it says so, more;
numbers are little-endian. Functions of the library are those of Webots' reference manual (``supervisor.h``, ``robot.h``).

=====  ==========================================================  ====================================================
first  length (u4), JSON: bodies, tops                             length (u4), JSON: time, timestep, missing
``n``                                                              length (u4), JSON: the nodes of the world
``s``                                                              states
``f``  a force and a torque (6 f8) for each of ``tops``
``g``  how many steps (u4)                                         i4: −1 where Webots ended, else 0
=====  ==========================================================  ====================================================

States (f8): of each body its position (3) and rotation matrix (9), of each of ``tops`` its velocity (6), in world axes.
"""

from __future__ import annotations

import ctypes
import json
import socket
import struct
import sys
from collections.abc import Sequence
from typing import Any

DOUBLES = ctypes.POINTER(ctypes.c_double)
NODE = FIELD = ctypes.c_void_p
FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "wb_robot_init": (ctypes.c_int, ()),
    "wb_robot_step": (ctypes.c_int, (ctypes.c_int,)),
    "wb_robot_get_time": (ctypes.c_double, ()),
    "wb_robot_get_basic_time_step": (ctypes.c_double, ()),
    "wb_supervisor_node_get_root": (NODE, ()),
    "wb_supervisor_node_get_from_def": (NODE, (ctypes.c_char_p,)),
    "wb_supervisor_node_get_def": (ctypes.c_char_p, (NODE,)),
    "wb_supervisor_node_get_type_name": (ctypes.c_char_p, (NODE,)),
    "wb_supervisor_node_get_number_of_fields": (ctypes.c_int, (NODE,)),
    "wb_supervisor_node_get_field_by_index": (FIELD, (NODE, ctypes.c_int)),
    "wb_supervisor_node_get_position": (DOUBLES, (NODE,)),
    "wb_supervisor_node_get_orientation": (DOUBLES, (NODE,)),
    "wb_supervisor_node_get_velocity": (DOUBLES, (NODE,)),
    "wb_supervisor_node_add_force": (None, (NODE, DOUBLES, ctypes.c_bool)),
    "wb_supervisor_node_add_torque": (None, (NODE, DOUBLES, ctypes.c_bool)),
    "wb_supervisor_field_get_name": (ctypes.c_char_p, (FIELD,)),
    "wb_supervisor_field_get_type_name": (ctypes.c_char_p, (FIELD,)),
    "wb_supervisor_field_get_count": (ctypes.c_int, (FIELD,)),
}
"""Result and arguments of each function."""
KINDS: dict[str, tuple[str, Any, int]] = {
    "Bool": ("bool", ctypes.c_bool, 0),
    "Int32": ("int32", ctypes.c_int, 0),
    "Float": ("float", ctypes.c_double, 0),
    "Vec2f": ("vec2f", DOUBLES, 2),
    "Vec3f": ("vec3f", DOUBLES, 3),
    "Rotation": ("rotation", DOUBLES, 4),
    "Color": ("color", DOUBLES, 3),
    "String": ("string", ctypes.c_char_p, 0),
    "Node": ("node", NODE, 0),
}
"""By the kind of a field, without SF or MF: the end of the functions that read it, their result, and the length of a vector."""
for _end, _result, _ in KINDS.values():
    FUNCTIONS[f"wb_supervisor_field_get_sf_{_end}"] = (_result, (FIELD,))
    FUNCTIONS[f"wb_supervisor_field_get_mf_{_end}"] = (_result, (FIELD, ctypes.c_int))


class WebotsController:
    """The client of Webots. In the first message: ``bodies``, names of nodes; ``tops``, of those, by number, the ones that
    move by themselves, with velocities in the states and forces that act on them."""

    def __init__(self, library: str, channel: socket.socket):
        self._library = ctypes.CDLL(library)
        for name, (result, arguments) in FUNCTIONS.items():
            function = getattr(self._library, name)
            function.restype, function.argtypes = result, arguments
        self._channel = channel
        self._bodies: list[int] = []
        self._tops: list[int] = []

    def serve(self) -> None:
        """Connect, and answer until the socket is closed."""
        content = json.loads(self._received(self._count()))
        lib = self._library
        lib.wb_robot_init()
        found = [lib.wb_supervisor_node_get_from_def(name.encode()) for name in content["bodies"]]
        given = {
            "time": lib.wb_robot_get_time(),
            "timestep": lib.wb_robot_get_basic_time_step(),
            "missing": [name for name, node in zip(content["bodies"], found, strict=True) if not node],
        }
        self._json(given)
        if given["missing"]:
            return
        self._bodies, self._tops = found, [found[number] for number in content["tops"]]
        timestep = round(given["timestep"])
        while letter := self._channel.recv(1):
            if letter == b"n":
                root = lib.wb_supervisor_node_get_root()
                self._json(self._values(self._field_of(root, "children")))
            elif letter == b"s":
                self._channel.sendall(self._states())
            elif letter == b"f":
                self._push(self._received(48 * len(self._tops)))
            elif letter == b"g":
                ended = any(lib.wb_robot_step(timestep) < 0 for _ in range(self._count()))
                self._channel.sendall(struct.pack("<i", -1 if ended else 0))
            else:
                raise ValueError(f"unknown message {letter!r}")

    # --- messages -------------------------------------------------------------------------------------------------

    def _count(self) -> int:
        (count,) = struct.unpack("<I", self._received(4))
        return int(count)

    def _received(self, count: int) -> bytes:
        parts = []
        while count:
            part = self._channel.recv(count)
            if not part:
                raise SystemExit(0)
            parts.append(part)
            count -= len(part)
        return b"".join(parts)

    def _json(self, content: Any) -> None:
        text = json.dumps(content).encode()
        self._channel.sendall(struct.pack("<I", len(text)) + text)

    # --- what Webots holds ------------------------------------------------------------------------------------------

    def _states(self) -> bytes:
        lib, numbers = self._library, []
        for node in self._bodies:
            numbers += lib.wb_supervisor_node_get_position(node)[:3]
            numbers += lib.wb_supervisor_node_get_orientation(node)[:9]
        for node in self._tops:
            numbers += lib.wb_supervisor_node_get_velocity(node)[:6]
        return struct.pack(f"<{len(numbers)}d", *numbers)

    def _push(self, wrenches: bytes) -> None:
        lib, vector = self._library, ctypes.c_double * 3
        for node, numbers in zip(self._tops, struct.iter_unpack("<6d", wrenches), strict=True):
            if any(numbers[:3]):
                lib.wb_supervisor_node_add_force(node, vector(*numbers[:3]), False)
            if any(numbers[3:]):
                lib.wb_supervisor_node_add_torque(node, vector(*numbers[3:]), False)

    def _field_of(self, node: int, name: str) -> int:
        lib = self._library
        for index in range(lib.wb_supervisor_node_get_number_of_fields(node)):
            field = lib.wb_supervisor_node_get_field_by_index(node, index)
            if lib.wb_supervisor_field_get_name(field).decode() == name:
                return int(field)
        raise LookupError(f"Webots' root has no {name}")

    def _node(self, node: int | None) -> dict[str, Any] | None:
        """A node with all of its fields, as plain data; None for NULL."""
        if not node:
            return None
        lib = self._library
        label = lib.wb_supervisor_node_get_def(node)
        fields = {}
        for index in range(lib.wb_supervisor_node_get_number_of_fields(node)):
            field = lib.wb_supervisor_node_get_field_by_index(node, index)
            kind = lib.wb_supervisor_field_get_type_name(field).decode()
            name = lib.wb_supervisor_field_get_name(field).decode()
            fields[name] = {"kind": kind, "values": self._values(field)}
        kind = lib.wb_supervisor_node_get_type_name(node).decode()
        return {"node": kind, "label": label.decode() if label else "", "fields": fields}

    def _values(self, field: int) -> list[Any]:
        """The values of a field, those of vectors one after the other."""
        lib = self._library
        kind = lib.wb_supervisor_field_get_type_name(field).decode()
        end, _, size = KINDS[kind[2:]]
        if kind.startswith("MF"):
            get = getattr(lib, f"wb_supervisor_field_get_mf_{end}")
            found = [get(field, index) for index in range(lib.wb_supervisor_field_get_count(field))]
        else:
            found = [getattr(lib, f"wb_supervisor_field_get_sf_{end}")(field)]
        if size:
            return [number for value in found for number in value[:size]]
        return [self._plain(end, value) for value in found]

    def _plain(self, end: str, value: Any) -> Any:
        if end == "node":
            return self._node(value)
        return value.decode() if end == "string" else float(value) if end in ("int32", "float") else value


def main(arguments: Sequence[str]) -> int:
    """Serve the socket of the command line."""
    library, descriptor = arguments
    with socket.socket(fileno=int(descriptor)) as channel:
        WebotsController(library, channel).serve()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
