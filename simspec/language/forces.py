"""Forces and torques that act on bodies during given times: pushes and loads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from simspec.language.quantities import Number, Vector
from simspec.language.shapes import Point
from simspec.language.strict import ABSENT, Fault, Faults, Strict, show
from simspec.language.words import Name

MOST_FORCES = 1000


class _Force(Strict):
    """Base of a force."""

    if TYPE_CHECKING:  # the types of what _FORCE makes; `from` is read with getattr
        body: str
        force: tuple[float, float, float] | None
        torque: tuple[float, float, float] | None
        at: tuple[float, float, float] | None
        until: float | None

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "force" not in data and "torque" not in data:
            yield Fault((), "neither force nor torque", show(dict(data)), "force, torque or both", "force: [10, 0, 0]")
        if "at" in data and "force" not in data:
            yield Fault(
                ("at",), "a torque acts on the body as a whole, at no point", show(data["at"]), None, "remove it"
            )
        try:
            start, until = Number("time", 0).read(data.get("from", 0.0)), Number("time", 0).read(data["until"])
        except (Faults, KeyError):
            return  # reported where it is read, or without end
        if until <= start:
            yield Fault(("until",), "it ends before it begins", f"{until:g} s", f"above {start:g} s")


_FORCE: dict[str, Any] = {
    "body": (Annotated[str, Name(path=True)], Field(..., description="Full name of the body; one that can move")),
    "force": (
        Annotated[tuple[float, float, float], Vector(Number("force"))],
        Field(ABSENT, description="Force, in the world's axes"),
    ),
    "torque": (
        Annotated[tuple[float, float, float], Vector(Number("torque"))],
        Field(ABSENT, description="Torque, in the world's axes, beside that of the force"),
    ),
    "at": (
        Point,
        Field(ABSENT, description="Where the force acts, in the body's frame; default: its origin"),
    ),
    "from": (Annotated[float, Number("time", 0)], Field(0.0, description="Time from which on it acts")),
    "until": (
        Annotated[float, Number("time", 0, above=True)],
        Field(ABSENT, description="Time up to which it acts; default: the end of the run"),
    ),
}
Force: type[_Force] = create_model(
    "Force", __base__=_Force, __doc__="A force and a torque that act on a body during some time.", **_FORCE
)
"""The model of a force; ``from`` is a word of Python's own, so it cannot be written as a class."""
