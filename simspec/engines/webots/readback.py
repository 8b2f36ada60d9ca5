"""What Webots says it holds: all fields of its nodes, and the velocities of its bodies, read as a file is (``raising.py``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from simspec.dialects.webots.raising import raised
from simspec.engines.webots.program import NAME, Live
from simspec.engines.webots.simulation import Simulation
from simspec.errors import EngineError
from simspec.formats.wbt.format import NODES, VERSION
from simspec.formats.wbt.reading import Value, WbtDocument, WbtField, WbtNode
from simspec.world.types import ReadBack

HELD: Final = "Webots"
"""What stands for a file's name in errors."""
MOVES: Final = ("linearVelocity", "angularVelocity")
"""Fields of Solids that the manual does not have: what Webots' bodies move with is asked."""
MOVING: Final = ("Solid", "Robot")


def read_back(sim: Simulation) -> ReadBack:
    """The model as Webots holds it, and its state. Raises EngineError, which names the node, for what simspec did not write.
    Fields that a newer Webots has beside those of R2023b are told with its messages, and not compared."""
    live = sim.live()
    strange: dict[str, None] = {}
    try:
        held = raised(held_document(live, list(sim.states.centres), strange), sim.told)
    except ValueError as error:
        raise EngineError(NAME, f"holds another world than it was told: {error}") from error
    sim.note(strange)
    return held


def held_document(live: Live, tops: Sequence[int], strange: dict[str, None]) -> WbtDocument:
    """The nodes that Webots holds, as a document; ``tops``: the numbers of bodies that move by themselves. ``strange`` becomes
    the fields that a node of simspec's does not have."""
    speeds = live.states()[2].tolist()
    velocities = {f"body_{row}": speed for row, speed in zip(tops, speeds, strict=True)}
    return WbtDocument(HELD, VERSION, tuple(_node(told, velocities, strange) for told in live.nodes()))


def _node(told: Mapping[str, Any], velocities: Mapping[str, Sequence[float]], strange: dict[str, None]) -> WbtNode:
    kind, label = told["node"], told["label"]
    known = NODES.get(kind)
    if known is None:
        raise EngineError(NAME, f"holds a {kind} {label}, which simspec does not write")
    moves = MOVES if kind in MOVING else ()
    fields: list[WbtField] = []
    for name, field in told["fields"].items():
        if name not in known:
            strange[f"{kind}.{name}"] = None
        elif name not in moves:
            values: list[Value] = [
                _node(value, velocities, strange) if isinstance(value, dict) else value for value in field["values"]
            ]
            fields.append(WbtField(name, 0, tuple(values), field["kind"].startswith("MF")))
    speed = velocities.get(label, (0.0,) * 6)
    parts = (tuple(speed[:3]), tuple(speed[3:]))
    fields += [WbtField(name, 0, part, False) for name, part in zip(moves, parts, strict=False)]
    return WbtNode(HELD, kind, label, 0, tuple(fields))
