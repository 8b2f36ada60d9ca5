"""The mutation table of this dialect, for the complete self-test: words, whole numbers, additions, inert changes."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit.file_mutations import INERT as OF_MESHES
from simspec.dialects.kit.mutations import FileAddition, Inert, MutationTable
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.dialects.mujoco.mutation_additions import ATTRIBUTES, ELEMENTS, NOT_OF_VELOCITY
from simspec.formats.mjcf.format import MODEL
from simspec.language.vocabulary import JOINT_KINDS

# Changes of files for MuJoCo that are declared inert, with the reason.

NORMALISED = ("scaled", "moved", "sign", "swapped")
_SAME_ROTATION = "a quaternion is normalised, and its negative is the same rotation"
ROUND_OFF = 1e-11
"""Of a tensor or a mass matrix: a ball on rough ground makes up to 7e-12 of it (measured)."""
MUJOCO_DEFAULT = "MuJoCo's default, stated explicitly"
INERT: tuple[Inert, ...] = (
    *OF_MESHES,
    Inert("mujoco@model", "a name"),
    Inert("compiler*", "how the file is compiled into a model, all of whose active parts are compared"),
    *(Inert(f"{tag}@*", MUJOCO_DEFAULT, ("attribute removed",)) for tag in ("option", "flag", "size")),
    *(
        Inert(f"size@{name}", "the memory of a state: too little is an error of the run")
        for name in ("memory", "nstack")
    ),
    Inert("size*", "joints' user data has two numbers, so that its size is two by default"),
    *(Inert(f"mujoco/{tag}", "for viewers only") for tag in ("visual", "statistic")),
    *(Inert(f"{tag}@name", "a name that nothing refers to") for tag in ("pair", "exclude")),
    # tendons
    Inert("fixed@*", MUJOCO_DEFAULT, ("attribute removed",)),
    Inert("fixed@range", "no tendon has limits", without=".//fixed[@limited='true']"),
    Inert("fixed@springlength", "the tendon has no spring", without=".//fixed[@stiffness!='0']"),
    *(Inert(f"fixed@{name}", "tendons are distinguished by their names alone") for name in ("class", "group")),
    *(
        Inert(f"fixed@{name}friction", "no tendon has friction", without=".//fixed[@solreffriction]")
        for name in ("solref", "solimp")
    ),
    *(
        Inert(f"fixed@{name}limit", "no tendon has limits", without=".//fixed[@limited='true']")
        for name in ("solref", "solimp")
    ),
    # the last of five, the power of the curve
    *(Inert(f"fixed@solimp{of}", MUJOCO_DEFAULT, ("number dropped",)) for of in ("friction", "limit")),
    # defaults
    Inert("geom@*", "each class, or each shape, states its own value", place="mujoco/default/geom@*"),
    Inert("joint@*", MUJOCO_DEFAULT, ("attribute removed",), place="mujoco/default/joint@*"),
    Inert("joint@*", "each joint that uses it states its own value", place="mujoco/default/joint@*"),
    Inert("pair@*", MUJOCO_DEFAULT, ("attribute removed",), place="mujoco/default/pair@*"),
    Inert("pair@*", "each explicit pair states its own value", place="mujoco/default/pair@*"),
    Inert("*", "no shape uses the class", place="*/default(visual)*", without=".//worldbody//geom[@class='visual']"),
    Inert("*", "there are no shapes", place="mujoco/default*geom*", without=".//worldbody//geom"),
    Inert("*", "there are no joints", place="mujoco/default/joint*", without=".//worldbody//joint"),
    Inert("*", "there are no explicit pairs", place="mujoco/default/pair*", without=".//contact/pair"),
    Inert("default/*", "a default for elements that the file does not have", ("element added",)),
    *(
        Inert(f"{tag}@*class", "the class sets only values of shapes, which state their own")
        for tag in ("body", "joint", "pair", "position", "velocity")
    ),
    # shapes
    *(Inert(f"geom@{name}", "visual only") for name in ("rgba", "castshadow")),
    *(
        Inert(f"geom@{name}", "shapes have no mass of their own: inertiafromgeom is off")
        for name in ("mass", "density", "shellinertia")
    ),
    Inert("geom@fitscale", "for shapes that are fitted to meshes only"),
    *(Inert(f"mesh@{name}", "visual only") for name in ("normal", "smoothnormal", "texcoord")),
    Inert("mesh@class", "the class that it takes anyway"),
    Inert("mesh@content_type", "the file's ending says what it is"),
    Inert("mesh@params", "for built-in meshes only"),
    Inert("mesh@name", "by default that of the file", ("attribute removed",)),
    Inert("mesh@inertia", "of a closed hull the same in every way, but for round-off", within=1e-9),
    Inert("geom@size", "a mesh has its own size", ("attribute added",)),
    Inert("obj/f", "shapes are the hulls of their vertices", file="*.obj", within=1e-9),
    Inert("obj/v", "the same vertices, but for round-off", ("swapped", "element doubled"), "*.obj", within=1e-9),
    Inert("geom@fluidcoef", "for shapes with a fluidshape only"),
    *(
        Inert(f"geom@{name}", "the same as the default", ("attribute removed",))
        for name in ("contype", "conaffinity", "condim", "group", "friction", "solref", "solimp")
    ),
    *(Inert(site, _SAME_ROTATION, NORMALISED) for site in ("body@quat", "key@qpos", "site@quat")),
    # of equal moments any rotation gives the same tensor up to round-off
    Inert("inertial@quat", _SAME_ROTATION, NORMALISED, within=ROUND_OFF),
    Inert(
        "geom@quat",
        "a quaternion is normalised, its negative is the same rotation, and a rotation within a shape's symmetry gives the "
        "same contact up to round-off",
        NORMALISED,
        within=1e-9,
    ),
    Inert(
        "geom@group",
        "each visual-only shape states its own value",
        ("scaled", "sign"),
        place="*/default(visual)/geom@*",
    ),
    Inert("geom@name", "two shapes of a body with the same physical properties", ("swapped",)),
    Inert("geom@pos", "a translation of a plane within itself", ("moved",)),
    Inert("geom@size", "of a plane, used by viewers only", ("moved", "scaled", "sign", "swapped")),
    Inert("joint@axis", "a hinge's axis is normalised", ("scaled",)),
    *(
        Inert(f"geom@{name}", "each shape states its own value", ("attribute added",), place="*/default(*)/geom@*")
        for name in ("axisangle", "conaffinity", "contype", "euler", "pos", "quat", "size", "type", "xyaxes", "zaxis")
    ),
    Inert(
        "geom@margin",
        "each shape of the class states its own",
        ("attribute added",),
        place="*/default(material/*)/geom@*",
    ),
    Inert("geom@class", "the two classes say the same of the shape", ("word",)),
    Inert("default@class", "the two classes say the same of each of their shapes", ("swapped",)),
    *(
        Inert(f"geom@{name}", "other bits of a mask, by which the same shapes collide", ("scaled", "moved", "sign"))
        for name in ("contype", "conaffinity")
    ),
    *(
        Inert(site, MUJOCO_DEFAULT, ("attribute removed",))
        for site in (
            "body@pos",
            "body@quat",
            "geom@pos",
            "geom@quat",
            "geom@type",
            "inertial@quat",
            "joint@type",
            "site@quat",
        )
    ),
    *(
        Inert(
            f"key@{name}",
            "the initial state is that of the file's bodies, at rest",
            ("attribute removed", "number dropped"),
        )
        for name in ("qpos", "qvel")
    ),
    Inert(
        "geom",
        "each class states what differs from MuJoCo's default",
        ("element removed",),
        place="mujoco/default/geom",
    ),
    Inert(
        "pair",
        "each explicit pair states what differs from MuJoCo's default",
        ("element removed",),
        place="mujoco/default/pair",
    ),
    Inert("option", "the same statement twice", ("element doubled",)),
    Inert("contact", "it is empty", ("element doubled", "element removed"), without=".//contact/*"),
    # joints and bodies
    Inert("body@simple", "another algorithm for the same mass matrix", within=ROUND_OFF),
    *(
        Inert(f"joint@{name}", "for hinges and slides only")
        for name in ("actuatorfrclimited", "limited", "pos", "ref", "springref", "axis", "user")
    ),
    Inert("joint@group", "for viewers only"),
    # constraints
    *(
        Inert(f"site@{name}", "for viewers and sensors only", ("attribute added",))
        for name in ("class", "group", "rgba", "size", "type", "user")
    ),
    *(
        Inert(f"{tag}@class", "no class sets anything of constraints", ("attribute added",))
        for tag in ("connect", "weld")
    ),
    # actuators
    *(
        Inert(f"{tag}@{name}", MUJOCO_DEFAULT, ("attribute removed", "number dropped", "word"))
        for tag in ("position", "velocity")
        for name in ("ctrllimited", "forcelimited", "gear")
    ),
    *(
        Inert(f"{tag}@forcerange", "a range of a limit that is off", ("attribute added",))
        for tag in ("position", "velocity")
    ),
    # lists
    *(
        Inert(f"{tag}@{name}", "the last number is MuJoCo's default", ("number dropped",))
        for tag in ("geom", "joint", "pair", "connect", "weld")
        for name in ("friction", "polycoef", "solimp", "solimplimit", "solimpfriction", "solref")
    ),
    *(
        Inert(
            f"pair@{name}",
            "two pairs that share a shape: the same two pairs in the other order",
            ("swapped",),
            within=1e-9,
        )
        for name in ("geom1", "geom2")
    ),
)

WORDS: Mapping[str, tuple[str, ...]] = {
    "option@cone": ("pyramidal", "elliptic"),
    "option@solver": ("PGS", "CG", "Newton"),
    "option@integrator": ("Euler", "RK4", "implicit", "implicitfast"),
    "option@jacobian": ("dense", "sparse", "auto"),
    "compiler@angle": ("radian", "degree"),
    "compiler@inertiafromgeom": ("true", "false", "auto"),
    "joint@type": ("free", "ball", "slide", "hinge"),
    "joint@limited": ("true", "false", "auto"),
    "joint@actuatorfrclimited": ("true", "false", "auto"),
    "geom@type": ("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box"),
    "position@forcelimited": ("true", "false", "auto"),
    "velocity@forcelimited": ("true", "false", "auto"),
    "body@sleep": ("auto", "never", "allowed", "init"),
    "settings.solver": ("newton", "cg", "pgs"),
    "friction_cone": ("elliptic", "pyramid-inscribed", "pyramid-circumscribed"),
    "bodies.*.kind": JOINT_KINDS,
}
INTEGERS = frozenset(
    {
        *(f"geom@{name}" for name in ("contype", "conaffinity", "condim", "group", "priority")),
        *(f"option@{name}" for name in ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")),
        *("pair@condim", "size@nuser_jnt"),
    }
)

TABLE = MutationTable(
    words=WORDS,
    integers=INTEGERS,
    additions={
        MODEL: (
            *(FileAddition(tag, value, name) for tag, rows in ATTRIBUTES.items() for name, value in rows.items()),
            *(
                FileAddition("velocity", value, name)
                for name, value in ATTRIBUTES["position"].items()
                if name not in NOT_OF_VELOCITY
            ),
            *ELEMENTS,
        ),
        SIDECAR: (
            FileAddition("", '"more"', "more"),
            FileAddition("settings", "1", "more"),
            FileAddition("settings", "true", "sleeping"),
        ),
    },
    inert=INERT,
)
