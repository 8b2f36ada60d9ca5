"""A model of the MJCF language that has everything that can be written."""

from __future__ import annotations

from simspec.formats.mjcf.tree import Actuator, Body, Default, Exclude, Geom, Inertial, Joint, Key, Model, Pair

TURN = (0.5, 0.5, 0.5, 0.5)
AT = (0.1, 0.0, 1e-07)
STRAIGHT = (1.0, 0.0, 0.0, 0.0)


def ball(name: str, **more: object) -> Geom:
    return Geom(name, "sphere", (0.25,), AT, STRAIGHT, "soft", tuple(more.items()))  # type: ignore[arg-type]


FULL = Model(
    "a & <b> \"c\" 'd'",
    compiler=(("angle", "radian"), ("autolimits", False), ("boundmass", 0)),
    option=(("timestep", 0.001), ("gravity", (0.0, 0.0, -9.81)), ("solver", "CG"), ("iterations", 7)),
    flags=(("contact", True), ("limit", False)),
    size=(("nuser_jnt", 2),),
    default=Default(elements=(("joint", (("damping", 0.5), ("limited", True))), ("geom", (("group", 3),)))),
    classes=(Default("soft", (("geom", (("solref", (0.02, 1.0)), ("condim", 4))),)), Default("eye", ())),
    bodies=(
        Body("root", AT, TURN, 0, Inertial(AT, TURN, 2.5, (1.0, 2.0, 2.5)), (Joint("root_joint", "free"),)),
        Body("arm", AT, STRAIGHT, 1, None, (Joint("hinge", "hinge", (("axis", (0.0, 0.0, 1.0)),)),), (ball("one"),)),
        Body("hand", AT, STRAIGHT, 2, geoms=(ball("two", group=4, rgba=(1.0, 0.0, 0.0, 1.0)), ball("three"))),
        Body("leg", AT, STRAIGHT, 1),
        Body("other", AT, STRAIGHT, 0, more=(("sleep", "never"),)),
    ),
    pairs=(Pair("one", "two", (("condim", 6), ("friction", (1.0, 1.0, 0.0, 0.0, 0.0)))),),
    excludes=(Exclude("arm", "leg"),),
    actuators=(Actuator("position", "servo", "hinge", (("kp", 3.0), ("forcelimited", False))),),
    keys=(Key("start", (0.0,) * 8, (0.1,) * 7), Key("end", (1.0,) * 8, (-0.0,) * 7)),
)
