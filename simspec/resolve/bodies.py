"""Bodies of the world: each tree of the spec is resolved once, and copied to where the spec puts it."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from simspec.errors import Problem
from simspec.language import trees
from simspec.language.arrays import Frame as SpecFrame
from simspec.language.arrays import State, initial_entries
from simspec.language.document import Key
from simspec.language.joints import read_position, read_velocity
from simspec.language.models import Use
from simspec.language.sources import Source
from simspec.language.strict import near, required
from simspec.language.trees import model_of, placed
from simspec.resolve.body_trees import BodyTree, resolved_trees
from simspec.resolve.shapes import (
    ShapeFiles,
    elements,
    orientation,
    pose,
    read_grids,
    read_meshes,
    too_many,
    too_many_heights,
)
from simspec.world import frames
from simspec.world.kinematics import owner_of
from simspec.world.types import Body, Frame, Joint, Pose, Vector3


@dataclass(frozen=True)
class WrittenFrame:
    """A frame of one copy of a model, or of the scenario: where it stands, what it says, and the prefix of the body's name."""

    file: Source
    path: tuple[Key, ...]
    content: SpecFrame
    prefix: str = ""

    @property
    def body(self) -> str:
        return self.prefix + self.content.body


Places = Mapping[str, tuple[str, Pose]]
"""Of bodies and frames by name: the body, and the place in its frame."""


def written_frames(source: Source) -> dict[str, WrittenFrame]:
    """The frames of a scenario and of every copy of every model, by their full names. The nearer file's replaces another's."""
    found: dict[str, WrittenFrame] = {}

    def take(prefix: str, files: Sequence[Source]) -> None:
        for file in reversed(files):
            model = file.file.model if file.file is not None else None
            for name, content in (model.frames if model is not None else {}).items():
                found[prefix + name] = WrittenFrame(file, ("model", "frames", name), content, prefix)

    if source.file is not None:
        for name, content in source.file.frames.items():
            found[name] = WrittenFrame(source, ("frames", name), content)
    if (model_bodies := model_of(source)) is not None:
        take("", model_bodies.files)
    for placement, use, bodies in placed(source):
        if use is None:
            continue  # has errors, which are reported elsewhere
        for suffix, _ in elements(use.array):
            prefix = f"{placement}{suffix}/"
            take(prefix, bodies.files)
            for name, content in use.frames.items():
                found[prefix + name] = WrittenFrame(source, ("models", placement, "frames", name), content, prefix)
    return found


def named_frames(
    source: Source, bodies: Iterable[Body], arrays: Iterable[tuple[str, dict[str, str], dict[str, str]]]
) -> tuple[tuple[Frame, ...], list[Problem]]:
    """The frames of a spec, sorted by name, and what is wrong with them. ``arrays``: of every copy of a loose tree in an array
    its suffix, and the full names of its joints and bodies by their names in the spec; frames on it are copied with it, and
    noted among these bodies, since constraints may name them in their place."""
    known = {body.name for body in bodies}
    copies = list(arrays)
    resolved: dict[str, Frame] = {}
    problems: list[Problem] = []
    refused: set[tuple[int, tuple[Key, ...]]] = set()
    for name, written in written_frames(source).items():
        place = (id(written.file), written.path)
        for full, body in _copied(name, written, copies):
            message = hint = None
            key = False
            if body not in known:
                names = [other.removeprefix(written.prefix) for other in known if other.startswith(written.prefix)]
                message, hint = f"there is no body {written.content.body!r}", near(written.content.body, names)
            elif full in known or full in resolved:
                message = f"there is a {'body' if full in known else 'frame'} {full!r} already"
                hint, key = "another name", True
            if message is None:
                resolved[full] = Frame(full, body, pose(written.content.pose))
            elif place not in refused:
                refused.add(place)
                below: tuple[Key, ...] = () if key else ("body",)
                found = full if key else written.content.body
                document = written.file.document
                problems.append(
                    document.problem((*written.path, *below), message, key=key, found=found, hint=hint, code="S408")
                )
    return tuple(resolved[name] for name in sorted(resolved)), problems


def _copied(
    name: str, written: WrittenFrame, arrays: Iterable[tuple[str, dict[str, str], dict[str, str]]]
) -> Iterator[tuple[str, str]]:
    """The full name of a frame and of its body, once for each copy of the body."""
    copied = False
    for suffix, _, bodies in arrays if not written.prefix else ():
        if (body := bodies.get(written.body)) is not None:
            copied = True
            bodies.setdefault(name, name + suffix)
            yield name + suffix, body
    if not copied:
        yield name, written.body


def places_of(bodies: Iterable[Body], named: Iterable[Frame]) -> dict[str, tuple[str, Pose]]:
    """The names that can stand for a point of a body: bodies, each with its own frame, and frames."""
    return {body.name: (body.name, Pose()) for body in bodies} | {
        frame.name: (frame.body, frame.pose) for frame in named
    }


DEFAULT_MATERIAL = "default"
"""The material of a model file that defines none, when the file is compiled alone: no friction, no restitution."""


@dataclass
class Expansion:
    """The bodies of the world, what was wrong, and the files of the shapes.

    excluded, touching     the pairs that model files exclude, and those that they let touch (full names)
    held                   the pairs that loops join
    positions, velocities  the full names of the joints whose initial position or velocity is stated, and not the default
    arrays                 of every copy of a loose tree in an array its suffix, and the full names of its joints and bodies by
                           their names in the spec
    """

    bodies: tuple[Body, ...] = ()
    excluded: list[tuple[str, str]] = field(default_factory=list)
    touching: list[tuple[str, str]] = field(default_factory=list)
    joined_pairs: list[tuple[str, str]] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    files: ShapeFiles = field(default_factory=ShapeFiles)
    positions: set[str] = field(default_factory=set)
    velocities: set[str] = field(default_factory=set)
    arrays: list[tuple[str, dict[str, str], dict[str, str]]] = field(default_factory=list)
    boxes: bool = False
    """Whether bodies get the boxes by which they feel a fluid."""
    kinematic: list[str] = field(default_factory=list)
    """Full names of the roots that move as `motion` says."""
    frames: Mapping[str, WrittenFrame] = field(default_factory=dict)
    """The named frames as they are written, by their full names."""

    def note(self, tree: BodyTree, copies: Sequence[Body], bodies: trees.Bodies) -> None:
        """Remember what is stated of a tree, that of ``bodies``, for one copy of it."""
        self.kinematic += [copies[0].name] if bodies.is_kinematic(owner_of(tree.bodies[0].name)) else []
        for body, copy in zip(tree.bodies, copies, strict=True):
            if body.joint.name in tree.positions:
                self.positions.add(copy.joint.name)
            if body.joint.name in tree.velocities:
                self.velocities.add(copy.joint.name)


@dataclass
class _Instance:
    """One copy of a tree, and the place in the spec that it comes from."""

    bodies: list[Body]
    source: Source
    path: tuple[Key, ...]


def expand(source: Source, boxes: bool = False) -> Expansion:
    """All bodies of a spec: loose trees, then models, in the order of the file, every parent before its children; ``boxes``:
    with those by which they feel a fluid. Raises SpecError where a file of a shape cannot be read."""
    expansion = Expansion(
        files=ShapeFiles(read_meshes(source), read_grids(source)), boxes=boxes, frames=written_frames(source)
    )
    only = _only_material(source)
    models = _carriers_first(list(_models(source, only, expansion)), expansion)
    instances = [*_loose(source, only, expansion), *models, *_single_model(source, only, expansion)]
    made = tuple(body for instance in instances for body in instance.bodies)
    expansion.problems += [*too_many(source, made), *too_many_heights(source, made)]
    if not expansion.problems:
        _check_names(instances, expansion)
    expansion.bodies = tuple(body for instance in instances for body in instance.bodies)
    return expansion


def _carriers_first(models: list[_Instance], expansion: Expansion) -> list[_Instance]:
    """Models in the order of the file, but each after the one that it is attached to; and what is wrong with that."""
    owner = {body.name: instance for instance in models for body in instance.bodies}
    ordered: list[_Instance] = []
    for start in models:
        chain: list[_Instance] = []
        link: _Instance | None = start
        while link is not None and not any(link is other for other in (*ordered, *chain)):
            chain.append(link)
            carrier = link.bodies[0].joint.parent
            if carrier is None:
                link = None
            elif carrier not in owner:
                hint = near(carrier, [*owner, *expansion.frames])
                place = (*link.path, "attach")
                message = f"no model has a body or a frame {carrier!r}"
                expansion.problems.append(
                    link.source.document.problem(place, message, found=carrier, hint=hint, code="S408")
                )
                _stand_alone(link)
                link = None
            else:
                link = owner[carrier]
        if link is not None and any(link is other for other in chain):
            message, hint = "these models are attached to each other", "one of them must not be attached"
            expansion.problems.append(
                start.source.document.problem((*start.path, "attach"), message, hint=hint, code="S408")
            )
            _stand_alone(chain[-1])
        ordered += reversed(chain)
    return ordered


def _stand_alone(instance: _Instance) -> None:
    """Let a model whose attachment is wrong stand on its own, so that what is looked at later finds whole trees."""
    root = instance.bodies[0]
    instance.bodies[0] = replace(root, joint=replace(root.joint, parent=None))


def _only_material(source: Source) -> str | None:
    names = {name for member in source.all() if member.file is not None for name in member.file.contact.materials}
    if not names and source.file is not None and source.file.model is not None:
        return DEFAULT_MATERIAL
    return next(iter(names)) if len(names) == 1 else None


def _copy(
    tree: BodyTree, prefix: str, suffix: str, model: str, place: Pose, velocity: tuple[Vector3, Vector3]
) -> list[Body]:
    """The tree with full names, its root at ``place``; velocities of a free root in world axes."""

    def full(name: str) -> str:
        body, point, joint = name.partition(".")
        return f"{prefix}{body}{suffix}{point}{joint}"

    copies = []
    for index, body in enumerate(tree.bodies):
        joint, name = body.joint, full(body.name)
        joint_name = full(joint.name) if joint.name in tree.given_names else _implied(joint.name, body.name, name)
        if index == 0:
            joint = _root_joint(joint, place, velocity)
        parent = None if joint.parent is None else full(joint.parent)
        joint = replace(joint, name=joint_name, parent=parent)
        shapes = tuple(
            replace(
                shape,
                name=full(shape.name) if shape.name in tree.given_names else _implied(shape.name, body.name, name),
            )
            for shape in body.shapes
        )
        copies.append(replace(body, name=name, model=model, joint=joint, shapes=shapes))
    return copies


def _implied(name: str, body: str, full: str) -> str:
    """The implied name of a joint or shape of ``body``, whose full name is ``full``: `<body>_joint`, `<body>_0`."""
    return f"{full}{name.removeprefix(body)}"


def _root_joint(joint: Joint, place: Pose, velocity: tuple[Vector3, Vector3]) -> Joint:
    if joint.kind != "free":
        return replace(joint, origin=place)
    position = (*place.position, *place.quaternion)
    return replace(joint, origin=Pose(), position=position, velocity=(*velocity[0], *velocity[1]))


def _loose(source: Source, only: str | None, expansion: Expansion) -> Iterator[_Instance]:
    bodies = trees.loose(source)
    if bodies is None:
        return
    for tree in resolved_trees(bodies, only, expansion.files, expansion.boxes):
        root = owner_of(tree.bodies[0].name)
        array, path = bodies.content(root).array, (*bodies.path, root)
        for suffix, element in elements(array):
            place = tree.placement if array is None else frames.compose(tree.placement, element)
            copied = _copy(tree, "", suffix, f"{root}{suffix}", place, tree.velocity)
            expansion.note(tree, copied, bodies)
            if array is not None:
                pairs = list(zip(tree.bodies, copied, strict=True))
                joints = {body.joint.name: copy.joint.name for body, copy in pairs}
                expansion.arrays.append((suffix, joints, {body.name: copy.name for body, copy in pairs}))
            yield _Instance(copied, source, path)


def _models(source: Source, only: str | None, expansion: Expansion) -> Iterator[_Instance]:
    for name, use, bodies in trees.placed(source):
        if use is None:
            raise ValueError(f"{name} has errors, so it is not resolved")
        tree = _positioned(
            _begun(next(resolved_trees(bodies, only, expansion.files, expansion.boxes)), source, bodies),
            use,
            trees.followers(source, bodies),
        )
        frame = pose(use.pose)
        for suffix, element in elements(use.array):
            model = f"{name}{suffix}"
            where = frames.compose(frame, element)
            if use.velocity is not None:
                velocity = (use.velocity.linear, use.velocity.angular)
            else:  # the root's own is in the model's axes, as its pose is: a model that is placed turned moves turned
                linear, angular = tree.velocity
                velocity = (frames.rotate(where.quaternion, linear), frames.rotate(where.quaternion, angular))
            place = frames.compose(where, tree.placement)
            copied = _copy(tree, f"{model}/", "", model, place, velocity)
            expansion.note(tree, copied, bodies)
            if use.attach is not None:
                copied[0] = replace(copied[0], joint=_attached(copied[0].joint, use.attach, expansion.frames))
            yield _Instance(copied, source, bodies.placed)
            _touching(bodies.files, bodies, copied, expansion, f"{model}/")


def _attached(joint: Joint, carrier: str, named: Mapping[str, WrittenFrame]) -> Joint:
    """The joint of a model's root that is fixed to a body of another, or to a frame on it."""
    if carrier not in named:
        return replace(joint, parent=carrier)
    frame = named[carrier]
    return replace(joint, parent=frame.body, origin=frames.compose(pose(frame.content.pose), joint.origin))


def _single_model(source: Source, only: str | None, expansion: Expansion) -> Iterator[_Instance]:
    bodies = trees.model_of(source)
    if bodies is None:
        return
    tree = _begun(next(resolved_trees(bodies, only, expansion.files, expansion.boxes)), source, bodies)
    path = (*bodies.path, owner_of(tree.bodies[0].name))
    copied = _copy(tree, "", "", source.content.name, tree.placement, tree.velocity)
    expansion.note(tree, copied, bodies)
    yield _Instance(copied, bodies.source, path)
    _touching(bodies.files[1:], bodies, copied, expansion)


def _touching(
    files: Sequence[Source], bodies: trees.Bodies, copied: Sequence[Body], expansion: Expansion, prefix: str = ""
) -> None:
    """Note the pairs of a model's bodies that its ``files`` exclude, or let touch; and all pairs that could touch, where one of
    its files says that none do."""
    contacts = [file.content.contact for file in files]
    expansion.excluded += [(prefix + a, prefix + b) for contact in contacts for a, b in contact.exclude]
    expansion.touching += [(prefix + a, prefix + b) for contact in contacts for a, b in contact.touch]
    if not all(file.content.contact.self_collision for file in bodies.files):
        colliding = [body.name for body in copied if any(shape.collision for shape in body.shapes)]
        expansion.excluded += itertools.combinations(colliding, 2)


def _begun(tree: BodyTree, source: Source, bodies: trees.Bodies) -> BodyTree:
    """The tree in the initial state that is chosen for it."""
    chosen = trees.chosen_state(source, bodies)
    if chosen is None:
        return tree
    state = required(trees.states(source, bodies)[chosen[2]].typed)
    if state.pose is not None:
        tree = replace(tree, placement=pose(state.pose))
    if state.velocity is not None:
        tree = replace(tree, velocity=(state.velocity.linear, state.velocity.angular))
    return _positioned(tree, state, trees.followers(source, bodies))


def _positioned(tree: BodyTree, use: Use | State, left_out: Container[str]) -> BodyTree:
    """The tree with the initial positions and velocities that its placement, or a state, gives; ``left_out``: joints that no
    pattern means."""
    if not use.positions and not use.velocities:
        return tree
    kinds = {body.joint.name: body.joint.kind for body in tree.bodies}
    positions, _ = initial_entries(use.positions, kinds, left_out)
    velocities, _ = initial_entries(use.velocities, kinds, left_out)
    changed = []
    for body in tree.bodies:
        joint = body.joint
        if joint.name in positions:
            value = read_position(joint.kind, use.positions[positions[joint.name]])
            joint = replace(joint, position=orientation(value) if joint.kind == "ball" else (value,))
        if joint.name in velocities:
            value = read_velocity(joint.kind, use.velocities[velocities[joint.name]])
            joint = replace(joint, velocity=value if joint.kind == "ball" else (value,))
        changed.append(replace(body, joint=joint))
    return replace(
        tree,
        bodies=tuple(changed),
        positions=tree.positions | positions.keys(),
        velocities=tree.velocities | velocities.keys(),
    )


def _check_names(instances: Sequence[_Instance], expansion: Expansion) -> None:
    """Names that two bodies, two joints or two shapes share."""
    taken: Mapping[str, dict[str, _Instance]] = {"body": {}, "joint": {}, "shape": {}}
    reported: set[tuple[object, ...]] = set()
    for instance in instances:
        for body in instance.bodies:
            names = [("body", body.name), ("joint", body.joint.name), *(("shape", shape.name) for shape in body.shapes)]
            for noun, name in names:
                if name not in taken[noun]:
                    taken[noun][name] = instance
                    continue
                other = taken[noun][name]
                key = (instance.path, other.path)  # once for two arrays, not for each element, joint and shape
                if key in reported:
                    continue
                reported.add(key)
                place = other.source.document.locate(other.path, key=True)
                message = f"two {'bodies' if noun == 'body' else noun + 's'} would be called {name!r}"
                where = ".".join(map(str, other.path)) + (f" at {place}" if place else "")
                expansion.problems.append(
                    instance.source.document.problem(
                        instance.path, message, key=True, found=f"the other one: {where}", code="S303"
                    )
                )
