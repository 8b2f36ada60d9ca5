"""Names and places of the prims of a world."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from simspec.formats.usd.several import carriers, several
from simspec.world.contact_pairs import solid_shapes
from simspec.world.kinematics import trees
from simspec.world.types import Body, World

ROOT: Final = "World"
JOINTS: Final = "joints"
MATERIALS: Final = "materials"
GROUPS: Final = "groups"
SCENE: Final = "physics_scene"
RESERVED: Final = (JOINTS, MATERIALS, GROUPS, SCENE)
_ODD: Final = re.compile(r"[^A-Za-z0-9_]")


class Taken:
    """Names within one prim, each once."""

    def __init__(self, reserved: Iterable[str] = ()):
        self._taken = set(reserved)

    def give(self, wanted: str) -> str:
        """A name that USD allows, like ``wanted``."""
        plain = _ODD.sub("_", wanted)
        if plain[0].isdigit():
            plain = f"_{plain}"
        name, count = plain, 2
        while name in self._taken:
            name, count = f"{plain}_{count}", count + 1
        self._taken.add(name)
        return name


@dataclass
class Places:
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


def places(world: World, nested: bool) -> Places:
    """Paths for a world; ``nested``: bodies stand within their parents."""
    found = Places()
    chains = several(world)
    left_out = carriers(chains)
    outer, outer_joints = Taken(RESERVED), Taken()
    for root, bodies in trees(world).items():
        model = model_of(bodies)
        base, names, joints = f"/{ROOT}", outer, outer_joints
        if model is not None:
            base = found.models[root] = f"/{ROOT}/{outer.give(model)}"
            names, joints = Taken(RESERVED), Taken()
        inside: dict[str, Taken] = {}
        for body in bodies:
            if body.name in left_out:
                continue
            chain = chains.get(body.name)
            parent = body.joint.parent if chain is None else chain.parent
            if nested and parent is not None:
                # shapes of the parent stand beside: they are numbered after the bodies
                own = inside.setdefault(parent, Taken(RESERVED))
                found.bodies[body.name] = f"{found.bodies[parent]}/{own.give(local(body.name, model))}"
            else:
                found.bodies[body.name] = f"{base}/{names.give(local(body.name, model))}"
            found.joints[body.name] = f"{base}/{JOINTS}/{joints.give(local(body.joint.name, model))}"
    own = Taken()
    for material in world.contact.materials:
        found.materials[material.name] = f"/{ROOT}/{MATERIALS}/{own.give(material.name)}"
    own = Taken()
    for name in sorted(
        {body.collision_group for body in world.bodies if solid_shapes(body)}
    ):  # readers drop empty ones
        found.groups[name] = f"/{ROOT}/{GROUPS}/{own.give(name)}"
    return found
