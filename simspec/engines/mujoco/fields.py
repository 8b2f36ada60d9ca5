"""Every field of ``mjModel`` and ``mjOption``, and what the proof makes of it: data.

A test holds these tables against the installed MuJoCo, so that a field of a new version has to be looked at before it can be
used unseen. Fields are named as MuJoCo's reference names them.
"""

from __future__ import annotations

from collections.abc import Mapping

ELEMENTS = {
    "body": ("nbody", "BODY"),
    "jnt": ("njnt", "JOINT"),
    "dof": ("nv", "JOINT"),
    "geom": ("ngeom", "GEOM"),
    "pair": ("npair", "PAIR"),
    "actuator": ("nu", "ACTUATOR"),
    "key": ("nkey", "KEY"),
    "eq": ("neq", "EQUALITY"),
    "tendon": ("ntendon", "TENDON"),
}
"""By prefix of an array: its count, and MuJoCo's word for what has the names of its rows."""

FLAG_FIELDS = ("disableflags", "enableflags")

NEUTRAL_ARRAYS = (
    *("body_mocapid", "body_plugin", "body_margin"),
    *("jnt_margin", "jnt_actfrclimited", "jnt_actfrcrange", "jnt_actgravcomp"),
    *("jnt_stiffnesspoly", "jnt_springyield", "jnt_plasticadr", "dof_dampingpoly"),
    *(
        "geom_dataid",
        "geom_matid",
        "geom_plugin",
        "geom_priority",
        "geom_solmix",
        "geom_margin",
        "geom_gap",
        "geom_fluid",
    ),
    *("geom_adhesion", "pair_margin", "pair_gap", "pair_adhesion"),
    *("actuator_dyntype", "actuator_dynprm", "actuator_gaintype", "actuator_trntype", "actuator_actnum"),
    *("actuator_actadr", "actuator_actearly", "actuator_actlimited", "actuator_actrange", "actuator_ctrllimited"),
    *("actuator_ctrlrange", "actuator_gear", "actuator_cranklength", "actuator_group", "actuator_plugin"),
    *("actuator_armature", "actuator_damping", "actuator_dampingpoly", "actuator_delay", "actuator_history"),
    *("actuator_historyadr", "actuator_lengthrange", "actuator_ctrlnum", "actuator_outnum"),
    *("tendon_type", "tendon_margin", "tendon_armature", "tendon_actfrclimited"),
    *("tendon_actfrcrange", "tendon_stiffnesspoly", "tendon_dampingpoly", "tendon_springyield", "tendon_plasticadr"),
    "key_time",
)
"""Arrays of which every row must have MuJoCo's default, read from a model that sets nothing. Such a field is one entry of the
inventory (``geom.gap: neutral``), and every row that differs is one more."""

COVERED: Mapping[str, str] = {
    "body_parentid": "L2, parent",
    "body_pos": "L2, origin; of a free body it is qpos0",
    "body_quat": "L2, origin; of a free body it is qpos0",
    "body_ipos": "L1, centre of mass",
    "body_iquat": "L1, inertia tensor",
    "body_inertia": "L1, inertia tensor",
    "body_gravcomp": "L1, weight",
    "body_jntnum": "L2, joint type",
    "jnt_type": "L2, joint type",
    "jnt_bodyid": "L2, joint of each body",
    "jnt_pos": "L2, origin; read-back refuses it at the last joint of a body",
    "jnt_axis": "L2, axis",
    "jnt_limited": "L2, position limits",
    "jnt_user": "L2, velocity and effort limit",
    "geom_type": "L4, shape type",
    "geom_bodyid": "L4, shapes of each body",
    "geom_size": "L4, shape size",
    "geom_pos": "L4, shape position",
    "geom_surfacevel": "L4, surface velocity",
    "geom_quat": "L4, shape orientation",
    **dict.fromkeys(
        (
            *("actuator_trnid", "actuator_gainprm", "actuator_biastype", "actuator_biasprm"),
            *("actuator_forcelimited", "actuator_forcerange"),
        ),
        "L2, controllers",
    ),
    **dict.fromkeys(
        ("hfield_size", "hfield_nrow", "hfield_ncol", "hfield_adr", "hfield_data", "nhfielddata"), "L4, height field"
    ),
    "key_qpos": "L2, initial position",
    "key_qvel": "L2, initial velocity",
    **dict.fromkeys(
        (
            *("eq_type", "eq_obj1id", "eq_obj2id", "eq_objtype", "eq_active0", "eq_data"),
            *("site_bodyid", "site_pos", "site_quat"),
        ),
        "L2, constraints",
    ),
    **dict.fromkeys(
        (
            *("tendon_adr", "tendon_num", "tendon_limited", "tendon_range", "tendon_stiffness", "tendon_damping"),
            "tendon_frictionloss",
            *("tendon_lengthspring", "wrap_type", "wrap_objid", "wrap_prm"),
        ),
        "L2, sums",
    ),
}
"""Compared as fields of the read-back, by that check; indices into other arrays with what they lead to."""

DERIVED: Mapping[str, str] = {
    **dict.fromkeys(
        (
            *("body_rootid", "body_weldid", "body_jntadr", "body_dofnum", "body_dofadr", "body_treeid", "body_geomnum"),
            *("body_geomadr", "jnt_qposadr", "jnt_dofadr", "dof_bodyid", "dof_jntid", "dof_parentid", "dof_treeid"),
            *("dof_Madr", "dof_simplenum", "tree_bodyadr", "tree_bodynum", "tree_dofadr", "tree_dofnum", "ntree"),
            *(
                "ten_J_*",
                "tendon_treenum",
                "tendon_treeid",
                "tendon_actuatorid",
                "jnt_actuatorid",
                "actuator_outadr",
                "actuator_ctrladr",
                "pair_signature",
            ),
        ),
        "from the order and the parents of bodies and joints",
    ),
    **dict.fromkeys(
        ("body_simple", "body_sameframe", "geom_sameframe"),
        "from poses: shorter ways to the same numbers, proven by L2 and L3",
    ),
    **dict.fromkeys(
        (
            *("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "dof_length"),
            *("actuator_acc0", "actuator_length0", "tendon_length0", "tendon_invweight0"),
        ),
        "by the compiler from masses and joints at qpos0; no file can say them",
    ),
    **dict.fromkeys(("body_contype", "body_conaffinity"), "the masks of the body's shapes together"),
    **dict.fromkeys(("geom_rbound", "geom_aabb"), "from sizes, by the compiler"),
    **dict.fromkeys(
        ("nB", "nC", "nD", "nM", "nJmom", "nJten", "nJfe", "B_*", "M_*", "D_*", "map*", "efm*", "nefm*", "nemax"),
        "the pattern of non-zeros of the mass matrix and its factors",
    ),
}

INERT: Mapping[str, str] = {
    **dict.fromkeys(
        ("names", "names_map", "name_*", "nnames", "nnames_map", "paths", "npaths", "text_data"),
        "names",
    ),
    "hfield_pathadr": "names",
    **dict.fromkeys(
        ("nbuffer", "narena", "signature"),
        "sizes of memory, of which too little ends a run with an error, and the compiler's checksum",
    ),
    **dict.fromkeys(
        ("nbvh", "nbvhstatic", "nbvhdynamic", "bvh_*", "body_bvhadr", "body_bvhnum", "noct"),
        "boxes that spare the collision search pairs at large distances",
    ),
    **dict.fromkeys(("vis", "geom_rgba", "geom_castshadow", "jnt_group", "body_user"), "visual only, or user data"),
    **dict.fromkeys(
        (
            *("site_dataid", "site_group", "site_matid", "site_rgba", "site_size", "site_type", "site_user"),
            "site_sameframe",
        ),
        "sites are frames that constraints name; their looks and sizes act on nothing",
    ),
    **dict.fromkeys(
        ("tendon_group", "tendon_matid", "tendon_rgba", "tendon_width", "tendon_user"),
        "fixed tendons are not drawn",
    ),
    "stat": "for viewers; its meaninertia is compared, since versions before 4 scale the solver's tolerance by it",
}

EMPTY: Mapping[str, str] = {
    **dict.fromkeys(("cam_*", "light_*", "mat_*", "tex_*", "skin_*"), "count.ncam, ..."),
    **dict.fromkeys(("mesh_*", "flex_*", "flexedge_*", "oct_*", "nflex?*", "nmesh?*", "nskin?*"), "count.nmesh, ..."),
    **dict.fromkeys(("ntexdata", "ntextdata", "nnumericdata", "ntupledata", "nsensordata"), "no such things"),
    **dict.fromkeys(("sensor_*",), "count.nsensor"),
    **dict.fromkeys(
        ("numeric_*", "text_adr", "text_size", "tuple_*", "plugin*", "npluginattr", "npluginstate"),
        "count.nnumeric, ...",
    ),
    **dict.fromkeys(("key_act", "key_mpos", "key_mquat", "key_plastic"), "count.na, count.nmocap, count.nplastic"),
    **dict.fromkeys(("geom_user", "actuator_user", "npolygonmax"), "count.nuser_geom, count.nuser_actuator"),
}
"""Contents of things of which there are none: their count is compared."""
