"""What of a file for MuJoCo moves nothing, with the reason."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Inert

NORMALISED = ("scaled", "moved", "sign", "swapped")
OWN_DEFAULT = "MuJoCo's own default, stated explicitly"
INERT: tuple[Inert, ...] = (
    Inert("mujoco@model", "a name"),
    Inert("compiler*", "how the file is turned into a model, of which everything that can act is compared"),
    *(Inert(f"{tag}@*", OWN_DEFAULT, ("attribute removed",)) for tag in ("option", "flag", "size")),
    *(Inert(f"size@{name}", "how much memory is taken at the start") for name in ("memory", "nstack")),
    Inert("size*", "joints' user data have two numbers, and so two places without being told"),
    *(Inert(f"mujoco/{tag}", "for viewers") for tag in ("visual", "statistic")),
    *(Inert(f"{tag}@name", "a name that nothing refers to") for tag in ("pair", "exclude")),
    # defaults
    Inert("geom@*", "each class, or each shape, states its own", place="mujoco/default/geom@*"),
    Inert("joint@*", OWN_DEFAULT, ("attribute removed",), place="mujoco/default/joint@*"),
    Inert("joint@*", "each joint that has it states its own", place="mujoco/default/joint@*"),
    Inert("pair@*", OWN_DEFAULT, ("attribute removed",), place="mujoco/default/pair@*"),
    Inert("pair@*", "each explicit pair states its own", place="mujoco/default/pair@*"),
    Inert("*", "no shape is of the class", place="*/default(visual)*", without=".//worldbody//geom[@class='visual']"),
    Inert("*", "there are no shapes", place="mujoco/default*geom*", without=".//worldbody//geom"),
    Inert("*", "there are no joints", place="mujoco/default/joint*", without=".//worldbody//joint"),
    Inert("*", "there are no explicit pairs", place="mujoco/default/pair*", without=".//contact/pair"),
    Inert("default/*", "a default of what is not there", ("element added",)),
    *(
        Inert(f"{tag}@*class", "the class says something of shapes alone, which state their own")
        for tag in ("body", "joint", "pair", "position", "velocity")
    ),
    # shapes
    *(Inert(f"geom@{name}", "visual only") for name in ("rgba", "castshadow")),
    *(
        Inert(f"geom@{name}", "shapes make no mass: inertiafromgeom is off")
        for name in ("mass", "density", "shellinertia")
    ),
    Inert("geom@fitscale", "of meshes alone"),
    Inert("geom@fluidcoef", "of shapes with a fluidshape alone"),
    *(
        Inert(f"geom@{name}", "as the default has it", ("attribute removed",))
        for name in ("contype", "conaffinity", "condim", "group", "friction", "solref", "solimp")
    ),
    *(
        Inert(site, "a quaternion is normalised, and its negative is the same turn", NORMALISED)
        for site in ("body@quat", "inertial@quat", "key@qpos")
    ),
    Inert(
        "geom@quat",
        "a quaternion is normalised, its negative the same turn, and turns that a shape's symmetry makes meaningless give the "
        "same contact in turned axes, with other round-off",
        NORMALISED,
        within=1e-9,
    ),
    Inert("geom@group", "each visual-only shape states its own", ("scaled", "sign"), place="*/default(visual)/geom@*"),
    Inert("geom@name", "two shapes of a body that are alike in all that acts", ("swapped",)),
    Inert("geom@pos", "a shift of a plane within itself", ("moved",)),
    Inert("geom@size", "of a plane what viewers draw", ("moved", "scaled", "sign", "swapped")),
    Inert("joint@axis", "a hinge's axis is normalised", ("scaled",)),
    *(
        Inert(f"geom@{name}", "each shape states its own", ("attribute added",), place="*/default(*)/geom@*")
        for name in ("axisangle", "conaffinity", "contype", "euler", "pos", "quat", "size", "type", "xyaxes", "zaxis")
    ),
    *(
        Inert(f"geom@{name}", "other bits of a mask, and the same shapes touch", ("scaled", "moved", "sign"))
        for name in ("contype", "conaffinity")
    ),
    *(
        Inert(site, OWN_DEFAULT, ("attribute removed",))
        for site in ("body@pos", "body@quat", "geom@pos", "geom@quat", "geom@type", "inertial@quat", "joint@type")
    ),
    *(
        Inert(
            f"key@{name}",
            "where the state begins as the file's bodies are, and at rest",
            ("attribute removed", "number dropped"),
        )
        for name in ("qpos", "qvel")
    ),
    Inert(
        "geom", "each class states what is not MuJoCo's own default", ("element removed",), place="mujoco/default/geom"
    ),
    Inert(
        "pair",
        "each explicit pair states what is not MuJoCo's own default",
        ("element removed",),
        place="mujoco/default/pair",
    ),
    Inert("option", "the same statement twice", ("element doubled",)),
    Inert("contact", "it is empty", ("element doubled", "element removed"), without=".//contact/*"),
    # joints and bodies
    Inert("body@simple", "the longer way to the same mass matrix"),
    *(
        Inert(f"joint@{name}", "of hinges and slides alone")
        for name in ("actuatorfrclimited", "limited", "pos", "ref", "springref", "axis", "user")
    ),
    Inert("joint@group", "for viewers"),
    # actuators
    *(
        Inert(f"{tag}@{name}", OWN_DEFAULT, ("attribute removed", "number dropped", "word"))
        for tag in ("position", "velocity")
        for name in ("ctrllimited", "forcelimited", "gear")
    ),
    *(
        Inert(f"{tag}@forcerange", "a range without its limit", ("attribute added",))
        for tag in ("position", "velocity")
    ),
    # lists
    *(
        Inert(f"{tag}@{name}", "the last number is MuJoCo's own default", ("number dropped",))
        for tag in ("geom", "joint", "pair")
        for name in ("friction", "solimp", "solimplimit", "solimpfriction", "solref")
    ),
    *(
        Inert(f"pair@{name}", "two pairs that share their other shape: the same two in the other order", ("swapped",))
        for name in ("geom1", "geom2")
    ),
)
