"""gz sim, Gazebo's simulator, through its Python bindings. This module has never run a gz sim.

It was written to gz sim's documentation and the sources of its bindings and physics system (gz sim 8 to 10), and tried on a
stand-in of the functions that it calls. Nothing in this package was measured in gz sim; figures that were measured in DART
say so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from simspec.contact import Rules
from simspec.dialects.gazebo import NO_VELOCITY_LIMITS, STOPS
from simspec.engines.gazebo.building import proper_inertia
from simspec.engines.gzsim import bindings
from simspec.engines.gzsim.bindings import NAME
from simspec.engines.gzsim.simulation import GzSimSimulation, Server
from simspec.engines.kit.capabilities import FIXED_TIMESTEP, Capability, Deviation
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.settings import Setting
from simspec.engines.kit.simulated import GivenEngine
from simspec.engines.kit.world_simulation import free_joint
from simspec.errors import EngineError
from simspec.formats.sdf.format import UNLIMITED
from simspec.formats.world import AxisJoint, FreeJoint, JsonBody
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.support import classes, features
from simspec.support.declarations import (
    EXACT,
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    for_each,
    never,
    unsupported_if,
)
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import lumped
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, ReadBack, Shape, Vector3, World

# The model in the components of gz sim's server, in the world's frames and order, before its first step.
#
# The server makes components of the SDF; its physics system makes a world of them, which cannot be queried.

KINDS = {"FIXED": "fixed", "REVOLUTE": "hinge", "PRISMATIC": "slide"}
"""SDF's types of joints, as its bindings call them."""
WORLD = "world"


def read_back(sim: GzSimSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model in the server's components, and the present state."""
    backs: list[ReadBack] = []
    q, v = sim.get_state()

    def ask(server: Server, info: Any, components: Any) -> None:
        bodies = []
        for row, body in enumerate(sim.document.bodies):
            state = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
            joint = free_joint(body.joint.name, *state) if isinstance(body.joint, FreeJoint) else None
            joint = joint or dataclasses.replace(
                _joint(sim, server, components, row), position=tuple(state[0]), velocity=tuple(state[1])
            )
            bodies.append(Body(body.name, body.model, _inertial(server, components, row), joint, _seen(body)))
        gravity, step = server.world.gravity(components), info.dt.total_seconds()
        if gravity is None:
            raise EngineError(NAME, "reports no gravity")
        backs.append(sim.model(bodies, _vector(gravity), step, unreadable))

    sim.query(ask)
    return backs[0]


def _joint(sim: GzSimSimulation, server: Server, components: Any, row: int) -> Joint:
    joint, given = server.joints[row], sim.document.bodies[row].joint
    parents = {f"b{number}": number for number in range(len(sim.names))}
    above, below = joint.parent_link_name(components), joint.child_link_name(components)
    if below != f"b{row}" or (above != WORLD and above not in parents):
        raise EngineError(NAME, f"has joint {given.name!r} between {above!r} and {below!r}")
    kind = KINDS.get(joint.type(components).name)
    if kind is None:
        raise EngineError(NAME, f"has joint {given.name!r} as {joint.type(components).name}")
    at = _place(server, components, row)
    origin = at if above == WORLD else frames.compose(frames.inverse(_place(server, components, parents[above])), at)
    origin = frames.compose(origin, _pose(joint.pose(components)))
    found = Joint(given.name, kind, None if above == WORLD else sim.names[parents[above]], origin)
    if kind == "fixed" or not isinstance(given, AxisJoint):
        return found
    (axis,) = joint.axis(components)
    limits = (float(axis.lower()), float(axis.upper()))
    return dataclasses.replace(
        found,
        axis=_vector(axis.xyz()),
        position_limits=limits if any(abs(limit) < UNLIMITED for limit in limits) else None,
        effort_limit=float(axis.effort()) if 0.0 <= axis.effort() < UNLIMITED else None,
        dry_friction=float(axis.friction()),
        # the damping that the server applies, and that of simspec
        damping=float(axis.damping()) + given.damping,
        spring_stiffness=float(axis.spring_stiffness()) + given.spring_stiffness,
        spring_rest=given.spring_rest,
    )


def _inertial(server: Server, components: Any, row: int) -> Inertial:
    """Mass, centre and tensor in the axes of the link, from those in the world's axes that gz sim reports."""
    actual, place = server.links[row].world_inertial(components), _place(server, components, row)
    if actual is None:
        raise EngineError(NAME, "reports no inertia of a link")
    centre = frames.compose(frames.inverse(place), Pose(_vector(actual.pose().pos()))).position
    tensor = actual.moi()
    given = (*(tensor(i, i) for i in range(3)), tensor(0, 1), tensor(0, 2), tensor(1, 2))
    return Inertial(
        float(actual.mass_matrix().mass()), centre, frames.rotate_inertia(frames.conjugate(place.quaternion), given)
    )


def _seen(body: JsonBody) -> tuple[Shape, ...]:
    return tuple(
        Shape(shape.name, shape.kind, shape.size, shape.pose, collision=False, visual=True) for shape in body.shapes
    )


def _place(server: Server, components: Any, row: int) -> Pose:
    return _pose(server.links[row].world_pose(components))


def _pose(pose: Any) -> Pose:
    turn: Quaternion = (pose.rot().w(), pose.rot().x(), pose.rot().y(), pose.rot().z())
    return Pose(_vector(pose.pos()), frames.normalise(turn))


def _vector(vector: Any) -> Vector3:
    return (vector.x() + 0.0, vector.y() + 0.0, vector.z() + 0.0)


_NO_CONTACT = "gz sim's Python bindings report no contacts to compare, so that simspec passes no collision shapes"
_NO_DYNAMICS = "gz sim's Python bindings report no dynamics"
_EFFORTS_ONLY = "simspec drives gz sim by efforts only"
_NO_SHAPES = "simspec does not pass visual shapes to gz sim, whose physics ignores them"
MICROSECOND = 1e-6
"""s: gz sim's bindings tell times in Python's timedelta, which has no shorter ones."""


def _nothing_solid(world: World) -> Refinement | None:
    """Declarations of contact do not matter where no shape is solid."""
    return None if _solid(world) else Refinement(Level.EXACT, "no shape of this world is solid")


def _only_visual(world: World) -> Refinement | None:
    name = _solid(world)
    return unsupported_if(f"{_NO_CONTACT}, and {name!r} is solid" if name else None)


def _solid(world: World) -> str | None:
    return next((shape.name for body in world.bodies for shape in solid_shapes(body)), None)


def _proper_inertias(world: World) -> Refinement | None:
    """Not supported where a body moves whose inertia SDF's reader rejects."""
    groups, inertials = rigid_groups(world), lumped(world)
    for body in world.bodies:
        inertial = inertials.get(body.name, body.inertial)
        if groups[body.name] != "world" and not proper_inertia(inertial.mass, inertial.inertia):
            return unsupported_if(
                f"SDF has no moving bodies without mass or moment of inertia, and {body.name!r} moves"
            )
    return None


def _whole_microseconds(world: World) -> Refinement | None:
    steps = world.physics.timestep / MICROSECOND
    whole = steps >= 0.5 and abs(steps - round(steps)) < 1e-9 * steps
    return unsupported_if(None if whole else "gz sim's Python bindings report timesteps in whole microseconds only")


_NO_SHAPES = "simspec passes no shapes to gz sim"


class GzSim(GivenEngine[GzSimSimulation]):
    """The simulator gz sim with its physics system, through its Python bindings: poses, velocities and joint states of its
    server's components, efforts as its commands. Files only: where it is not installed, the files are proven (L0). *simspec
    has never run a real gz sim:* the interface follows its documentation and was tested with a stand-in. Mass matrix, bias
    force and contact cannot be queried."""

    NAME: ClassVar[str] = bindings.NAME
    TITLE: ClassVar[str] = "gz sim"
    DIALECT: ClassVar[str] = "gazebo"
    DISTRIBUTION: ClassVar[str] = ""
    EXTRA: ClassVar[str] = ""
    NEEDS: ClassVar[Needs] = Needs(program=bindings.INSTALLED, elsewhere=bindings.WANTED)
    FILES_ALONE: ClassVar[str] = (
        "no gz sim is installed that simspec could run: files only. simspec has never run a real gz sim"
    )
    RULES: ClassVar[Rules] = Rules("min", "product")
    LAYERS: ClassVar[bool] = True
    STEPS_UNMEASURED: ClassVar[str] = "accelerations of single steps were not measured in gz sim"
    LACKS: ClassVar[Mapping[Capability, str]] = {
        Capability.TIMESTEP: FIXED_TIMESTEP,
        Capability.MASS_MATRIX: _NO_DYNAMICS,
        Capability.BIAS_FORCE: _NO_DYNAMICS,
        Capability.ENERGY: _NO_DYNAMICS,
        Capability.INVENTORY: "gz sim's physics system does not report its world",
        Capability.PAIR_DETECTION: _NO_CONTACT,
        Capability.NATIVE_CONTROLLERS: _EFFORTS_ONLY,
        Capability.FOREIGN_FILES: "simspec does not load users' worlds through gz sim",
    }
    SUPPORT: ClassVar[Table] = {
        **classes.driven("gz sim"),
        Feature.DRY_FRICTION: EXACT,
        **for_each(
            exact("SDF supports it for static bodies only", refine=_proper_inertias),
            Feature.INERTIA_SINGULAR,
            Feature.MASSLESS,
        ),
        Feature.JOINT_FREE: approximate(
            "gz sim updates the pose and velocity of a link only after it has moved or turned by 1e-6 since the last update; "
            "see docs/engines/gzsim.md",
            short="the pose and velocity of a free body are updated only after it has moved or turned by 1e-6",
        ),
        **for_each(
            never("simspec does not implement it for gz sim"),
            *(Feature.JOINT_BALL, Feature.BALL_DAMPING, Feature.BALL_SPRING, Feature.BALL_ARMATURE),
            *(Feature.FREE_ARMATURE, Feature.KINEMATIC),
        ),
        Feature.JOINT_SEVERAL: classes.NO_MASSLESS,
        Feature.LIMIT_POSITION: STOPS,
        Feature.LIMIT_VELOCITY: NO_VELOCITY_LIMITS,
        **for_each(classes.explicit("DART"), Feature.DAMPING, Feature.SPRING),
        Feature.DAMPING_IMPLICIT: never("simspec does not implement it for gz sim"),
        Feature.ARMATURE: never("DART has no armature, and simspec does not compute it for gz sim"),
        **classes.NOT_IN_WORLD_JSON,
        **{Feature(f"shape.{kind}"): exact(_NO_SHAPES, refine=_only_visual) for kind in SHAPE_KINDS},
        Feature.SHAPE_VISUAL: exact(_NO_SHAPES),
        **for_each(
            dataclasses.replace(never(_NO_CONTACT), refine=_nothing_solid),
            *(*features.CONTACT_LAWS, *features.HARDNESSES, *features.FILTERS),
        ),
        Feature.TIMESTEP: exact("gz sim's timestep is a multiple of 1 µs", refine=_whole_microseconds),
        Feature.CONTROL_NATIVE: never(_EFFORTS_ONLY),
        **for_each(
            classes.IN_TREES_ONLY,
            *(*features.CONSTRAINTS, Feature.SUM_DRY_FRICTION, Feature.SUM_LIMITS),
        ),
    }
    SETTINGS: ClassVar[Mapping[str, Setting]] = {}
    CONTACT_DEVIATIONS: ClassVar[tuple[Deviation, ...]] = ()
    UNREADABLE: ClassVar[Mapping[str, str]] = {
        "collision_group": _NO_SHAPES,
        "shape.visual": _NO_SHAPES,
        "friction_cone": _NO_SHAPES,
        "joint.velocity_limit": "simspec passes no velocity limits to gz sim, whose DART would enforce them",
        "static.inertial": "simspec writes another inertia of static bodies where SDF accepts none",
    }

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> GzSimSimulation:
        return GzSimSimulation(folder, sidecar)

    def _read_model(self) -> ReadBack:
        return read_back(self._simulation, dict(self.UNREADABLE))

    def contacts(self) -> dict[str, np.ndarray]:
        return self._simulation.contacts()

    def disable_dry_friction(self, v: np.ndarray) -> None:
        self._simulation.disable_dry_friction(v)
