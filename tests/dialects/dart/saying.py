"""Worlds said to DART, and what its reader is held against."""

from __future__ import annotations

import dataclasses
import json
import math
from xml.etree import ElementTree

from simspec.compiler import target_of
from simspec.dialects.dart.dialect import DartDialect
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.dart.engine import Dart
from simspec.formats.skel.format import WORLD
from simspec.proof.comparator import compare
from simspec.proof.selftest_worlds import surfaces
from simspec.world.types import Contact, Material, PairContact, Pose, Shape
from tests import worlds

SMALL = 3e-4
"""An initial rotation (rad) in the range that DART turns by a Taylor form."""


def target(world):
    return target_of(world, Dart)


SHAPES = tuple(f"shape.{kind}" for kind in ("box", "cylinder", "capsule", "ellipsoid", "plane"))


def emit(world):
    """The files, with the contact of every pair of shapes accepted: no detector of DART is sound for all."""
    given = world.options("dart")
    accepted = worlds.with_options(
        world, "dart", settings=given.settings, outside=given.outside, accept=(*given.accept, *SHAPES)
    )
    return DartDialect().emit(accepted, target(accepted))


def failures(world, actual, text=False):
    """The checks of the comparator that fail, as (name, place)."""
    checks = compare(world, actual, Dart.RULES, Dart.LAYERS, text=text)
    assert len(checks) > 5
    return [(check.name, check.where) for check in checks if not check.passed]


def change_joint(world, index, **changes):
    """The world with some fields of one body's joint changed."""
    body = world.bodies[index]
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, **changes))
    return dataclasses.replace(world, bodies=(*world.bodies[:index], body, *world.bodies[index + 1 :]))


def two_materials():
    """Two materials on one body, above a floor of a third: frictions by min, restitutions by product."""
    base = worlds.shapes_world(("box", "sphere"))
    names = ("ground", "rough", "slick")
    friction = {("ground", "rough"): 0.7, ("ground", "slick"): 0.1}
    pairs = tuple(
        PairContact(name, other, friction.get((name, other), 0.7 if "slick" not in (name, other) else 0.1), 0.25)
        for index, name in enumerate(names)
        for other in names[index:]
    )
    floor, box, sphere = base.bodies
    shapes = (
        Shape("a", "box", (0.1, 0.1, 0.1), Pose(), "rough"),
        Shape("b", "box", (0.1, 0.1, 0.1), Pose((0.2, 0.0, 0.0)), "slick"),
    )
    floor = dataclasses.replace(floor, shapes=(dataclasses.replace(floor.shapes[0], material="ground"),))
    sphere = dataclasses.replace(sphere, shapes=(dataclasses.replace(sphere.shapes[0], material="rough"),))
    contact = Contact(materials=tuple(Material(name, 0.5, 0.25) for name in names), pairs=pairs)
    return dataclasses.replace(base, bodies=(floor, dataclasses.replace(box, shapes=shapes), sphere), contact=contact)


def small_turns(**more):
    """A free and a ball joint that start with a small rotation."""
    world = worlds.world(worlds.tree(["free", "ball", "hinge"], 8, **more))
    q = (math.cos(SMALL / 2.0), 0.6 * math.sin(SMALL / 2.0), 0.0, 0.8 * math.sin(SMALL / 2.0))
    world = change_joint(world, 0, position=(*world.bodies[0].joint.position[:3], *q))
    return change_joint(world, 1, position=q)


def reserved_name():
    """A body called as DART calls the world."""
    bodies = worlds.tree(["hinge", "ball"], 4)
    first = dataclasses.replace(bodies[0], name="world", model="world")
    second = dataclasses.replace(bodies[1], model="world", joint=dataclasses.replace(bodies[1].joint, parent="world"))
    return worlds.world((first, second), contact=Contact(excluded_bodies=(("link1", "world"),)))


def interleaved():
    """Two trees whose bodies alternate in the world's order."""
    bodies, other = worlds.tree(["free", "hinge"], 5, prefix="a"), worlds.tree(["ball", "slide"], 6, prefix="b")
    return worlds.world((bodies[0], other[0], bodies[1], other[1]))


WORLDS = {
    "every-joint": lambda: worlds.every_joint(damping=0.2),
    "damped-springs": worlds.damped_springs,
    "limits": lambda: worlds.limits_and_armature(armature=0.2, dry_friction=0.3),
    "shapes": worlds.shapes_world,
    "ellipsoid-and-plane": lambda: worlds.shapes_world(("ellipsoid", "plane")),
    "mixed-shapes": worlds.mixed_shapes,
    "two-materials": two_materials,
    "spheres": worlds.spheres,
    "gripper": worlds.gripper,
    "small-turns": small_turns,
    "reserved-name": reserved_name,
    "interleaved": interleaved,
    "hung": lambda: worlds.world(worlds.tree(["ball", "slide", "hinge"], 4, velocity_limit=2.0, effort_limit=3.0)),
}


def with_cone(cone):
    world = worlds.shapes_world()
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))


def edited(change):
    """The files of the self-test's world of surfaces with one change to the XML tree and the sidecar."""
    files = emit(surfaces("dart"))
    root, content = ElementTree.fromstring(files[WORLD]), json.loads(files[SIDECAR])
    change(root, content)
    return {WORLD: ElementTree.tostring(root, encoding="unicode"), SIDECAR: json.dumps(content)}


def drop_filter(root, content):
    content["filter"]["apart"].remove(["ice.0", "rubber.0"])
