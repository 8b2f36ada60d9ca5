"""A world as a stage of USD with the schemas of UsdPhysics: metres, kilograms, z up, every attribute authored.

Attributes of the schemas have single precision. Beside those that would lose digits stand attributes of simspec's own with
the world's doubles (``simspec:NAME``), which its importer takes where the two agree.
"""

from __future__ import annotations

import math
from typing import Final

from simspec.control.native import drives
from simspec.formats.usd.joints import DEGREES, KINDS, Joined, axes, single, stand
from simspec.formats.usd.names import GROUPS, JOINTS, MATERIALS, ROOT, SCENE, Places, Taken, local, model_of, places
from simspec.formats.usd.several import carriers, several
from simspec.formats.usd.shapes import place, shape_prim
from simspec.formats.usd.tree import Prim, Stage
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.frames import sorted_pair
from simspec.world.inertia import principal_axes
from simspec.world.kinematics import is_carrier, joined, poses, rigid_groups, trees
from simspec.world.types import Body, Connect, Frame, Inertial, Material, Pose, Vector3, Weld, World

SMALLEST_MASS: Final = 1e-9
"""kg, of a body that has none: zero means that the file does not say it."""
SMALLEST_MOMENT: Final = 1e-12
"""kg m², for the same reason."""


def stage_of(world: World, nested: bool = False) -> Stage:
    """The file of a world. ``nested``: bodies stand within their parents, else beside each other."""
    return _Writer(world, nested).stage()


class _Writer:
    def __init__(self, world: World, nested: bool):
        self.world, self.nested = world, nested
        self.several = several(world)
        self.left_out = carriers(self.several)
        """Bodies between joints of one body that are one joint in the file."""
        self.places: Places = places(world, nested)
        self.poses = poses(world)
        self.filter = CollisionFilter(world)
        self.drives = {drive.joint: drive for drive in drives(world)}
        self.kinematic = {motion.body for motion in world.motions}
        self.prims: dict[str, Prim] = {}
        """Prims of bodies, by the names of the bodies."""
        taken = Taken(path.rpartition("/")[2] for path in self.places.joints.values())
        self.loops = {one.name: f"/{ROOT}/{JOINTS}/{taken.give(one.name)}" for one in world.constraints}
        self.frames: dict[str, list[Frame]] = {}
        """By the names of their bodies."""
        for frame in world.frames:
            self.frames.setdefault(frame.body, []).append(frame)
        self.shapes: dict[str, list[str]] = {}
        """Paths of shapes that collide, by their body."""

    def stage(self) -> Stage:
        root = Prim(ROOT, "Xform")
        root.own("string", "world", self.world.name)
        root.children.append(self._scene())
        if self.world.contact.materials:
            root.children.append(
                Prim(MATERIALS, "Scope", children=[self._material(one) for one in self.world.contact.materials])
            )
        loose: list[Prim] = []
        for bodies in trees(self.world).values():
            self._tree(root, bodies, loose)
        loose += [self._loop(constraint) for constraint in self.world.constraints if constraint.kind != "follow"]
        if loose:
            root.children.append(Prim(JOINTS, "Scope", children=loose))
        self._filters()
        if self.places.groups.keys() - {"default"} or self._ignored():
            root.children.append(Prim(GROUPS, "Scope", children=[self._group(name) for name in self.places.groups]))
        return Stage(self.world.name, root)

    def _scene(self) -> Prim:
        scene = Prim(SCENE, "PhysicsScene")
        gravity = self.world.physics.gravity
        size = math.sqrt(frames.dot(gravity, gravity))
        along = (gravity[0] / size, gravity[1] / size, gravity[2] / size) if size else (0.0, 0.0, -1.0)
        scene.say("vector3f", "physics:gravityDirection", along)
        scene.say("float", "physics:gravityMagnitude", size)
        scene.own("double3", "gravity", gravity)
        scene.own("double", "timestep", self.world.physics.timestep)
        return scene

    def _material(self, material: Material) -> Prim:
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
        prim.own("double", "friction", law.friction)
        prim.own("double", "restitution", law.restitution)
        return prim

    def _named(self, path: str, kind: str, name: str) -> Prim:
        """A prim for something of a name, which it says where the path cannot."""
        prim = Prim(path.rpartition("/")[2], kind)
        if prim.name != name:
            prim.own("string", "name", name)
        return prim

    # --- trees --------------------------------------------------------------------------------------------------

    def _tree(self, root: Prim, bodies: tuple[Body, ...], loose: list[Prim]) -> None:
        model = model_of(bodies)
        base, joints = root, loose
        if model is not None:
            base = self._named(self.places.models[bodies[0].name], "Xform", model)
            root.children.append(base)
            joints = []
        still = is_still(bodies)
        bodies = tuple(body for body in bodies if body.name not in self.left_out)
        for body in bodies:
            prim = self._body(body, model, still)
            self.prims[body.name] = prim
            parent = self._above(body)
            (self.prims[parent] if self.nested and parent is not None else base).children.append(prim)
            if not still and body.joint.kind != "free":
                joints.append(self._joint(body, model))
        for body in bodies:
            self._shapes(body)
        if len(bodies) > 1:
            first = joints[-len(bodies)] if bodies[0].joint.kind != "free" else self.prims[bodies[0].name]
            (base if model is not None else first).apply("PhysicsArticulationRootAPI")
        if model is not None and joints:
            base.children.append(Prim(JOINTS, "Scope", children=joints))

    def _body(self, body: Body, model: str | None, still: bool) -> Prim:
        prim = self._named(self.places.bodies[body.name], "Xform", local(body.name, model))
        joint = body.joint
        if not still:
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
                prim.own("double3", "velocity", linear)
                prim.own("double3", "angular_velocity", angular)
            if free and joint.name != f"{body.name}_joint":
                prim.own("string", "joint_name", local(joint.name, model))
            _mass(prim, body.inertial, alone=not is_carrier(body.name))
        _place(prim, self.poses[body.name], reset=self.nested and self._above(body) is not None)
        return prim

    def _shapes(self, body: Body) -> None:
        prim = self.prims[body.name]
        taken = Taken((JOINTS, *(child.name for child in prim.children)))
        paths = self.shapes.setdefault(body.name, [])
        base = f"{body.model}/" if body.name.startswith(f"{body.model}/") else ""
        for shape in body.shapes:
            made = shape_prim(shape, self.places.materials.get(shape.material, ""))
            if made is None:
                continue
            plain = shape.name.removeprefix(base)
            made.name = taken.give(plain)
            if made.name != plain:
                made.own("string", "name", plain)
            prim.children.append(made)
            if shape.collision:
                paths.append(f"{self.places.bodies[body.name]}/{made.name}")
        for frame in self.frames.get(body.name, ()):
            plain = frame.name.removeprefix(base)
            made = Prim(taken.give(plain), "Xform")
            if made.name != plain:
                made.own("string", "name", plain)
            made.own("bool", "frame", True)
            place(made, frame.pose, [])
            prim.children.append(made)

    def _joint(self, body: Body, model: str | None) -> Prim:
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
            axes(prim, chain, joined, [local(one.name, model) for one in chain.joints], self.drives)
        return prim

    def _above(self, body: Body) -> str | None:
        """The body that a body stands on in the file."""
        chain = self.several.get(body.name)
        return body.joint.parent if chain is None else chain.parent

    # --- what is outside the trees ------------------------------------------------------------------------------

    def _loop(self, constraint: Connect | Weld) -> Prim:
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
            prim.own("double3", "second_point", constraint.second_point)
        prim.own("double3", "origin", first.position)
        prim.own("quatd", "orientation", first.quaternion)
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
                for i, one in enumerate(names)
                for other in names[i + 1 :]
                if (pair := sorted_pair(one, other)) not in quiet
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

    def _group(self, name: str) -> Prim:
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


def is_still(bodies: tuple[Body, ...]) -> bool:
    """Whether a tree is one body that is fixed to the world, without mass: shapes without a rigid body say the same."""
    body = bodies[0]
    return (
        len(bodies) == 1
        and body.joint.kind == "fixed"
        and not body.inertial.mass
        and body.joint.name == f"{body.name}_joint"
    )


def _place(prim: Prim, pose: Pose, reset: bool = False) -> None:
    place(prim, pose, ["!resetXformStack!"] if reset else [])


def _mass(prim: Prim, inertial: Inertial, alone: bool) -> None:
    """Mass properties; those of a body that stands between joints (not ``alone``) are the ones that are written."""
    moments, turn = principal_axes(inertial.inertia)
    prim.say("float", "physics:mass", max(inertial.mass, SMALLEST_MASS))
    prim.say("float", "physics:density", 0.0)
    prim.say("point3f", "physics:centerOfMass", inertial.centre_of_mass)
    prim.say("float3", "physics:diagonalInertia", tuple(max(moment, SMALLEST_MOMENT) for moment in moments))
    prim.say("quatf", "physics:principalAxes", turn)
    if not alone and not inertial.mass:
        return
    prim.own("double", "mass", inertial.mass)
    prim.own("double3", "centre_of_mass", inertial.centre_of_mass)
    prim.own("double[]", "inertia", list(inertial.inertia))
