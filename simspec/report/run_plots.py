"""``run.plot``: recorded channels of a run over time, with matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.errors import Problem, SpecError
from simspec.language.strict import near
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.runner.metrics import moving_bodies
from simspec.runner.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_LINES = 12
"""Joints, or bodies, that are drawn where none are named."""

Line = tuple[str, np.ndarray]


def _joints(channel: str) -> Callable[[Run, Sequence[str]], Iterator[Line]]:
    """Positions or velocities of joints or coordinates; of hinges and slides where none are named."""

    def lines(run: Run, names: Sequence[str]) -> Iterator[Line]:
        scalar = [body.joint.name for body in run.world.bodies if body.joint.kind in SCALAR_JOINTS]
        for name in names or scalar[:MOST_LINES]:
            values = getattr(run, channel)(name)
            if values.ndim == 1:
                yield name, values
            else:
                yield from ((f"{name}, {place}", column) for place, column in enumerate(values.T))

    return lines


def _bodies(array: str) -> Callable[[Run, Sequence[str]], Iterator[Line]]:
    """x, y and z of bodies; of those that can move where none are named."""

    def lines(run: Run, names: Sequence[str]) -> Iterator[Line]:
        moving = [run.world.bodies[int(number)].name for number in moving_bodies(run.world)]
        for name in names or moving[: MOST_LINES // 3]:
            if name not in run.index:
                raise SpecError(
                    [Problem(f"there is no body {name!r}", found=name, hint=near(name, run.index), code="R107")]
                )
            for part, axis in enumerate("xyz"):
                yield f"{name}, {axis}", run.arrays[array][:, run.index[name], part]

    return lines


def _driven(method: str) -> Callable[[Run, Sequence[str]], Iterator[Line]]:
    """Targets or efforts of driven joints; of all where none are named."""

    def lines(run: Run, names: Sequence[str]) -> Iterator[Line]:
        joints = list((run.provenance.get("control") or {}).get("joints", ()))
        return ((name, getattr(run, method)(name)) for name in names or joints[:MOST_LINES])

    return lines


def _energy(run: Run, names: Sequence[str]) -> Iterator[Line]:
    if "energy" in run.arrays:
        kinetic, potential = run.arrays["energy"].T
        yield from (("kinetic", kinetic), ("potential", potential), ("sum", kinetic + potential))


def _contacts(run: Run, names: Sequence[str]) -> Iterator[Line]:
    if "contact.row" in run.arrays:
        yield "contact points", np.bincount(run.arrays["contact.row"], minlength=len(run.time)).astype(float)


CHANNELS: Mapping[str, tuple[str, Callable[[Run, Sequence[str]], Iterator[Line]]]] = {
    "q": ("position of joints, rad or m", _joints("q")),
    "v": ("velocity of joints, rad/s or m/s", _joints("v")),
    "position": ("position of bodies, m", _bodies("pose")),
    "velocity": ("velocity of bodies, m/s", _bodies("velocity")),
    "target": ("target of driven joints, rad or m", _driven("target")),
    "effort": ("effort of driven joints, N m or N", _driven("effort")),
    "energy": ("energy, J", _energy),
    "contacts": ("contact points", _contacts),
}
"""The label of the axis, and the function that makes the lines, of each channel."""


def plot_run(
    run: Run, channel: str = "q", names: Sequence[str] | str = (), axes: Axes | None = None, **style: Any
) -> Axes:
    """A channel of the run over time as a plot of matplotlib; its axes.

    channel  ``q``, ``v`` (joints), ``position``, ``velocity`` (bodies), ``target``, ``effort`` (driven joints), ``energy``,
             ``contacts``
    names    joints or coordinates (``elbow``, ``base.x``), or bodies; without, the first ones
    axes     axes to draw into, so that runs of several engines share them; without, new ones
    style    passed on to ``Axes.plot``

    Raises SpecError for unknown channels and names, for channels that the run did not record, and where matplotlib is not
    installed.
    """
    if channel not in CHANNELS:
        message = f"there is no channel {channel!r}"
        allowed = ", ".join(CHANNELS)
        raise SpecError([Problem(message, found=channel, allowed=allowed, hint=near(channel, CHANNELS), code="R107")])
    if not run.recorded:
        raise SpecError([Problem(f"{run.label} recorded nothing: {run.failed}", code="R106")])
    label, make = CHANNELS[channel]
    lines = list(make(run, [names] if isinstance(names, str) else list(names)))
    if not lines:
        hint = "record: {channels: [...]} in the spec says what is recorded"
        raise SpecError(
            [Problem(f"{run.label} has nothing to plot of the channel {channel!r}", hint=hint, code="R107")]
        )
    try:
        from matplotlib import pyplot
    except ImportError as error:
        hint = "pip install 'simspec-physics[plots]'"
        raise SpecError([Problem("plot needs matplotlib", found=str(error), hint=hint, code="C110")]) from None
    if axes is None:
        _, axes = pyplot.subplots(layout="constrained")
    for name, values in lines:
        shown = f"{name} ({run.engine})".replace("$", r"\$")  # "$" begins mathematics
        axes.plot(run.time, values, label=shown, **style)
    axes.set_xlabel("time, s")
    axes.set_ylabel(label)
    axes.legend(fontsize="small")
    return axes
