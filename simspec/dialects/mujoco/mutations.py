"""The mutation table of this dialect, for the complete self-test: words, whole numbers, additions, inert changes."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit.mutations import Addition, MutationTable
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.dialects.mujoco.mutation_additions import ATTRIBUTES, ELEMENTS, NOT_OF_VELOCITY
from simspec.dialects.mujoco.mutation_inert import INERT
from simspec.formats.mjcf.format import MODEL
from simspec.language.vocabulary import JOINT_KINDS

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
            *(Addition(tag, value, name) for tag, rows in ATTRIBUTES.items() for name, value in rows.items()),
            *(
                Addition("velocity", value, name)
                for name, value in ATTRIBUTES["position"].items()
                if name not in NOT_OF_VELOCITY
            ),
            *ELEMENTS,
        ),
        SIDECAR: (
            Addition("", '"more"', "more"),
            Addition("settings", "1", "more"),
            Addition("settings", "true", "sleeping"),
        ),
    },
    inert=INERT,
)
