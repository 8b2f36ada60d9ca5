"""Grasps of the placed models: postures by the joints' full names, and the efforts that press."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.errors import Problem
from simspec.language.document import Details, Key
from simspec.language.sources import Source
from simspec.language.strict import Faults, near
from simspec.language.trajectory import BY_JOINT
from simspec.language.trajectory import Grasp as SpecGrasp
from simspec.language.trees import model_of, placed
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.resolve.named_frames import Places, places_of
from simspec.resolve.poses import elements
from simspec.world import frames
from simspec.world.types import Body, Pose, World


@dataclass(frozen=True)
class Grasp:
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


def grasps(source: Source, world: World) -> tuple[dict[str, Grasp], list[Problem]]:
    """Every grasp of every placed model by MODEL/NAME, those of a model file compiled alone by NAME, and what is wrong with
    them."""
    resolved: dict[str, Grasp] = {}
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
            wrong.append(((), f"the model has a grasp {name!r} already", {"key": True, "hint": "another name"}))
        taken.add(prefix + name)
        if wrong:
            refused.add((id(file), path))
        problems += [file.document.problem((*path, *at), message, **more) for at, message, more in wrong]
        if grasp is not None:
            resolved[grasp.name] = grasp
    return resolved, problems


def _written(source: Source) -> Iterator[tuple[str, Source, tuple[Key, ...], str, SpecGrasp]]:
    """(prefix of names, file, path, grasp's name, grasp) of every grasp of every model, in every copy of it."""
    if (own := model_of(source)) is not None:
        for file, path, name, grasp in _of_files(own.files):
            yield "", file, path, name, grasp
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        here = [(source, ("models", placement, "grasps", name), name, grasp) for name, grasp in use.grasps.items()]
        for suffix, _ in elements(use.array):
            for file, path, name, grasp in (*_of_files(bodies.files), *here):
                yield f"{placement}{suffix}/", file, path, name, grasp


def _of_files(files: Sequence[Source]) -> Iterator[tuple[Source, tuple[Key, ...], str, SpecGrasp]]:
    """The grasps of the model files that lead to a model; what holds its bodies comes first."""
    for file in reversed(files):
        model = file.file.model if file.file is not None else None
        for name, grasp in (model.grasps if model is not None else {}).items():
            yield file, ("model", "grasps", name), name, grasp


def _grasp(
    prefix: str,
    name: str,
    written: SpecGrasp,
    joints: Mapping[str, Body],
    bodies: Mapping[str, Body],
    places: Places,
) -> tuple[Grasp | None, list[tuple[tuple[Key, ...], str, Details]]]:
    wrong: list[tuple[tuple[Key, ...], str, Details]] = []
    postures: dict[str, list[float]] = {"open": [], "closed": []}
    for posture, values in postures.items():
        for joint in written.open:
            body = joints.get(prefix + joint)
            place = (posture, joint)
            if body is None or body.joint.kind not in SCALAR_JOINTS:
                kind = "not a hinge or slide" if body is not None else "no joint of the model"
                movable = [own for own, mover in joints.items() if mover.joint.kind in SCALAR_JOINTS]
                hint = near(joint, _within(prefix, movable))
                wrong.append((place, f"{joint!r} is {kind}", {"found": joint, "hint": hint, "key": True}))
                continue
            try:
                value = BY_JOINT["positions"].number(body.joint.kind).read(getattr(written, posture)[joint])
            except Faults as error:
                wrong += [
                    (place, item.message, {"found": item.found, "allowed": item.allowed}) for item in error.faults
                ]
                continue
            values.append(value)
            limits = body.joint.position_limits
            if limits is not None and not limits[0] <= value <= limits[1]:
                allowed = f"{limits[0]:g} to {limits[1]:g}"
                wrong.append((place, f"outside the limits of {joint}", {"found": f"{value:g}", "allowed": allowed}))
    forces = []
    for index, force in enumerate(written.forces):
        if prefix + force.body not in places:
            hint = near(force.body, _within(prefix, places))
            message = f"the model has no body {force.body!r}"
            wrong.append((("forces", index, "body"), message, {"found": force.body, "hint": hint}))
            continue
        body_name, held = places[prefix + force.body]
        if not any(above.joint.name.removeprefix(prefix) in written.open for above in _above(body_name, bodies)):
            message = f"no joint of the grasp moves {force.body}, so it cannot apply a force"
            wrong.append((("forces", index, "body"), message, {"found": force.body}))
            continue
        point = frames.compose(held, Pose(force.at)).position
        forces.append((body_name, np.array(point), np.array(frames.rotate(held.quaternion, force.force))))
    if wrong:
        return None, wrong
    names = tuple(prefix + joint for joint in written.open)
    return Grasp(name, names, np.array(postures["open"]), np.array(postures["closed"]), tuple(forces)), []


def _within(prefix: str, names: Iterable[str]) -> list[str]:
    """The names of a model, without its own."""
    return [name.removeprefix(prefix) for name in names if name.startswith(prefix)]


def _above(name: str, bodies: Mapping[str, Body]) -> Iterator[Body]:
    """A body, its parent, and so on to the root."""
    at: str | None = name
    while at is not None:
        yield bodies[at]
        at = bodies[at].joint.parent
