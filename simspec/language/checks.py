"""Checks between the parts of a spec: parents, roots, references to materials, groups and joints, masses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from simspec.errors import Problem
from simspec.language import trees
from simspec.language.arrays import (
    CLASH_HINT,
    chosen,
    clash_words,
    entry_of,
    initial_entries,
    initial_meant,
    is_name_or_pattern,
    too_many,
)
from simspec.language.document import INVALID, Document, Key, listed, mapping
from simspec.language.joints import beyond_limits, read_position, read_velocity
from simspec.language.models import Body
from simspec.language.quantities import article
from simspec.language.sources import Source
from simspec.language.strict import Fault, Faults, fault_problem, near, required
from simspec.language.trees import Bodies
from simspec.language.vocabulary import JOINT_KINDS

DEFAULT_GROUP = "default"
RESERVED = "world"
"""The world's own name, which no body may take."""
_SINGLE_ROOT = "a model has exactly one root (a body without parent); this one has"
_ONLY_FIXED = {
    "plane": ("plane", "a large flat box"),
    "heightfield": ("height field", "a mesh as pieces, or several boxes"),
}
"""Shapes of bodies that cannot move: the noun, and what a body that moves can have instead."""


def check(source: Source) -> Iterator[Problem]:
    """Every problem between the parts of a spec and of the files that it uses."""
    for bodies in trees.every(source):
        yield from _tree(bodies)
        yield from _masses(bodies)
    for _, _, bodies in trees.placed(source):
        yield from _placement(source, bodies)
        yield from _states(source, bodies)
    if (model := trees.model_of(source)) is not None:
        yield from _states(source, model)
    yield from _contact(source)


def _tree(bodies: Bodies) -> Iterator[Problem]:
    document, path = bodies.source.document, bodies.path
    joints: dict[str, str] = {}
    for name in bodies.raw:
        parent = bodies.parent(name)
        if parent is not None and parent not in bodies.raw:
            message, hint = f"there is no body {parent!r}", near(parent, bodies.raw)
            yield document.problem((*path, name, "parent"), message, found=parent, hint=hint, code="S405")
        if name == RESERVED:
            message = f"{RESERVED!r} is the name of the world itself"
            yield document.problem((*path, name), message, key=True, hint="another name", code="S303")
        for index, joint in enumerate(bodies.joint_names(name)):
            if joint in joints:
                message = f"the joint name {joint!r} is taken: it is that of {joints[joint]}'s joint"
                place = (*path, name, *bodies.joint_place(name, index), "name")
                yield document.problem(place, message, found=joint, code="S303")
            joints.setdefault(joint, name)
    for cycle in bodies.cycles():
        chain = " -> ".join([*cycle, cycle[0]])
        message, hint = (
            f"the parents of these bodies form a loop: {chain}",
            "one of them must be a root, or have another parent",
        )
        yield document.problem((*path, cycle[0], "parent"), message, hint=hint, code="S405")
    roots = bodies.roots()
    if not bodies.model:
        return
    if not bodies.raw:
        yield document.problem(path, "a model has at least one body", code="S113")
    elif len(roots) > 1:
        shown = ", ".join(roots[:6]) + (", ..." if len(roots) > 6 else "")
        yield document.problem(
            (*path, roots[1]), f"{_SINGLE_ROOT} {len(roots)}", key=True, found=shown, allowed="one", code="S405"
        )
    elif not roots and not bodies.cycles():
        yield document.problem(path, f"{_SINGLE_ROOT} none", code="S405")
    for name in roots:
        if bodies.field(name, "array") is not None:
            message, hint = (
                "a model has one root; write the array where it is used",
                "models: {NAME: {use: ..., array: ...}}",
            )
            yield document.problem((*path, name, "array"), message, hint=hint, code="S405")
    for file in bodies.files:
        for word in ("exclude", "touch"):
            for index, pair in enumerate(listed(file.document.at("contact", word))):
                for position, name in enumerate(listed(pair)):
                    if isinstance(name, str) and name not in bodies.raw:
                        message, hint = f"the model has no body {name!r}", near(name, bodies.raw)
                        place = ("contact", word, index, position)
                        yield file.document.problem(place, message, found=name, hint=hint, code="S302")


def _masses(bodies: Bodies) -> Iterator[Problem]:
    fixed = bodies.fixed_bodies()
    document = bodies.source.document
    for name in bodies.order():
        body = bodies.typed.get(name)
        for index, shape in enumerate(body.shapes if body is not None and name not in fixed else ()):
            for kind, (noun, hint) in _ONLY_FIXED.items():
                if getattr(shape, kind) is not None:
                    message = f"a {noun} requires a body fixed to the world, and this body moves"
                    yield document.problem((*bodies.path, name, "shapes", index, kind), message, hint=hint, code="S110")
    for top, members in bodies.moving_groups().items():
        if not bodies.is_kinematic(top):  # the mass of a kinematic body has no effect
            for name, fault in group_faults(bodies, members):
                yield fault_problem(document, (*bodies.path, name), fault)


def group_faults(bodies: Bodies, members: Sequence[str]) -> Iterator[tuple[str, Fault]]:
    """The faults of the masses of bodies that move as one, each with its body: a body that moves alone needs a mass and three
    positive moments, several bodies one mass among them. Whether their tensors together are regular is checked in the
    resolved world."""
    typed = {name: bodies.typed.get(name) for name in members}
    top, *others = members
    carried = bodies.attached and bodies.parent(top) is None and bodies.joint_type(top) == "fixed"
    if not others and not carried:
        body = typed[top]
        yield from ((top, fault) for fault in (mass_faults(body) if body is not None else ()))
        return
    if None not in typed.values() and not carried and not any(_weighs(body) for body in typed.values() if body):
        hint = "a mass of one of them, or shapes with density"
        message = "a moving body needs a mass: neither this one nor what is fixed to it has one"
        yield top, Fault((), message, None, None, hint, code="S401")
    for name, body in typed.items():
        if body is not None:
            yield from ((name, fault) for fault in member_faults(body))


def _weighs(body: Body) -> bool:
    return bool(body.mass) or any(shape.density for shape in body.shapes if shape.has_volume)


def member_faults(body: Body) -> Iterator[Fault]:
    """The faults of the mass of a body that moves with others."""
    if _weighs(body):
        yield from (fault for fault in mass_faults(body) if fault.loc != ("inertia",))  # the group's tensor counts
    elif body.inertia is not None:
        message = "a moving body without mass has no moments of inertia"
        yield Fault(("inertia",), message, None, None, "a mass above 0, or no inertia", code="S402")


def mass_faults(body: Body) -> Iterator[Fault]:
    """The faults of the mass of a moving body, which needs a positive mass and three positive principal moments."""
    solid = [shape for shape in body.shapes if shape.has_volume]
    dense = [shape for shape in solid if shape.density is not None]
    if dense:
        if not any(shape.density for shape in dense):
            yield Fault((), "a moving body needs a mass; all its densities are zero", code="S401")
    elif body.mass is None:
        hint = "mass with inertia; mass with shapes; or shapes with density"
        yield Fault((), "a moving body needs a mass", None, None, hint, code="S401")
    elif body.mass <= 0.0:
        yield Fault(("mass",), "the mass of a moving body must be above 0", f"{body.mass:g}", code="S401")
    elif body.inertia is None and not solid:
        hint = "inertia: {principal: [...]}, or a shape that the inertia is computed from"
        yield Fault(
            (), "a moving body needs moments of inertia, or shapes to compute them from", None, None, hint, code="S402"
        )
    elif body.inertia is not None:
        from simspec.language.moments import principal_moments

        tensor, moments = body.inertia.tensor, body.inertia.principal
        moments = principal_moments(tuple(tensor.model_dump().values())) if tensor is not None else required(moments)
        if min(moments) <= 0.0:
            shown = ", ".join(f"{moment:.6g}" for moment in moments)
            message = "the principal moments of a moving body must be above 0"
            yield Fault(
                ("inertia",), message, f"{shown} kg m²", None, "moments this small are not physical", code="S402"
            )


def _placement(source: Source, bodies: Bodies) -> Iterator[Problem]:
    document, path = source.document, bodies.placed
    raw: Any = document.data["models"][path[1]]
    yield from _starts(source, document, path, raw, bodies)
    roots = bodies.roots()
    if len(roots) != 1:
        return
    root = roots[0]
    kind = bodies.joint_type(root)
    jointed = f"the root {root!r} has a joint to the world, so it cannot be"
    if raw.get("fixed") is True and kind != "fixed":
        yield document.problem((*path, "fixed"), f"{jointed} fixed as well", found=f"a {kind} joint", code="S404")
    elif raw.get("kinematic") is True and kind != "free":
        yield document.problem((*path, "kinematic"), f"{jointed} kinematic", found=f"a {kind} joint", code="S404")
    elif raw.get("fixed") is True and bodies.field(root, "velocity") is not None:
        yield document.problem(
            (*path, "fixed"), f"the root {root!r} has a velocity, so it cannot be fixed", code="S404"
        )
    if "velocity" in raw and kind != "free":
        yield document.problem(
            (*path, "velocity"), f"the root {root!r} is not free", hint="write velocities", code="S404"
        )


def _states(source: Source, bodies: Bodies) -> Iterator[Problem]:
    """The problems of the states of a model, and of the name of its initial state."""
    named = trees.states(source, bodies)
    roots = bodies.roots()
    kind = bodies.joint_type(roots[0]) if len(roots) == 1 else "free"
    actuators = trees.actuator_names(source, bodies)
    for state in named.values():
        yield from _starts(source, state.source.document, state.path, state.raw, bodies)
        yield from _commands(state, actuators)
        if "pose" in state.raw and kind not in ("free", "fixed"):
            hint = "write positions"
            message = f"the root {roots[0]!r} has a joint to the world, so it has no pose of its own"
            yield state.source.document.problem(
                (*state.path, "pose"), message, found=f"a {kind} joint", hint=hint, code="S507"
            )
    chosen = trees.chosen_state(source, bodies)
    if chosen is None:
        return
    file, path, name = chosen
    if name not in named:
        allowed = ", ".join(list(named)[:20]) or "the model has no states"
        message = f"the model has no state {name!r}"
        yield file.document.problem(path, message, found=name, allowed=allowed, hint=near(name, named), code="S302")
    elif "velocity" in named[name].raw and kind != "free":
        message = f"the state {name!r} has a velocity of the root {roots[0]!r}, which is not free"
        yield file.document.problem(path, message, found=f"a {kind} joint", code="S507")


def _commands(state: trees.WrittenState, actuators: Sequence[str]) -> Iterator[Problem]:
    """The problems of the names of commands by actuator."""
    document, path, commands = state.source.document, (*state.path, "commands"), mapping(state.raw.get("commands"))
    if (many := too_many(commands)) is not None:
        yield fault_problem(document, path, many.faults[0])
        return
    named = {name: value for name, value in commands.items() if is_name_or_pattern(name)}
    for name in named:
        if not chosen(name, actuators):
            message, allowed = f"the model has no actuator {name!r}", ", ".join(list(actuators)[:20]) or None
            yield document.problem(
                (*path, name), message, key=True, allowed=allowed, hint=near(name, actuators), code="S302"
            )
    for clash in entry_of(named, lambda entry: chosen(entry, actuators))[1]:
        yield document.problem((*path, clash.other), clash_words(clash), key=True, hint=CLASH_HINT, code="S304")


def _starts(
    source: Source, document: Document, path: tuple[Key, ...], raw: Mapping[str, Any], bodies: Bodies
) -> Iterator[Problem]:
    """The problems of initial positions and velocities by joint, which ``document`` says at ``path``."""
    joints = {joint: (name, k) for name in bodies.raw for k, joint in enumerate(bodies.joint_names(name))}
    kinds = {joint: str(bodies.joint_types(owner)[index]) for joint, (owner, index) in joints.items()}
    following = trees.followers(source, bodies)
    for key, reader in (("positions", read_position), ("velocities", read_velocity)):
        written = raw.get(key)
        if not isinstance(written, Mapping):
            continue
        values = {entry: value for entry, value in written.items() if is_name_or_pattern(entry)}
        if (many := too_many(values)) is not None:
            yield fault_problem(document, (*path, key), many.faults[0])
            continue
        for entry, value in values.items():
            place = (*path, key, entry)
            meant = initial_meant(entry, values, kinds, following)
            if not meant:
                allowed = ", ".join(list(joints)[:20])
                message = f"no joint of the model that {entry!r} could mean" if "*" in entry else ""
                message = message or f"the model has no joint {entry!r}"
                yield document.problem(place, message, key=True, allowed=allowed, hint=near(entry, joints), code="S302")
                continue
            types = {kinds[joint]: joint for joint in meant}
            if len(types) > 1:
                found = ", ".join(f"{joint}: {article(kind)}" for kind, joint in types.items())
                message = "one number for hinges and slides would have two units"
                yield document.problem(
                    place, message, key=True, found=found, hint="separate patterns, or names", code="S304"
                )
                continue
            wrong = (
                _start(document, place, joint, kinds[joint], value, reader, joints[joint], bodies) for joint in meant
            )
            yield from next(filter(None, wrong), [])  # of a pattern those of the first joint
        for clash in initial_entries(values, kinds, following)[1]:
            yield document.problem(
                (*path, key, clash.other), clash_words(clash), key=True, hint=CLASH_HINT, code="S304"
            )


def _start(
    document: Document,
    place: tuple[Key, ...],
    joint: str,
    kind: str,
    value: Any,
    reader: Callable[[str, Any], Any],
    where: tuple[str, int],
    bodies: Bodies,
) -> list[Problem]:
    """The problems of the initial position or velocity (by ``reader``) of a joint; ``where``: its body, and its index
    there."""
    if value is INVALID or kind not in JOINT_KINDS:
        return []
    word = "position" if reader is read_position else "velocity"
    if kind in ("fixed", "free"):
        hint = "write pose and velocity of the model" if kind == "free" else "remove it"
        return [document.problem(place, f"{joint} is a {kind} joint, which has no {word}", hint=hint, code="S507")]
    try:
        read = reader(kind, value)
    except Faults as error:
        return [fault_problem(document, place, fault) for fault in error.faults]
    owner, index = where
    body = bodies.typed.get(owner)
    written = None if body is None else body.joints[index] if body.joints else body.joint
    limits = None if written is None else written.limits
    if word == "velocity" or limits is None:
        return []
    beyond = beyond_limits(read, limits.position, limits.angle)
    of = f" of {joint}" if place[-1] != joint else ""
    return [fault_problem(document, place, beyond._replace(message=beyond.message + of))] if beyond is not None else []


def _part(source: Source, name: str) -> Mapping[str, Any]:
    """A mapping of ``contact``; empty where there is none."""
    entries = mapping(source.document.at("contact", name))
    return {key: value for key, value in entries.items() if isinstance(key, str)}


def _ignores(group: Any) -> list[tuple[int, str]]:
    """The groups that a group ignores, with their places in the list; values that are not names are reported where they are
    read."""
    ignored = listed(mapping(group).get("ignores"))
    return [(index, other) for index, other in enumerate(ignored) if isinstance(other, str)]


def _contact(source: Source) -> Iterator[Problem]:
    yield from _merged(source, "materials", "material")
    yield from _merged(source, "groups", "collision group")
    materials = {name for member in source.all() for name in _part(member, "materials")}
    groups, used = {DEFAULT_GROUP}, {DEFAULT_GROUP}
    for member in source.all():
        for name, group in _part(member, "groups").items():
            groups.add(name)
            groups.update(other for _, other in _ignores(group))
    for bodies in trees.every(source):
        yield from _references(source, bodies, materials, groups)
        used.update(group for name in bodies.raw if isinstance(group := bodies.field(name, "collision_group"), str))
    defined = {name for member in source.all() for name in _part(member, "groups")} | used
    for member in source.all():
        for name, group in _part(member, "groups").items():
            for index, other in _ignores(group):
                if other not in defined:
                    place, message = ("contact", "groups", name, "ignores", index), f"no body is in a group {other!r}"
                    yield member.document.problem(
                        place, message, allowed=_some(defined), hint=near(other, defined), code="S302"
                    )
    for path, pairs in _lists_of_pairs(source):
        yield from _pairs(source.document, path, pairs, materials)
    yield from _pairs_of_models(source, materials)


def _some(words: Any) -> str:
    in_order = sorted(words)
    return ", ".join(in_order[:20]) + (", ..." if len(in_order) > 20 else "") if in_order else "none is defined"


def _merged(source: Source, part: str, noun: str) -> Iterator[Problem]:
    """Tables of several files are one table: the same name must mean the same."""
    first: dict[str, tuple[Source, Any]] = {}
    for member in source.all():
        if member.file is None:
            continue
        for name, value in getattr(member.file.contact, part).items():
            where, known = first.setdefault(name, (member, value))
            if known != value:
                place = where.document.locate(("contact", part, name), key=True)
                message = f"the {noun} {name!r} has another definition in another file"
                shown = ", ".join(f"{key} {item}" for key, item in known.model_dump().items())
                found = f"{shown} at {place}"
                yield member.document.problem(("contact", part, name), message, key=True, found=found, code="S605")


def _references(source: Source, bodies: Bodies, materials: set[str], groups: set[str]) -> Iterator[Problem]:
    document = bodies.source.document
    part = _part(bodies.source, "materials")
    alone = not bodies.placed and bodies.model and not materials
    without: list[tuple[Key, ...]] = []
    for name in bodies.raw:
        group = bodies.field(name, "collision_group")
        if isinstance(group, str) and group not in groups:
            message, hint = f"contact.groups does not define {group!r}", near(group, groups)
            path = (*bodies.path, name, "collision_group")
            yield document.problem(path, message, found=group, allowed=_some(groups), hint=hint, code="S302")
        for index, shape in enumerate(listed(bodies.field(name, "shapes"))):
            if not isinstance(shape, Mapping):
                continue
            material, place = shape.get("material"), (*bodies.path, name, "shapes", index)
            if material is None:
                if shape.get("collision") is not False and len(part) != 1 and len(materials) != 1 and not alone:
                    without.append(place)
            elif isinstance(material, str) and material not in materials:
                yield _no_material(document, (*place, "material"), material, materials)
    if without:
        others = len(without) - 1
        more = f" (and {others} other{'s' * (others > 1)} in this file)" if others else ""
        hint = "material: NAME" if materials else "contact: {materials: {NAME: {friction: 0.5}}}"
        message = f"a colliding shape needs a material{more}"
        yield document.problem(without[0], message, allowed=_some(materials), hint=hint, code="S606")


def _no_material(document: Document, path: tuple[Key, ...], name: str, materials: set[str]) -> Problem:
    hint = near(name, materials)
    return document.problem(path, f"there is no material {name!r}", allowed=_some(materials), hint=hint, code="S302")


def _lists_of_pairs(source: Source) -> Iterator[tuple[tuple[Key, ...], Any]]:
    """Every list of pairs of materials, with its place: of laws, and of engines' settings."""
    yield ("contact", "pairs"), source.document.at("contact", "pairs")
    for name, options in mapping(source.document.at("engines")).items():
        yield ("engines", name, "pairs"), mapping(options).get("pairs")
        for index, entry in enumerate(listed(mapping(options).get("at_timestep"))):
            yield ("engines", name, "at_timestep", index, "pairs"), mapping(entry).get("pairs")


def _pairs_of_models(source: Source, materials: set[str]) -> Iterator[Problem]:
    """The problems of the pairs of model files: in each file, and where two say different laws of a pair of which the
    scenario says none."""
    pairs = source.file.contact.pairs if source.file is not None else []
    settled = {tuple(sorted(pair.between)) for pair in pairs}
    first: dict[tuple[str, ...], tuple[Source, int, Any]] = {}
    for member in source.all():
        if member is source:
            continue
        place = ("contact", "pairs")
        yield from _pairs(member.document, place, member.document.at(*place), materials)
        for index, pair in enumerate(member.file.contact.pairs if member.file is not None else ()):
            both = tuple(sorted(pair.between))
            law = pair.model_dump(exclude={"between"})
            where, number, known = first.setdefault(both, (member, index, law))
            if known != law and both not in settled:
                message = f"the pair {' and '.join(both)} has another law in another file"
                found = f"{where.document.locate(('contact', 'pairs', number))}"
                hint = "say the pair in the scenario: its law replaces both"
                yield member.document.problem(("contact", "pairs", index), message, found=found, hint=hint, code="S605")


def _pairs(document: Document, path: tuple[Key, ...], pairs: Any, materials: set[str]) -> Iterator[Problem]:
    """Unknown materials, and pairs that stand twice in a list."""
    seen: dict[tuple[str, ...], int] = {}
    for index, pair in enumerate(listed(pairs)):
        between = mapping(pair).get("between")
        if not isinstance(between, (list, tuple)) or not all(isinstance(name, str) for name in between):
            continue
        for position, name in enumerate(between):
            if name not in materials:
                yield _no_material(document, (*path, index, "between", position), name, materials)
        both = tuple(sorted(between))
        if both in seen:
            message = f"the pair {' and '.join(both)} is duplicated"
            first = document.locate((*path, seen[both]))
            found = f"first as pair {seen[both]}" + (f" at {first}" if first is not None else "")
            hint = "remove one, or combine both into one entry"
            yield document.problem((*path, index), message, found=found, hint=hint, code="S303")
        seen.setdefault(both, index)
