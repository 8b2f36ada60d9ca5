"""The world itself as JSON: for engines that are built by calls of their API, and have no file language.

``world.json`` holds what acts and nothing else, in SI units: bodies in the world's order with their joints and shapes, of each
collision shape the copies that the contact plan asks for with their numbers, which materials meet in which layer, and which
bodies and collision groups do not touch. Of a joint it holds the fields that its kind has (``JOINT_FIELDS``). Free roots have
their frame at the centre of mass, as in every format (``passes.recentre_free_roots``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from simspec.contact.meeting import solid_shapes
from simspec.contact.plan import ContactPlan
from simspec.dialects.kit.contract import Dialect
from simspec.dialects.kit.sidecar import SIDECAR, sidecar, sidecar_text
from simspec.dialects.kit.target import Target
from simspec.formats.kit.passes import excluded_pairs_to_write, recentre_free_roots
from simspec.support.declarations import EXACT, Table, unsupported
from simspec.support.features import Feature
from simspec.world.types import Body, Joint, ReadBack, Shape, World

WORLD = "world.json"
SCHEMA = 1

_STATE = ("position", "velocity")
_LOSSES = ("damping", "spring_stiffness")
_DRIVEN = (
    *("axis", "position_limits", "velocity_limit", "effort_limit", *_LOSSES, "spring_rest", "dry_friction", "armature"),
    *_STATE,
)
JOINT_FIELDS: Mapping[str, tuple[str, ...]] = {
    "fixed": ("parent", "origin"),
    "hinge": ("parent", "origin", *_DRIVEN),
    "slide": ("parent", "origin", *_DRIVEN),
    "ball": ("parent", "origin", *_LOSSES, *_STATE),
    "free": _STATE,
}
"""The fields of each kind of joint beside its name and kind."""


class DrakeDialect(Dialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "drake"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = dict.fromkeys(Feature, EXACT) | {
        Feature.CONTROL_NATIVE: unsupported("world.json has no gains of controllers yet"),
    }

    def emit(self, world: World, target: Target) -> dict[str, str]:
        """``world.json`` and ``sidecar.json``."""
        moved, offsets = recentre_free_roots(world)
        copies = {
            (shape.material, layer)
            for body in world.bodies
            for shape in solid_shapes(body)
            for layer in target.plan.layers(shape.material)
        }
        used = {body.collision_group for body in world.bodies if solid_shapes(body)}
        content = {
            "schema": SCHEMA,
            "gravity": world.physics.gravity,
            "timestep": world.physics.timestep,
            "friction_cone": world.contact.friction_cone,
            "bodies": [_body(body, target.plan) for body in moved.bodies],
            "meets": [
                [*pair, layer]
                for pair, layer in sorted(target.plan.layer_of.items())
                if {(material, layer) for material in pair} <= copies
            ],
            "apart": {
                "bodies": excluded_pairs_to_write(world),
                "groups": [pair for pair in world.contact.ignored_groups if set(pair) <= used],
            },
        }
        return {WORLD: sidecar_text(content), SIDECAR: sidecar_text(sidecar(self.FORMAT, world, target, offsets))}

    def read(self, folder: Path) -> ReadBack:
        """Read ``world.json`` (see ``dialects/drake/reading.py``)."""
        from simspec.dialects.drake.reading import read_folder

        return read_folder(folder)


def _body(body: Body, plan: ContactPlan) -> dict[str, Any]:
    return {
        "name": body.name,
        "model": body.model,
        "group": body.collision_group,
        "mass": body.inertial.mass,
        "centre_of_mass": body.inertial.centre_of_mass,
        "inertia": body.inertial.inertia,
        "joint": _joint(body.joint),
        "shapes": [_shape(shape, plan) for shape in body.shapes],
    }


def _joint(joint: Joint) -> dict[str, Any]:
    fields = {name: getattr(joint, name) for name in JOINT_FIELDS[joint.kind]}
    return {"name": joint.name, "kind": joint.kind, **fields}


def _shape(shape: Shape, plan: ContactPlan) -> dict[str, Any]:
    """A shape; one that is not solid has no copies, one that cannot be seen no colour."""
    copies = []
    if shape.collision:
        for layer in plan.layers(shape.material):
            numbers = dataclasses.asdict(plan.numbers[shape.material, layer])
            if numbers["hardness"] is None:
                del numbers["hardness"]
            copies.append({"layer": layer, **numbers})
    return {
        "name": shape.name,
        "kind": shape.kind,
        "size": shape.size,
        "pose": shape.pose,
        "material": shape.material if shape.collision else "",
        "colour": shape.colour if shape.visual else None,
        "copies": copies,
    }
