"""Constraints of the world: names resolved, copies made, followers put where their leaders want them, and what is wrong."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Unpack

import numpy as np

from simspec.errors import Problem
from simspec.language.constraints import Connect as SpecConnect
from simspec.language.constraints import Constraint as SpecConstraint
from simspec.language.constraints import Displacement
from simspec.language.constraints import Follow as SpecFollow
from simspec.language.constraints import Sum as SpecSum
from simspec.language.constraints import Weld as SpecWeld
from simspec.language.document import Details, Key
from simspec.language.joints import nearest, within
from simspec.language.quantities import article
from simspec.language.sources import Source
from simspec.language.strict import Faults, near, required
from simspec.language.trees import model_of, placed
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.resolve.bodies import Expansion, places_of
from simspec.resolve.shapes import elements, pose
from simspec.world import frames
from simspec.world.actions import JointSum
from simspec.world.constraints import ROWS, Violation
from simspec.world.kinematics import initial_state, poses, rigid_groups
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Constraint,
    FollowConstraint,
    Frame,
    Pose,
    WeldConstraint,
    World,
)

AGREE = 1e-9
"""How far an initial position or velocity of a follower that is stated may be from its leader's, relative to the larger of it
and 1 (rad, m, and per second): round-off of a spec's arithmetic. The first step removes the deviation, at φ/dt."""
MEET = 1e-6
"""The same for the two points of a connect and the two frames of a weld (m, rad), whose places follow from positions that are
written with any number of digits: at 1 ms it is taken back at 1 mm/s."""
MOST_NAMED = 8


class Constrained(NamedTuple):
    """The result of `constraints`.

    constraints  sorted by name
    sums         those along which something acts, sorted by name
    bodies       the world's bodies, the initial positions and velocities of followers filled in
    joined       pairs of bodies that are held together, and do not touch
    problems     what is wrong; then the rest is what could be made of it
    """

    constraints: tuple[Constraint, ...]
    sums: tuple[JointSum, ...]
    bodies: tuple[Body, ...]
    joined: list[tuple[str, str]]
    problems: list[Problem]

    @property
    def followers(self) -> dict[str, str]:
        """The joints that follow, each with its leader."""
        return {
            constraint.joint: constraint.leader
            for constraint in self.constraints
            if isinstance(constraint, FollowConstraint)
        }


@dataclass(frozen=True)
class _WrittenConstraint:
    """A constraint of a spec, once for each copy: its full name, where it stands, and the full names of the joints and bodies
    that it names."""

    name: str
    file: Source
    path: tuple[Key, ...]
    content: SpecConstraint
    prefix: str = ""
    joints: Mapping[str, str] = field(default_factory=dict)
    bodies: Mapping[str, str] = field(default_factory=dict)

    def joint(self, name: str) -> str:
        return self.joints.get(name, self.prefix + name)

    def body(self, name: str) -> str:
        return self.bodies.get(name, self.prefix + name)


def constraints(source: Source, expansion: Expansion, named: Iterable[Frame] = ()) -> Constrained:
    """The constraints of a spec, and what they say of the bodies of ``expansion``. ``named``: the frames that may be named in
    place of a body."""
    draft = _ConstraintDraft(expansion, named)
    for written in _all(source, expansion):
        draft.add(written)
    if not draft.problems and not expansion.problems:
        draft.settle()
    if not draft.problems and not expansion.problems:
        draft.close()
    if not draft.problems and not expansion.problems:
        draft.check_sums()
    resolved = tuple(sorted(draft.resolved.values(), key=lambda constraint: constraint.name))
    joined = [(connect.first, connect.second) for connect in resolved if not isinstance(connect, FollowConstraint)]
    sums = tuple(sorted(draft.sums.values(), key=lambda joint_sum: joint_sum.name))
    return Constrained(resolved, sums, tuple(draft.bodies.values()), joined, draft.problems)


# --- which there are -------------------------------------------------------------------------------------------------


def _all(source: Source, expansion: Expansion) -> Iterator[_WrittenConstraint]:
    """Every constraint of every model and of the scenario, in every copy of it."""
    if (model := model_of(source)) is not None:
        for file, path, name, content in _of_files(model.files):
            yield _WrittenConstraint(name, file, path, content)
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        place: tuple[Key, ...] = ("models", placement, "constraints")
        here = [(source, (*place, name), name, content) for name, content in use.constraints.items()]
        for suffix, _ in elements(use.array):
            prefix = f"{placement}{suffix}/"
            for file, path, name, content in (*_of_files(bodies.files), *here):
                yield _WrittenConstraint(prefix + name, file, path, content, prefix)
    for name, content in source.content.constraints.items():
        yield from _of_scenario(source, name, content, expansion)


def _of_files(files: Sequence[Source]) -> Iterator[tuple[Source, tuple[Key, ...], str, SpecConstraint]]:
    """The constraints of the model files that lead to a model; the one with its bodies comes first."""
    for file in reversed(files):
        model = file.file.model if file.file is not None else None
        for name, content in (model.constraints if model is not None else {}).items():
            yield file, ("model", "constraints", name), name, content


def _of_scenario(
    source: Source, name: str, content: SpecConstraint, expansion: Expansion
) -> Iterator[_WrittenConstraint]:
    """A constraint of the scenario; one within a loose tree of an array once for each copy of the tree."""
    copied = False
    for suffix, joints, bodies in expansion.arrays:
        known = joints if content.follow is not None or content.sum is not None else bodies
        if all(named in known for named in _named(content)):
            copied = True
            yield _WrittenConstraint(name + suffix, source, ("constraints", name), content, "", joints, bodies)
    if not copied:
        yield _WrittenConstraint(name, source, ("constraints", name), content)


def _named(content: SpecConstraint) -> tuple[str, ...]:
    """The joints or bodies that a constraint names."""
    if content.follow is not None:
        return content.follow.joint, content.follow.leader
    if content.sum is not None:
        return tuple(content.sum.joints)
    return content.connect.bodies if content.connect is not None else required(content.weld).bodies


# --- what they are ---------------------------------------------------------------------------------------------------


class _ConstraintDraft:
    """Constraints while they are resolved: ``resolved`` and where each was ``written``, by name."""

    def __init__(self, expansion: Expansion, named: Iterable[Frame] = ()):
        self.places = places_of(expansion.bodies, named)
        self.bodies = {body.name: body for body in expansion.bodies}
        self.owner = {body.joint.name: body.name for body in expansion.bodies}
        self.resolved: dict[str, Constraint] = {}
        self.sums: dict[str, JointSum] = {}
        self.written: dict[str, _WrittenConstraint] = {}
        self.problems: list[Problem] = []
        self.follows: dict[str, FollowConstraint] = {}
        """By the joint that follows."""
        self._expansion = expansion
        self._groups = rigid_groups(World("", expansion.bodies)) if not expansion.problems else {}
        self._refused: set[tuple[int, tuple[Key, ...]]] = set()

    def problem(
        self, written: _WrittenConstraint, below: tuple[Key, ...], message: str, **more: Unpack[Details]
    ) -> None:
        """Note what is wrong, once for all copies of a constraint."""
        key = (id(written.file), written.path)
        if key in self._refused:
            return
        self._refused.add(key)
        self.problems.append(written.file.document.problem((*written.path, *below), message, **more))

    def add(self, written: _WrittenConstraint) -> None:
        """Resolve the names of one."""
        content = written.content
        if written.name in self.written:
            self.problem(
                written,
                (),
                f"there is a constraint {written.name!r} already",
                key=True,
                hint="another name",
                code="S303",
            )
            return
        self.written[written.name] = written
        if content.follow is not None:
            self._follow(written, content.follow)
        elif content.connect is not None:
            self._loop(written, "connect", content.connect)
        elif content.sum is not None:
            self._sum(written, content.sum)
        else:
            self._loop(written, "weld", required(content.weld))

    def _follow(self, written: _WrittenConstraint, content: SpecFollow) -> None:
        names = {"joint": written.joint(content.joint), "leader": written.joint(content.leader)}
        if not all(self._is_scalar(written, ("follow", key), name) for key, name in names.items()):
            return
        joint, leader = names["joint"], names["leader"]
        if joint in self.follows:
            other = self.follows[joint]
            message = f"{joint} follows {other.leader} already, by the constraint {other.name!r}"
            self.problem(
                written,
                ("follow", "joint"),
                message,
                found=joint,
                hint="a joint follows one other at most",
                code="S504",
            )
            return
        offset = 0.0
        if content.offset is not None:
            try:
                offset = Displacement().number(self.bodies[self.owner[joint]].joint.kind).read(content.offset)
            except Faults as error:
                wrong = error.faults[0]
                more: Details = {
                    "found": wrong.found,
                    "allowed": wrong.allowed,
                    "hint": wrong.hint,
                    "code": wrong.code,
                }
                self.problem(written, ("follow", "offset"), wrong.message, **more)
                return
        self.follows[joint] = FollowConstraint(written.name, joint, leader, content.ratio, offset)
        self.resolved[written.name] = self.follows[joint]

    def _is_scalar(self, written: _WrittenConstraint, place: tuple[Key, ...], name: str) -> bool:
        """Whether there is a hinge or slide of this name; notes what is wrong, where there is none."""
        if name not in self.owner:
            known = [joint for joint, body in self.owner.items() if self.bodies[body].joint.kind in SCALAR_JOINTS]
            self.problem(written, place, f"there is no joint {name!r}", found=name, hint=near(name, known), code="S302")
            return False
        kind = self.bodies[self.owner[name]].joint.kind
        if kind not in SCALAR_JOINTS:
            self.problem(
                written, place, f"{name} is {article(kind)} joint", found=name, allowed="hinges and slides", code="S504"
            )
            return False
        return True

    def _sum(self, written: _WrittenConstraint, content: SpecSum) -> None:
        joints = {written.joint(name): coefficient for name, coefficient in content.joints.items()}
        for name in content.joints:
            if not self._is_scalar(written, ("sum", "joints", name), written.joint(name)):
                return
        limits = None if content.limits is None else content.limits.position
        ordered = tuple(sorted(joints.items()))
        numbers = content.stiffness, content.rest, content.damping
        self.sums[written.name] = JointSum(written.name, ordered, *numbers, limits, content.dry_friction)

    def _loop(self, written: _WrittenConstraint, kind: str, content: SpecConnect | SpecWeld) -> None:
        ends = [written.body(name) for name in content.bodies]
        for index, name in enumerate(ends):
            if name not in self.places:
                hint = near(name, self.places)
                self.problem(
                    written, (kind, "bodies", index), f"there is no body {name!r}", found=name, hint=hint, code="S302"
                )
                return
        (first, near_end), (second, far_end) = (self.places[name] for name in ends)
        if self._groups and self._groups[first] == self._groups[second]:
            message = f"{first} and {second} are joined rigidly already"
            self.problem(written, (kind, "bodies"), message, hint="remove the constraint", code="S502")
            return
        # values that are not given follow from the initial positions, in ``close``
        if isinstance(content, SpecConnect):
            at = frames.compose(near_end, Pose(content.at)).position
            second_at = (math.nan,) * 3
            if content.second_at is not None:
                second_at = frames.compose(far_end, Pose(content.second_at)).position
            self.resolved[written.name] = ConnectConstraint(written.name, first, second, at, second_at)
        else:
            place = Pose((math.nan,) * 3)
            if content.pose is not None:
                place = frames.compose(frames.compose(near_end, pose(content.pose)), frames.inverse(far_end))
            self.resolved[written.name] = WeldConstraint(written.name, first, second, place)

    # --- initial state ------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """Put followers where their leaders want them, each after its leader; stated positions must agree."""
        done: set[str] = set()
        for start in self.follows:
            chain: list[str] = []
            joint = start
            while joint in self.follows and joint not in done and joint not in chain:
                chain.append(joint)
                joint = self.follows[joint].leader
            if joint in chain:
                circle = [*chain[chain.index(joint) :], joint]
                shown = " -> ".join(circle[:MOST_NAMED]) + (" -> ..." if len(circle) > MOST_NAMED else "")
                message = f"these joints follow each other: {shown}"
                hint = "one of them must follow none"
                self.problem(
                    self.written[self.follows[joint].name], ("follow", "leader"), message, hint=hint, code="S504"
                )
                return
            for follower in reversed(chain):
                self._settle(self.follows[follower])
                done.add(follower)

    def _settle(self, follow: FollowConstraint) -> None:
        written = self.written[follow.name]
        body, lead = (self.bodies[self.owner[name]] for name in (follow.joint, follow.leader))
        wanted = {
            "position": follow.ratio * lead.joint.position[0] + follow.offset,
            "velocity": follow.ratio * lead.joint.velocity[0],
        }
        for key, value in wanted.items():
            is_stated = follow.joint in (self._expansion.positions if key == "position" else self._expansion.velocities)
            local = getattr(body.joint, key)[0]
            if not is_stated:
                continue
            if abs(local - value) > AGREE * max(1.0, abs(value)):
                self.problem(
                    written,
                    ("follow",),
                    f"the initial {key} of {follow.joint} is not where {follow.leader} wants it",
                    found=f"{local:.9g}",
                    allowed=f"{value:.9g}",
                    hint=f"leave out the {key} of {follow.joint}: it follows from {follow.leader}'s",
                    code="S503",
                )
                return
            wanted[key] = local
        if (limits := body.joint.position_limits) is not None:
            position = within(wanted["position"], limits)
            if position is None:
                self._beyond(written, follow, wanted["position"], limits)
                return
            wanted["position"] = position
        joint = dataclasses.replace(body.joint, position=(wanted["position"],), velocity=(wanted["velocity"],))
        self.bodies[body.name] = dataclasses.replace(body, joint=joint)

    def _beyond(
        self, written: _WrittenConstraint, follow: FollowConstraint, position: float, limits: tuple[float, float]
    ) -> None:
        """Note that a follower would begin beyond its limits, with the position of its leader that is nearest to the present
        one and keeps both within theirs, where there is one."""
        leader = self.bodies[self.owner[follow.leader]].joint
        wanted = (nearest(position, limits) - follow.offset) / follow.ratio
        hint = f"another initial position of {follow.leader}, or another ratio or offset"
        if leader.position_limits is None or within(wanted, leader.position_limits) is not None:
            hint = f"{follow.leader} at {wanted:.9g}, the nearest allowed value; or another ratio or offset"
        self.problem(
            written,
            ("follow",),
            f"{follow.leader} wants {follow.joint} to begin beyond its limits",
            found=f"{position:.9g}",
            allowed=f"{limits[0]:g} to {limits[1]:g}",
            hint=hint,
            code="S503",
        )

    def check_sums(self) -> None:
        """Sums begin within their limits."""
        start = {body.joint.name: body.joint.position for body in self.bodies.values()}
        for joint_sum in self.sums.values():
            if joint_sum.position_limits is None:
                continue
            begins = sum(coefficient * start[joint][0] for joint, coefficient in joint_sum.joints)
            lower, upper = joint_sum.position_limits
            room = AGREE * max(1.0, abs(lower), abs(upper))
            if not lower - room <= begins <= upper + room:
                self.problem(
                    self.written[joint_sum.name],
                    ("sum", "limits", "position"),
                    "the sum begins beyond its limits",
                    found=f"{begins:.9g}",
                    allowed=f"{lower:g} to {upper:g}",
                    hint="other initial positions of the joints, or other limits",
                    code="S503",
                )

    def close(self) -> None:
        """Fill in points and poses that follow from the initial positions; stated values must agree with them."""
        actual = [constraint for constraint in self.resolved.values() if not isinstance(constraint, FollowConstraint)]
        if not actual:
            return
        place = poses(World("", tuple(self.bodies.values())))
        for constraint in actual:
            between = frames.compose(frames.inverse(place[constraint.second]), place[constraint.first])
            if isinstance(constraint, ConnectConstraint):
                self._close_point(constraint, between)
            else:
                self._close_frame(constraint, frames.inverse(between))
        if not self.problems:
            self._check_speeds(place)

    def _check_speeds(self, place: Mapping[str, Pose]) -> None:
        """Bodies that are held together begin with velocities that keep them so."""
        bodies = tuple(self.bodies.values())
        actual = [constraint for constraint in self.resolved.values() if not isinstance(constraint, FollowConstraint)]
        violation = Violation(bodies, actual)
        rows = np.array([[*place[body.name].position, *place[body.name].quaternion] for body in bodies])
        rates = violation.jacobian(rows) @ initial_state(World("", bodies))[1]
        start = 0
        for constraint in actual:
            local = rates[start : start + ROWS[constraint.kind]]
            start += ROWS[constraint.kind]
            if (fastest := float(np.abs(local).max())) > MEET:
                self.problem(
                    self.written[constraint.name],
                    (constraint.kind,),
                    f"the initial velocities of {constraint.first} and {constraint.second} would part them",
                    found=f"{fastest:.3g} m/s or rad/s",
                    hint="initial velocities that fit each other, or none",
                    code="S503",
                )

    def _close_point(self, constraint: ConnectConstraint, first_in_second: Pose) -> None:
        meets = frames.compose(first_in_second, Pose(constraint.first_point)).position
        if math.isnan(constraint.second_point[0]):
            self.resolved[constraint.name] = dataclasses.replace(constraint, second_point=meets)
        elif (away := math.dist(meets, constraint.second_point)) > MEET:
            shown = ", ".join(f"{value:.9g}" for value in meets)
            self.problem(
                self.written[constraint.name],
                ("connect", "second_at"),
                f"the points of {constraint.first} and {constraint.second} do not meet initially",
                found=f"a distance of {away:.3g} m",
                allowed=f"second_at: [{shown}]",
                hint="leave out second_at: it follows from the initial positions; or change those",
                code="S503",
            )

    def _close_frame(self, constraint: WeldConstraint, second_in_first: Pose) -> None:
        if math.isnan(constraint.pose.position[0]):
            self.resolved[constraint.name] = dataclasses.replace(constraint, pose=second_in_first)
            return
        away = math.dist(second_in_first.position, constraint.pose.position)
        turn = frames.multiply(frames.conjugate(constraint.pose.quaternion), second_in_first.quaternion)
        angle = 2.0 * math.sqrt(sum(value * value for value in turn[1:]))
        if max(away, angle) > MEET:
            self.problem(
                self.written[constraint.name],
                ("weld", "pose"),
                f"{constraint.second} is not initially where {constraint.first} holds it",
                found=f"{away:.3g} m and {angle:.3g} rad away",
                hint="leave out pose: it follows from the initial positions; or change those",
                code="S503",
            )
