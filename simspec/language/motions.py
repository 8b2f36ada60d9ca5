"""Motions of kinematic bodies: where they are at given times, whatever pushes them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import Field

from simspec.language.quantities import Number
from simspec.language.shapes import RPY, Angles, Orientation, Point, Quaternion
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, show
from simspec.language.trajectory import MOST_POINTS
from simspec.language.vocabulary import MOTION_INTERPOLATIONS
from simspec.language.words import Word


class MotionPoint(Strict):
    """Where a kinematic body is at a time. What is left out is as at the point before, at the first point as its `pose`."""

    at: Annotated[float, Number("time", 0)] = Field(..., description="Time; later than that of the point before")
    xyz: Maybe[Point] = Field(ABSENT, description="Position of the body's frame in the world")
    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description="Unit quaternion w x y z")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from Orientation.faults(data)


class Motion(Strict):
    """How a kinematic body moves. Before its first point and after its last one it stands still."""

    interpolation: Annotated[str, Word(MOTION_INTERPOLATIONS)] = Field(
        "cubic", description="Interpolation between points, see above"
    )
    points: list[MotionPoint] = Field(..., description="Points in time, in order")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        points = data.get("points")
        if not isinstance(points, list):
            return
        if not 0 < len(points) <= MOST_POINTS:
            yield Fault(
                ("points",), "no points" if not points else "too many points", str(len(points)), f"1 to {MOST_POINTS}"
            )
        before: float | None = None
        for index, point in enumerate(points[:MOST_POINTS]):
            given = point.get("at") if isinstance(point, Mapping) else getattr(point, "at", None)
            try:
                time = Number("time", 0).read(given)
            except Faults:
                continue  # reported where it is read
            if before is not None and time <= before:
                yield Fault(("points", index, "at"), "times must increase", show(time), f"above {before:g} s")
            before = time
