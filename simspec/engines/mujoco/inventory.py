"""Everything that a loaded ``mjModel`` holds beside the fields of a read-back, by MuJoCo's own names."""

from __future__ import annotations

from typing import Any

import numpy as np

from simspec.dialects.kit.sidecar import flat
from simspec.dialects.mujoco.sidecar import MujocoSidecar
from simspec.engines.mujoco.fields import COUNTS, ELEMENTS, NEUTRAL, OPTIONS
from simspec.formats.mjcf.names import world_name

NEWER = ("tree_sleep_policy", "actuator_ctrlspec")
"""Fields that are compared where a version has them."""
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
"""A model that says nothing: what its last row of each array holds is what MuJoCo takes when it is told nothing."""
TORQUE_SCALE = 10
"""Where it stands in a weld's data."""
GROUP_OF_ID = 16
"""An excluded pair's signature is one body's number, shifted by these bits, plus the other's."""
SLEEP = {3: "never", 4: "allowed", 5: "init"}
"""MuJoCo's mjtSleepPolicy where the file says it; the rest is MuJoCo's own choice, "auto"."""

Inventories = tuple[dict[str, Any], dict[str, Any]]
"""What the model holds, and what MuJoCo holds when it is told nothing."""


def inventory(mujoco: Any, model: Any, sidecar: MujocoSidecar, disableflags: int) -> Inventories:
    """(inventory, neutral) of ``model``. ``disableflags``: as the file gave them, before the engine's module added its own."""
    return _Inventory(mujoco, model, sidecar, disableflags).whole()


def _plain(value: Any) -> Any:
    found = np.asarray(value).tolist()
    return tuple(found) if isinstance(found, list) else found


class _Inventory:
    def __init__(self, mujoco: Any, model: Any, sidecar: MujocoSidecar, disableflags: int):
        self._mujoco, self._model, self._sidecar, self._disableflags = mujoco, model, sidecar, disableflags
        self._reference = mujoco.MjModel.from_xml_string(REFERENCE)
        self._names = {
            prefix: self._names_of(kind, count) for prefix, (count, kind) in ELEMENTS.items() if prefix != "dof"
        }
        pairs = range(model.npair)
        geom = self._names["geom"]
        ends = [sorted((geom[model.pair_geom1[pair]], geom[model.pair_geom2[pair]])) for pair in pairs]
        self._names["pair"] = [f"{one},{two}" for one, two in ends]  # pairs need no name of their own
        self._names["body"] = ["world", *(world_name(name) for name in self._names["body"][1:])]
        self._names["dof"] = [self._names["jnt"][joint] for joint in model.dof_jntid.tolist()]

    def _names_of(self, kind: str, count: str) -> list[str]:
        kind_number = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}", None)
        return [
            (self._mujoco.mj_id2name(self._model, kind_number, index) if kind_number is not None else "") or str(index)
            for index in range(getattr(self._model, count))
        ]

    def whole(self) -> Inventories:
        empty = self._mujoco.MjModel.from_xml_string("<mujoco/>")
        found = flat(self._sidecar.plain(), "sidecar")
        found |= self._options(self._model.opt) | self._flags()
        found |= self._counts(self._model)
        found |= self._unlike_neutral()
        found |= self._joints() | self._geoms() | self._pairs() | self._rows("eq", ("solref", "solimp"))
        found |= self._rows("tendon", ("solref_lim", "solimp_lim", "solref_fri", "solimp_fri")) | self._torque_scales()
        if hasattr(self._model, "actuator_ctrlspec"):
            found |= self._rows("actuator", ("ctrlspec",))
        found |= self._masks() | self._excludes()
        model = self._model
        found |= {f"body.{name}.mass": _plain(model.body_mass[index]) for index, name in enumerate(self._names["body"])}
        found |= {
            f"key.{name}.ctrl": tuple(sorted(set(_plain(row))))
            for name, row in zip(self._names["key"], model.key_ctrl, strict=True)
        }
        found |= self._sleep()
        # mean of the mass matrix' diagonal
        found["stat.meaninertia"] = float(model.stat.meaninertia)
        mean = float(np.mean(model.dof_M0)) if model.nv else float(empty.stat.meaninertia)
        there = {f"has.{name}": True for name in (*NEUTRAL, *NEWER) if hasattr(model, name)}
        flags = dict.fromkeys(self._flags(), False)
        return found, {**self._options(empty.opt), **self._counts(empty), **flags, **there, "stat.meaninertia": mean}

    def _options(self, option: Any) -> dict[str, Any]:
        return {f"opt.{name}": _plain(getattr(option, name)) for name in OPTIONS if hasattr(option, name)}

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

    def _counts(self, model: Any) -> dict[str, int]:
        return {f"count.{name}": int(getattr(model, name)) for name in COUNTS if hasattr(model, name)}

    def _unlike_neutral(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for field in NEUTRAL:
            if not hasattr(self._model, field):
                continue  # another version's
            prefix, _, rest = field.partition("_")
            found[f"{prefix}.{rest}"] = "neutral"
            rows, neutral = getattr(self._model, field), getattr(self._reference, field)[-1]
            if rows.size:
                unlike = (rows != neutral).reshape(len(rows), -1).any(axis=1)
                found |= {
                    f"{prefix}.{self._names[prefix][row]}.{rest}": _plain(rows[row]) for row in np.flatnonzero(unlike)
                }
        return found

    def _joints(self) -> dict[str, Any]:
        model, found = self._model, {}
        ends = [*model.jnt_dofadr.tolist()[1:], model.nv]
        places = [*model.jnt_qposadr.tolist()[1:], model.nq]
        for joint, name in enumerate(self._names["jnt"]):
            dofs = slice(int(model.jnt_dofadr[joint]), ends[joint])
            at = slice(int(model.jnt_qposadr[joint]), places[joint])
            for field in ("solref", "solimp", "stiffness", "range"):
                found[f"jnt.{name}.{field}"] = _plain(getattr(model, f"jnt_{field}")[joint])
            for field in ("armature", "damping", "frictionloss"):
                found[f"dof.{name}.{field}"] = _plain(getattr(model, f"dof_{field}")[dofs])
            for field in ("solref", "solimp"):
                rows = getattr(model, f"dof_{field}")[dofs]
                found[f"dof.{name}.{field}"] = tuple(rows.ravel().tolist())
            for field in ("qpos0", "qpos_spring"):
                found[f"jnt.{name}.{field}"] = _plain(getattr(model, field)[at])
        return found

    def _geoms(self) -> dict[str, Any]:
        return self._rows("geom", ("condim", "friction", "solref", "solimp", "group"))

    def _pairs(self) -> dict[str, Any]:
        return self._rows("pair", ("dim", "friction", "solref", "solimp", "solreffriction"))

    def _rows(self, prefix: str, fields: tuple[str, ...]) -> dict[str, Any]:
        model = self._model
        return {
            f"{prefix}.{name}.{field}": _plain(getattr(model, f"{prefix}_{field}")[row])
            for field in fields
            for row, name in enumerate(self._names[prefix])
        }

    def _torque_scales(self) -> dict[str, Any]:
        """How welds weigh rotation against translation."""
        model, weld = self._model, int(self._mujoco.mjtEq.mjEQ_WELD)
        return {
            f"eq.{self._names['eq'][row]}.torquescale": float(model.eq_data[row, TORQUE_SCALE])
            for row in np.flatnonzero(model.eq_type == weld)
        }

    def _masks(self) -> dict[str, Any]:
        """What the masks let touch: shapes of the same masks are a class, called by the first of their names."""
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
            one, two = sorted((names[signature >> GROUP_OF_ID], names[signature & ((1 << GROUP_OF_ID) - 1)]))
            found[f"exclude.{one},{two}"] = True
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
