"""What a loaded ``mjModel`` must hold beside the fields of a read-back, from the world and the settings resolved from it.

This states MuJoCo's numbers a second time, from the law: it shares no code with what writes them (``dialects/mujoco``). Only
the plan of which numbers materials get (``contact/plan.py``) is common to all sides.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from typing import Any

from simspec.contact.plan import contact_plan
from simspec.contact.rules import Rules
from simspec.control.native import natives
from simspec.dialects.kit.sidecar import flat
from simspec.engines.mujoco.expected_touching import Touching
from simspec.engines.mujoco.fields import NEUTRAL
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.canonical import sha256
from simspec.world.carriers import absorbed
from simspec.world.gathering import lumped_gravity_scale, lumped_inertial
from simspec.world.kinematics import free_rigid, rigid_groups
from simspec.world.meeting import Pair, meeting_laws, shape_pairs
from simspec.world.types import VELOCITY_SIZE, Body, Hardness, Joint, PairContact, Quaternion, Surface, Weld, World

SOLVERS = {"pgs": 0, "cg": 1, "newton": 2}
CONES = {"pyramid-inscribed": 0, "elliptic": 1}
EULER, AUTO = 0, 2
BY_POSITION, BY_VELOCITY = 1, 2
"""What an actuator's input is, where MuJoCo says it."""
"""MuJoCo's numbers of the integrator and of the choice of Jacobian."""
SET_FLAGS = {"disable_filterparent", "disable_eulerdamp", "disable_autoreset"}
"""Flags that are always set. Others are never, but for those that settings switch."""
SOFT, CUSHION, HARDEST = 1e-4, 0.01, 0.9999
"""Impedance of springs, of a frictional contact at first touch, and the largest there is."""
DEFAULT_REFERENCE, DEFAULT_IMPEDANCE = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
COMPLIANT = ("time-constant", "stiffness")
GROUP = {(True, True): 0, (False, True): 2, (True, False): 3, (False, False): 4}
"""Of (solid, visible)."""


def expected_inventory(
    world: World,
    settings: Mapping[str, Any],
    neutral: Mapping[str, Any],
    rules: Rules,
    layers: bool,
    engine: str = "mujoco",
) -> dict[str, Any]:
    """The inventory that ``world`` makes with all settings (resolved, with defaults) in force; ``engine``: the name of the one
    that is told it in MuJoCo's files."""
    return _Expected(world, settings, neutral, rules, layers, engine).whole()


def _flat_impedance(value: float) -> tuple[float, ...]:
    return (value, value, 0.001, 0.5, 2.0)


def _by_dof(joint: Joint, number: float, angular: float) -> tuple[float, ...]:
    """A number of a joint for each of its degrees of freedom; of a free one the last three are of rotation."""
    return (number,) * 3 + (angular,) * 3 if joint.kind == "free" else (number,) * VELOCITY_SIZE[joint.kind]


class _Expected:
    def __init__(
        self,
        world: World,
        settings: Mapping[str, Any],
        neutral: Mapping[str, Any],
        rules: Rules,
        layers: bool,
        engine: str,
    ):
        self.world, self.settings, self.neutral, self.engine = world, settings, neutral, engine
        self.own = {(pair.first, pair.second): dict(pair.settings) for pair in world.options(engine).pairs}
        self.plan = contact_plan(world, rules, layers)
        self.laws = meeting_laws(world)
        self.dt = world.physics.timestep
        self.groups = rigid_groups(world)
        self._owner = {shape.name: body for body in world.bodies for shape in body.shapes}
        self._touching = Touching(world)
        self.solid = {body.name: [shape for shape in body.shapes if shape.collision] for body in world.bodies}

    def whole(self) -> dict[str, Any]:
        found = flat(self._sidecar(), "sidecar")
        found |= self._options() | self._flags() | self._counts()
        # fields that this version does not have are not there on the other side either, and have no neutral value
        found |= {name.replace("_", ".", 1): "neutral" for name in NEUTRAL if self.neutral.get(f"has.{name}", False)}
        for body in self.world.bodies:
            found |= self._joint(body)
        for body in self.world.bodies:
            for shape in body.shapes:
                found |= self._geom(shape)
            if margin := max((shape.margin for shape in self.solid[body.name]), default=0.0):
                found[f"body.{body.name}.margin"] = margin  # MuJoCo's own, of bodies' bounding boxes
        pairs, _ = self._explicit
        for pair, one, two in pairs:
            found |= self._pair(self.laws[pair], one, two)
        for constraint in self.world.constraints:
            found[f"eq.{constraint.name}.solref"] = (-1.0 / self.dt**2, -1.0 / self.dt)
            found[f"eq.{constraint.name}.solimp"] = _flat_impedance(HARDEST)
            if isinstance(constraint, Weld):
                found[f"eq.{constraint.name}.torquescale"] = 1.0
        limit = float(self.settings["limit_impedance"])
        for summed in self.world.sums:
            bounded = summed.position_limits is not None
            hard = (-float(self.settings["limit_error_reduction"]) / self.dt**2, -1.0 / self.dt)
            rubbed, friction = bool(summed.dry_friction), float(self.settings["dry_friction_impedance"])
            found[f"tendon.{summed.name}.solref_fri"] = (0.0, -1.0 / self.dt) if rubbed else DEFAULT_REFERENCE
            found[f"tendon.{summed.name}.solimp_fri"] = _flat_impedance(friction) if rubbed else DEFAULT_IMPEDANCE
            found[f"tendon.{summed.name}.solref_lim"] = hard if bounded else DEFAULT_REFERENCE
            found[f"tendon.{summed.name}.solimp_lim"] = _flat_impedance(limit) if bounded else DEFAULT_IMPEDANCE
        found |= self._touching.masks()
        found |= {f"exclude.{one},{two}": True for one, two in self._touching.excluded()}
        found["body.world.mass"] = 0.0
        found |= {
            f"body.{body.name}.mass": lumped_inertial(self.world, body).mass
            for body in self.world.bodies
            if body.name not in absorbed(self.world)
        }
        if self.neutral.get("has.actuator_ctrlspec", False):
            for controller in natives(self.world):
                for joint, kp in zip(controller.joints, controller.kp, strict=True):
                    found[f"actuator.{joint}.ctrlspec"] = BY_POSITION if kp else BY_VELOCITY
        found["key.initial.ctrl"] = (0.0,) if natives(self.world) else ()
        found |= self._sleep()
        found["stat.meaninertia"] = self.neutral["stat.meaninertia"]
        return found

    # --- options and counts ---------------------------------------------------------------------------------------

    @property
    def _sleeping(self) -> bool:
        return "sleeping" in self.settings and bool(self.settings["sleeping"])

    @property
    def _coulomb(self) -> bool:
        """Whether friction obeys Coulomb's law, which needs neither a cushion nor a rate."""
        return bool(self.settings["friction"] == "coulomb")

    def _impratio(self) -> float:
        least, most = float(self.settings["impratio"]), float(self.settings["high_impratio"])
        needed = 0.0
        for law in self.laws.values():
            if law.friction and law.hardness.kind in COMPLIANT:
                return most
            for moment in (law.torsional_friction, law.rolling_friction):
                if law.friction and moment:
                    # 1e4 at 0.5 ms and c = μ mm, with the inverse square of both
                    needed = max(needed, 1e4 * (law.friction * 1e-3 / moment) ** 2 * (0.5e-3 / self.dt) ** 2)
        powers = (float(f"1e{exponent}") for exponent in range(-30, 30))
        raised = next(power for power in powers if power >= 0.999 * needed)
        return max(least, min(most, raised))

    def _options(self) -> dict[str, Any]:
        """What simspec says; all else is MuJoCo's own, and without effect (``o_*`` without override) or off."""
        settings = self.settings
        said: dict[str, Any] = {
            "timestep": self.dt,
            "gravity": self.world.physics.gravity,
            "cone": CONES[self.world.contact.friction_cone],
            "solver": SOLVERS[settings["solver"]],
            "impratio": self._impratio(),
            "integrator": EULER,
            "jacobian": AUTO,
            **self._fluid(),
            "magnetic": (0.0, 0.0, 0.0),
            "noslip_tolerance": 1e-6,
            "ccd_iterations": 50,
        }
        for name in ("iterations", "tolerance", "ls_iterations", "ls_tolerance", "noslip_iterations", "ccd_tolerance"):
            said[name] = settings[name]
        if self._sleeping:
            said["sleep_tolerance"] = float(settings["sleep_tolerance"])
        own = {name: value for name, value in self.neutral.items() if name.startswith("opt.")}
        return {name: said.get(name.removeprefix("opt."), value) for name, value in own.items()}

    def _fluid(self) -> dict[str, Any]:
        around = self.world.physics.fluid
        if around is None or all(body.box is None for body in self.world.bodies):
            return {"density": 0.0, "viscosity": 0.0, "wind": (0.0, 0.0, 0.0)}
        return {"density": around.density, "viscosity": around.viscosity, "wind": around.velocity}

    def _flags(self) -> dict[str, bool]:
        on = set(SET_FLAGS)
        on |= {f"disable_{name}" for name in ("warmstart",) if not self.settings[name]}
        if self._sleeping:
            on.add("enable_sleep")
        # since MuJoCo 4 these two are on unless they are disabled, before they were off unless enabled
        for name, wanted in (
            ("island", self.settings["island"] or self._sleeping),
            ("multiccd", self.settings["multiccd"]),
        ):
            by_default = f"flags.disable_{name}" in self.neutral
            if by_default != bool(wanted):
                on.add(f"{'disable' if by_default else 'enable'}_{name}")
        return {name: name.removeprefix("flags.") in on for name in self.neutral if name.startswith("flags.")}

    def _counts(self) -> dict[str, int]:
        """Of what the world has; of everything else as many as in an empty model."""
        moving = [body.joint for body in self.world.bodies if body.joint.kind != "fixed"]
        servos = sum(len(one.joints) for one in natives(self.world))
        there = {
            "nbody": 1 + len(self.world.bodies) - len(absorbed(self.world)),
            "njnt": len(moving),
            "nv": sum(VELOCITY_SIZE[joint.kind] for joint in moving),
            "nq": sum(len(joint.position) for joint in moving),
            "ngeom": sum(len(body.shapes) for body in self.world.bodies),
            "npair": len(self._explicit[0]),
            "nexclude": len(self._touching.excluded()),
            "nu": servos,
            "nactuator": servos,
            "nout": servos,
            "nkey": 1,
            "nmesh": len(self._hulls),
            "nhfield": len(self._fields),
            "neq": len(self.world.constraints),
            "ntendon": len(self.world.sums),
            "nwrap": sum(len(one.joints) for one in self.world.sums),
            "nsite": 2 * sum(constraint.kind != "follow" for constraint in self.world.constraints)
            + len(self.world.frames),
            "nuser_jnt": 2,
            "flg_surfacevel": int(
                any(any(shape.surface_velocity) for shapes in self.solid.values() for shape in shapes)
            ),
            **self._weights(),
        }
        own = {name: value for name, value in self.neutral.items() if name.startswith("count.")}
        return {name: there.get(name.removeprefix("count."), value) for name, value in own.items()}

    def _weights(self) -> dict[str, int]:
        """How many bodies have another weight than mass × gravity, and whether any has."""
        odd = sum(lumped_gravity_scale(self.world, body) != 1.0 for body in self.world.bodies)
        return {"ngravcomp": odd, "flg_gravcomp": int(odd > 0)}

    # --- joints ---------------------------------------------------------------------------------------------------

    def _joint(self, body: Body) -> dict[str, Any]:
        joint, dt = body.joint, self.dt
        if joint.kind == "fixed":
            return {}
        dofs = VELOCITY_SIZE[joint.kind]
        position = self._start(body)
        straight = joint.kind in SCALAR_JOINTS
        limit, friction = (float(self.settings[f"{name}_impedance"]) for name in ("limit", "dry_friction"))
        values = {
            "jnt.{}.solref": (-float(self.settings["limit_error_reduction"]) / dt**2, -1.0 / dt),
            "jnt.{}.solimp": _flat_impedance(limit),
            "jnt.{}.stiffness": joint.spring_stiffness,
            "jnt.{}.range": joint.position_limits or (0.0, joint.angle_limit or 0.0),
            "jnt.{}.qpos0": (0.0,) if straight else position,
            "jnt.{}.qpos_spring": (joint.spring_rest,) if straight else position,
            "dof.{}.solref": (0.0, -1.0 / dt) * dofs,
            "dof.{}.solimp": _flat_impedance(friction) * dofs,
            "dof.{}.armature": _by_dof(joint, joint.armature, joint.angular_armature),
            "dof.{}.damping": _by_dof(joint, joint.damping, joint.angular_damping),
            "dof.{}.frictionloss": (joint.dry_friction,) * dofs,
        }
        return {name.format(joint.name): value for name, value in values.items()}

    def _start(self, body: Body) -> tuple[float, ...]:
        """Where the joint is before a keyframe is taken: a free body's centre of mass in its place, a ball unturned."""
        joint: Joint = body.joint
        if joint.kind != "free":
            return (1.0, 0.0, 0.0, 0.0)
        turn = joint.position[3:7]
        centre = frames.rotate(turn, lumped_inertial(self.world, body).centre_of_mass)  # type: ignore[arg-type]
        return (*frames.add(joint.position[:3], centre), *turn)  # type: ignore[arg-type]

    # --- contact numbers ------------------------------------------------------------------------------------------

    def _reference(
        self, held: Surface, inverse_mass: float, cushion: bool, settings: Mapping[str, Any]
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """solref and solimp of a law."""
        hardness = held.hardness or Hardness()
        high = float(settings["contact_impedance"])
        if hardness.kind == "native":
            return DEFAULT_REFERENCE, DEFAULT_IMPEDANCE
        if hardness.kind == "time-constant":
            return (hardness.time_constant, hardness.damping_ratio), _flat_impedance(SOFT)
        if hardness.kind == "stiffness":
            share = (1.0 - SOFT) * inverse_mass
            return (-hardness.stiffness * share, -hardness.damping * share), _flat_impedance(SOFT)
        taken_back, bounce = float(settings["contact_error_reduction"]), held.restitution or 0.0
        solref = (-taken_back / self.dt**2, -(1.0 + bounce) / self.dt)
        depth = float(settings["friction_cushion"])
        cushioned = cushion and not self._coulomb and self.world.contact.friction_cone == "elliptic"
        soft = cushioned and depth and held.friction and not bounce
        return solref, ((CUSHION, high, depth, 0.5, 2.0) if soft else _flat_impedance(high))

    @staticmethod
    def _directions(held: Surface | PairContact) -> int:
        return 6 if held.rolling_friction else 4 if held.torsional_friction else 3 if held.friction else 1

    @functools.cached_property
    def _hulls(self) -> list[tuple[float, ...]]:
        """The distinct meshes, in the order in which the file has them."""
        return self._distinct("mesh")

    @functools.cached_property
    def _fields(self) -> list[tuple[float, ...]]:
        """The distinct height fields, in the order in which the file has them."""
        return self._distinct("heightfield")

    def _distinct(self, kind: str) -> list[tuple[float, ...]]:
        shapes = (shape for body in self.world.bodies for shape in body.shapes)
        return list(dict.fromkeys(shape.size for shape in shapes if shape.kind == kind))

    def _geom(self, shape: Any) -> dict[str, Any]:
        assets = {"mesh": self._hulls, "heightfield": self._fields}.get(shape.kind)
        mesh = {f"geom.{shape.name}.dataid": assets.index(shape.size)} if assets is not None else {}
        held = self.plan.numbers[shape.material, 0] if shape.collision else Surface()
        solref, solimp = self._reference(held, 1.0, False, self.settings)
        margin = {f"geom.{shape.name}.margin": shape.margin} if shape.collision and shape.margin else {}
        return (
            mesh
            | margin
            | {
                f"geom.{shape.name}.condim": self._directions(held),
                f"geom.{shape.name}.friction": (
                    held.friction or 0.0,
                    held.torsional_friction or 0.0,
                    held.rolling_friction or 0.0,
                ),
                f"geom.{shape.name}.solref": solref,
                f"geom.{shape.name}.solimp": solimp,
                f"geom.{shape.name}.group": GROUP[shape.collision, shape.visual],
            }
        )

    @functools.cached_property
    def _explicit(self) -> tuple[list[tuple[Pair, str, str]], bool]:
        """The explicit pairs of shapes, with the materials that they are of; and whether all with friction are among them."""
        elliptic = self.world.contact.friction_cone == "elliptic"
        must, may = [], []
        for pair, law in self.laws.items():
            kind = law.hardness.kind
            if pair in self.plan.missed or kind == "stiffness" or pair in self.own or law.margin is not None:
                must.append(pair)
            elif self._coulomb:
                continue
            elif law.friction and (kind in COMPLIANT or (law.restitution and elliptic)):
                must.append(pair)
            elif elliptic and law.friction and kind != "native":
                may.append(pair)
        number: dict[str, int] = {}
        for shapes in self.solid.values():
            for shape in shapes:
                number[shape.material] = number.get(shape.material, 0) + 1
        most = sum(number[a] * (number[b] if a != b else number[b] / 2) for a, b in (*must, *may))
        all_there = most <= int(self.settings["explicit_pairs_limit"])
        chosen = [*must, *may] if all_there else must
        return [(pair, one, two) for pair in chosen for one, two in shape_pairs(self.world, [pair])], all_there

    def _pair(self, law: PairContact, one: str, two: str) -> dict[str, Any]:
        held = Surface(law.friction, law.torsional_friction, law.rolling_friction, law.restitution, law.hardness)
        settings = {**self.settings, **self.own.get((law.first, law.second), {})}
        weight = self._inverse_mass(one) + self._inverse_mass(two)
        solref, solimp = self._reference(held, weight, True, settings)
        name = f"pair.{one},{two}"
        margin = self._margin[one] + self._margin[two] if law.margin is None else law.margin
        return ({f"{name}.margin": margin} if margin else {}) | {
            f"{name}.dim": self._directions(law),
            f"{name}.friction": (law.friction,) * 2 + (law.torsional_friction,) + (law.rolling_friction,) * 2,
            f"{name}.solref": solref,
            f"{name}.solimp": solimp,
            f"{name}.solreffriction": (0.0, -self._slip_rate(law.hardness.kind, settings)),
        }

    @functools.cached_property
    def _margin(self) -> dict[str, float]:
        """Of each solid shape, by its name."""
        return {shape.name: shape.margin for shapes in self.solid.values() for shape in shapes}

    def _slip_rate(self, kind: str, settings: Mapping[str, Any]) -> float:
        """1/s at which friction takes back slip."""
        if kind == "native":
            return 0.0
        if self._coulomb:
            return 1.0 / self.dt
        most = float(settings["friction_share"]) / self.dt
        return most * SOFT if kind in COMPLIANT else min(most, float(settings["friction_rate"]))

    def _inverse_mass(self, shape: str) -> float:
        """Of a single free body; nothing that stiffness is allowed for has another."""
        owner = self._owner[shape]
        mass = lumped_inertial(self.world, owner).mass
        return 0.0 if self.groups[owner.name] == "world" or not mass else 1.0 / mass

    # --- the rest -------------------------------------------------------------------------------------------------

    def _sleep(self) -> dict[str, str]:
        """Trees that are not one free rigid body stay awake, where anything sleeps at all."""
        if not self.neutral.get("has.tree_sleep_policy", False):
            return {}
        may_sleep = free_rigid(self.world)
        found = {}
        for body in self._tree_tops():
            awake = self._sleeping and body.name not in may_sleep
            top = absorbed(self.world).get(body.name, body.name)
            found[f"tree.{top}.sleep"] = "never" if awake else "auto"
        return found

    def _tree_tops(self) -> Iterator[Body]:
        """The topmost moving body of each of MuJoCo's trees."""
        for body in self.world.bodies:
            parent = body.joint.parent
            if body.joint.kind != "fixed" and (parent is None or self.groups[parent] == "world"):
                yield body

    def _carriers(self) -> dict[str, Quaternion]:
        """Orientations of what stands between joints in the body's frame, all joints at zero."""
        found = {}
        known = {body.name: body for body in self.world.bodies}
        for name in absorbed(self.world):
            body, turn = known[absorbed(self.world)[name]], frames.IDENTITY
            while body.name != name:
                turn = frames.multiply(body.joint.origin.quaternion, turn)
                body = known[str(body.joint.parent)]
            found[name] = frames.conjugate(turn)
        return found

    def _own_of(self, pair: Pair) -> dict[str, Any]:
        """What the sidecar says of a pair of materials with settings of its own."""
        solid = [shape for shapes in self.solid.values() for shape in shapes]
        named = [[shape.name for shape in solid if shape.material == material] for material in pair]
        return {"between": list(pair), "shapes": named, "settings": self.own[pair]}

    def _sidecar(self) -> dict[str, Any]:
        settings = {**self.settings, "impratio": self._impratio()}
        if self._sleeping:
            settings["island"] = True
        else:
            for name in ("sleeping", "sleep_tolerance"):  # means nothing without its switch, and is not written
                settings.pop(name, None)
        if not settings.get("arena"):
            settings.pop("arena", None)
        bodies = self.world.bodies
        free = {
            body.name: lumped_inertial(self.world, body).centre_of_mass for body in bodies if body.joint.kind == "free"
        }
        return {
            **({"pair_settings": [self._own_of(pair) for pair in sorted(self.own)]} if self.own else {}),
            "schema": 2,
            "dialect": "mujoco",
            "format": "mjcf",
            "engine": self.engine,
            "world": sha256(self.world),
            "settings": settings,
            "bodies": [
                {"name": body.name, "kind": body.joint.kind, "frame_offset": free.get(body.name, (0.0, 0.0, 0.0))}
                for body in bodies
            ],
            "friction_cone": self.world.contact.friction_cone,
            "explicit_pairs": self._explicit[1],
            "models": [body.model for body in bodies],
            "fixed_joints": {body.name: body.joint.name for body in bodies if body.joint.kind == "fixed"},
            **({"carriers": turns} if (turns := self._carriers()) else {}),
        }
