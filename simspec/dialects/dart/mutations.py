"""Additions to .skel files, and changes declared inert, for the complete self-test.

The elements and attributes are those that DART's reader supports (its SkelParser), and some that it might be expected to. See
``dialects/kit/mutations.py``.
"""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert, MutationTable
from simspec.dialects.kit.obj_mutations import INERT as OF_MESHES
from simspec.language.vocabulary import JOINT_KINDS

JOINT_TYPES = (
    *(
        "weld",
        "prismatic",
        "revolute",
        "universal",
        "ball",
        "euler",
        "translational",
        "translational2d",
        "planar",
        "screw",
    ),
    "free",
)
BALL = "<geometry><sphere><radius>0.3</radius></sphere></geometry>"
HERE = "<transformation>0 0 0 0 0 0</transformation>"
BODY = (
    f'<body name="one-more">{HERE}<inertia><mass>1</mass><moment_of_inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz><ixy>0</ixy>'
    "<ixz>0</ixz><iyz>0</iyz></moment_of_inertia></inertia></body>"
)
DOF = '<dof local_index="0">'

SKEL_ADDITIONS = (
    # the world's
    Addition("physics", "<sub_steps>4</sub_steps>"),
    Addition("physics", "<solver>pgs</solver>"),
    Addition("physics", "<split_impulse>true</split_impulse>"),
    Addition("physics", "<max_contacts>1</max_contacts>"),
    Addition("world", f'<skeleton name="one-more">{BODY}</skeleton>'),
    Addition(
        "world",
        f'<skeleton name="one-more">{BODY}<joint type="free" name="one-more"><parent>world</parent><child>one-more</child>'
        "</joint></skeleton>",
    ),
    Addition("world", "<wind>1 0 0</wind>"),
    # a skeleton's
    Addition("skeleton", "<transformation>0 0 0.1 0 0 0</transformation>"),
    Addition("skeleton", "<self_collision>false</self_collision>"),
    Addition("skeleton", "<gravity>0 0 0</gravity>"),
    Addition("skeleton", BODY),
    Addition("skeleton", "false", "mobile"),
    # a body's
    Addition("body", "<self_collide>false</self_collide>"),
    Addition("body", "<collidable>false</collidable>"),
    Addition("body", "<friction_coeff>0.1</friction_coeff>"),
    Addition("body", "<restitution_coeff>0.9</restitution_coeff>"),
    Addition("body", '<marker name="mark"><offset>0 0 0.1</offset></marker>'),
    Addition("body", f"<collision_shape>{HERE}{BALL}</collision_shape>"),
    Addition("body", f"<visualization_shape>{HERE}{BALL}</visualization_shape>"),
    Addition(
        "body",
        f"<soft_shape><total_mass>1</total_mass>{HERE}<geometry><box><size>0.1 0.1 0.1</size><frags>3 3 3</frags></box>"
        "</geometry>"
        "<kv>500</kv><ke>10</ke><damp>5</damp></soft_shape>",
    ),
    Addition("body", "soft", "type"),
    Addition("collision_shape", "<collidable>false</collidable>"),
    Addition("collision_shape", "<friction>0.1</friction>"),
    Addition("collision_shape", "<secondary_friction>0.1</secondary_friction>"),
    Addition("collision_shape", "<restitution>0.9</restitution>"),
    Addition("visualization_shape", "<hidden>true</hidden>"),
    Addition("inertia", "<offset>0.1 0 0</offset>"),
    # a joint's
    *(
        Addition("joint", kind, "actuator")
        for kind in ("force", "passive", "servo", "mimic", "acceleration", "velocity", "locked")
    ),
    Addition("joint", "<init_acc>1</init_acc>"),
    Addition("joint", "<init_force>1</init_force>"),
    Addition("joint", "<axis2><xyz>1 0 0</xyz></axis2>"),
    Addition("joint", "<axis><xyz>1 0 0</xyz><dynamics><damping>3</damping></dynamics></axis>"),
    Addition("joint", '<mimic joint="{joint[0]}"><multiplier>2</multiplier><offset>0.1</offset></mimic>'),
    Addition("joint", f'{DOF}<position lower="-0.1" upper="0.1" initial="0.05"/></dof>'),
    Addition("joint", f'{DOF}<velocity lower="-0.1" upper="0.1"/></dof>'),
    Addition("joint", f'{DOF}<acceleration lower="-0.1" upper="0.1"/></dof>'),
    Addition("joint", f'{DOF}<force lower="-0.1" upper="0.1"/></dof>'),
    Addition("joint", f"{DOF}<damping>3</damping></dof>"),
    Addition("joint", f"{DOF}<friction>2</friction></dof>"),
    Addition("joint", f"{DOF}<spring_stiffness>50</spring_stiffness></dof>"),
    Addition("joint", f"{DOF}<spring_rest_position>0.3</spring_rest_position></dof>"),
    Addition("axis", "<limit><lower>-0.1</lower><upper>0.1</upper></limit>"),
    Addition("axis", "<damping>3</damping>"),
    Addition("limit", "<velocity>0.1</velocity>"),
    Addition("limit", "<force>0.1</force>"),
)

SIDECAR_ADDITIONS = (
    Addition("", "9.81", "strength"),
    Addition("settings", "true", "sleeping"),
    Addition("settings", "true", "split_impulse"),
    Addition("damping", '{"body": "nobody", "value": 1.0}'),
    Addition("springs", '{"body": "nobody", "stiffness": 1.0, "rest": 0.0}'),
    Addition("enforce_limits", '"nobody"'),
    Addition("excluded", '["nobody", "nothing"]'),
    Addition("groups", "[]", "one-more"),
    Addition("filter.classes", "[]", "one-more"),
    Addition("filter.apart", '["nobody", "nothing"]'),
)

FIRST_ONLY = "DART reads only the first of repeated elements"
ABSENT = "the value in the file is DART's default"
NAMED = "a name that nothing refers to"
SEEN = "visual only"
UNKNOWN = "DART's reader ignores it"
CHECKED = "only names the layer in which copies of shapes should collide, for the check of the collision matrix"
ORDER = "the order of elements that are found by name"

FIRST = (
    *("axis", "box", "capsule", "child", "collision_detector", "color", "cylinder", "damping", "dynamics", "file_name"),
    "friction",
    *(
        "geometry",
        "gravity",
        "height",
        "inertia",
        "init_pos",
        "init_vel",
        "ixx",
        "ixy",
        "ixz",
        "iyy",
        "iyz",
        "izz",
        "limit",
    ),
    *(
        "lower",
        "mass",
        "mesh",
        "mobile",
        "moment_of_inertia",
        "normal",
        "offset",
        "parent",
        "physics",
        "plane",
        "radius",
        "scale",
        "size",
        "sphere",
    ),
    *("spring_rest_position", "spring_stiffness", "time_step", "transformation", "upper", "world", "xyz"),
)
"""Elements of which the first counts."""

STRANGE = (
    *(
        "physics/sub_steps",
        "physics/solver",
        "physics/split_impulse",
        "physics/max_contacts",
        "world/wind",
        "skeleton@mobile",
    ),
    *("skeleton/self_collision", "body/self_collide", "body/collidable", "body/friction_coeff"),
    *("body/restitution_coeff", "body@type", "collision_shape/friction", "joint/mimic"),
    *("collision_shape/secondary_friction", "collision_shape/restitution", "visualization_shape/hidden", "joint/axis2"),
    *("axis/damping", "limit/velocity", "limit/force"),
)
"""Elements that DART's reader ignores."""

TABLE = MutationTable(
    words={
        "joint@type": JOINT_TYPES,
        "collision_detector/text()": ("dart", "ode", "bullet", "fcl", "fcl_mesh", "something-else"),
        "friction_cone": ("elliptic", "pyramid-circumscribed", "pyramid-inscribed", "something-else"),
        "bodies.*.kind": (*JOINT_KINDS, "something-else"),
        "settings.contact_solver": ("auto", "nsgs", "dantzig", "something-else"),
        "settings.collision_detector": ("auto", "dart", "ode", "bullet", "fcl", "something-else"),
        "settings.exact_rotation": ("auto", "always", "never", "something-else"),
        "settings.contact_overflow": ("error", "log", "something-else"),
    },
    additions={"*.skel": SKEL_ADDITIONS, "sidecar.json": SIDECAR_ADDITIONS},
    inert=(
        *OF_MESHES,
        *(Inert(tag, FIRST_ONLY, ("element doubled",), "*.skel") for tag in FIRST),
        *(
            Inert(site, FIRST_ONLY, ("element added",), "*.skel")
            for site in ("inertia/offset", "joint/axis", "axis/limit", "skeleton/gravity")
        ),
        *(
            Inert(site, ABSENT, ("element removed", "number dropped"), "*.skel")
            for site in (
                *("transformation", "transformation/text()", "dynamics", "damping", "friction", "spring_stiffness"),
                *("spring_rest_position", "gravity", "init_vel", "mobile", "offset"),
            )
        ),
        Inert("*/text()", ABSENT, ("number dropped",), "*.skel"),
        Inert("time_step*", "DART's default timestep of 1 ms is the world's", ("sign", "element removed"), "*.skel"),
        Inert("parent", "for a root, whose parent is the world", ("element removed",), "*.skel"),
        Inert("body", "DART ignores a second element of the same name", ("element doubled",), "*.skel"),
        Inert("joint", "DART ignores a second element for the same body", ("element doubled",), "*.skel"),
        Inert("skeleton/body", "DART ignores a body without a joint", ("element added",), "*.skel"),
        Inert("body@name", "for copies of one body, which are welded to it in the same place", ("swapped",), "*.skel"),
        *(Inert(site, NAMED, (), "*.skel") for site in ("world@name", "skel@version", "joint@name")),
        Inert("body/visualization_shape", SEEN, ("element added",), "*.skel"),
        Inert("normal/text()", "DART normalises it", ("scaled",), "*.skel"),
        Inert("color*", SEEN, (), "*.skel"),
        Inert("transformation/text()", "a rotation within a shape's symmetry", (), "*.skel"),
        *(Inert(site, UNKNOWN, ("element added", "attribute added"), "*.skel") for site in STRANGE),
        Inert(
            "joint@actuator", "for a joint without coordinates, or the default, force", ("attribute added",), "*.skel"
        ),
        Inert("joint/init_acc", "of the first instant only, and set to zero", ("element added",), "*.skel"),
        Inert("joint/init_force", "of the first instant only, and set to zero", ("element added",), "*.skel"),
        Inert(
            "collision_detector*",
            "DART's default for an unknown word is the detector in use; its mesh variant is set by the API",
            ("word", "element removed"),
            "*.skel",
        ),
        Inert(
            "damping/text()", "overwritten while loading, by the value that realises the armature", ("moved",), "*.skel"
        ),
        Inert("joint/dof", "for a joint without coordinates", ("element added",), "*.skel"),
        Inert("filter.layers*", CHECKED, (), "sidecar.json"),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        *(
            Inert(site, ORDER, ("swapped",), "sidecar.json")
            for site in (
                *(
                    "filter.apart.*",
                    "filter.apart.*.*",
                    "filter.classes.*.*",
                    "excluded.*",
                    "excluded.*.*",
                    "groups.*.*",
                ),
                *("ignored_groups.*", "ignored_groups.*.*", "damping.*", "armature.*", "springs.*", "effort_limits.*"),
                *("velocity_limits.*", "enforce_limits.*", "copies.*", "shapes.*", "shapes.*.surfaces.*"),
            )
        ),
    ),
)
