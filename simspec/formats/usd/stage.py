"""A world as a stage of USD with the schemas of UsdPhysics: metres, kilograms, z up, every attribute authored.

Attributes of the schemas have single precision. Attributes ``simspec:NAME`` next to them have the doubles of the world; the
importer takes them where the two agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from simspec.control.reference import drives
from simspec.formats.usd.joints import DEGREES, KINDS, Joined, axes, carriers, several, single, stand
from simspec.formats.usd.text import UsdPrim, UsdProperty, UsdStage
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter, solid_shapes
from simspec.world.frames import sorted_pair
from simspec.world.inertia import principal_axes
from simspec.world.kinematics import is_carrier, joined, poses, rigid_groups, trees
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Frame,
    Inertial,
    Material,
    Pose,
    Shape,
    Vector3,
    WeldConstraint,
    World,
)

ROOT: Final = "World"
JOINTS: Final = "joints"
MATERIALS: Final = "materials"
GROUPS: Final = "groups"
SCENE: Final = "physics_scene"
RESERVED: Final = (JOINTS, MATERIALS, GROUPS, SCENE)
_NOT_ALLOWED: Final = re.compile(r"[^A-Za-z0-9_]")


class PrimNames:
    """Names within one prim, each once."""

    def __init__(self, reserved: Iterable[str] = ()):
        self._taken = set(reserved)

    def give(self, wanted: str) -> str:
        """A name that USD allows, like ``wanted``."""
        plain = _NOT_ALLOWED.sub("_", wanted)
        if plain[0].isdigit():
            plain = f"_{plain}"
        name, count = plain, 2
        while name in self._taken:
            name, count = f"{plain}_{count}", count + 1
        self._taken.add(name)
        return name


@dataclass
class PrimPaths:
    """Where everything of a world stands: paths of prims by the names of bodies, joints, materials and groups."""

    models: dict[str, str] = field(default_factory=dict)
    """Of the trees that are models of their own, by the name of the root."""
    bodies: dict[str, str] = field(default_factory=dict)
    joints: dict[str, str] = field(default_factory=dict)
    """By the name of the body that the joint moves."""
    materials: dict[str, str] = field(default_factory=dict)
    groups: dict[str, str] = field(default_factory=dict)


def model_of(bodies: tuple[Body, ...]) -> str | None:
    """The name of the model that a tree is; None for a tree of loose bodies."""
    name = bodies[0].model
    return name if all(body.name.startswith(f"{name}/") for body in bodies) else None


def local(name: str, model: str | None) -> str:
    """A name within its model."""
    return name if model is None else name.removeprefix(f"{model}/")


def places(world: World, nested: bool) -> PrimPaths:
    """Paths for a world; ``nested``: bodies stand within their parents."""
    found = PrimPaths()
    chains = several(world)
    left_out = carriers(chains)
    outer, outer_joints = PrimNames(RESERVED), PrimNames()
    for root, bodies in trees(world).items():
        model = model_of(bodies)
        base, names, joints = f"/{ROOT}", outer, outer_joints
        if model is not None:
            base = found.models[root] = f"/{ROOT}/{outer.give(model)}"
            names, joints = PrimNames(RESERVED), PrimNames()
        inside: dict[str, PrimNames] = {}
        for body in bodies:
            if body.name in left_out:
                continue
            chain = chains.get(body.name)
            parent = body.joint.parent if chain is None else chain.parent
            if nested and parent is not None:
                # shapes of the parent are siblings: they are numbered after the bodies
                values = inside.setdefault(parent, PrimNames(RESERVED))
                found.bodies[body.name] = f"{found.bodies[parent]}/{values.give(local(body.name, model))}"
            else:
                found.bodies[body.name] = f"{base}/{names.give(local(body.name, model))}"
            found.joints[body.name] = f"{base}/{JOINTS}/{joints.give(local(body.joint.name, model))}"
    values = PrimNames()
    for material in world.contact.materials:
        found.materials[material.name] = f"/{ROOT}/{MATERIALS}/{values.give(material.name)}"
    values = PrimNames()
    for name in sorted(
        {body.collision_group for body in world.bodies if solid_shapes(body)}
    ):  # readers drop empty ones
        found.groups[name] = f"/{ROOT}/{GROUPS}/{values.give(name)}"
    return found


# --- shapes ---

TYPES: Final = {
    "sphere": "Sphere",
    "box": "Cube",
    "cylinder": "Cylinder",
    "capsule": "Capsule",
    "plane": "Plane",
    "mesh": "Mesh",
}
PLANE: Final = 200.0
"""m; how far a plane is drawn: it collides without end."""


def place(prim: UsdPrim, pose: Pose, before: Sequence[str] = (), scale: Vector3 | None = None) -> None:
    """Where a prim stands in the one that it is in."""
    prim.say("double3", "xformOp:translate", pose.position)
    prim.say("quatd", "xformOp:orient", pose.quaternion)
    order = [*before, "xformOp:translate", "xformOp:orient"]
    if scale is not None:
        prim.say("double3", "xformOp:scale", scale)
        order.append("xformOp:scale")
    prim.properties.append(UsdProperty("token[]", "xformOpOrder", order, uniform=True))


def shape_prim(shape: Shape, material: str) -> UsdPrim | None:
    """The prim of a shape; None for a kind that the schemas do not have. ``material``: the path of its material."""
    kind = TYPES.get(shape.kind)
    if kind is None:
        return None
    prim = UsdPrim(shape.name, kind)
    scale: Vector3 | None = None
    size = shape.size
    match shape.kind:
        case "sphere":
            prim.say("double", "radius", size[0])
            _extent(prim, (size[0],) * 3)
        case "box":
            prim.say("double", "size", 1.0)
            scale = (size[0], size[1], size[2])
            _extent(prim, (0.5,) * 3)
        case "cylinder" | "capsule":
            prim.uniform("axis", "Z")
            prim.say("double", "radius", size[0])
            prim.say("double", "height", size[1])
            cap = size[0] if shape.kind == "capsule" else 0.0
            _extent(prim, (size[0], size[0], 0.5 * size[1] + cap))
        case "plane":
            prim.uniform("axis", "Z")
            prim.say("double", "width", PLANE)
            prim.say("double", "length", PLANE)
            _extent(prim, (0.5 * PLANE, 0.5 * PLANE, 0.0))
        case "mesh":
            _mesh(prim, size)
    place(prim, shape.pose, scale=scale)
    red, green, blue, opacity = shape.colour
    prim.say("color3f[]", "primvars:displayColor", [(red, green, blue)])
    prim.say("float[]", "primvars:displayOpacity", [opacity])
    prim.custom("double4", "colour", shape.colour)
    prim.uniform("purpose", "default" if shape.visual else "guide")
    if shape.collision:
        prim.apply("PhysicsCollisionAPI", "MaterialBindingAPI")
        prim.say("bool", "physics:collisionEnabled", True)
        if material:
            prim.relate("material:binding:physics", [material])
        if shape.kind == "mesh":
            prim.apply("PhysicsMeshCollisionAPI")
            prim.uniform("physics:approximation", "convexHull")
    return prim


def _extent(prim: UsdPrim, half: Sequence[float]) -> None:
    prim.say("float3[]", "extent", [tuple(-value for value in half), tuple(half)])


def _mesh(prim: UsdPrim, size: Sequence[float]) -> None:
    """A hull: triangles, anticlockwise from outside."""
    from simspec.world.hull import mesh_triangles

    triangles = mesh_triangles(tuple(size)).tolist()
    points = [tuple(size[start : start + 3]) for start in range(0, len(size), 3)]
    low, high = (tuple(limit(point[k] for point in points) for k in range(3)) for limit in (min, max))
    prim.say("float3[]", "extent", [low, high])
    prim.say("point3f[]", "points", points)
    prim.say("int[]", "faceVertexCounts", [3] * len(triangles))
    prim.say("int[]", "faceVertexIndices", [index for triangle in triangles for index in triangle])
    prim.uniform("subdivisionScheme", "none")
    prim.custom("double3[]", "points", points)


# --- the stage ---

SMALLEST_MASS: Final = 1e-9
"""kg, of a body that has none: zero means that the file does not say it."""
SMALLEST_MOMENT: Final = 1e-12
"""kg m², for the same reason."""


def stage_of(world: World, nested: bool = False) -> UsdStage:
    """The file of a world. ``nested``: bodies stand within their parents, else as siblings."""
    return _Writer(world, nested).stage()


class _Writer:
    def __init__(self, world: World, nested: bool):
        self.world, self.nested = world, nested
        self.several = several(world)
        self.left_out = carriers(self.several)
        """Bodies between joints of one body that are one joint in the file."""
        self.places: PrimPaths = places(world, nested)
        self.poses = poses(world)
        self.filter = CollisionFilter(world)
        self.drives = {drive.joint: drive for drive in drives(world)}
        self.kinematic = {motion.body for motion in world.motions}
        self.prims: dict[str, UsdPrim] = {}
        """Prims of bodies, by the names of the bodies."""
        taken = PrimNames(path.rpartition("/")[2] for path in self.places.joints.values())
        self.loops = {
            constraint.name: f"/{ROOT}/{JOINTS}/{taken.give(constraint.name)}" for constraint in world.constraints
        }
        self.frames: dict[str, list[Frame]] = {}
        """By the names of their bodies."""
        for frame in world.frames:
            self.frames.setdefault(frame.body, []).append(frame)
        self.shapes: dict[str, list[str]] = {}
        """Paths of shapes that collide, by their body."""

    def stage(self) -> UsdStage:
        root = UsdPrim(ROOT, "Xform")
        root.custom("string", "world", self.world.name)
        root.children.append(self._scene())
        if self.world.contact.materials:
            root.children.append(
                UsdPrim(
                    MATERIALS, "Scope", children=[self._material(material) for material in self.world.contact.materials]
                )
            )
        loose: list[UsdPrim] = []
        for bodies in trees(self.world).values():
            self._tree(root, bodies, loose)
        loose += [self._loop(constraint) for constraint in self.world.constraints if constraint.kind != "follow"]
        if loose:
            root.children.append(UsdPrim(JOINTS, "Scope", children=loose))
        self._filters()
        if self.places.groups.keys() - {"default"} or self._ignored():
            root.children.append(UsdPrim(GROUPS, "Scope", children=[self._group(name) for name in self.places.groups]))
        return UsdStage(self.world.name, root)

    def _scene(self) -> UsdPrim:
        scene = UsdPrim(SCENE, "PhysicsScene")
        gravity = self.world.physics.gravity
        size = math.sqrt(frames.dot(gravity, gravity))
        along = (gravity[0] / size, gravity[1] / size, gravity[2] / size) if size else (0.0, 0.0, -1.0)
        scene.say("vector3f", "physics:gravityDirection", along)
        scene.say("float", "physics:gravityMagnitude", size)
        scene.custom("double3", "gravity", gravity)
        scene.custom("double", "timestep", self.world.physics.timestep)
        return scene

    def _material(self, material: Material) -> UsdPrim:
        law = next(pair for pair in self.world.contact.pairs if pair.first == pair.second == material.name)
        prim = self._named(self.places.materials[material.name], "Material", material.name)
        prim.apply("PhysicsMaterialAPI")
        for name, value in (
            ("staticFriction", law.friction),
            ("dynamicFriction", law.friction),
            ("restitution", law.restitution),
        ):
            prim.say("float", f"physics:{name}", value)
        prim.say("float", "physics:density", 0.0)
        prim.custom("double", "friction", law.friction)
        prim.custom("double", "restitution", law.restitution)
        return prim

    def _named(self, path: str, kind: str, name: str) -> UsdPrim:
        """A prim for something of a name, which it says where the path cannot."""
        prim = UsdPrim(path.rpartition("/")[2], kind)
        if prim.name != name:
            prim.custom("string", "name", name)
        return prim

    # --- trees --------------------------------------------------------------------------------------------------

    def _tree(self, root: UsdPrim, bodies: tuple[Body, ...], loose: list[UsdPrim]) -> None:
        model = model_of(bodies)
        base, joints = root, loose
        if model is not None:
            base = self._named(self.places.models[bodies[0].name], "Xform", model)
            root.children.append(base)
            joints = []
        static = is_static(bodies)
        bodies = tuple(body for body in bodies if body.name not in self.left_out)
        for body in bodies:
            prim = self._body(body, model, static)
            self.prims[body.name] = prim
            parent = self._above(body)
            (self.prims[parent] if self.nested and parent is not None else base).children.append(prim)
            if not static and body.joint.kind != "free":
                joints.append(self._joint(body, model))
        for body in bodies:
            self._shapes(body)
        if len(bodies) > 1:
            first = joints[-len(bodies)] if bodies[0].joint.kind != "free" else self.prims[bodies[0].name]
            (base if model is not None else first).apply("PhysicsArticulationRootAPI")
        if model is not None and joints:
            base.children.append(UsdPrim(JOINTS, "Scope", children=joints))

    def _body(self, body: Body, model: str | None, static: bool) -> UsdPrim:
        prim = self._named(self.places.bodies[body.name], "Xform", local(body.name, model))
        joint = body.joint
        if not static:
            prim.apply("PhysicsRigidBodyAPI", "PhysicsMassAPI")
            prim.say("bool", "physics:rigidBodyEnabled", True)
            prim.say("bool", "physics:kinematicEnabled", body.name in self.kinematic)
            prim.say("bool", "physics:startsAsleep", False)
            free = joint.kind == "free"
            linear: Vector3 = joint.velocity[:3] if free else (0.0, 0.0, 0.0)  # type: ignore[assignment]
            angular: Vector3 = joint.velocity[3:] if free else (0.0, 0.0, 0.0)  # type: ignore[assignment]
            prim.say("vector3f", "physics:velocity", linear)
            prim.say("vector3f", "physics:angularVelocity", tuple(DEGREES * value for value in angular))
            if free and any(joint.velocity):
                prim.custom("double3", "velocity", linear)
                prim.custom("double3", "angular_velocity", angular)
            if free and joint.name != f"{body.name}_joint":
                prim.custom("string", "joint_name", local(joint.name, model))
            _mass(prim, body.inertial, alone=not is_carrier(body.name))
        _place(prim, self.poses[body.name], reset=self.nested and self._above(body) is not None)
        return prim

    def _shapes(self, body: Body) -> None:
        prim = self.prims[body.name]
        taken = PrimNames((JOINTS, *(child.name for child in prim.children)))
        paths = self.shapes.setdefault(body.name, [])
        base = f"{body.model}/" if body.name.startswith(f"{body.model}/") else ""
        for shape in body.shapes:
            made = shape_prim(shape, self.places.materials.get(shape.material, ""))
            if made is None:
                continue
            plain = shape.name.removeprefix(base)
            made.name = taken.give(plain)
            if made.name != plain:
                made.custom("string", "name", plain)
            prim.children.append(made)
            if shape.collision:
                paths.append(f"{self.places.bodies[body.name]}/{made.name}")
        for frame in self.frames.get(body.name, ()):
            plain = frame.name.removeprefix(base)
            made = UsdPrim(taken.give(plain), "Xform")
            if made.name != plain:
                made.custom("string", "name", plain)
            made.custom("bool", "frame", True)
            place(made, frame.pose, [])
            prim.children.append(made)

    def _joint(self, body: Body, model: str | None) -> UsdPrim:
        joint, chain = body.joint, self.several.get(body.name)
        kind = "" if chain is not None else KINDS[joint.kind]
        prim = self._named(self.places.joints[body.name], f"Physics{kind}Joint", local(joint.name, model))
        above = self._above(body)
        parent = None if above is None else self.places.bodies[above]
        touching = above is not None and self.filter.may_touch(above, body.name)
        joined = Joined(parent, self.places.bodies[body.name], touching=touching)
        if chain is None:
            single(prim, joint, joined, self.drives)
        else:
            axes(prim, chain, joined, [local(joint.name, model) for joint in chain.joints], self.drives)
        return prim

    def _above(self, body: Body) -> str | None:
        """The body that a body stands on in the file."""
        chain = self.several.get(body.name)
        return body.joint.parent if chain is None else chain.parent

    # --- what is outside the trees ------------------------------------------------------------------------------

    def _loop(self, constraint: ConnectConstraint | WeldConstraint) -> UsdPrim:
        kind = "Spherical" if constraint.kind == "connect" else "Fixed"
        prim = self._named(self.loops[constraint.name], f"Physics{kind}Joint", constraint.name)
        if constraint.kind == "connect":
            first, second = Pose(constraint.first_point), Pose(constraint.second_point)
        else:
            first, second = constraint.pose, Pose()
        bodies = self.places.bodies
        touching = self.filter.may_touch(constraint.first, constraint.second)
        between = Joined(bodies[constraint.first], bodies[constraint.second], touching=touching, loop=True)
        stand(prim, between, first, second)
        if constraint.kind == "connect":
            prim.uniform("physics:axis", "X")
            prim.say("float", "physics:coneAngle0Limit", -1.0)
            prim.say("float", "physics:coneAngle1Limit", -1.0)
            prim.custom("double3", "second_point", constraint.second_point)
        prim.custom("double3", "origin", first.position)
        prim.custom("quatd", "orientation", first.quaternion)
        return prim

    def _filters(self) -> None:
        """Pairs of bodies that do not touch, but those that joints join; bodies that are one rigid thing do not either."""
        quiet = joined(self.world.bodies)
        for constraint in self.world.constraints:
            if constraint.kind != "follow":
                quiet.add(sorted_pair(constraint.first, constraint.second))
        pairs = {pair for pair in self.world.contact.excluded_bodies if pair not in quiet}
        rigid: dict[str, list[str]] = {}
        for name, group in rigid_groups(self.world).items():
            if group != "world" and self.shapes.get(name):
                rigid.setdefault(group, []).append(name)
        for names in rigid.values():
            pairs |= {
                pair
                for i, name in enumerate(names)
                for other in names[i + 1 :]
                if (pair := sorted_pair(name, other)) not in quiet
            }
        targets: dict[str, list[str]] = {}
        for first, second in sorted(pairs):
            targets.setdefault(first, []).append(self.places.bodies[second])
        for name, others in targets.items():
            self.prims[name].apply("PhysicsFilteredPairsAPI")
            self.prims[name].relate("physics:filteredPairs", others)

    def _ignored(self) -> list[tuple[str, str]]:
        """The pairs of groups that ignore each other and both have colliders."""
        known = self.places.groups.keys()
        return [pair for pair in self.world.contact.ignored_groups if known >= set(pair)]

    def _group(self, name: str) -> UsdPrim:
        prim = self._named(self.places.groups[name], "PhysicsCollisionGroup", name)
        prim.apply("CollectionAPI:colliders")
        prim.say("bool", "physics:invertFilteredGroups", False)
        ignored = sorted(
            {
                other
                for pair in self._ignored()
                for other in pair
                if name in pair and (other != name or pair == (name, name))
            }
        )
        members = [
            path for body in self.world.bodies if body.collision_group == name for path in self.shapes[body.name]
        ]
        if ignored:
            prim.relate("physics:filteredGroups", [self.places.groups[other] for other in ignored])
        if members:
            prim.uniform("collection:colliders:expansionRule", "explicitOnly")
            prim.relate("collection:colliders:includes", members)
        return prim


def is_static(bodies: tuple[Body, ...]) -> bool:
    """Whether a tree is one body that is fixed to the world, without mass: shapes without a rigid body say the same."""
    body = bodies[0]
    return (
        len(bodies) == 1
        and body.joint.kind == "fixed"
        and not body.inertial.mass
        and body.joint.name == f"{body.name}_joint"
    )


def _place(prim: UsdPrim, pose: Pose, reset: bool = False) -> None:
    place(prim, pose, ["!resetXformStack!"] if reset else [])


def _mass(prim: UsdPrim, inertial: Inertial, alone: bool) -> None:
    """Mass properties; those of a body that stands between joints (not ``alone``) are the ones that are written."""
    moments, turn = principal_axes(inertial.inertia)
    prim.say("float", "physics:mass", max(inertial.mass, SMALLEST_MASS))
    prim.say("float", "physics:density", 0.0)
    prim.say("point3f", "physics:centerOfMass", inertial.centre_of_mass)
    prim.say("float3", "physics:diagonalInertia", tuple(max(moment, SMALLEST_MOMENT) for moment in moments))
    prim.say("quatf", "physics:principalAxes", turn)
    if not alone and not inertial.mass:
        return
    prim.custom("double", "mass", inertial.mass)
    prim.custom("double3", "centre_of_mass", inertial.centre_of_mass)
    prim.custom("double[]", "inertia", list(inertial.inertia))
