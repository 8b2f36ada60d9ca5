"""Additions to ``world.json``, and changes declared inert, for the complete self-test of every engine that reads it (see
``dialects/kit/mutations.py``). The form is checked field by field, so that a field more or less is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simspec.dialects.kit.mutations import UNKNOWN, Addition, Inert, MutationTable
from simspec.language.vocabulary import FRICTION_CONES, JOINT_KINDS
from simspec.world.shapes import SHAPES

WORLD = "world.json"
COPY = '{"layer": 7, "friction": 0.3, "torsional_friction": 0, "rolling_friction": 0, "restitution": 0}'

ADDITIONS = (
    Addition("", "1.0", "strength"),
    Addition("bodies.*", "0.1", "drag"),
    Addition("bodies.*.joint", "0.1", "backlash"),
    Addition("bodies.*.joint", '{"kp": 10.0, "kd": 1.0, "effort_limit": null}', "servo"),
    Addition("bodies.*.joint.servo", "0.1", "ki"),
    Addition("bodies.*.shapes.*", "0.01", "margin"),
    Addition("bodies.*.shapes.*.copies", COPY),
    Addition("bodies.*.shapes.*.copies.*", "0.1", "adhesion"),
    Addition("meets", '["nothing", "nothing", 0]'),
    Addition("apart.bodies", '["nobody", "nothing"]'),
    Addition("apart.groups", '["nobody", "nothing"]'),
)

SEEN = "visual only"
SYMMETRIC = "the order of elements that are found by name, or of the two names of a pair"
INERT = (
    Inert("bodies.*.group", "a group that no pair names, or of a body that touches nothing", ("word",), WORLD),
    Inert("bodies.*.shapes.*.material", "a material of what touches nothing", ("word",), WORLD),
    Inert("*quaternion*", "q and −q are the same rotation", ("sign",), WORLD),
    Inert("bodies.*.joint.position.*", "q and −q are the same rotation", ("sign",), WORLD),
    Inert("bodies.*.shapes.*.pose.quaternion.*", "a rotation within a shape's symmetry", (), WORLD),
    Inert("bodies.*.shapes.*.pose.position.*", "a translation of a plane within itself", (), WORLD),
    Inert("bodies.*.shapes.*", "the order of visual-only shapes among collision shapes", ("swapped",), WORLD),
    Inert("apart.bodies.*", "engines never let welded bodies collide", ("element removed",), WORLD),
    Inert("bodies.*.shapes.*.colour*", SEEN, (), WORLD),
    *(Inert(site, SYMMETRIC, ("swapped",), WORLD) for site in ("meets.*", "meets.*.*", "apart.*.*", "apart.*.*.*")),
)

INERTIAL = ("bodies.*.mass", "bodies.*.centre_of_mass.*", "bodies.*.inertia.*")


def in_single_precision(within: float) -> tuple[Inert, ...]:
    """Rows of an engine that computes in single precision: what is the same but for its roundings, by which motion departs
    up to ``within``; what turns a shape itself the read-back sees."""
    rounded = "but for roundings to single precision"
    return (
        Inert("*quaternion*", f"q and −q are the same rotation, {rounded}", ("sign",), WORLD, within=within),
        Inert(
            "bodies.*.shapes.*.pose.position.*",
            f"a translation of a plane within itself, {rounded}",
            (),
            WORLD,
            within=within,
        ),
        Inert(
            "bodies.*.shapes.*.pose.quaternion.*",
            f"a rotation within a shape's symmetry, {rounded}",
            ("swapped",),
            WORLD,
            within=within,
        ),
    )


def table(
    settings: Mapping[str, Sequence[str]],
    sidecar_additions: Sequence[Addition] = (),
    inert: Sequence[Inert] = (),
) -> MutationTable:
    """The table of a dialect. ``settings``: by name the words of the engine's settings that are words. ``sidecar_additions``:
    fields of the sidecar, and settings, that other engines have and this one does not. ``inert``: rows of its own, before
    those of all."""
    return MutationTable(
        words={
            "bodies.*.joint.kind": (*JOINT_KINDS, UNKNOWN),
            "bodies.*.kind": (*JOINT_KINDS, UNKNOWN),
            "bodies.*.shapes.*.kind": (*SHAPES, UNKNOWN),
            "friction_cone": (*FRICTION_CONES, UNKNOWN),
            **{f"settings.{name}": (*words, UNKNOWN) for name, words in settings.items()},
        },
        integers=frozenset({"schema", "meets.*.2", "bodies.*.shapes.*.copies.*.layer"}),
        additions={WORLD: ADDITIONS, "sidecar.json": tuple(sidecar_additions)},
        inert=(*inert, *INERT),
    )
