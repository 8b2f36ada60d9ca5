"""Gravity, time, the fluid around the bodies, and the recording of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import Field

from simspec.language.contact import WHOLE
from simspec.language.quantities import Number, Vector
from simspec.language.shapes import LinearVelocity
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict
from simspec.language.vocabulary import CHANNELS, DAMPINGS, INTEGRATORS
from simspec.language.words import Name, Word

MOST_STEPS = 10**9
"""Steps of one scenario; at a microsecond each that is a quarter of an hour."""


def whole_steps(time: float, timestep: float) -> int | None:
    """How many timesteps ``time`` is; None when it is no whole number of them."""
    steps = time / timestep
    nearest = round(steps)
    return nearest if abs(steps - nearest) <= WHOLE * max(1.0, nearest) else None


def not_whole(name: str, time: float, timestep: float, loc: tuple[str | int, ...]) -> Fault:
    """The fault of a time that is no whole number of timesteps, with the nearest ones that are."""
    steps = int(time / timestep)
    lower, upper = (float(f"{count * timestep:.12g}") for count in (steps, steps + 1))
    nearest = f"{lower!r} s or {upper!r} s" if lower else f"{upper!r} s"
    found = f"{time:g} s / {timestep:g} s = {time / timestep:.10g} steps"
    return Fault(loc, f"{name} must be a whole number of timesteps", found, f"the nearest: {nearest}", code="S206")


class Fluid(Strict):
    """A fluid that fills the world, at rest or in uniform motion: drag and viscous resistance of every moving body,
    as of a box with its mass and principal moments of inertia.
    """

    density: Annotated[float, Number("density", 0)] = Field(0.0, description="Density ρ: drag, quadratic in velocity")
    viscosity: Annotated[float, Number("viscosity", 0)] = Field(
        0.0, description="Dynamic viscosity μ: resistance, linear in velocity"
    )
    velocity: LinearVelocity = Field(
        (0.0, 0.0, 0.0), description="Velocity of the fluid, in world axes: wind, a current"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "density" not in data and "viscosity" not in data:
            hint = "fluid: {density: 1.2, viscosity: 1.8e-5}"
            yield Fault((), "a fluid needs a density or a viscosity", hint=hint, code="S102")


class Physics(Strict):
    """Gravity, time and the fluid around the bodies. The common integrator is semi-implicit Euler: v ← v + dt a, then
    q ← q ⊕ dt v.
    """

    gravity: Annotated[tuple[float, float, float], Vector(Number("acceleration"))] = Field(
        (0.0, 0.0, -9.81), description="Gravity in world axes"
    )
    timestep: Annotated[float, Number("time", 0, above=True)] = Field(0.001, description="Length of one step")
    duration: Annotated[float, Number("time", 0)] = Field(
        0.0, description="Simulated time of a run; a whole number of steps"
    )
    fluid: Maybe[Fluid] = Field(ABSENT, description="The fluid around the bodies; none: a vacuum")
    integrator: Annotated[str, Word(INTEGRATORS)] = Field(
        "common",
        description="The method of integration: semi-implicit Euler in all engines, or the usual one of each engine",
    )
    damping: Annotated[str, Word(DAMPINGS)] = Field(
        "explicit",
        description="Damping of hinges, slides and balls in time: an effort −d v of the velocity v at the beginning of each "
        "step, or −d v′ of the velocity v′ at its end, which is stable at every timestep",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if data.get("damping") == "implicit" and data.get("integrator") == "engine":
            yield Fault(
                ("damping",),
                "implicit damping is that of the common integrator; the usual methods of the engines have damping of their own",
                "integrator: engine",
                hint="integrator: common, or no damping",
                code="S103",
            )
        times = {"timestep": 0.001, "duration": 0.0}
        for name in times:
            if name in data:
                try:
                    times[name] = Number("time", 0).read(data[name])
                except Faults:
                    return  # reported where it is read
        if times["timestep"] == 0.0:
            return
        if times["duration"] / times["timestep"] > MOST_STEPS:
            found = f"{times['duration'] / times['timestep']:.3g} steps"
            yield Fault(("duration",), "too many steps", found, f"up to {MOST_STEPS:g}", code="S207")
        elif whole_steps(times["duration"], times["timestep"]) is None:
            yield not_whole("duration", times["duration"], times["timestep"], ("duration",))
        elif times["duration"] > 0.0 and not whole_steps(times["duration"], times["timestep"]):
            found = f"{times['duration']:g} s, {times['duration'] / times['timestep']:.3g} steps"
            yield Fault(
                ("duration",), "shorter than any step", found, f"0, or at least {times['timestep']:g} s", code="S207"
            )


class Record(Strict):
    """The recording of a run."""

    every: Maybe[Annotated[float, Number("time", 0, above=True)]] = Field(
        ABSENT, description="Time between two records, a whole number of steps; default: one step"
    )
    channels: list[Annotated[str, Word(CHANNELS)]] = Field(
        list(CHANNELS), description="Poses and velocities of all bodies, contacts, kinetic and potential energy"
    )
    show: list[Annotated[str, Name(path=True)]] = Field(
        [],
        description="Full names of bodies, hinges and slides whose final state the table of a run shows; none: the roots that "
        "can move, and all joints",
    )
