"""A model of the MJCF language that has everything that can be written."""

from __future__ import annotations

from simspec.formats.mjcf.tree import (
    MjcfActuator,
    MjcfBody,
    MjcfDefault,
    MjcfExclude,
    MjcfGeom,
    MjcfInertial,
    MjcfJoint,
    MjcfKey,
    MjcfModel,
    MjcfPair,
)

TURN = (0.5, 0.5, 0.5, 0.5)
AT = (0.1, 0.0, 1e-07)
STRAIGHT = (1.0, 0.0, 0.0, 0.0)


def ball(name: str, **more: object) -> MjcfGeom:
    return MjcfGeom(name, "sphere", (0.25,), AT, STRAIGHT, "soft", tuple(more.items()))  # type: ignore[arg-type]


FULL = MjcfModel(
    "a & <b> \"c\" 'd'",
    compiler=(("angle", "radian"), ("autolimits", False), ("boundmass", 0)),
    option=(("timestep", 0.001), ("gravity", (0.0, 0.0, -9.81)), ("solver", "CG"), ("iterations", 7)),
    flags=(("contact", True), ("limit", False)),
    size=(("nuser_jnt", 2),),
    default=MjcfDefault(elements=(("joint", (("damping", 0.5), ("limited", True))), ("geom", (("group", 3),)))),
    classes=(MjcfDefault("soft", (("geom", (("solref", (0.02, 1.0)), ("condim", 4))),)), MjcfDefault("eye", ())),
    bodies=(
        MjcfBody("root", AT, TURN, 0, MjcfInertial(AT, TURN, 2.5, (1.0, 2.0, 2.5)), (MjcfJoint("root_joint", "free"),)),
        MjcfBody(
            "arm", AT, STRAIGHT, 1, None, (MjcfJoint("hinge", "hinge", (("axis", (0.0, 0.0, 1.0)),)),), (ball("one"),)
        ),
        MjcfBody("hand", AT, STRAIGHT, 2, geoms=(ball("two", group=4, rgba=(1.0, 0.0, 0.0, 1.0)), ball("three"))),
        MjcfBody("leg", AT, STRAIGHT, 1),
        MjcfBody("other", AT, STRAIGHT, 0, more=(("sleep", "never"),)),
    ),
    pairs=(MjcfPair("one", "two", (("condim", 6), ("friction", (1.0, 1.0, 0.0, 0.0, 0.0)))),),
    excludes=(MjcfExclude("arm", "leg"),),
    actuators=(MjcfActuator("position", "servo", "hinge", (("kp", 3.0), ("forcelimited", False))),),
    keys=(MjcfKey("start", (0.0,) * 8, (0.1,) * 7), MjcfKey("end", (1.0,) * 8, (-0.0,) * 7)),
)
