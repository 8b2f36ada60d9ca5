"""Controllers of the world: names and patterns resolved to joints, gears resolved away, limits the smaller of two."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

from simspec.control.law import needs_dynamics
from simspec.errors import Problem
from simspec.language.arrays import CLASH_HINT, chosen, clash_words, entry_of
from simspec.language.control import PER_JOINT
from simspec.language.control import Controller as SpecController
from simspec.language.document import Details, Key
from simspec.language.physics import whole_steps
from simspec.language.quantities import LARGEST, article
from simspec.language.sources import Source
from simspec.language.strict import Faults, near, required
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.resolve.actuators import ActuatorsDraft
from simspec.world.actions import JointController
from simspec.world.kinematics import trees
from simspec.world.types import Body, World

if TYPE_CHECKING:
    from simspec.control.stability import ControlInstability

MOST_NAMED = 8
"""Joints that one message names."""


class Driven(NamedTuple):
    """The result of `control`.

    controllers      sorted by name
    bodies           the world's bodies, rotors' inertia added to the armature of their joints
    velocity_limits  by the joint's full name, for every joint that has one (rad/s, m/s): the smaller of the joint's own
                     and the actuator's, on the joint's side
    aims             of joints that actuators act on: the constant target (rad, m) and feed-forward effort (N m, N)
    problems         what is wrong; then the rest is what could be made of it
    """

    controllers: tuple[JointController, ...]
    bodies: tuple[Body, ...]
    velocity_limits: Mapping[str, float]
    aims: Mapping[str, tuple[float, float]]
    problems: list[Problem]


def controllers(source: Source, bodies: Sequence[Body], followers: Mapping[str, str] = MappingProxyType({})) -> Driven:
    """The controllers of a spec, and what they say of the ``bodies`` (those of the world, in its order). ``followers``: the
    joints that follow others, with their leaders; patterns leave them out, and naming one is an error."""
    problems: list[Problem] = []
    local = {body.joint.name: body.joint.velocity_limit for body in bodies}
    limits = {name: limit for name, limit in local.items() if limit is not None}
    armature: dict[str, float] = {}
    resolved: list[JointController] = []
    taken: dict[str, str] = {}
    aims: dict[str, tuple[float, float]] = {}
    for name, written in source.content.control.items():
        if written.actuators is not None:
            acting = ActuatorsDraft(source, ("control", name), written, bodies, taken, followers)
            taken.update(dict.fromkeys(acting.joints, name))
            resolved.append(acting.controller(name))
            aims.update(acting.aims())
            problems += acting.problems
            continue
        controller = _ControllerDraft(source, ("control", name), written, bodies, taken, followers)
        taken.update(dict.fromkeys(controller.joints, name))
        resolved.append(controller.controller(name))
        limits.update(controller.velocity_limits())
        armature.update(controller.armature())
        problems += controller.problems
    driven = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, armature=armature[body.joint.name]))
        if body.joint.name in armature
        else body
        for body in bodies
    )
    return Driven(tuple(sorted(resolved, key=lambda controller: controller.name)), driven, limits, aims, problems)


def unstable(source: Source, world: World) -> list[Problem]:
    """Controllers whose explicit law grows without end at the world's timestep; without controllers nothing is evaluated."""
    if not world.controllers:
        return []
    lawless = _without_dynamics(source, world)
    if lawless:
        return lawless
    try:
        from simspec.control import stability

        instabilities = stability.unstable(world)
    except ModuleNotFoundError as error:
        message = f"control needs a library that is not installed ({error.name})"
        return [
            source.document.problem(
                ("control",), message, key=True, hint="pip install 'simspec-physics[pin]'", code="C110"
            )
        ]
    floating = {body.joint.name for bodies in trees(world).values() if _without_law(bodies) for body in bodies}
    joints = {controller.name: controller.joints for controller in world.controllers}
    return [
        _of_instability(
            source,
            instability,
            implicit=all(floating.isdisjoint(joints[name]) for name in instability.controller.split(", ")),
        )
        for instability in instabilities
    ]


def _without_law(bodies: Sequence[Body]) -> Body | None:
    """The first body of a tree whose joint keeps laws that need the tree's dynamics away; None for a tree of hinges and slides
    on a fixed base."""
    return next((body for body in bodies if body.joint.kind not in ("fixed", *SCALAR_JOINTS)), None)


def _without_dynamics(source: Source, world: World) -> list[Problem]:
    """Controllers with a law that needs the dynamics of a tree that the law has none of: with a ball or a free joint."""
    problems = []
    for bodies in trees(world).values():
        joints = {body.joint.name for body in bodies}
        law = _without_law(bodies)
        problems += [
            source.document.problem(
                ("control", controller.name),
                "its law needs a tree of hinges and slides on a fixed base",
                key=True,
                found=f"bodies.{law.name}, with a {law.joint.kind} joint",
                hint=_explicit_hint(world, controller),
                code="S705",
            )
            for controller in world.controllers
            if law is not None and needs_dynamics(controller) and not joints.isdisjoint(controller.joints)
        ]
    return problems


def _explicit_hint(world: World, controller: JointController) -> str:
    """The law that a controller of a tree with a free or a ball joint can have, and up to which timestep with its gains."""
    hint = "law: pd with discretisation: explicit and without gravity_compensation"
    if controller.law != "pd":
        return f"{hint} can be used"
    try:
        from simspec.control import stability
    except ModuleNotFoundError:  # without Pinocchio no mass matrix is known
        return f"{hint} can be used"
    explicit = dataclasses.replace(controller, discretisation="explicit", gravity_compensation=False)
    instabilities = stability.unstable(dataclasses.replace(world, controllers=(explicit,)))
    if not instabilities:
        return f"{hint} can be used: with these gains it is stable at this timestep"
    largest = min(instability.largest_stable_step for instability in instabilities)
    if not largest:
        return f"{hint} can be used, with other gains: with these it is unstable at any timestep"
    return f"{hint} can be used: with these gains it is stable up to a physics.timestep of {largest:.3g} s, or use lower gains"


def _of_instability(source: Source, instability: ControlInstability, *, implicit: bool) -> Problem:
    """``implicit``: whether its trees can have implicit laws."""
    # controllers of one tree may be unstable together, each of them stable alone
    names = instability.controller.split(", ")
    who = "the explicit law is" if len(names) == 1 else f"the explicit laws of {' and '.join(names)} are together"
    growth = f"its errors grow by a factor of {instability.growth:.4g} in every step"
    text = at_most = ""
    if instability.hold > 1:
        text = f", efforts held for {instability.hold} steps"
        at_most = f", every: {instability.largest_stable_step * instability.hold:.3g} s"
    return source.document.problem(
        ("control", names[0]),
        f"{who} unstable at this timestep: {growth}",
        key=True,
        found=f"a timestep of {instability.timestep:g} s{text}",
        allowed=f"up to {instability.largest_stable_step:.3g} s{at_most}"
        if instability.largest_stable_step
        else "none: it is unstable at any timestep",
        hint=("use discretisation: implicit, " if implicit else "use ")
        + f"lower gains, {'a shorter every, ' if text else ''}or a smaller physics.timestep",
        code="S704",
    )


class _ControllerDraft:
    """One controller while it is resolved; ``taken``: joints that other controllers drive, with their names."""

    def __init__(
        self,
        source: Source,
        path: tuple[Key, ...],
        written: SpecController,
        bodies: Sequence[Body],
        taken: Mapping[str, str],
        followers: Mapping[str, str],
    ):
        self.written = written
        self.problems: list[Problem] = []
        self._source, self._path, self._followers = source, path, followers
        self._types = {body.joint.name: body.joint.kind for body in bodies}
        chosen_joints = self._joints(taken)
        self._chosen = {body.joint.name: body.joint for body in bodies if body.joint.name in chosen_joints}
        self.joints = tuple(self._chosen)  # in the order of the bodies
        self._gear = self._numbers("gear", 1.0)

    # --- which joints ---

    def _joints(self, taken: Mapping[str, str]) -> dict[str, None]:
        joints: dict[str, None] = {}
        movable = [name for name, kind in self._types.items() if kind in SCALAR_JOINTS and name not in self._followers]
        for index, entry in enumerate(self.written.joints or ()):
            place = (*self._path, "joints", index)
            if entry in self._followers:
                message = f"{entry} follows {self._followers[entry]}, and has no controller"
                self._problem(place, message, found=entry, hint=f"drive {self._followers[entry]}", code="S702")
                continue
            meant = (
                chosen(entry, movable) if "*" in entry else [entry] if self._types.get(entry) in SCALAR_JOINTS else []
            )
            if not meant:
                self._none(place, entry, movable)
                continue
            other = {name: taken[name] for name in meant if name in taken}
            if other:
                name, holder = next(iter(other.items()))
                message = f"{name} has a controller already: {holder}"
                more = f" (and {len(other) - 1} more joints)" if len(other) > 1 else ""
                self._problem(
                    place, message + more, found=entry, hint="a joint has at most one controller", code="S702"
                )
            elif all(name in joints for name in meant):
                self._problem(
                    place, "every joint of this entry is already listed", found=entry, hint="remove it", code="S702"
                )
            joints.update(dict.fromkeys(name for name in meant if name not in taken))
        return joints

    def _none(self, place: tuple[Key, ...], entry: str, movable: Sequence[str]) -> None:
        others = chosen(entry, self._types)
        if others:
            kind = self._types[others[0]]
            self._problem(
                place, f"{others[0]} is {article(kind)} joint", found=entry, allowed="hinges and slides", code="S702"
            )
        elif "*" in entry:
            allowed = _some(movable) if movable else "the world has no hinge and no slide"
            self._problem(place, f"no hinge or slide is called {entry!r}", found=entry, allowed=allowed, code="S302")
        else:
            hint = near(entry, movable)
            none = None if movable else "the world has no hinge and no slide"
            self._problem(place, f"there is no joint {entry!r}", found=entry, allowed=none, hint=hint, code="S302")

    # --- numbers of joints ---

    def _numbers(self, key: str, default: float | None = None) -> dict[str, float | None]:
        """The number of every joint, as the spec says it: on the actuator's side."""
        value = getattr(self.written, key)
        if value is None or not self.joints:
            return dict.fromkeys(self.joints, default)
        if isinstance(value, Mapping):
            return {**dict.fromkeys(self.joints, default), **dict(self._mapped(key, value))}
        return {**dict.fromkeys(self.joints, default), **dict(self._same(key, value, self.joints, ()))}

    def _mapped(self, key: str, value: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
        said, clashes = entry_of(value, lambda entry: chosen(entry, self.joints))
        for entry, number in value.items():
            place = (*self._path, key, entry)
            meant = chosen(entry, self.joints)
            if not meant:
                message = f"{entry!r} is not a joint of this controller"
                self._problem(
                    place, message, key=True, allowed=_some(self.joints), hint=near(entry, self.joints), code="S302"
                )
            yield from self._same(key, number, [name for name in meant if said[name] == entry], (entry,))
        for clash in clashes:
            self._problem((*self._path, key, clash.other), clash_words(clash), key=True, hint=CLASH_HINT, code="S304")
        lacking = [name for name in self.joints if name not in said]
        if lacking:
            allowed = "one entry per joint, or one number for all"
            self._problem((*self._path, key), f"no value for {_some(lacking)}", key=True, allowed=allowed, code="S703")

    def _same(self, key: str, value: Any, joints: Sequence[str], below: tuple[Key, ...]) -> Iterator[tuple[str, float]]:
        """One number for several joints, which must be of one type where the number has a unit."""
        place = (*self._path, key, *below)
        reader = PER_JOINT[key]
        types = {self._types[name]: name for name in joints}
        if reader.quantity and len(types) > 1:
            units = " or ".join(reader.number(kind).unit() for kind in types)
            found = ", ".join(f"{name}: {article(kind)}" for kind, name in types.items())
            message = f"one number for hinges and slides would have two units ({units})"
            self._problem(
                place,
                message,
                found=found,
                hint=f"{key}: {{JOINT: number, ...}}, separately for hinges and slides",
                code="S703",
            )
            return
        for name in joints:
            try:
                yield name, reader.number(self._types[name]).read(value)
            except Faults as error:
                for wrong in error.faults:
                    self._problem(
                        place, wrong.message, found=wrong.found, allowed=wrong.allowed, hint=wrong.hint, code=wrong.code
                    )
                return

    def _geared(self, key: str, power: int) -> dict[str, float | None]:
        """The numbers on the joint's side: multiplied by a power of the gear's ratio."""
        values = self._numbers(key)
        for name, value in values.items():
            ratio = self._gear[name]
            if value is None or ratio is None:
                continue
            geared = value * ratio**power if power >= 0 else value / ratio**-power
            values[name] = geared
            if geared > LARGEST:
                message = f"{key} of {name} times the gear ratio is too large a number"
                found_there = f"{value:g} × {ratio:g}^{power}"
                self._problem((*self._path, key), message, found=found_there, allowed=f"up to {LARGEST:g}", code="S202")
                values[name] = None
        return values

    # --- what follows ---

    def controller(self, name: str) -> JointController:
        """The world's controller."""
        written = self.written
        gains = written.law != "computed-torque"
        return JointController(
            name=name,
            joints=self.joints,
            law=written.law,
            discretisation=written.discretisation,
            kp=tuple(value or 0.0 for value in self._geared("kp", 2).values()) if gains else (),
            kd=tuple(value or 0.0 for value in self._geared("kd", 2).values()) if gains else (),
            natural_frequency=0.0 if gains else required(written.natural_frequency),
            damping_ratio=0.0 if gains else written.damping_ratio,
            gravity_compensation=written.gravity_compensation,
            effort_limits=tuple(
                _smaller(value, self._chosen[joint].effort_limit)
                for joint, value in self._geared("effort_limit", 1).items()
            ),
            every_steps=self._every(),
        )

    def _every(self) -> int:
        """Every how many steps it acts; 0 for every step, the default."""
        every = self.written.every
        steps = 1 if every is None else whole_steps(every, self._source.content.physics.timestep)
        if not steps:
            raise ValueError("a validated interval of control is a whole number of steps")
        return steps if steps > 1 else 0

    def velocity_limits(self) -> dict[str, float]:
        """The limits of those joints that have one, on the joint's side."""
        both = {
            name: _smaller(value, self._chosen[name].velocity_limit)
            for name, value in self._geared("velocity_limit", -1).items()
        }
        return {name: limit for name, limit in both.items() if limit is not None}

    def armature(self) -> dict[str, float]:
        """The armature of those joints that have a rotor."""
        rotors = self._geared("rotor_inertia", 2)
        return {name: self._chosen[name].armature + value for name, value in rotors.items() if value is not None}

    def _problem(self, place: tuple[Key, ...], message: str, **more: Unpack[Details]) -> None:
        self.problems.append(self._source.document.problem(place, message, **more))


def _smaller(first: float | None, other: float | None) -> float | None:
    """The smaller of two limits, None where there is none."""
    return min((limit for limit in (first, other) if limit is not None), default=None)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:MOST_NAMED]) + (f", ... ({len(names)} in all)" if len(names) > MOST_NAMED else "")
