"""Additions to plain URDF, and changes declared inert, for the complete self-test.

Engines that use this dialect may read less than the whole language; the rows hold for those that follow it. See
``dialects/kit/mutations.py``.
"""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert, MutationTable
from simspec.dialects.kit.obj_mutations import INERT as OF_MESHES

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
HEAVY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BALL = '<geometry><sphere radius="0.3"/></geometry>'
NAMED = "a name; links are known by theirs, the model's and materials' say nothing"
SEEN = "visual only"

TABLE = MutationTable(
    words={"joint@type": JOINT_TYPES},
    additions={
        "*.urdf": (
            Addition("link", f"<collision>{BALL}</collision>"),
            Addition("link", f"<visual>{BALL}</visual>"),
            Addition("link", HEAVY),
            Addition("joint", '<limit lower="-0.1" upper="0.1" effort="1" velocity="0.1"/>'),
            Addition("joint", '<dynamics damping="3" friction="2"/>'),
            Addition("joint", '<mimic joint="{joint[0]}" multiplier="2" offset="0.1"/>'),
            Addition("robot", f'<link name="one-more">{HEAVY}</link>'),
        ),
        "sidecar.json": (
            Addition("", "9.81", "strength"),
            Addition("springs", '{"body": "nobody", "stiffness": 1.0, "rest": 0.0}'),
            Addition("excluded", '["nobody", "nothing"]'),
        ),
    },
    inert=(
        *OF_MESHES,
        *(Inert(site, NAMED, (), "*.urdf") for site in ("robot@name", "material@name")),
        *(Inert(site, SEEN, (), "*.urdf") for site in ("color*", "visual*", "link/visual", "material")),
    ),
)
