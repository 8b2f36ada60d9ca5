"""Every value of ``mjModel`` besides the fields of a read-back, by MuJoCo's names: as MuJoCo stores it, and as it must be.

The tables list each name once, with the expectation that follows from the world (``expectation.py``); MuJoCo's value is the row
of the array of that name. ``fields.py`` says where all other fields of ``mjModel`` are proven.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.control.reference import natives
from simspec.dialects.kit.sidecar import flat
from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.engines.kit.inventory import NEUTRAL, Items, below
from simspec.engines.mujoco.expectation import (
    HARDEST,
    MujocoContactLaw,
    MujocoExpectation,
    MujocoExpectedJoint,
    Reference,
    flat_impedance,
)
from simspec.engines.mujoco.fields import ELEMENTS, NEUTRAL_ARRAYS
from simspec.formats.mjcf.bodies import world_name
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.inertia import lumped_gravity_scale, lumped_inertial
from simspec.world.kinematics import absorbed
from simspec.world.types import VELOCITY_SIZE, Constraint, WeldConstraint

REFERENCE = """
<mujoco>
  <worldbody>
    <body><joint name="hinge"/><geom name="one" size="1"/></body>
    <body><freejoint/><geom name="other" size="1"/></body>
  </worldbody>
  <contact><pair geom1="one" geom2="other"/></contact>
  <tendon><fixed><joint joint="hinge" coef="1"/></fixed></tendon>
  <actuator><position joint="hinge" kp="1"/></actuator>
  <keyframe><key/></keyframe>
</mujoco>
"""
"""A model without attributes: the last row of each of its arrays has MuJoCo's defaults."""
WELD, TORQUE_SCALE = 1, 10
"""MuJoCo's number of a weld among equalities, and the place of its weight of rotation in its data."""
GROUP_OF_ID = 16
"""An excluded pair's signature is one body's number, shifted by these bits, plus the other's."""
SLEEP = {3: "never", 4: "allowed", 5: "init"}
"""MuJoCo's mjtSleepPolicy where the file sets it; the rest is MuJoCo's choice, "auto"."""
NEWER = ("tree_sleep_policy", "actuator_ctrlspec")
"""Fields that are compared where a version has them."""
INTEGRATOR_NUMBERS = {"common": 0, "euler": 0, "RK4": 1, "implicit": 2, "implicitfast": 3}
AUTO = 2
"""MuJoCo's numbers of the integrator and of the choice of Jacobian."""
SOLVERS = {"pgs": 0, "cg": 1, "newton": 2}
CONES = {"pyramid-inscribed": 0, "elliptic": 1}
BY_POSITION, BY_VELOCITY = 1, 2
"""MuJoCo's numbers of an actuator's input."""
SET_FLAGS = {"disable_filterparent", "disable_autoreset"}
"""Flags that are always set. Others are never, but for those that settings switch."""


@dataclass(frozen=True, slots=True)
class ModelRow:
    """A row of ``mjModel``'s arrays of a prefix, or the rows of a joint's coordinates."""

    model: Any
    prefix: str
    at: int | slice

    def value(self, name: str) -> Any:
        """Of ``PREFIX_NAME``; None where this version has no such array."""
        array = getattr(self.model, f"{self.prefix}_{name}" if self.prefix else name, None)
        return None if array is None else plain(array[self.at])


def plain(value: Any) -> Any:
    """A number, or the tuple of all numbers of an array."""
    numbers = np.asarray(value)
    return tuple(numbers.ravel().tolist()) if numbers.ndim else numbers.tolist()


def _option(option: Any, name: str) -> Any:
    return plain(getattr(option, name)) if hasattr(option, name) else None


def _count(model: Any, name: str) -> int | None:
    return int(getattr(model, name)) if hasattr(model, name) else None


def _torque_scale(row: ModelRow) -> float | None:
    """The weight of rotation against translation in a weld."""
    weld = row.model.eq_type[row.at] == WELD
    return float(row.model.eq_data[row.at, TORQUE_SCALE]) if weld else None


OPTIONS = Items[Any, MujocoExpectation].named(
    _option,
    {
        "timestep": lambda e: e.dt,
        "gravity": lambda e: e.world.physics.gravity,
        "cone": lambda e: CONES[e.world.contact.friction_cone],
        "solver": lambda e: SOLVERS[e.settings["solver"]],
        "impratio": lambda e: e.impratio,
        "integrator": lambda e: INTEGRATOR_NUMBERS[e.integrator],
        "jacobian": AUTO,
        "density": lambda e: 0.0 if e.fluid is None else e.fluid.density,
        "viscosity": lambda e: 0.0 if e.fluid is None else e.fluid.viscosity,
        "wind": lambda e: (0.0, 0.0, 0.0) if e.fluid is None else e.fluid.velocity,
        "magnetic": (0.0, 0.0, 0.0),
        "noslip_tolerance": 1e-6,
        "ccd_iterations": 50,
        "iterations": lambda e: e.settings["iterations"],
        "tolerance": lambda e: e.settings["tolerance"],
        "ls_iterations": lambda e: e.settings["ls_iterations"],
        "ls_tolerance": lambda e: e.settings["ls_tolerance"],
        "noslip_iterations": lambda e: e.settings["noslip_iterations"],
        "ccd_tolerance": lambda e: e.settings["ccd_tolerance"],
        "sleep_tolerance": lambda e: e.setting("sleep_tolerance")
        if e.sleeping
        else e.neutral.get("opt.sleep_tolerance"),
        # without effect (o_* without override), or off
        **dict.fromkeys(("disableactuator", "sdf_initpoints", "sdf_iterations"), NEUTRAL),
        **dict.fromkeys(("o_margin", "o_solref", "o_solimp", "o_friction"), NEUTRAL),
    },
)
"""As ``opt.NAME``; the two fields of flags bit by bit, as ``flags.NAME``."""


def _servos(e: MujocoExpectation) -> int:
    return sum(len(controller.joints) for controller in natives(e.world))


def _weighted(e: MujocoExpectation) -> int:
    """How many bodies have another weight than mass × gravity."""
    return sum(lumped_gravity_scale(e.world, body) != 1.0 for body in e.world.bodies)


def _sites(e: MujocoExpectation) -> int:
    return 2 * sum(constraint.kind != "follow" for constraint in e.world.constraints) + len(e.world.frames)


COUNTS = Items[Any, MujocoExpectation].named(
    _count,
    {
        "nbody": lambda e: 1 + len(e.world.bodies) - len(absorbed(e.world)),
        "njnt": lambda e: len(e.moving),
        "nv": lambda e: sum(VELOCITY_SIZE[body.joint.kind] for body in e.moving),
        "nq": lambda e: sum(len(body.joint.position) for body in e.moving),
        "ngeom": lambda e: sum(len(body.shapes) for body in e.world.bodies),
        "npair": lambda e: len(e.explicit[0]),
        "nexclude": lambda e: len(e.touching.excluded()),
        "nu": _servos,
        "nactuator": _servos,
        "nout": _servos,
        "nkey": 1,
        "nmesh": lambda e: len(e.assets["mesh"]),
        "nhfield": lambda e: len(e.assets["heightfield"]),
        "neq": lambda e: len(e.world.constraints),
        "ntendon": lambda e: len(e.world.sums),
        "nwrap": lambda e: sum(len(summed.joints) for summed in e.world.sums),
        "nsite": _sites,
        "nuser_jnt": 2,
        "flg_surfacevel": lambda e: int(any(any(shape.surface_velocity) for shape in e.solid_shapes)),
        "ngravcomp": _weighted,
        "flg_gravcomp": lambda e: int(_weighted(e) > 0),
        **dict.fromkeys(("na", "ncam", "nlight", "nflex", "nskin", "nmat", "ntex", "nsensor", "nnumeric"), NEUTRAL),
        **dict.fromkeys(("ntext", "ntuple", "nmocap", "nplugin", "nuserdata", "nhistory", "nplastic"), NEUTRAL),
        **dict.fromkeys(("njmax", "nconmax", "flg_adhesion", "nuser_body", "nuser_geom", "nuser_site"), NEUTRAL),
        **dict.fromkeys(("nuser_cam", "nuser_tendon", "nuser_actuator", "nuser_sensor"), NEUTRAL),
    },
)
"""As ``count.NAME``; the numbers of elements that simspec never writes must be those of an empty model."""

JOINT = Items[ModelRow, MujocoExpectedJoint].named(
    ModelRow.value,
    {
        "solref": lambda j: (-j.e.setting("limit_error_reduction") / j.e.dt**2, -1.0 / j.e.dt),
        "solimp": lambda j: flat_impedance(j.e.setting("limit_impedance")),
        "stiffness": lambda j: j.joint.spring_stiffness,
        "range": lambda j: j.joint.position_limits or (0.0, j.joint.angle_limit or 0.0),
    },
)
POSITION = Items[ModelRow, MujocoExpectedJoint].named(
    ModelRow.value,
    {
        "qpos0": lambda j: (0.0,) if j.joint.kind in SCALAR_JOINTS else j.start,
        "qpos_spring": lambda j: (j.joint.spring_rest,) if j.joint.kind in SCALAR_JOINTS else j.start,
    },
)
"""Of a joint's coordinates, as ``jnt.JOINT.NAME``."""
DOF = Items[ModelRow, MujocoExpectedJoint].named(
    ModelRow.value,
    {
        "solref": lambda j: (0.0, -1.0 / j.e.dt) * j.dofs,
        "solimp": lambda j: flat_impedance(j.e.setting("dry_friction_impedance")) * j.dofs,
        "armature": lambda j: j.by_dof(j.joint.armature, j.joint.angular_armature),
        "damping": lambda j: j.by_dof(j.joint.damping, j.joint.angular_damping),
        "frictionloss": lambda j: (j.joint.dry_friction,) * j.dofs,
    },
)
"""Of all degrees of freedom of a joint, as ``dof.JOINT.NAME``."""
GEOM = Items[ModelRow, MujocoContactLaw].named(
    ModelRow.value,
    {
        "condim": lambda law: law.condim,
        "friction": lambda law: law.friction,
        "solref": lambda law: law.reference[0],
        "solimp": lambda law: law.reference[1],
        "group": lambda law: law.group,
    },
)
PAIR = Items[ModelRow, MujocoContactLaw].named(
    ModelRow.value,
    {
        "dim": lambda law: law.condim,
        "friction": lambda law: tuple(law.friction[place] for place in (0, 0, 1, 2, 2)),
        "solref": lambda law: law.reference[0],
        "solimp": lambda law: law.reference[1],
        "solreffriction": lambda law: (0.0, -law.slip_rate),
    },
)
EQUALITY = Items[ModelRow, tuple[MujocoExpectation, Constraint]](
    {
        "solref": (lambda row: row.value("solref"), lambda of: (-1.0 / of[0].dt ** 2, -1.0 / of[0].dt)),
        "solimp": (lambda row: row.value("solimp"), flat_impedance(HARDEST)),
        "torquescale": (_torque_scale, lambda of: 1.0 if isinstance(of[1], WeldConstraint) else None),
    }
)
TENDON = Items[ModelRow, tuple[Reference, Reference]].named(
    ModelRow.value,
    {
        "solref_lim": lambda of: of[0][0],
        "solimp_lim": lambda of: of[0][1],
        "solref_fri": lambda of: of[1][0],
        "solimp_fri": lambda of: of[1][1],
    },
)
"""Of the references of a tendon's limits and of its dry friction."""
ROWS: Mapping[str, Items[ModelRow, Any]] = {
    "jnt": JOINT,
    "dof": DOF,
    "geom": GEOM,
    "pair": PAIR,
    "eq": EQUALITY,
    "tendon": TENDON,
}
COMPARED = (
    *(f"{prefix}_{name}" for prefix, items in ROWS.items() for name in items.table if name != "torquescale"),
    *POSITION.table,
    *("body_mass", "geom_contype", "geom_conaffinity", "pair_geom1", "pair_geom2", "exclude_signature", "key_ctrl"),
    *NEWER,
)
"""The arrays that are compared row by row."""
# --- MuJoCo's values ----------------------------------------------------------------------------------------------


class Inventory:
    """The values of ``model``. ``disableflags``: as the file gave them, before the engine's module added its own."""

    def __init__(self, mujoco: Any, model: Any, sidecar: MujocoSidecar, disableflags: int):
        self._mujoco, self._model, self._sidecar, self._disableflags = mujoco, model, sidecar, disableflags
        self._names = {
            prefix: self._names_of(kind, count) for prefix, (count, kind) in ELEMENTS.items() if prefix != "dof"
        }
        geom = self._names["geom"]
        pairs = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
        self._names["pair"] = [",".join(sorted((geom[entry], geom[other]))) for entry, other in pairs]
        self._names["body"] = ["world", *(world_name(name) for name in self._names["body"][1:])]
        self._names["dof"] = [self._names["jnt"][joint] for joint in model.dof_jntid.tolist()]

    def _names_of(self, kind: str, count: str) -> list[str]:
        kind_number = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}", None)
        return [
            (self._mujoco.mj_id2name(self._model, kind_number, index) if kind_number is not None else "") or str(index)
            for index in range(getattr(self._model, count))
        ]

    def values(self) -> tuple[dict[str, Any], dict[str, Any]]:
        model, empty = self._model, self._mujoco.MjModel.from_xml_string("<mujoco/>")
        flags = self._flags()
        found = flat(self._sidecar.plain(), "sidecar") | OPTIONS.read(model.opt, "opt") | flags
        found |= COUNTS.read(model, "count") | self._unlike_neutral()
        for prefix in ("jnt", "geom", "pair", "eq", "tendon"):
            for name, row in self._rows(prefix):
                found |= ROWS[prefix].read(row, f"{prefix}.{name}")
        found |= self._joint_rows() | self._masks() | self._excludes() | self._sleep()
        found |= {f"body.{name}.mass": plain(model.body_mass[index]) for index, name in enumerate(self._names["body"])}
        for name, row in self._rows("actuator"):
            if (value := row.value("ctrlspec")) is not None:
                found[f"actuator.{name}.ctrlspec"] = value
        for name, controls in zip(self._names["key"], model.key_ctrl, strict=True):
            found[f"key.{name}.ctrl"] = tuple(sorted(set(plain(controls))))
        # mean of the mass matrix' diagonal
        found["stat.meaninertia"] = float(model.stat.meaninertia)
        mean = float(np.mean(model.dof_M0)) if model.nv else float(empty.stat.meaninertia)
        neutral = OPTIONS.read(empty.opt, "opt") | COUNTS.read(empty, "count") | dict.fromkeys(flags, False)
        neutral |= {f"has.{name}": True for name in (*NEUTRAL_ARRAYS, *NEWER) if hasattr(model, name)}
        return found, neutral | {"stat.meaninertia": mean}

    def _rows(self, prefix: str) -> Iterator[tuple[str, ModelRow]]:
        """The names of elements, with their rows of the arrays of ``prefix``."""
        for index, name in enumerate(self._names[prefix]):
            yield name, ModelRow(self._model, prefix, index)

    def _joint_rows(self) -> dict[str, Any]:
        """The rows of the coordinates and of the degrees of freedom of each joint."""
        model, found = self._model, dict[str, Any]()
        dofs, positions = [*model.jnt_dofadr.tolist(), model.nv], [*model.jnt_qposadr.tolist(), model.nq]
        for joint, name in enumerate(self._names["jnt"]):
            found |= DOF.read(ModelRow(model, "dof", slice(dofs[joint], dofs[joint + 1])), f"dof.{name}")
            found |= POSITION.read(ModelRow(model, "", slice(positions[joint], positions[joint + 1])), f"jnt.{name}")
        return found

    def _flags(self) -> dict[str, bool]:
        """Every flag by the name that MuJoCo's enumeration gives it, in small letters: set or not."""
        found = {}
        for prefix, bits, kinds in (
            ("DSBL", self._disableflags, self._mujoco.mjtDisableBit),
            ("ENBL", int(self._model.opt.enableflags), self._mujoco.mjtEnableBit),
        ):
            for name, bit in kinds.__members__.items():
                if name.startswith(f"mj{prefix}_"):
                    word = "disable" if prefix == "DSBL" else "enable"
                    found[f"flags.{word}_{name.partition('_')[2].lower()}"] = bool(bits & int(bit))
        return found

    def _unlike_neutral(self) -> dict[str, Any]:
        reference, found = self._mujoco.MjModel.from_xml_string(REFERENCE), dict[str, Any]()
        for field in NEUTRAL_ARRAYS:
            if not hasattr(self._model, field):
                continue  # another version's
            prefix, _, rest = field.partition("_")
            found[f"{prefix}.{rest}"] = "neutral"
            rows, neutral = getattr(self._model, field), getattr(reference, field)[-1]
            if rows.size:
                unlike = (rows != neutral).reshape(len(rows), -1).any(axis=1)
                found |= {
                    f"{prefix}.{self._names[prefix][row]}.{rest}": plain(rows[row]) for row in np.flatnonzero(unlike)
                }
        return found

    def _masks(self) -> dict[str, Any]:
        """The pairs that the masks let touch: shapes of the same masks are a class, called by the first of their names."""
        model = self._model
        members: dict[tuple[int, int], list[str]] = {}
        masks = zip(model.geom_contype.tolist(), model.geom_conaffinity.tolist(), strict=True)
        for name, mask in zip(self._names["geom"], masks, strict=True):
            members.setdefault(mask, []).append(name)
        classes = {mask: sorted(names) for mask, names in members.items()}
        found: dict[str, Any] = {}
        for (kind, affinity), names in classes.items():
            touches = [other[0] for (k, a), other in classes.items() if kind & a or k & affinity]
            found[f"masks.{names[0]}.members"] = tuple(names)
            found[f"masks.{names[0]}.touches"] = tuple(sorted(touches))
        return found

    def _excludes(self) -> dict[str, Any]:
        names = self._names["body"]
        found = {}
        for signature in self._model.exclude_signature.tolist():
            entry, two = sorted((names[signature >> GROUP_OF_ID], names[signature & ((1 << GROUP_OF_ID) - 1)]))
            found[f"exclude.{entry},{two}"] = True
        return found

    def _sleep(self) -> dict[str, str]:
        """Of each tree, by its topmost moving body; versions without sleeping have none."""
        model = self._model
        if not hasattr(model, "tree_sleep_policy"):
            return {}
        return {
            f"tree.{self._names['body'][int(body)]}.sleep": SLEEP.get(int(policy), "auto")
            for body, policy in zip(model.tree_bodyadr, model.tree_sleep_policy, strict=True)
        }


# --- the expectation ----------------------------------------------------------------------------------------------


def expected_inventory(e: MujocoExpectation) -> dict[str, Any]:
    """The inventory of the world of ``e``: by the same tables, without MuJoCo."""
    world, neutral = e.world, e.neutral
    found = flat(e.sidecar(), "sidecar")
    # options, counts and fields that this version does not have are not read either, and have no neutral value
    known = OPTIONS.expect(e, "opt", below("opt", neutral)) | COUNTS.expect(e, "count", below("count", neutral))
    found |= {name: value for name, value in known.items() if name in neutral} | _expected_flags(e)
    found |= {name.replace("_", ".", 1): "neutral" for name in NEUTRAL_ARRAYS if neutral.get(f"has.{name}", False)}
    for body in e.moving:
        joint, name = e.joint(body), body.joint.name
        found |= JOINT.expect(joint, f"jnt.{name}") | POSITION.expect(joint, f"jnt.{name}")
        found |= DOF.expect(joint, f"dof.{name}")
    for body in world.bodies:
        for shape in body.shapes:
            found |= GEOM.expect(e.geom(shape), f"geom.{shape.name}")
            if shape.kind in e.assets:
                found[f"geom.{shape.name}.dataid"] = e.assets[shape.kind].index(shape.size)
            if shape.collision and shape.margin:
                found[f"geom.{shape.name}.margin"] = shape.margin
        if margin := max((shape.margin for shape in e.solid[body.name]), default=0.0):
            found[f"body.{body.name}.margin"] = margin  # MuJoCo's, of bodies' bounding boxes
    for pair, entry, other in e.explicit[0]:
        found |= PAIR.expect(e.pair(e.laws[pair], entry, other), f"pair.{entry},{other}")
        if margin := e.margin(e.laws[pair], entry, other):
            found[f"pair.{entry},{other}.margin"] = margin
    for constraint in world.constraints:
        found |= EQUALITY.expect((e, constraint), f"eq.{constraint.name}")
    for summed in world.sums:
        found |= TENDON.expect(e.tendon(summed), f"tendon.{summed.name}")
    found |= e.touching.masks() | {f"exclude.{name},{two}": True for name, two in e.touching.excluded()}
    found["body.world.mass"] = 0.0
    carried = absorbed(world)
    found |= {
        f"body.{body.name}.mass": lumped_inertial(world, body).mass for body in world.bodies if body.name not in carried
    }
    controllers = natives(world)
    if neutral.get("has.actuator_ctrlspec", False):
        for controller in controllers:
            for name, kp in zip(controller.joints, controller.kp, strict=True):
                found[f"actuator.{name}.ctrlspec"] = BY_POSITION if kp else BY_VELOCITY
    found["key.initial.ctrl"] = (0.0,) if controllers else ()
    if neutral.get("has.tree_sleep_policy", False):
        found |= {f"tree.{name}.sleep": "never" if awake else "auto" for name, awake in e.trees()}
    return found | {"stat.meaninertia": neutral["stat.meaninertia"]}


def _expected_flags(e: MujocoExpectation) -> dict[str, bool]:
    on = SET_FLAGS | (set() if e.settings["warmstart"] else {"disable_warmstart"})
    on |= {"enable_sleep"} if e.sleeping else set()
    on |= set() if e.integrator == "euler" else {"disable_eulerdamp"}
    # since MuJoCo 4 these two are on unless they are disabled, before they were off unless enabled
    for name, wanted in (("island", e.settings["island"] or e.sleeping), ("multiccd", e.settings["multiccd"])):
        by_default = f"flags.disable_{name}" in e.neutral
        if by_default != bool(wanted):
            on.add(f"{'disable' if by_default else 'enable'}_{name}")
    return {f"flags.{name}": name in on for name in below("flags", e.neutral)}
