"""The sidecar of a ``model.xml`` for MuJoCo: data that MJCF has no place for; and the meaning of MJCF's contact numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from simspec.dialects.kit.contract import NeededSetting, wrong_pair_settings, wrong_settings
from simspec.dialects.kit.sidecar import Sidecar
from simspec.formats.mjcf.bodies import DEFAULT_COLOUR
from simspec.formats.mjcf.reading import MjcfDocument, MjcfItem
from simspec.formats.mjcf.tree import Attributes
from simspec.world import frames
from simspec.world.kinematics import CARRYING, is_carrier, owner_of
from simspec.world.types import Hardness, Pose, Quaternion, Surface

# Names that mean the same to whoever writes a model for MuJoCo, reads it, or loads it.

KEYFRAME: Final = "initial"
"""The keyframe that holds the world's initial state."""
NO_RATING: Final = -1.0
"""In a joint's user data: no velocity or effort rating."""
NATIVE: Final = "native"
COULOMB: Final = "coulomb"
"""Values of the setting ``friction``. Under coulomb, friction takes back slip at once, and its effect on the normal direction
is corrected outside, at every step (``engines/mujoco/stepping.py``): no cushion, and no pairs for friction's sake."""

RK4: Final = "RK4"
INTEGRATORS: Final[Mapping[str, str]] = {
    "common": "Euler",
    "euler": "Euler",
    "implicit": "implicit",
    "implicitfast": "implicitfast",
    RK4: "RK4",
}
"""MuJoCo's words for the values of the setting ``integrator``; ``euler`` has the flag eulerdamp."""

# Choices of how simspec writes a world for MuJoCo, which are not the world's: each row with its reason.
#
# Nothing is left to MuJoCo's defaults: the common attributes of all joints, shapes or explicit pairs stand once in the file's
# ``<default>``.

COMPILER: Final[Attributes] = (
    ("angle", "radian"),
    ("autolimits", False),  # a limit holds where ``limited`` says so, not where a range happens to stand
    ("inertiafromgeom", False),  # mass properties are the world's, never made from shapes
    ("balanceinertia", False),  # no silent repair of an inertia
    ("boundmass", 0),
    ("boundinertia", 0),
    ("settotalmass", -1),
    ("alignfree", False),  # a free body's frame is not moved into its principal axes
    ("discardvisual", False),
    ("fusestatic", False),  # bodies joined rigidly stay bodies
    ("usethread", False),
)
FLAGS: Final[tuple[tuple[str, bool], ...]] = (
    ("constraint", True),
    ("equality", True),
    ("frictionloss", True),
    ("limit", True),
    ("contact", True),
    ("spring", True),
    ("damper", True),
    ("gravity", True),
    ("clampctrl", True),
    ("filterparent", False),  # which bodies touch is said pair by pair, equally in every engine
    ("actuation", True),
    ("refsafe", True),
    ("sensor", True),
    ("midphase", True),
    ("eulerdamp", False),  # damping is explicit in time, unless a setting selects MuJoCo's own Euler
    ("autoreset", False),  # a state that is not finite is a result, not a reason to begin again
    ("nativeccd", True),
    ("override", False),
    ("energy", False),
    ("fwdinv", False),
    ("invdiscrete", False),
)
"""Flags that every supported version knows; ``warmstart``, ``island`` and ``multiccd`` are settings. Newer versions have
further flags, all off by default (``sleep``, by ``sleeping``); the engine's module checks them after loading."""
OPTION: Final[Attributes] = (
    ("integrator", "Euler"),  # semi-implicit, as in all engines, unless a setting selects another
    ("jacobian", "auto"),
    ("density", 0.0),
    ("viscosity", 0.0),
    ("wind", (0.0, 0.0, 0.0)),
    ("magnetic", (0.0, 0.0, 0.0)),
    ("noslip_tolerance", 1e-6),
    ("ccd_iterations", 50),
)
SIZE: Final[Attributes] = (("nuser_jnt", 2),)
"""``user`` of a joint: its velocity and its effort rating, ``NO_RATING`` for none. Neither is enforced; MJCF's own
``actuatorfrcrange`` would be, on actuators only."""
JOINT_DEFAULTS: Final[Attributes] = (
    ("pos", (0.0, 0.0, 0.0)),
    ("ref", 0.0),
    ("limited", False),
    ("margin", 0.0),
    ("actuatorfrclimited", False),
    ("actuatorgravcomp", False),
    ("damping", 0.0),
    ("frictionloss", 0.0),
    ("armature", 0.0),
    ("stiffness", 0.0),
    ("springref", 0.0),
    ("user", (NO_RATING, NO_RATING)),
)
GEOM_DEFAULTS: Final[Attributes] = (
    ("group", 0),
    ("contype", 1),
    ("conaffinity", 1),
    ("condim", 1),
    ("friction", (0.0, 0.0, 0.0)),
    ("priority", 0),  # equal priorities: the larger friction holds
    ("solmix", 1.0),
    ("margin", 0.0),
    ("gap", 0.0),
    ("mass", 0.0),
    ("rgba", DEFAULT_COLOUR),
)
ACTUATOR: Final[Attributes] = (
    ("ctrllimited", False),
    ("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)),  # gains are on the joint's side
)
"""Of position and velocity actuators, the engine's own controllers (law ``native``)."""

MATERIAL_CLASS: Final = "material/"
"""Prefix of the class of a material; shapes that only show are of class ``visual``."""
VISUAL_CLASS: Final = "visual"
SOLVERS: Final[Mapping[str, str]] = {"newton": "Newton", "cg": "CG", "pgs": "PGS"}
SETTINGS: Final[Mapping[str, NeededSetting]] = {
    "solver": NeededSetting(str, tuple(SOLVERS)),
    "friction": NeededSetting(str, (NATIVE, COULOMB)),
    **dict.fromkeys(("iterations", "ls_iterations", "noslip_iterations", "explicit_pairs_limit"), NeededSetting(int)),
    **dict.fromkeys(("tolerance", "ls_tolerance", "ccd_tolerance", "impratio", "high_impratio"), NeededSetting(float)),
    **dict.fromkeys(("warmstart", "island", "multiccd"), NeededSetting(bool)),
    **dict.fromkeys(("contact_error_reduction", "contact_impedance"), NeededSetting(float, by_pair=True)),
    **dict.fromkeys(("friction_rate", "friction_share", "friction_cushion"), NeededSetting(float, by_pair=True)),
    **dict.fromkeys(("limit_error_reduction", "limit_impedance", "dry_friction_impedance"), NeededSetting(float)),
    "integrator": NeededSetting(str, tuple(INTEGRATORS), optional=True),
    "arena": NeededSetting(int, optional=True),
    "sleeping": NeededSetting(bool, optional=True),
    "sleep_tolerance": NeededSetting(float, optional=True),
}
"""Settings that an engine of this dialect must have; the last four are absent where they are off."""

UNIT = 1e-9
"""By how much the length of a quaternion may miss 1: far more than round-off, far less than an error."""
LAST = (*CARRYING, "ball")
"""Kinds of the last of several joints."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoSidecar(Sidecar):
    """Names, and whether friction has all the explicit pairs that it should have."""

    explicit_pairs: bool
    """Whether every two shapes that may touch with friction are listed."""
    models: tuple[str, ...]
    """The model of each body."""
    fixed_joints: Mapping[str, str]
    """The names of rigid joints by body: MJCF has no element for them."""
    carriers: Mapping[str, Quaternion] | None = None
    """By name what stands between two joints of one body, and is no body of the file: the orientation of its frame in that
    body's, all joints at zero. The joints' places and axes stand in the file."""

    def check(self) -> None:
        """Raise ValueError where a setting is missing or of another kind, or names are not those of the bodies."""
        for name in wrong_settings(SETTINGS, self.settings):
            raise ValueError(f"sidecar.settings.{name} should be {SETTINGS[name].expected}")
        for index, pair in enumerate(self.pair_settings or ()):
            for name in wrong_pair_settings(SETTINGS, pair.settings):
                raise ValueError(f"sidecar.pair_settings.{index}.settings.{name} is no setting of a pair of materials")
        kinds = {body.name: body.kind for body in self.bodies}
        for name, turn in (self.carriers or {}).items():
            if kinds.get(name) not in CARRYING or not is_carrier(name) or kinds.get(owner_of(name)) not in LAST:
                raise ValueError(f"sidecar.carriers.{name} does not stand between joints of one of sidecar.bodies")
            if abs(math.hypot(*turn) - 1.0) > UNIT:
                raise ValueError(f"sidecar.carriers.{name} is no quaternion of unit length")
        if len(self.models) != len(self.bodies):
            raise ValueError(f"sidecar.models has {len(self.models)} entries for {len(self.bodies)} bodies")
        fixed = {body.name for body in self.bodies if body.kind == "fixed"}
        if fixed != set(self.fixed_joints):
            wrong = sorted(fixed ^ set(self.fixed_joints))
            raise ValueError(f"sidecar.fixed_joints and the fixed bodies of sidecar.bodies differ in {wrong}")


# Bodies with several joints, for readers of a file or a model: the effect of each joint of a body in the world.
#
# Nothing here is known to what writes them (``formats/mjcf/bodies.py``).

Chain = tuple[tuple[str, Quaternion], ...]
"""Names of the world's bodies that the joints of one body move, in order, itself last, each with the orientation of its frame
in the body's, all joints at zero."""


def chains(sidecar: MujocoSidecar) -> Mapping[str, Chain]:
    """The chain of each body of the file, by its name in the world; of one on a single joint, or on none, itself alone."""
    turns = sidecar.carriers or {}
    above: dict[str, list[tuple[str, Quaternion]]] = {}
    for body in sidecar.bodies:
        if body.name in turns:
            above.setdefault(owner_of(body.name), []).append((body.name, frames.normalise(turns[body.name])))
    return {
        body.name: (*above.get(body.name, ()), (body.name, frames.IDENTITY))
        for body in sidecar.bodies
        if body.name not in turns
    }


def origins(place: Pose, in_body: Sequence[Pose]) -> list[Pose]:
    """Of frames in one body's frame, which stands at ``place`` in its parent's: the first in the parent's, and each further one
    in that before it."""
    first = frames.compose(place, in_body[0])
    return [first, *(frames.compose(frames.inverse(first), other) for first, other in pairwise(in_body))]


# From friction, condim, solref and solimp back to a surface of the world, for the independent reader of files and for the
# engine's read-back; it shares nothing with what writes these numbers. Every
# contact of MuJoCo obeys a₁ + d (b v + k r) = (1 − d) a₀ (its documentation, "Computation": a₀ the acceleration without the
# contact, a₁ with it, d the impedance); a spring-damper is an impedance near zero, a rigid contact one near one.

MUJOCO_DEFAULT = ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))
"""MuJoCo's own solref and solimp."""
SOFT = 1e-3
"""Impedances below this leave a₀ to the other forces, up to a thousandth: springs. MuJoCo allows 1e-4 to 0.9999."""
ROUND_OFF = 1e-12
"""How far the error reduction, a quotient by the timestep's square, may be from the common law's."""


@dataclass(frozen=True, slots=True)
class CommonLaw:
    """The inputs that identify the common law of a contact: the timestep, and the settings that give it its numbers."""

    timestep: float
    error_reduction: float
    solimps: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, timestep: float, settings: Mapping[str, Any]) -> CommonLaw:
        """From a sidecar's settings; the two impedances are the rigid one, and native friction's with its soft first touch."""
        high, cushion = float(settings["contact_impedance"]), float(settings["friction_cushion"])
        rigid = (high, high, 0.001, 0.5, 2.0)
        soft = () if settings["friction"] == "coulomb" else ((0.01, high, cushion, 0.5, 2.0),)
        return cls(timestep, float(settings["contact_error_reduction"]), (rigid, *soft))


def surface(
    condim: int,
    friction: Sequence[float],
    solref: Sequence[float],
    solimp: Sequence[float],
    common: CommonLaw,
    inverse_mass: float = 1.0,
) -> Surface:
    """The surface that one geom or one explicit pair holds.

    ``friction``: sliding, torsional, rolling.
    ``inverse_mass`` (1/kg): of an explicit pair the sum of both bodies'; a geom holds what it would be at 1 kg.
    """
    hardness = _hardness(solref, solimp, common, inverse_mass)
    return Surface(
        float(friction[0]) if condim >= 3 else 0.0,
        float(friction[1]) if condim >= 4 else 0.0,
        float(friction[2]) if condim >= 6 else 0.0,
        _restitution(float(solref[1]), common.timestep) if hardness.kind == "common" else 0.0,
        hardness,
    )


def _restitution(damping: float, timestep: float) -> float:
    """The damping of the common law's reference, per step, is one plus the restitution: the shortest number of which it is."""
    restitution = 0.0 - damping * timestep - 1.0
    # at timesteps of 13 ms and others the product rounds to 1 - 1e-16
    shortest = round(restitution, 14) + 0.0
    return shortest if 0.0 - (1.0 + shortest) / timestep == damping else restitution


def _hardness(solref: Sequence[float], solimp: Sequence[float], common: CommonLaw, inverse_mass: float) -> Hardness:
    stiffness, damping = (float(value) for value in solref)
    if (tuple(solref), tuple(solimp)) == MUJOCO_DEFAULT:
        return Hardness("native")
    constant = solimp[0] == solimp[1]
    if constant and stiffness > 0.0 and solimp[0] <= SOFT:
        return Hardness("time-constant", time_constant=stiffness, damping_ratio=damping)
    taken_back = 0.0 - stiffness * common.timestep * common.timestep
    if tuple(solimp) in common.solimps and abs(taken_back - common.error_reduction) <= ROUND_OFF:
        return Hardness("common")
    # a spring-damper by what holds a load: its depth is (1 − d) a₀ / k
    yielding = inverse_mass * (1.0 - solimp[0])
    if not yielding:
        return Hardness("stiffness")
    return Hardness("stiffness", stiffness=0.0 - stiffness / yielding, damping=0.0 - damping / yielding)


# From meshes and height fields of an MJCF document back to those of a world; shares no code with what writes them.

IN_MESH: Final = {"name", "file", "inertia"}
"""The attributes of a mesh. Others would scale, move or cut it."""
MESH_FOLDERS: Final = {"meshdir", "assetdir", "strippath"}
"""Attributes of the compiler that change which file a name means."""
IN_FIELD: Final = {"name", "nrow", "ncol", "size", "elevation"}
"""The attributes of a height field."""
MOST_POINTS: Final = 1_000_000
"""Points of one height field that are read."""


Sizes = dict[str, tuple[float, ...]]
"""Sizes of shapes by the names of what they are."""


def read_assets(document: MjcfDocument) -> tuple[Sizes, Sizes]:
    """The meshes and the height fields of a document. Raises ValueError for what is not read."""
    if document.section("asset") and (moved := MESH_FOLDERS & document.compiler.stated.keys()):
        raise document.compiler.refused(f"{min(moved)} is not read")
    meshes, fields, files = Sizes(), Sizes(), set[str]()
    for item in document.section("asset"):
        if item.tag == "hfield":
            name, size = _height_field(item)
            if fields.setdefault(name, size) is not size:
                raise item.refused("a second height field of its name")
            continue
        if item.tag != "mesh" or item.values.keys() != IN_MESH or item.element.children:
            raise item.refused(f"is not read, but for meshes that have {', '.join(sorted(IN_MESH))} and nothing else")
        name, file = item.text("name"), item.text("file")
        if name in meshes or file not in document.meshes:
            raise item.refused(f"a second mesh of its name, or without its file {file[:60]!r}")
        if item.text("inertia") != "convex":
            raise item.refused("inertia should be convex")
        meshes[name] = document.meshes[file]
        files.add(file)
    if unused := document.meshes.keys() - files:
        raise ValueError(f"{document.file}: no mesh has the files {sorted(unused)}")
    return meshes, fields


def _height_field(item: MjcfItem) -> tuple[str, tuple[float, ...]]:
    """The name and the size (``world/shapes.py``) of a height field. Raises ValueError where its elevations are not what
    every reader leaves as it is: shares from 0 to 1, or 0 throughout."""
    if item.values.keys() != IN_FIELD or item.element.children:
        raise item.refused(f"is not read, but with {', '.join(sorted(IN_FIELD))} and nothing else")
    rows, columns = (item.number(name) for name in ("nrow", "ncol"))
    if not all(2.0 <= count <= MOST_POINTS and count == int(count) for count in (rows, columns)):
        raise item.refused(f"{rows:g} rows and {columns:g} columns")
    if rows * columns > MOST_POINTS:
        raise item.refused(f"{rows:g} × {columns:g} points, more than the {MOST_POINTS:,} that are read")
    half_x, half_y, top, base = item.numbers("size", 4)
    shares = item.numbers("elevation", int(rows * columns))
    if min(shares) != 0.0 or max(shares) not in (0.0, 1.0):
        raise item.refused(f"its elevations are from {min(shares):g} to {max(shares):g}, should be from 0 to 1")
    wide = int(columns)
    northward = [shares[wide * row : wide * (row + 1)] for row in reversed(range(int(rows)))]
    heights = (top * share for row in northward for share in row)
    return item.text("name"), (rows, columns, 2.0 * half_x, 2.0 * half_y, base, *heights)
