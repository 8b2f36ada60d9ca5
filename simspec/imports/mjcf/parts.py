"""Geoms, height fields, actuators and keys of a compiled model as those of a spec."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.imports.draft import shape_data
from simspec.imports.mjcf.bodies import MjcfBodies, MjcfNames, Vector, inverse, numbers, pose, product, rotated
from simspec.imports.mjcf.compiled import BALL, FREE, HINGE, SLIDE, CompiledMjcf
from simspec.imports.mjcf.constraints import add_tendons
from simspec.imports.mjcf.contact import MjcfSurfaces
from simspec.language.beginning import LimitStart
from simspec.language.joints import ROUND_OFF, nearest, scaled_to, within
from simspec.language.shapes import MOST_VERTICES
from simspec.language.trees import MOST
from simspec.meshes.load import read_grid
from simspec.meshes.reading import MeshError
from simspec.world.inertia import SINGULAR

# Geoms and height fields of a compiled model as shapes of a spec.


MOST_ROWS: Final = 2**16
"""Heights that are written into a spec; of more, a picture that says the same is named."""
SAME: Final = 1e-6
"""Share of the range by which a picture may be off: the compiler has single precision."""


def height_field(bodies: MjcfBodies, number: int) -> dict[str, Any] | None:
    """The shape of a geom; None for what the language does not have: one on a body that may move, and one of more heights than
    are read."""
    model = bodies.model
    data, shares = int(model["geom_dataid"][number]), model.get("hfield_data")
    if shares is None or not _is_static(bodies, int(model["geom_bodyid"][number])):
        return None
    rows, columns = int(model["hfield_nrow"][data]), int(model["hfield_ncol"][data])
    half_x, half_y, top, base = model["hfield_size"][data].tolist()
    first = int(model["hfield_adr"][data])
    grid = shares[first : first + rows * columns].reshape(rows, columns)[::-1]  # as on a map: the greatest y first
    said = {"size": numbers([2.0 * half_x, 2.0 * half_y]), "heights": [0.0, float(top)], "base": float(base)}
    path = model.field_files.get(data)
    if path is not None and _says(path, grid):
        text = os.path.relpath(path, bodies.folder).replace(os.sep, "/")
        bodies.files[text] = path
        return {"heightfield": {"file": text, **said}}
    if rows * columns > MOST_ROWS:
        return None
    if not grid.any():  # all at the lowest, as in the compiled model
        said["heights"] = [0.0, 0.0]
    return {"heightfield": {"rows": [numbers(row) for row in grid], **said}}


def _is_static(bodies: MjcfBodies, body: int) -> bool:
    """Whether a body is fixed to the world, and no program moves one above it."""
    if int(bodies.model["body_weldid"][body]) != 0:
        return False
    while body:
        if int(bodies.model["body_mocapid"][body]) >= 0:
            return False
        body = int(bodies.model["body_parentid"][body])
    return True


def _says(path: Path, grid: NDArray[Any]) -> bool:
    """Whether a file is a picture that the language reads, with these shares of its range."""
    if path.suffix.lower() != ".png":
        return False
    try:
        shades = read_grid(path)
    except MeshError:
        return False
    span = shades.max() - shades.min()
    return shades.shape == grid.shape and bool(np.abs((shades - shades.min()) / (span or 1.0) - grid).max() <= SAME)


PLANE, HEIGHT_FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)
"""Types of geoms."""
SIZED: Final[Mapping[int, tuple[str, tuple[float, ...]]]] = {
    PLANE: ("plane", ()),
    SPHERE: ("sphere", (1.0,)),
    CAPSULE: ("capsule", (1.0, 2.0)),
    ELLIPSOID: ("ellipsoid", (1.0, 1.0, 1.0)),
    CYLINDER: ("cylinder", (1.0, 2.0)),
    BOX: ("box", (2.0, 2.0, 2.0)),
}
"""The word of a shape, and the sizes of the language by those of a geom, which has half lengths."""
SUFFIXES: Final = (".obj", ".stl", ".ply", ".msh")
"""Files of meshes that the language and the compiler read alike."""
MOST_FACES: Final = 200_000
"""Triangles of a mesh in the language."""
THINNEST: Final = 1e-6
"""Share of a mesh's length: a thinner one is flat, and has no hull."""
HIDDEN: Final = 3
"""Groups from this one on are not drawn by default."""


def add_shapes(bodies: MjcfBodies, surfaces: MjcfSurfaces) -> None:
    """Give each body its shapes; those of the world are a body of their own, which is fixed."""
    model = bodies.model
    names = MjcfNames()
    for number in range(model.numbers["ngeom"]):
        part = model.part("geom", number)
        shape = _shape(bodies, surfaces, number)
        if shape is None:
            continue
        if part.name:
            shape = {"name": names.give(part.name, "geom"), **shape}
        body = int(model["geom_bodyid"][number])
        if body == 0:
            name = bodies.named(0)
            bodies.places.setdefault((name,), part.element.location)
        else:
            name = bodies.names[body]
        shapes = bodies.data[name].setdefault("shapes", [])
        bodies.places[name, "shapes", len(shapes)] = part.element.location
        shapes.append(shape)


def _shape(bodies: MjcfBodies, surfaces: MjcfSurfaces, number: int) -> dict[str, Any] | None:
    model = bodies.model
    element = model.part("geom", number).element
    kind, body = int(model["geom_type"][number]), int(model["geom_bodyid"][number])
    material = surfaces.material(number)
    place, turn = model["geom_pos"][number], model["geom_quat"][number]
    if kind == MESH:
        made = _mesh(bodies, number, material is not None)
        shape, place, turn = made or (None, place, turn)
    elif kind == HEIGHT_FIELD:
        shape = height_field(bodies, number)
    else:
        word, factors = SIZED.get(kind, ("", ()))
        sizes = [factor * float(size) for factor, size in zip(factors, model["geom_size"][number], strict=False)]
        shape = shape_data(word, sizes) if word else None
    if shape is None:
        bodies.features.add("geom.kind" if material is not None else "geom.appearance", element)
        return None
    where = pose(place - bodies.shifts[body], turn)
    if where:
        shape["pose"] = where
    if material is None:
        shape["collision"] = False
    else:
        shape["material"] = material
        if margin := surfaces.margin(number):
            shape["margin"] = margin
        if moving := _moving(bodies, number, place, turn):
            shape["surface_velocity"] = moving
        if int(model["geom_group"][number]) >= HIDDEN:
            shape["visual"] = False
    shape["colour"] = _colour(bodies, number)
    return shape


def _moving(bodies: MjcfBodies, number: int, place: Vector, turn: Vector) -> dict[str, Any]:
    """The velocity of a geom's surface, in the frame of the shape, which of a mesh is not the geom's; ``place``, ``turn``: of
    the shape in the file's frame of the body."""
    field = bodies.model.get("geom_surfacevel")
    if field is None or not field[number].any():
        return {}
    linear, angular = field[number][:3], field[number][3:]
    local_place, local_turn = bodies.model["geom_pos"][number], bodies.model["geom_quat"][number]
    if not (np.array_equal(place, local_place) and np.array_equal(turn, local_turn)):
        linear = linear + np.cross(angular, rotated(inverse(local_turn), place - local_place))
        into = product(inverse(turn), local_turn)
        linear, angular = rotated(into, linear), rotated(into, angular)
    return {name: numbers(value) for name, value in (("linear", linear), ("angular", angular)) if value.any()}


def _mesh(bodies: MjcfBodies, number: int, solid: bool) -> tuple[dict[str, Any], Vector, Vector] | None:
    """The shape of a mesh, and where the frame of its file is in the body's: the compiler moves meshes to their centre.
    None for what the language does not have."""
    model, data = bodies.model, int(bodies.model["geom_dataid"][number])
    mesh = model.meshes.get(data)
    if mesh is None or mesh.path is None or mesh.path.suffix.lower() not in SUFFIXES:
        return None
    flat = min(mesh.extent) < THINNEST * max(mesh.extent)
    scale, origin, rotation = (np.array(values) for values in (mesh.scale, mesh.origin, mesh.turn))
    turned = np.any(rotation[1:])
    if flat or mesh.faces > MOST_FACES or (turned and np.any(scale != scale[0])):
        return None
    turn = product(model["geom_quat"][number], inverse(model["mesh_quat"][data]))
    place = model["geom_pos"][number] - rotated(turn, model["mesh_pos"][data])
    rotation = rotation / np.linalg.norm(rotation)
    place = place - rotated(turn, scale * rotated(inverse(rotation), origin))
    text = os.path.relpath(mesh.path, bodies.folder).replace(os.sep, "/")
    bodies.files[text] = mesh.path
    said: dict[str, Any] = {"file": text}
    if np.any(scale != 1.0):
        said["scale"] = numbers(scale)
    if mesh.hull > MOST_VERTICES:
        said["max_vertices"] = MOST_VERTICES
        bodies.features.add("geom.hull" if solid else "geom.drawn_hull", model.part("geom", number).element)
    return {"mesh": said}, place, product(turn, inverse(rotation))


def _colour(bodies: MjcfBodies, number: int) -> list[float]:
    model = bodies.model
    colour, material = model["geom_rgba"][number], int(model["geom_matid"][number])
    if material >= 0 and list(colour) == [0.5, 0.5, 0.5, 1.0]:
        colour = model["mat_rgba"][material]
    return [round(min(1.0, max(0.0, float(value))), 6) for value in colour]


# Actuators and keys of a compiled model, and what of a model is not carried.

TRANSMISSIONS: Final = (0, 1)
"""Types of transmission that are a hinge or a slide: of a joint, and of one in its parent's frame."""
NONE, FIXED, AFFINE = 0, 0, 1
"""Types of dynamics and bias (none), of gain (fixed), and of bias (affine)."""
NOTE: Final = "they act where `control: {NAME: {actuators: [...]}}` names them"


def add_actuators(bodies: MjcfBodies, constraints: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The actuators of a file, by their names; those that a spec has are carried, the others are reported."""
    model, names, following = bodies.model, MjcfNames(), _following(constraints)
    made: dict[str, dict[str, Any]] = {}
    for number, part in model.parts["actuator"].items():
        words = _words(bodies, number, following) if len(made) < MOST["actuators"] else None
        if words is not None:
            made[names.give(part.name, f"actuator_{number}")] = words
            bodies.features.carry(part.element)
            bodies.features.actuators.add(number)
    return made


def _following(constraints: Mapping[str, Any]) -> set[str]:
    return {constraint["follow"]["joint"] for constraint in constraints.values() if "follow" in constraint}


def _words(bodies: MjcfBodies, number: int, following: set[str]) -> dict[str, Any] | None:
    """The words of a spec for an actuator; None where it has none."""
    model = bodies.model
    joint = int(model["actuator_trnid"][number][0])
    words_of = ("trntype", "dyntype", "gaintype", "biastype")
    transmission, dynamics, gain_type, bias = (int(model[f"actuator_{word}"][number]) for word in words_of)
    if transmission not in TRANSMISSIONS or (dynamics, gain_type) != (NONE, FIXED):
        return None
    if int(model["jnt_type"][joint]) not in (HINGE, SLIDE) or bias not in (NONE, AFFINE):
        return None
    gear, affine = float(model["actuator_gear"][number][0]), bias == AFFINE
    constant, stiffness, damping = (float(value) if affine else 0.0 for value in model["actuator_biasprm"][number][:3])
    if not gear or stiffness > 0.0 or damping > 0.0:
        return None
    limited = bool(model["actuator_forcelimited"][number])
    low, high = (float(end) for end in model["actuator_forcerange"][number])
    if limited and not -low == high > 0.0:
        return None
    name = bodies.joint_name(joint)
    if name in following:
        return None
    # the position of a spec counts from the file's reference
    constant += stiffness * gear * float(model["qpos0"][int(model["jnt_qposadr"][joint])])
    words = {"joint": name, **_law(float(model["actuator_gainprm"][number][0]), constant, stiffness, damping)}
    if gear != 1.0:
        words["gear"] = gear
    if limited:
        words["effort_limit"] = high
    if bool(model["actuator_ctrllimited"][number]):
        low, high = (float(value) for value in model["actuator_ctrlrange"][number])
        words["command_limits"] = numbers([low, high])
        if not low <= 0.0 <= high:
            words["command"] = low if low > 0.0 else high
    return words


def _law(gain: float, constant: float, stiffness: float, damping: float) -> dict[str, Any]:
    """The law of a force gain u + constant + stiffness ℓ + damping ℓ', and its numbers."""
    kp, kd = 0.0 - stiffness, 0.0 - damping
    if kp and gain == kp and not constant:
        return {"kp": kp, **({"kd": kd} if kd else {})}
    if kd and gain == kd and not kp and not constant:
        return {"law": "velocity", "kd": kd}
    if gain == 1.0 and not (constant or kp or kd):
        return {"law": "effort"}
    return {"law": "affine", "gain": gain, "bias": numbers([constant, stiffness, damping])}


# Keys as named states; the activation of actuators is not in them.

MOST_STATES: Final = 1000


def add_states(
    bodies: MjcfBodies,
    constraints: Mapping[str, Any],
    actuators: Mapping[str, Mapping[str, Any]],
    starts: list[LimitStart],
) -> dict[str, dict[str, Any]]:
    """The states of a model of one root, by their names; ``actuators``: those of the spec, by theirs. Joints that a key puts
    beyond their limits are at the nearest limit, and are added to ``starts``. A joint that follows another begins where that
    one says."""
    model, names, following = bodies.model, MjcfNames(), _following(constraints)
    states: dict[str, dict[str, Any]] = {}
    for key in range(min(model.numbers["nkey"], MOST_STATES)):
        moved: list[LimitStart] = []
        state = _state(bodies, model["key_qpos"][key], model["key_qvel"][key], following, moved)
        if state is not None:
            name = model.part("key", key).name
            if commands := _commands(bodies, model["key_ctrl"][key], actuators, name):
                state["commands"] = commands
            given = names.give(name, f"state_{key}")
            states[given] = state
            starts += [replace(entry, state=given, path=("model", "states", given)) for entry in moved]
            bodies.features.states.add(name)
    return states


def _commands(
    bodies: MjcfBodies, inputs: Any, actuators: Mapping[str, Mapping[str, Any]], key: str
) -> dict[str, float]:
    """The inputs of a key as commands of the spec's actuators, where they are others than these have anyway. An input beyond
    the limits acts as the nearest within."""
    model, numbered = bodies.model, list(bodies.model.parts["actuator"])
    if len(inputs) != len(numbered):
        return {}  # actuators with other than one input each
    carried = [number for number in numbered if number in bodies.features.actuators]
    if all(not inputs[number] for number in numbered if number not in bodies.features.actuators):
        bodies.features.commanded.add(key)
    commands = {}
    for number, (name, words) in zip(carried, actuators.items(), strict=True):
        value = float(inputs[number])
        if "command_limits" in words:
            low, high = (float(end) for end in model["actuator_ctrlrange"][number])
            value = min(max(value, low), high)
        if value != words.get("command", 0.0):
            commands[name] = value
    return commands


def _state(
    bodies: MjcfBodies, qpos: Any, qvel: Any, following: set[str], moved: list[LimitStart]
) -> dict[str, Any] | None:
    """A key as a state; None for a joint whose implied name is another's. Joints at a limit, since they would be beyond it, are
    added to ``moved``."""
    model = bodies.model
    state: dict[str, Any] = {}
    positions: dict[str, Any] = {}
    velocities: dict[str, Any] = {}
    for joint in range(model.numbers["njnt"]):
        kind, at, dof, body = (int(model[f"jnt_{word}"][joint]) for word in ("type", "qposadr", "dofadr", "bodyid"))
        body_name = bodies.names[body]
        name = bodies.joints.get(joint)
        if name is None and f"{body_name}_joint" in bodies.joint_names.taken:
            return None  # another joint has its implied name
        name = name or f"{body_name}_joint"
        if kind == FREE:
            turn, spin = np.asarray(qpos[at + 3 : at + 7]), np.asarray(qvel[dof + 3 : dof + 6])
            lever = rotated(turn, bodies.shifts[body])
            angular = rotated(turn, spin)
            state["pose"] = pose(np.asarray(qpos[at : at + 3]) + lever, turn) or {"xyz": [0, 0, 0]}
            if np.any(qvel[dof : dof + 6]):
                linear = np.asarray(qvel[dof : dof + 3]) + np.cross(angular, lever)
                state["velocity"] = {"linear": numbers(linear), "angular": numbers(angular)}
        elif name in following:
            continue
        elif kind == BALL:
            orientation = [float(value) for value in qpos[at : at + 4]]
            largest = bodies.joint_data(joint).get("limits", {}).get("angle", math.pi)
            angle = 2.0 * math.atan2(math.hypot(*orientation[1:]), abs(orientation[0]))
            if angle > largest + ROUND_OFF:
                orientation = list(scaled_to(orientation, largest))
                moved.append(LimitStart(name, (), largest, angle))
            positions[name] = {"quat": numbers(orientation)}
            if np.any(qvel[dof : dof + 3]):
                velocities[name] = numbers(np.asarray(qvel[dof : dof + 3]))
        else:
            reference = float(model["qpos0"][at])
            value = float(qpos[at]) - reference
            if bool(model["jnt_limited"][joint]) and not model.disabled("limit", "constraint"):
                limits = [float(bound) - reference for bound in model["jnt_range"][joint]]
                if within(value, limits) is None:
                    moved.append(LimitStart(name, (), nearest(value, limits), value))
                value = nearest(value, limits)
            positions[name] = value
            if qvel[dof]:
                velocities[name] = float(qvel[dof])
    state |= {key: values for key, values in (("positions", positions), ("velocities", velocities)) if values}
    return state


JOINT: Final = 0
"""The type of transmission that is a joint."""


def outside_the_tree(bodies: MjcfBodies, constraints: dict[str, Any]) -> None:
    """Add sums of joint positions to ``constraints``, and say as features what the spec does not have of the rest."""
    model, features = bodies.model, bodies.features
    if model.has_fluid:
        _say_fluid(bodies)
    add_tendons(bodies, bodies.fixed_tendons, constraints)
    for number, part in model.parts["actuator"].items():
        if _has_inertia(bodies, number):
            features.add("actuator.inertia", part.element, _controller(bodies, number))
        elif number not in features.actuators:
            features.add("actuator", part.element, _controller(bodies, number))
    if model.numbers["nplugin"]:
        features.add("plugin", model.root)


def _say_fluid(bodies: MjcfBodies) -> None:
    """The bodies on which a fluid acts by another law, or by another box, than in the spec."""
    model, features = bodies.model, bodies.features
    for number in np.flatnonzero(model["geom_fluid"][:, 0]).tolist():
        features.add("geom.fluid", model.part("geom", number).element)
    groups: dict[int, list[int]] = {}
    for number in bodies.names:
        groups.setdefault(int(model["body_weldid"][number]), []).append(number)
    for top, members in groups.items():
        heavy = [number for number in members if float(model["body_mass"][number]) > 0.0]
        if top and len(heavy) > 1 and any(_singular(model, number) for number in {top, *heavy}):
            features.add("option.fluid", model.part("body", top).element)


def _singular(model: CompiledMjcf, number: int) -> bool:
    moments = model["body_inertia"][number]
    return float(model["body_mass"][number]) <= 0.0 or float(min(moments)) <= SINGULAR * float(max(moments))


def _has_inertia(bodies: MjcfBodies, number: int) -> bool:
    arrays = (bodies.model.get("actuator_armature"), bodies.model.get("actuator_damping"))
    return any(values is not None and values[number].any() for values in arrays)


def _controller(bodies: MjcfBodies, number: int) -> str:
    """The controller of a spec that acts as an actuator; empty where there is none. The effort is
    g (a u + b₀ + b₁ g q + b₂ g v) with the gear g, the gain a and the input u."""
    model = bodies.model
    joint = int(model["actuator_trnid"][number][0])
    kinds = [int(model[f"actuator_{word}"][number]) for word in ("trntype", "dyntype", "gaintype")]
    if kinds != [JOINT, NONE, FIXED] or joint not in bodies.joints:
        return ""
    gear, gain = float(model["actuator_gear"][number][0]), float(model["actuator_gainprm"][number][0])
    affine = int(model["actuator_biastype"][number]) == AFFINE
    bias = model["actuator_biasprm"][number][:3].astype(float) if affine else (0.0,) * 3
    kp, kd = (-float(value) * gear**2 + 0.0 for value in bias[1:])
    if bias[0] or kp < 0.0 or kd < 0.0 or (kp and gain * gear**2 != kp):
        return ""
    said = [f"joints: [{bodies.joints[joint]}]"]
    if not kp:
        said.append(f"actuator: {'velocity' if kd else 'effort'}")
    said += [f"{word}: {value:.12g}" for word, value in (("kp", kp), ("kd", kd)) if value]
    limit = None
    if bool(model["actuator_forcelimited"][number]):
        limit = float(max(abs(model["actuator_forcerange"][number]))) * abs(gear)
    elif not kp and not kd and bool(model["actuator_ctrllimited"][number]):
        limit = float(max(abs(model["actuator_ctrlrange"][number]))) * abs(gain * gear)
    if limit is not None:
        said.append(f"effort_limit: {limit:.12g}")
    return f"control: {{NAME: {{{', '.join(said)}}}}}"
