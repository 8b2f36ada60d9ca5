"""What is wrong between the parts of a spec: parents, roots, references to materials, groups and joints, masses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from simspec.errors import Problem
from simspec.language import trees
from simspec.language.document import INVALID, Document, Key
from simspec.language.joint_names import (
    CLASH_HINT,
    chosen,
    clash_words,
    entry_of,
    initial_entries,
    initial_meant,
    is_name_or_pattern,
    too_many,
)
from simspec.language.joints import beyond_cone, outside, outside_cone, read_position, read_velocity, within
from simspec.language.models import Body
from simspec.language.sources import Source
from simspec.language.strict import Fault, Faults, near, required
from simspec.language.trees import Bodies
from simspec.language.units import article
from simspec.language.vocabulary import JOINT_KINDS

DEFAULT_GROUP = "default"
RESERVED = "world"
"""The world's own name, which no body may take."""


def check(source: Source) -> Iterator[Problem]:
    """Every problem between the parts of a spec and of the files that it uses."""
    for bodies in trees.every(source):
        yield from _tree(bodies)
        yield from _masses(bodies)
    for _, _, bodies in trees.placed(source):
        yield from _placement(source, bodies)
        yield from _states(source, bodies)
    if (own := trees.model_of(source)) is not None:
        yield from _states(source, own)
    yield from _contact(source)


def _tree(bodies: Bodies) -> Iterator[Problem]:
    document, path = bodies.source.document, bodies.path
    joints: dict[str, str] = {}
    for name in bodies.raw:
        parent = bodies.parent(name)
        if parent is not None and parent not in bodies.raw:
            message, hint = f"there is no body {parent!r}", near(parent, bodies.raw)
            yield document.problem((*path, name, "parent"), message, found=parent, hint=hint)
        if name == RESERVED:
            message = f"{RESERVED!r} is the name of the world itself"
            yield document.problem((*path, name), message, key=True, hint="another name")
        for index, joint in enumerate(bodies.joint_names(name)):
            if joint in joints:
                message = f"the joint name {joint!r} is taken: it is that of {joints[joint]}'s joint"
                place = (*path, name, *bodies.joint_place(name, index), "name")
                yield document.problem(place, message, found=joint)
            joints.setdefault(joint, name)
    for cycle in bodies.cycles():
        chain = " -> ".join([*cycle, cycle[0]])
        message = f"the parents of these bodies form a loop: {chain}"
        yield document.problem(
            (*path, cycle[0], "parent"), message, hint="one of them must be a root, or have another parent"
        )
    roots = bodies.roots()
    if bodies.model and len(roots) != 1 and bodies.raw:
        if roots:
            message = f"a model has exactly one root (a body without parent); this one has {len(roots)}"
            shown = ", ".join(roots[:6]) + (", ..." if len(roots) > 6 else "")
            yield document.problem((*path, roots[1]), message, key=True, found=shown, allowed="one")
        elif not bodies.cycles():
            yield document.problem(path, "a model has exactly one root (a body without parent); this one has none")
    if bodies.model and not bodies.raw:
        yield document.problem(path, "a model has at least one body")
    if bodies.model:
        yield from _model(bodies)


def _model(bodies: Bodies) -> Iterator[Problem]:
    for name in bodies.roots():
        if bodies.field(name, "array") is not None:
            hint = "models: {NAME: {use: ..., array: ...}}"
            place = (*bodies.path, name, "array")
            yield bodies.source.document.problem(
                place, "a model has one root; write the array where it is used", hint=hint
            )
    for file in bodies.files:
        contact = file.document.data.get("contact")
        for word in ("exclude", "touch"):
            pairs = contact.get(word) if isinstance(contact, Mapping) else None
            for index, pair in enumerate(pairs if isinstance(pairs, (list, tuple)) else ()):
                for position, name in enumerate(pair if isinstance(pair, (list, tuple)) else ()):
                    if isinstance(name, str) and name not in bodies.raw:
                        message, near_by = f"the model has no body {name!r}", near(name, bodies.raw)
                        at = ("contact", word, index, position)
                        yield file.document.problem(at, message, found=name, hint=near_by)


def _masses(bodies: Bodies) -> Iterator[Problem]:
    still = bodies.still()
    document = bodies.source.document
    for name in bodies.order():
        body = bodies.typed.get(name)
        if body is None:
            continue
        for index, shape in enumerate(body.shapes):
            if shape.plane is not None and name not in still:
                message = "a plane requires a body fixed to the world, and this body moves"
                yield document.problem((*bodies.path, name, "shapes", index, "plane"), message, hint="a large flat box")
            if shape.heightfield is not None and name not in still:
                message = "a height field requires a body fixed to the world, and this body moves"
                hint = "a mesh as pieces, or several boxes"
                yield document.problem((*bodies.path, name, "shapes", index, "heightfield"), message, hint=hint)
    for top, members in bodies.moving_groups().items():
        if bodies.is_kinematic(top):
            continue  # whose mass counts for nothing
        for name, fault in group_faults(bodies, members):
            place = (*bodies.path, name, *fault.loc)
            yield document.problem(place, fault.message, found=fault.found, hint=fault.hint)


def group_faults(bodies: Bodies, members: Sequence[str]) -> Iterator[tuple[str, Fault]]:
    """What bodies that move as one lack to move, each with the body: of one that moves alone its own mass and three positive
    moments, of several one mass among them. Whether their tensors together are regular shows in the resolved world."""
    typed = {name: bodies.typed.get(name) for name in members}
    top, *others = members
    carried = bodies.attached and bodies.parent(top) is None
    if not others and not carried:
        body = typed[top]
        yield from ((top, fault) for fault in (mass_faults(body) if body is not None else ()))
        return
    if None not in typed.values() and not carried and not any(_weighs(body) for body in typed.values() if body):
        hint = "a mass of one of them, or shapes with density"
        message = "a moving body needs a mass: neither this one nor what is fixed to it has one"
        yield top, Fault((), message, None, None, hint)
    for name, body in typed.items():
        if body is not None:
            yield from ((name, fault) for fault in member_faults(body))


def _weighs(body: Body) -> bool:
    return bool(body.mass) or any(shape.density for shape in body.shapes if shape.has_volume)


def member_faults(body: Body) -> Iterator[Fault]:
    """What is wrong with the mass of a body that moves with others."""
    if _weighs(body):
        lacking = (fault for fault in mass_faults(body) if fault.loc != ("inertia",))  # the group's tensor counts
        yield from lacking
    elif body.inertia is not None:
        message = "a moving body without mass has no moments of inertia"
        yield Fault(("inertia",), message, None, None, "a mass above 0, or no inertia")


def mass_faults(body: Body) -> Iterator[Fault]:
    """What a moving body lacks to move: a positive mass and three positive principal moments."""
    solid = [shape for shape in body.shapes if shape.has_volume]
    dense = [shape for shape in solid if shape.density is not None]
    if dense:
        if not any(shape.density for shape in dense):
            yield Fault((), "a moving body needs a mass; all its densities are zero")
    elif body.mass is None:
        hint = "mass with inertia; mass with shapes; or shapes with density"
        yield Fault((), "a moving body needs a mass", None, None, hint)
    elif body.mass <= 0.0:
        yield Fault(("mass",), "the mass of a moving body must be above 0", f"{body.mass:g}")
    elif body.inertia is None and not solid:
        hint = "inertia: {principal: [...]}, or a shape that the inertia is computed from"
        yield Fault((), "a moving body needs moments of inertia, or shapes to compute them from", None, None, hint)
    elif body.inertia is not None:
        from simspec.language.moments import principal_moments

        tensor = body.inertia.tensor
        if tensor is None:
            moments = required(body.inertia.principal)
        else:
            moments = principal_moments(tuple(tensor.model_dump().values()))
        if min(moments) <= 0.0:
            shown = ", ".join(f"{moment:.6g}" for moment in moments)
            message = "the principal moments of a moving body must be above 0"
            yield Fault(("inertia",), message, f"{shown} kg m²", None, "moments this small are not physical")


def _placement(source: Source, bodies: Bodies) -> Iterator[Problem]:
    document, path = source.document, bodies.placed
    raw: Any = document.data["models"][path[1]]
    yield from _starts(source, document, path, raw, bodies)
    roots = bodies.roots()
    if len(roots) != 1:
        return
    root = roots[0]
    kind = bodies.joint_type(root)
    if raw.get("fixed") is True and kind != "fixed":
        message = f"the root {root!r} has a joint to the world, so it cannot be fixed as well"
        yield document.problem((*path, "fixed"), message, found=f"a {kind} joint")
    elif raw.get("kinematic") is True and kind != "free":
        message = f"the root {root!r} has a joint to the world, so it cannot be kinematic"
        yield document.problem((*path, "kinematic"), message, found=f"a {kind} joint")
    elif raw.get("fixed") is True and bodies.field(root, "velocity") is not None:
        yield document.problem((*path, "fixed"), f"the root {root!r} has a velocity, so it cannot be fixed")
    if "velocity" in raw and kind != "free":
        yield document.problem((*path, "velocity"), f"the root {root!r} is not free", hint="write velocities")


def _states(source: Source, bodies: Bodies) -> Iterator[Problem]:
    """What is wrong with the states of a model, and with the one that it begins in."""
    named = trees.states(source, bodies)
    roots = bodies.roots()
    kind = bodies.joint_type(roots[0]) if len(roots) == 1 else "free"
    actuators = trees.actuator_names(source, bodies)
    for state in named.values():
        yield from _starts(source, state.source.document, state.path, state.raw, bodies)
        commands = state.raw.get("commands")
        if isinstance(commands, Mapping):
            yield from _commands(state.source.document, (*state.path, "commands"), commands, actuators)
        if "pose" in state.raw and kind not in ("free", "fixed"):
            hint = "write positions"
            message = f"the root {roots[0]!r} has a joint to the world, so it has no pose of its own"
            yield state.source.document.problem((*state.path, "pose"), message, found=f"a {kind} joint", hint=hint)
    chosen = trees.chosen_state(source, bodies)
    if chosen is None:
        return
    file, path, name = chosen
    if name not in named:
        allowed = ", ".join(list(named)[:20]) or "the model has no states"
        message = f"the model has no state {name!r}"
        yield file.document.problem(path, message, found=name, allowed=allowed, hint=near(name, named))
    elif "velocity" in named[name].raw and kind != "free":
        message = f"the state {name!r} has a velocity of the root {roots[0]!r}, which is not free"
        yield file.document.problem(path, message, found=f"a {kind} joint")


def _commands(
    document: Document, path: tuple[Key, ...], commands: Mapping[str, Any], actuators: Sequence[str]
) -> Iterator[Problem]:
    """What is wrong with the names of commands by actuator."""
    if (many := too_many(commands)) is not None:
        yield document.problem(path, many.faults[0].message, found=many.faults[0].found, allowed=many.faults[0].allowed)
        return
    named = {name: value for name, value in commands.items() if is_name_or_pattern(name)}
    for name in named:
        if not chosen(name, actuators):
            message, allowed = f"the model has no actuator {name!r}", ", ".join(list(actuators)[:20]) or None
            yield document.problem((*path, name), message, key=True, allowed=allowed, hint=near(name, actuators))
    for clash in entry_of(named, lambda entry: chosen(entry, actuators))[1]:
        yield document.problem((*path, clash.other), clash_words(clash), key=True, hint=CLASH_HINT)


def _starts(
    source: Source, document: Document, path: tuple[Key, ...], raw: Mapping[str, Any], bodies: Bodies
) -> Iterator[Problem]:
    """What is wrong with initial positions and velocities by joint, which ``document`` says at ``path``."""
    joints = {joint: (name, k) for name in bodies.raw for k, joint in enumerate(bodies.joint_names(name))}
    kinds = {joint: str(bodies.joint_types(owner)[index]) for joint, (owner, index) in joints.items()}
    following = trees.followers(source, bodies)
    for key, reader in (("positions", read_position), ("velocities", read_velocity)):
        written = raw.get(key)
        if not isinstance(written, Mapping):
            continue
        values = {entry: value for entry, value in written.items() if is_name_or_pattern(entry)}
        if (many := too_many(values)) is not None:
            fault = many.faults[0]
            yield document.problem((*path, key), fault.message, found=fault.found, allowed=fault.allowed)
            continue
        for entry, value in values.items():
            place = (*path, key, entry)
            meant = initial_meant(entry, values, kinds, following)
            if not meant:
                allowed = ", ".join(list(joints)[:20])
                message = f"no joint of the model that {entry!r} could mean" if "*" in entry else ""
                message = message or f"the model has no joint {entry!r}"
                yield document.problem(place, message, key=True, allowed=allowed, hint=near(entry, joints))
                continue
            types = {kinds[joint]: joint for joint in meant}
            if len(types) > 1:
                found = ", ".join(f"{joint}: {article(kind)}" for kind, joint in types.items())
                message = "one number for hinges and slides would have two units"
                yield document.problem(place, message, key=True, found=found, hint="separate patterns, or names")
                continue
            for joint in meant:
                wrong = list(_start(document, place, joint, kinds[joint], key, value, reader, joints[joint], bodies))
                yield from wrong
                if wrong:
                    break  # of a pattern the first
        for clash in initial_entries(values, kinds, following)[1]:
            yield document.problem((*path, key, clash.other), clash_words(clash), key=True, hint=CLASH_HINT)


def _start(
    document: Document,
    place: tuple[Key, ...],
    joint: str,
    kind: str,
    key: str,
    value: Any,
    reader: Callable[[str, Any], Any],
    where: tuple[str, int],
    bodies: Bodies,
) -> Iterator[Problem]:
    """What is wrong with the initial position or velocity (``key``) of one joint; ``where``: its body, and its index there."""
    if value is INVALID or kind not in JOINT_KINDS:
        return
    if kind in ("fixed", "free"):
        word = "position" if key == "positions" else "velocity"
        hint = "write pose and velocity of the model" if kind == "free" else "remove it"
        yield document.problem(place, f"{joint} is a {kind} joint, which has no {word}", hint=hint)
        return
    try:
        read = reader(kind, value)
    except Faults as error:
        for wrong in error.faults:
            yield document.problem(
                (*place, *wrong.loc), wrong.message, found=wrong.found, allowed=wrong.allowed, hint=wrong.hint
            )
        return
    owner, index = where
    body = bodies.typed.get(owner)
    written = None if body is None else body.joints[index] if body.joints else body.joint
    limits = None if written is None else written.limits
    if key != "positions" or limits is None:
        return
    beyond: Fault | None = None
    if limits.position is not None and within(read, limits.position) is None:
        beyond = outside(read, limits.position, ())
    elif limits.angle is not None and beyond_cone(read, limits.angle):
        beyond = outside_cone(read, limits.angle, ())
    if beyond is not None:
        of = f" of {joint}" if place[-1] != joint else ""
        yield document.problem(place, beyond.message + of, found=beyond.found, allowed=beyond.allowed, hint=beyond.hint)


def _part(source: Source, name: str) -> Mapping[str, Any]:
    """A mapping of ``contact``; empty where there is none."""
    data = source.document.data
    contact = data.get("contact") if isinstance(data, Mapping) else None
    entries = contact.get(name) if isinstance(contact, Mapping) else None
    return (
        {key: value for key, value in entries.items() if isinstance(key, str)} if isinstance(entries, Mapping) else {}
    )


def _ignores(group: Any) -> list[tuple[int, str]]:
    """The groups that a group ignores, with their places in the list; what is no name is reported where it is read."""
    ignored = group.get("ignores") if isinstance(group, Mapping) else None
    items = ignored if isinstance(ignored, (list, tuple)) else ()
    return [(index, other) for index, other in enumerate(items) if isinstance(other, str)]


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
                    place = ("contact", "groups", name, "ignores", index)
                    message = f"no body is in a group {other!r}"
                    yield member.document.problem(place, message, allowed=_some(defined), hint=near(other, defined))
    for path, pairs in _lists_of_pairs(source):
        yield from _pairs(source, path, pairs, materials)
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
                yield member.document.problem(("contact", part, name), message, key=True, found=found)


def _references(source: Source, bodies: Bodies, materials: set[str], groups: set[str]) -> Iterator[Problem]:
    document = bodies.source.document
    own = _part(bodies.source, "materials")
    alone = not bodies.placed and bodies.model and not materials
    without: list[tuple[Key, ...]] = []
    for name in bodies.raw:
        group = bodies.field(name, "collision_group")
        if isinstance(group, str) and group not in groups:
            message, hint = f"contact.groups does not define {group!r}", near(group, groups)
            path = (*bodies.path, name, "collision_group")
            yield document.problem(path, message, found=group, allowed=_some(groups), hint=hint)
        shapes = bodies.field(name, "shapes")
        for index, shape in enumerate(shapes if isinstance(shapes, (list, tuple)) else ()):
            if not isinstance(shape, Mapping):
                continue
            material, place = shape.get("material"), (*bodies.path, name, "shapes", index)
            if material is None:
                if shape.get("collision") is not False and len(own) != 1 and len(materials) != 1 and not alone:
                    without.append(place)
            elif isinstance(material, str) and material not in materials:
                hint = near(material, materials)
                message = f"there is no material {material!r}"
                yield document.problem((*place, "material"), message, allowed=_some(materials), hint=hint)
    if without:
        others = len(without) - 1
        more = f" (and {others} other{'s' * (others > 1)} in this file)" if others else ""
        hint = "material: NAME" if materials else "contact: {materials: {NAME: {friction: 0.5}}}"
        message = f"a colliding shape needs a material{more}"
        yield document.problem(without[0], message, allowed=_some(materials), hint=hint)


def _lists_of_pairs(source: Source) -> Iterator[tuple[tuple[Key, ...], Any]]:
    """Every list of pairs of materials, with its place: of laws, and of engines' settings."""
    data = source.document.data
    if not isinstance(data, Mapping):
        return
    holders: list[tuple[tuple[Key, ...], Any]] = [(("contact",), data.get("contact"))]
    engines = data.get("engines")
    for name, options in engines.items() if isinstance(engines, Mapping) else ():
        holders.append((("engines", name), options))
        entries = options.get("at_timestep") if isinstance(options, Mapping) else None
        for index, entry in enumerate(entries if isinstance(entries, (list, tuple)) else ()):
            holders.append((("engines", name, "at_timestep", index), entry))
    for place, holder in holders:
        if isinstance(holder, Mapping):
            yield (*place, "pairs"), holder.get("pairs")


def _pairs_of_models(source: Source, materials: set[str]) -> Iterator[Problem]:
    """What is wrong with the pairs of model files: in each file, and where two say different laws of a pair of which the
    scenario says none."""
    own = source.file.contact.pairs if source.file is not None else []
    settled = {tuple(sorted(pair.between)) for pair in own}
    first: dict[tuple[str, ...], tuple[Source, int, Any]] = {}
    for member in source.all():
        if member is source:
            continue
        data = member.document.data
        contact = data.get("contact") if isinstance(data, Mapping) else None
        yield from _pairs(
            member, ("contact", "pairs"), contact.get("pairs") if isinstance(contact, Mapping) else None, materials
        )
        for index, pair in enumerate(member.file.contact.pairs if member.file is not None else ()):
            both = tuple(sorted(pair.between))
            law = pair.model_dump(exclude={"between"})
            where, number, known = first.setdefault(both, (member, index, law))
            if known != law and both not in settled:
                message = f"the pair {' and '.join(both)} has another law in another file"
                found = f"{where.document.locate(('contact', 'pairs', number))}"
                hint = "say the pair in the scenario: its law replaces both"
                yield member.document.problem(("contact", "pairs", index), message, found=found, hint=hint)


def _pairs(source: Source, path: tuple[Key, ...], pairs: Any, materials: set[str]) -> Iterator[Problem]:
    """Unknown materials, and pairs that stand twice in a list."""
    seen: dict[tuple[str, ...], int] = {}
    for index, pair in enumerate(pairs if isinstance(pairs, (list, tuple)) else ()):
        between = pair.get("between") if isinstance(pair, Mapping) else None
        if not isinstance(between, (list, tuple)) or not all(isinstance(name, str) for name in between):
            continue
        for position, name in enumerate(between):
            if name not in materials:
                place, hint = (*path, index, "between", position), near(name, materials)
                message = f"there is no material {name!r}"
                yield source.document.problem(place, message, allowed=_some(materials), hint=hint)
        both = tuple(sorted(between))
        if both in seen:
            message = f"the pair {' and '.join(both)} is duplicated"
            first = source.document.locate((*path, seen[both]))
            found = f"first as pair {seen[both]}" + (f" at {first}" if first is not None else "")
            hint = "remove one, or combine both into one entry"
            yield source.document.problem((*path, index), message, found=found, hint=hint)
        seen.setdefault(both, index)
