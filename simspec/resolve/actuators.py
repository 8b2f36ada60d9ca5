"""Controllers of actuators: each one's law at its joint, as the world's ``pd`` law with a constant target and feed-forward.

With the gear g, an actuator's force f = a u + b₀ − kp g q − kd g v acts on its joint as g f. At the joint that is the stiffness
g² kp, the damping g² kd and the rest, which is constant: as the target u/g of a position law, else as feed-forward effort.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Unpack

import numpy as np

from simspec.errors import Problem
from simspec.language.actions import BY_JOINT, Grasp
from simspec.language.arrays import CLASH_HINT, chosen, clash_words, entry_of
from simspec.language.control import COMMAND, COMMANDS, OF_JOINT, Actuator
from simspec.language.control import Controller as SpecController
from simspec.language.document import Details, Key
from simspec.language.physics import whole_steps
from simspec.language.quantities import LARGEST, Number, article
from simspec.language.sources import Source
from simspec.language.strict import Faults, near
from simspec.language.trees import Bodies, chosen_state, model_of, placed, states
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.resolve.bodies import Places, places_of
from simspec.resolve.shapes import elements
from simspec.world import frames
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.types import Body, Joint, Pose, World


@dataclass(frozen=True)
class WrittenActuator:
    """An actuator of one copy of a model: the prefix of its names, the file and the place in it, and what it says."""

    prefix: str
    file: Source
    path: tuple[Key, ...]
    typed: Actuator
    started: tuple[Source, tuple[Key, ...], Any] | None = None
    """The command of the state that the model begins in: the file, the place in it, and the value."""


class AtJoint(NamedTuple):
    """An actuator at its joint (SI), as in the world's law. ``target`` None: where the joint begins."""

    kp: float
    kd: float
    limit: float | None
    target: float | None
    feed: float


def written_actuators(source: Source) -> dict[str, WrittenActuator]:
    """The actuators of loose bodies, and of every copy of every model, by their full names. The nearer file's replaces
    another's."""
    found: dict[str, WrittenActuator] = {}

    def begin(prefix: str, bodies: Bodies) -> None:
        begins = chosen_state(source, bodies)
        state = states(source, bodies).get(begins[2]) if begins is not None else None
        if state is None or state.typed is None:
            return
        commands = state.typed.commands
        names = [name.removeprefix(prefix) for name in found if name.startswith(prefix)]
        for name, entry in entry_of(commands, lambda entry: chosen(entry, names))[0].items():
            said = (state.source, (*state.path, "commands", entry), commands[entry])
            found[prefix + name] = replace(found[prefix + name], started=said)

    def take(prefix: str, files: Sequence[Source]) -> None:
        for file in reversed(files):
            model = file.file.model if file.file is not None else None
            for name, typed in (model.actuators if model is not None else {}).items():
                found[prefix + name] = WrittenActuator(prefix, file, ("model", "actuators", name), typed)

    if source.file is not None:
        for name, typed in source.file.actuators.items():
            found[name] = WrittenActuator("", source, ("actuators", name), typed)
    if (local := model_of(source)) is not None:
        take("", local.files)
        begin("", local)
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        for suffix, _ in elements(use.array):
            take(f"{placement}{suffix}/", bodies.files)
            for name, typed in use.actuators.items():
                path = ("models", placement, "actuators", name)
                found[f"{placement}{suffix}/{name}"] = WrittenActuator(f"{placement}{suffix}/", source, path, typed)
            begin(f"{placement}{suffix}/", bodies)
    return found


class ActuatorsDraft:
    """A controller of actuators while it is resolved; ``taken``: joints that other controllers drive, with their names."""

    def __init__(
        self,
        source: Source,
        path: tuple[Key, ...],
        written: SpecController,
        bodies: Sequence[Body],
        taken: Mapping[str, str],
        followers: Mapping[str, str],
    ):
        self.problems: list[Problem] = []
        self._source, self._path, self._written = source, path, written
        self._joints_of = {body.joint.name: body.joint for body in bodies}
        known = written_actuators(source)
        names = self._names(known)
        commands = self._commands(names)
        at: dict[str, AtJoint] = {}
        by: dict[str, str] = {}
        for name in names:
            joint = self._joint(known[name], taken, followers, by, name)
            if joint is None:
                continue
            by[joint.name] = name
            law = self._law(known[name], joint, commands.get(name))
            if law is not None:
                at[joint.name] = law
        self.joints = tuple(name for name in self._joints_of if name in at)
        self._at = at

    def controller(self, name: str) -> JointController:
        """The world's controller."""
        rows = [self._at[joint] for joint in self.joints]
        every = self._written.every
        steps = 1 if every is None else whole_steps(every, self._source.content.physics.timestep) or 1
        return JointController(
            name=name,
            joints=self.joints,
            discretisation=self._written.discretisation,
            kp=tuple(row.kp for row in rows),
            kd=tuple(row.kd for row in rows),
            effort_limits=tuple(row.limit for row in rows),
            every_steps=steps if steps > 1 else 0,
        )

    def aims(self) -> dict[str, tuple[float, float]]:
        """The constant target (rad, m) and feed-forward effort (N m, N) of each joint."""
        aims = {}
        for joint in self.joints:
            row = self._at[joint]
            start = self._joints_of[joint].position[0]
            aims[joint] = (start if row.target is None else row.target, row.feed)
        return aims

    # --- names ---

    def _names(self, known: Mapping[str, WrittenActuator]) -> list[str]:
        names: dict[str, None] = {}
        for index, entry in enumerate(self._written.actuators or ()):
            meant = chosen(entry, known)
            if not meant:
                allowed = ", ".join(list(known)[:8]) or "there are no actuators"
                self._problem(
                    ("actuators", index),
                    f"there is no actuator {entry!r}",
                    found=entry,
                    allowed=allowed,
                    hint=near(entry, known),
                    code="S302",
                )
            names.update(dict.fromkeys(meant))
        return list(names)

    def _commands(self, names: Sequence[str]) -> dict[str, tuple[tuple[Key, ...], Any]]:
        written = self._written.commands
        for entry in written:
            if not chosen(entry, names):
                message = f"{entry!r} is not an actuator of this controller"
                allowed = ", ".join(names[:8]) or None
                self._problem(
                    ("commands", entry), message, key=True, allowed=allowed, hint=near(entry, names), code="S302"
                )
        said, clashes = entry_of(written, lambda entry: chosen(entry, names))
        for clash in clashes:
            self._problem(("commands", clash.other), clash_words(clash), key=True, hint=CLASH_HINT, code="S304")
        return {name: (("commands", entry), written[entry]) for name, entry in said.items()}

    def _joint(
        self,
        written: WrittenActuator,
        taken: Mapping[str, str],
        followers: Mapping[str, str],
        by: Mapping[str, str],
        name: str,
    ) -> Joint | None:
        full = written.prefix + written.typed.joint
        joint = self._joints_of.get(full)
        message, hint = "", None
        if joint is None:
            message, hint = f"there is no joint {full!r}", near(full, self._joints_of)
        elif joint.kind not in SCALAR_JOINTS:
            message = f"{full} is {article(joint.kind)} joint; actuators act on hinges and slides"
        elif full in followers:
            message, hint = f"{full} follows {followers[full]}, and has no actuator", f"drive {followers[full]}"
        elif other := by.get(full) or taken.get(full):
            message = f"{full} is driven already, by {other}"
            hint = "a joint has at most one controller: name the actuators that act"
        if message:
            place = (*written.path, "joint")
            self.problems.append(
                written.file.document.problem(
                    place, message, found=f"{name} of control.{self._path[-1]}", hint=hint, code="S702"
                )
            )
            return None
        return joint

    # --- numbers ---

    def _law(self, written: WrittenActuator, joint: Joint, said: tuple[tuple[Key, ...], Any] | None) -> AtJoint | None:
        typed, kind = written.typed, joint.kind

        def local(key: str) -> float | None:
            value = getattr(typed, key)
            return None if value is None else self._read(OF_JOINT[key].number(kind), value, written, (key,))

        kp, kd, limit = local("kp") or 0.0, local("kd") or 0.0, local("effort_limit")
        number = COMMAND.number(kind, COMMANDS[typed.law])
        command = self._command(written, number, said)
        if command is None or self.problems:
            return None
        bias = typed.bias or (0.0, 0.0, 0.0)
        gain = {"position": kp, "velocity": kd, "effort": 1.0}.get(typed.law, 1.0 if typed.gain is None else typed.gain)
        if typed.law == "affine":
            kp, kd = 0.0 - bias[1], 0.0 - bias[2]
        gear = typed.gear
        target: float | None = None
        feed = gear * (gain * command + bias[0])
        if typed.law == "position":
            target, feed = command / gear, 0.0
        elif kp:
            target = 0.0
        at_joint = None if limit is None else limit * abs(gear)
        limits = [value for value in (at_joint, joint.effort_limit) if value is not None]
        law = AtJoint(kp * gear**2, kd * gear**2, min(limits, default=None), target, feed)
        if any(abs(value) > LARGEST for value in law if value is not None):
            self.problems.append(
                written.file.document.problem(written.path, "its effort is too large a number", key=True, code="S202")
            )
            return None
        return law

    def _command(
        self, written: WrittenActuator, number: Number, said: tuple[tuple[Key, ...], Any] | None
    ) -> float | None:
        """The command that is in force, within its limits."""
        place: tuple[Key, ...] = (*written.path, "command")
        document, value = written.file.document, written.typed.command
        if said is not None:
            place, document, value = (*self._path, *said[0]), self._source.document, said[1]
        elif written.started is not None:
            file, place, value = written.started
            document = file.document
        try:
            command = number.read(value)
        except Faults as error:
            for wrong in error.faults:
                self.problems.append(
                    document.problem(
                        place, wrong.message, found=wrong.found, allowed=wrong.allowed, hint=wrong.hint, code=wrong.code
                    )
                )
            return None
        if written.typed.command_limits is not None:
            ends = [
                self._read(number, value, written, ("command_limits", index))
                for index, value in enumerate(written.typed.command_limits)
            ]
            low, high = (end if end is not None else command for end in ends)
            if not low <= command <= high:
                self.problems.append(
                    document.problem(
                        place,
                        "the command is outside its limits",
                        found=f"{command:g}",
                        allowed=f"{low:g} to {high:g}",
                        code="S701",
                    )
                )
                return None
        return command

    def _read(self, number: Number, value: Any, written: WrittenActuator, below: tuple[Key, ...]) -> float | None:
        try:
            return float(number.read(value))
        except Faults as error:
            place = (*written.path, *below)
            self.problems += [
                written.file.document.problem(
                    place, wrong.message, found=wrong.found, allowed=wrong.allowed, hint=wrong.hint, code=wrong.code
                )
                for wrong in error.faults
            ]
        return None

    def _problem(self, below: tuple[Key, ...], message: str, **more: Unpack[Details]) -> None:
        self.problems.append(self._source.document.problem((*self._path, *below), message, **more))


def commanded(
    source: Source, path: JointTrajectory | None, aims: Mapping[str, tuple[float, float]], bodies: Sequence[Body]
) -> tuple[JointTrajectory | None, list[Problem]]:
    """The trajectory of a spec, completed by the constant targets and efforts of joints that actuators act on: columns that
    stay what they are at all times. An error where it moves such a joint itself."""
    problems = [
        source.document.problem(
            ("trajectory",),
            f"{joint} moves here, and an actuator with a constant command acts on it",
            key=True,
            found=joint,
            hint="leave it out of the trajectory, or its actuator out of control",
            code="S714",
        )
        for joint in (path.joints if path is not None else ())
        if joint in aims
    ]
    if not aims or problems:
        return path, problems
    moved = {} if path is None else {joint: column for column, joint in enumerate(path.joints)}
    path = path or JointTrajectory((), (0.0,), ((),), interpolation="hold")
    joints = tuple(body.joint.name for body in bodies if body.joint.name in moved or body.joint.name in aims)

    def completed(rows: tuple[tuple[float, ...], ...], actual: Mapping[str, float]) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(actual[joint] if joint in actual else row[moved[joint]] for joint in joints) for row in rows)

    targets, feeds = ({joint: aim[index] for joint, aim in aims.items()} for index in (0, 1))
    efforts = path.efforts
    if any(feeds.values()) and not efforts:
        efforts = ((0.0,) * len(moved),) * len(path.times)
    unmoved = dict.fromkeys(aims, 0.0)
    return (
        JointTrajectory(
            joints=joints,
            times=path.times,
            positions=completed(path.positions, targets),
            velocities=completed(path.velocities, unmoved),
            accelerations=completed(path.accelerations, unmoved),
            efforts=completed(efforts, feeds),
            interpolation=path.interpolation,
        ),
        [],
    )


# Grasps of the placed models: postures by the joints' full names, and the efforts that press.


@dataclass(frozen=True)
class ResolvedGrasp:
    """One grasp of one placed model: ``joints`` (full names), their positions ``open`` and ``closed``, and forces as (body's
    full name, point, force), both in the body's frame."""

    name: str
    joints: tuple[str, ...]
    open: np.ndarray
    closed: np.ndarray
    forces: tuple[tuple[str, np.ndarray, np.ndarray], ...]

    def efforts(self, world: World, q: np.ndarray, bodies: tuple[Body, ...]) -> np.ndarray:
        """Σ Jᵀ F (joints,) at positions ``q`` of the tree ``bodies``; forces move the grasp's joints alone."""
        from simspec.dynamics.tool import Tool, joints_to

        total = np.zeros(len(self.joints))
        for body, point, force in self.forces:
            on_the_way = {above.joint.name for above in joints_to(bodies, body)}
            rows = [row for row, name in enumerate(self.joints) if name in on_the_way]
            if rows:
                tool = Tool(world, body, Pose(), [self.joints[row] for row in rows])
                total[rows] += tool.efforts(q, point, force)
        return total


def grasps(source: Source, world: World) -> tuple[dict[str, ResolvedGrasp], list[Problem]]:
    """Every grasp of every placed model by MODEL/NAME, those of a model file compiled alone by NAME, and what is wrong with
    them."""
    resolved: dict[str, ResolvedGrasp] = {}
    problems: list[Problem] = []
    bodies = {body.name: body for body in world.bodies}
    joints = {body.joint.name: body for body in world.bodies}
    places = places_of(world.bodies, world.frames)
    taken: set[str] = set()
    refused: set[tuple[int, tuple[Key, ...]]] = set()
    for prefix, file, path, name, written in _written(source):
        if (id(file), path) in refused:
            continue  # another copy of the same
        grasp, wrong = _grasp(prefix, prefix + name, written, joints, bodies, places)
        if prefix + name in taken:
            wrong.append(
                ((), f"the model has a grasp {name!r} already", {"code": "S303", "key": True, "hint": "another name"})
            )
        taken.add(prefix + name)
        if wrong:
            refused.add((id(file), path))
        problems += [file.document.problem((*path, *at), message, **more) for at, message, more in wrong]
        if grasp is not None:
            resolved[grasp.name] = grasp
    return resolved, problems


def _written(source: Source) -> Iterator[tuple[str, Source, tuple[Key, ...], str, Grasp]]:
    """(prefix of names, file, path, grasp's name, grasp) of every grasp of every model, in every copy of it."""
    if (model := model_of(source)) is not None:
        for file, path, name, grasp in _of_files(model.files):
            yield "", file, path, name, grasp
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        here = [(source, ("models", placement, "grasps", name), name, grasp) for name, grasp in use.grasps.items()]
        for suffix, _ in elements(use.array):
            for file, path, name, grasp in (*_of_files(bodies.files), *here):
                yield f"{placement}{suffix}/", file, path, name, grasp


def _of_files(files: Sequence[Source]) -> Iterator[tuple[Source, tuple[Key, ...], str, Grasp]]:
    """The grasps of the model files that lead to a model; the one with its bodies comes first."""
    for file in reversed(files):
        model = file.file.model if file.file is not None else None
        for name, grasp in (model.grasps if model is not None else {}).items():
            yield file, ("model", "grasps", name), name, grasp


def _grasp(
    prefix: str,
    name: str,
    written: Grasp,
    joints: Mapping[str, Body],
    bodies: Mapping[str, Body],
    places: Places,
) -> tuple[ResolvedGrasp | None, list[tuple[tuple[Key, ...], str, Details]]]:
    wrong: list[tuple[tuple[Key, ...], str, Details]] = []
    postures: dict[str, list[float]] = {"open": [], "closed": []}
    for posture, values in postures.items():
        for joint in written.open:
            body = joints.get(prefix + joint)
            place = (posture, joint)
            if body is None or body.joint.kind not in SCALAR_JOINTS:
                kind = "not a hinge or slide" if body is not None else "no joint of the model"
                movable = [name for name, mover in joints.items() if mover.joint.kind in SCALAR_JOINTS]
                hint = near(joint, _within(prefix, movable))
                wrong.append(
                    (place, f"{joint!r} is {kind}", {"code": "S302", "found": joint, "hint": hint, "key": True})
                )
                continue
            try:
                value = BY_JOINT["positions"].number(body.joint.kind).read(getattr(written, posture)[joint])
            except Faults as error:
                wrong += [
                    (place, item.message, {"code": item.code, "found": item.found, "allowed": item.allowed})
                    for item in error.faults
                ]
                continue
            values.append(value)
            limits = body.joint.position_limits
            if limits is not None and not limits[0] <= value <= limits[1]:
                allowed = f"{limits[0]:g} to {limits[1]:g}"
                wrong.append(
                    (
                        place,
                        f"outside the limits of {joint}",
                        {"code": "S713", "found": f"{value:g}", "allowed": allowed},
                    )
                )
    forces = []
    for index, force in enumerate(written.forces):
        if prefix + force.body not in places:
            hint = near(force.body, _within(prefix, places))
            message = f"the model has no body {force.body!r}"
            wrong.append((("forces", index, "body"), message, {"code": "S302", "found": force.body, "hint": hint}))
            continue
        body_name, pose = places[prefix + force.body]
        if not any(above.joint.name.removeprefix(prefix) in written.open for above in _above(body_name, bodies)):
            message = f"no joint of the grasp moves {force.body}, so it cannot apply a force"
            wrong.append((("forces", index, "body"), message, {"code": "S713", "found": force.body}))
            continue
        point = frames.compose(pose, Pose(force.at)).position
        forces.append((body_name, np.array(point), np.array(frames.rotate(pose.quaternion, force.force))))
    if wrong:
        return None, wrong
    names = tuple(prefix + joint for joint in written.open)
    return ResolvedGrasp(name, names, np.array(postures["open"]), np.array(postures["closed"]), tuple(forces)), []


def _within(prefix: str, names: Iterable[str]) -> list[str]:
    """The names of a model, without its own."""
    return [name.removeprefix(prefix) for name in names if name.startswith(prefix)]


def _above(name: str, bodies: Mapping[str, Body]) -> Iterator[Body]:
    """A body, its parent, and so on to the root."""
    at: str | None = name
    while at is not None:
        yield bodies[at]
        at = bodies[at].joint.parent
