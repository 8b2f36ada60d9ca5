"""MuJoCo's model (``mjModel``), in the world's frames and order."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from simspec.dialects.mujoco.sidecar import (
    KEYFRAME,
    NO_RATING,
    Chain,
    CommonLaw,
    MujocoSidecar,
    chains,
    origins,
    surface,
)
from simspec.engines.mujoco.inventory import Inventory
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames, tensor
from simspec.formats.mjcf.bodies import file_name, world_name
from simspec.formats.mjcf.format import MODEL
from simspec.world import frames
from simspec.world.actions import LEAST_MOMENT, Fluid, InertiaBox, JointSum
from simspec.world.frames import vector3
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    ConnectConstraint,
    Constraint,
    EnginePair,
    EngineServo,
    FollowConstraint,
    Frame,
    Inertial,
    Joint,
    Pose,
    Quaternion,
    ReadBack,
    Shape,
    Surface,
    Vector3,
    Velocity6,
    WeldConstraint,
)

UNREADABLE = {
    "collision_group": "MuJoCo stores bit masks and excluded pairs, not the names of groups; simspec probes the filter"
}

JOINT_KINDS = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
"""MuJoCo's mjtJoint numbers."""
SHAPE_KINDS = {
    0: "plane",
    1: "heightfield",
    2: "sphere",
    3: "capsule",
    4: "ellipsoid",
    5: "cylinder",
    6: "box",
    7: "mesh",
}
"""MuJoCo's mjtGeom numbers."""
HALVED = {
    "sphere": (False,),
    "box": (True, True, True),
    "cylinder": (False, True),
    "capsule": (False, True),
    "ellipsoid": (False, False, False),
    "plane": (),
}
"""Which numbers of a geom's size are half lengths."""
SERVO = (0, 0, 0, 1)
"""MuJoCo's numbers of an actuator on a joint, without dynamics, with a fixed gain and an affine bias."""
EQUALITIES = {"mjEQ_JOINT": "follow", "mjEQ_CONNECT": "connect", "mjEQ_WELD": "weld"}
"""MuJoCo's kinds of equalities, as constraints."""
CONE_NAMES = {0: "pyramid-inscribed", 1: "elliptic"}
"""MuJoCo's mjtCone numbers."""
VISIBLE_GROUPS = (0, 1, 2)
"""Groups that MuJoCo's viewers show."""


def read_back(mujoco: Any, model: Any, sidecar: MujocoSidecar, disableflags: int) -> ReadBack:
    """The model as ``mjModel`` holds it; ``disableflags`` as the file gave them.

    It has no place for the names of models and of rigid joints; these come from the sidecar.
    """
    found, neutral = Inventory(mujoco, model, sidecar, disableflags).values()
    return dataclasses.replace(_ReadBack(mujoco, model, sidecar).world(), inventory=found, neutral=neutral)


def _vector(values: Any) -> Vector3:
    x, y, z = values.tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def _pose(position: Any, quaternion: Any) -> Pose:
    return Pose(_vector(position), frames.normalise(tuple(quaternion.tolist())))


def _single(values: Any) -> tuple[float, ...]:
    """Numbers that MuJoCo keeps in single precision, as the shortest decimals that give them."""
    return tuple(float(str(value)) for value in np.asarray(values, dtype=np.float32))


def frame_sites(mujoco: Any, model: Any) -> dict[str, int]:
    """The sites that stand for named frames, which are those that no equality is of, in the order of their names."""
    of_site = mujoco.mjtObj.mjOBJ_SITE
    actual = {
        int(site)
        for row in range(model.neq)
        if int(model.eq_objtype[row]) == int(of_site)
        for site in (model.eq_obj1id[row], model.eq_obj2id[row])
    }
    named = {
        mujoco.mj_id2name(model, of_site, site) or f"site {site}": site
        for site in range(model.nsite)
        if site not in actual
    }
    return dict(sorted(named.items()))


class _ReadBack:
    def __init__(self, mujoco: Any, model: Any, sidecar: MujocoSidecar):
        self._mujoco, self._model, self._sidecar = mujoco, model, sidecar
        self._names = {kind: self._all_names(kind) for kind in ("BODY", "JOINT", "GEOM", "KEY")}
        if KEYFRAME not in self._names["KEY"]:
            raise EngineError("mujoco", f"{MODEL} has no keyframe {KEYFRAME!r}")
        self._key = self._names["KEY"].index(KEYFRAME)
        self._law = CommonLaw.of(float(model.opt.timestep), sidecar.settings)

    def _all_names(self, kind: str) -> list[str]:
        count = {"BODY": "nbody", "JOINT": "njnt", "GEOM": "ngeom", "KEY": "nkey"}[kind]
        object_type = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}")
        return [
            self._mujoco.mj_id2name(self._model, object_type, index) or ""
            for index in range(getattr(self._model, count))
        ]

    def world(self) -> ReadBack:
        place = {name: index for index, name in enumerate(self._names["BODY"])}
        actual = {
            body.name: body
            for name, chain in chains(self._sidecar).items()
            for body in self._bodies(place[file_name(name)], chain)
        }
        bodies = tuple(
            dataclasses.replace(actual[body.name], model=model)
            for body, model in zip(self._sidecar.bodies, self._sidecar.models, strict=True)
        )
        option = self._model.opt
        return ReadBack(
            restore_frames(bodies, self._sidecar.offsets),
            _vector(option.gravity),
            float(option.timestep),
            CONE_NAMES[int(option.cone)],
            dict(UNREADABLE),
            self._pairs(),
            self._servos(),
            constraints=self._constraints(),
            sums=self._sums(),
            frames=self._frames(),
            fluid=self._fluid(),
        )

    def _fluid(self) -> Fluid | None:
        option = self._model.opt
        fluid = Fluid(float(option.density), float(option.viscosity), _vector(option.wind))
        return None if fluid == Fluid() else fluid

    def _box(self, index: int) -> InertiaBox | None:
        """The box by which the fluid acts on a body: MuJoCo's own, of a moving body with mass."""
        model, mass = self._model, float(self._model.body_mass[index])
        if self._fluid() is None or model.body_weldid[index] == 0 or mass < LEAST_MOMENT:
            return None
        x, y, z = model.body_inertia[index].tolist()
        edges = [math.sqrt(max(LEAST_MOMENT, moment) / mass * 6.0) for moment in (y + z - x, x + z - y, x + y - z)]
        return InertiaBox((edges[0], edges[1], edges[2]), frames.normalise(tuple(model.body_iquat[index].tolist())))

    def _constraints(self) -> tuple[Constraint, ...]:
        """The equalities as simspec writes them, of two joints and of two sites; others are counted (``count.neq``)."""
        model, kinds = self._model, self._mujoco.mjtEq.__members__
        names = {int(kinds[name]): word for name, word in EQUALITIES.items()}
        actual: list[Constraint] = []
        for row in range(model.neq):
            name = self._mujoco.mj_id2name(model, self._mujoco.mjtObj.mjOBJ_EQUALITY, row) or ""
            kind = names.get(int(model.eq_type[row]))
            index, other, data = int(model.eq_obj1id[row]), int(model.eq_obj2id[row]), model.eq_data[row].tolist()
            if kind is None or not model.eq_active0[row]:
                continue
            if kind == "follow":
                joints = self._names["JOINT"]
                if any(data[2:5]) or other < 0:
                    continue
                actual.append(FollowConstraint(name, joints[index], joints[other], data[1], data[0]))
                continue
            if int(model.eq_objtype[row]) != int(self._mujoco.mjtObj.mjOBJ_SITE):
                continue
            (first, near), (second, far) = self._end(index), self._end(other)
            if kind == "connect":
                actual.append(ConnectConstraint(name, first, second, near.position, far.position))
            else:
                actual.append(WeldConstraint(name, first, second, frames.compose(near, frames.inverse(far))))
        return tuple(sorted(actual, key=lambda constraint: constraint.name))

    def _sums(self) -> tuple[JointSum, ...]:
        """The fixed tendons; others show in the inventory (``count.nwrap``, ``tendon.type``)."""
        model, joints = self._model, self._names["JOINT"]
        of_joint = int(self._mujoco.mjtWrap.mjWRAP_JOINT)
        joint_sums: list[JointSum] = []
        for row in range(model.ntendon):
            parts = range(model.tendon_adr[row], model.tendon_adr[row] + model.tendon_num[row])
            if any(int(model.wrap_type[part]) != of_joint for part in parts):
                continue
            weights = tuple(
                sorted((joints[int(model.wrap_objid[part])], float(model.wrap_prm[part])) for part in parts)
            )
            slack, taut = model.tendon_lengthspring[row].tolist()
            if slack != taut:
                raise EngineError("mujoco", f"tendon {row} has a spring that is slack from {slack} to {taut}")
            lower, upper = model.tendon_range[row].tolist()
            joint_sums.append(
                JointSum(
                    self._mujoco.mj_id2name(model, self._mujoco.mjtObj.mjOBJ_TENDON, row) or "",
                    weights,
                    float(model.tendon_stiffness[row]),
                    slack,
                    float(model.tendon_damping[row]),
                    (lower, upper) if model.tendon_limited[row] else None,
                    float(model.tendon_frictionloss[row]),
                )
            )
        return tuple(sorted(joint_sums, key=lambda joint_sum: joint_sum.name))

    def _frames(self) -> tuple[Frame, ...]:
        return tuple(Frame(name, *self._end(site)) for name, site in frame_sites(self._mujoco, self._model).items())

    def _end(self, site: int) -> tuple[str, Pose]:
        """A site's body, and where it is in the world's frame of that."""
        model = self._model
        body = world_name(self._names["BODY"][int(model.site_bodyid[site])])
        place = _pose(model.site_pos[site], model.site_quat[site])
        offset = self._sidecar.offsets.get(body, (0.0, 0.0, 0.0))
        return body, Pose(frames.add(place.position, offset), place.quaternion)

    def _bodies(self, index: int, chain: Chain) -> Iterator[Body]:
        """A body, after those between its joints, of which the model has nothing but the joints."""
        model, name = self._model, chain[-1][0]
        moments = _vector(model.body_inertia[index])
        principal = _pose(model.body_ipos[index], model.body_iquat[index])
        inertial = Inertial(float(model.body_mass[index]), principal.position, tensor(moments, principal.quaternion))
        geoms = range(model.body_geomadr[index], model.body_geomadr[index] + model.body_geomnum[index])
        weight = 1.0 - float(model.body_gravcomp[index])
        shapes, box = tuple(map(self._shape, geoms)), self._box(index)
        above = int(model.body_parentid[index])
        parent = world_name(self._names["BODY"][above]) if above else None
        place = _pose(model.body_pos[index], model.body_quat[index])
        count = int(model.body_jntnum[index])
        if count == 0 and len(chain) == 1:
            fixed = Joint(self._sidecar.fixed_joints.get(name, ""), "fixed", parent, place)
            yield Body(name, "", inertial, fixed, shapes, gravity_scale=weight, box=box)
            return
        if count != len(chain):
            raise EngineError("mujoco", f"body {name!r} holds {count} joints, not {len(chain)}")
        joints = range(model.body_jntadr[index], model.body_jntadr[index] + count)
        in_body = [Pose(_vector(model.jnt_pos[joint]), turn) for joint, (_, turn) in zip(joints, chain, strict=True)]
        if any(in_body[-1].position):
            raise EngineError("mujoco", f"joint {self._names['JOINT'][joints[-1]]!r} is not at its body's origin")
        for joint, (called, turn), origin in zip(joints, chain, origins(place, in_body), strict=True):
            last = called == name
            moved = self._joint(joint, parent, origin, turn)
            body = Body(called, "", Inertial(0.0), moved)
            if last:
                body = dataclasses.replace(body, inertial=inertial, shapes=shapes, gravity_scale=weight, box=box)
            yield body
            parent = called

    def _joint(self, joint: int, parent: str | None, origin: Pose, turn: Quaternion) -> Joint:
        """A joint; ``origin``: of its frame in what it moves against, ``turn``: the orientation of that in the body's."""
        model = self._model
        kind = JOINT_KINDS[int(model.jnt_type[joint])]
        first, start = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        position = tuple(model.key_qpos[self._key][start : start + POSITION_SIZE[kind]].tolist())
        velocity = tuple(model.key_qvel[self._key][first : first + VELOCITY_SIZE[kind]].tolist())
        axis, rest = (0.0, 0.0, 0.0), 0.0
        if kind == "free":
            position = (*position[:3], *frames.normalise(position[3:]))
            velocity = (*velocity[:3], *frames.rotate(position[3:], velocity[3:]))
            origin = Pose()
        elif kind == "ball":
            position = frames.normalise(position)
        else:
            axis = frames.rotate(frames.conjugate(turn), _vector(model.jnt_axis[joint]))
            rest = float(model.qpos_spring[start]) - float(model.qpos0[start])
            self._check_zero(joint, start)
        velocity_limit, effort_limit = (
            None if rating == NO_RATING else float(rating) for rating in model.jnt_user[joint][:2]
        )
        lower, upper = model.jnt_range[joint].tolist()
        if kind == "ball" and lower:
            raise EngineError("mujoco", f"the range of {self._names['JOINT'][joint]!r} begins at {lower}, not at 0")
        return Joint(
            self._names["JOINT"][joint],
            kind,
            parent,
            origin,
            axis,
            (lower, upper) if model.jnt_limited[joint] and kind != "ball" else None,
            velocity_limit,
            effort_limit,
            damping=float(model.dof_damping[first]),
            dry_friction=float(model.dof_frictionloss[first]),
            armature=float(model.dof_armature[first]),
            spring_stiffness=float(model.jnt_stiffness[joint]),
            spring_rest=rest,
            position=position,
            velocity=velocity,
            angular_damping=float(model.dof_damping[first + 3]) if kind == "free" else 0.0,
            angular_armature=float(model.dof_armature[first + 3]) if kind == "free" else 0.0,
            angle_limit=upper if model.jnt_limited[joint] and kind == "ball" else None,
        )

    def _check_zero(self, joint: int, start: int) -> None:
        if self._model.qpos0[start] != 0.0:
            raise EngineError("mujoco", f"joint {self._names['JOINT'][joint]!r} is not at zero")

    def _shape(self, geom: int) -> Shape:
        model = self._model
        kind = SHAPE_KINDS[int(model.geom_type[geom])]
        pose, place = _pose(model.geom_pos[geom], model.geom_quat[geom]), Pose()
        if kind == "mesh":
            size, place = self._hull(int(model.geom_dataid[geom]))
            pose = frames.compose(pose, frames.inverse(place))
        elif kind == "heightfield":
            size = self._field(int(model.geom_dataid[geom]))
        else:
            size = tuple(
                2.0 * value if halved else value
                for value, halved in zip(model.geom_size[geom].tolist(), HALVED[kind], strict=False)
            )
        collides = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        surfaces: tuple[Surface, ...] = ()
        if collides:
            actual = (model.geom_friction[geom], model.geom_solref[geom], model.geom_solimp[geom])
            friction, solref, solimp = (tuple(numbers.tolist()) for numbers in actual)
            surfaces = (surface(int(model.geom_condim[geom]), friction, solref, solimp, self._law),)
        red, green, blue, alpha = _single(model.geom_rgba[geom])
        return Shape(
            self._names["GEOM"][geom],
            kind,
            size,
            pose,
            "",
            collides,
            int(model.geom_group[geom]) in VISIBLE_GROUPS,
            (red, green, blue, alpha),
            surfaces,
            margin=float(model.geom_margin[geom]) if collides else 0.0,
            surface_velocity=self._surface_velocity(geom, place),
        )

    def _surface_velocity(self, geom: int, place: Pose) -> Velocity6:
        """``place``: where MuJoCo has put the geom in the shape's frame."""
        if not hasattr(self._model, "geom_surfacevel"):
            return (0.0,) * 6
        linear, angular = (vector3(row) for row in self._model.geom_surfacevel[geom].reshape(2, 3).tolist())
        at = frames.add(linear, frames.cross(angular, frames.inverse(place).position))
        return (*frames.rotate(place.quaternion, at), *frames.rotate(place.quaternion, angular))

    def _hull(self, mesh: int) -> tuple[tuple[float, ...], Pose]:
        """The vertices that contact is computed with, in the frame of the file, and where in that frame MuJoCo has put the
        mesh's: its centre of mass and principal axes. Of a mesh that nothing touches there is no hull: all vertices count."""
        model = self._model
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], dtype=float)
        if model.mesh_graphadr[mesh] >= 0:
            graph = model.mesh_graph[int(model.mesh_graphadr[mesh]) :]
            corners = int(graph[0])
            vertices = vertices[graph[2 + corners : 2 + 2 * corners]]
        place = _pose(model.mesh_pos[mesh], model.mesh_quat[mesh])
        in_file = vertices @ np.array(frames.matrix(place.quaternion)).T + place.position
        return tuple(in_file.ravel().tolist()), place

    def _field(self, field: int) -> tuple[float, ...]:
        """A height field as the world has it; elevations are shares, in single precision."""
        model = self._model
        rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
        first = int(model.hfield_adr[field])
        shares = np.asarray(model.hfield_data[first : first + rows * columns], dtype=float)
        half_x, half_y, top, base = model.hfield_size[field].tolist()
        return (float(rows), float(columns), 2.0 * half_x, 2.0 * half_y, base, *(top * shares).tolist())

    def _servos(self) -> tuple[EngineServo, ...]:
        """The actuators, of which each must be a position or velocity controller of one joint."""
        model = self._model
        found = []
        for index in range(model.nu):
            joint = self._names["JOINT"][int(model.actuator_trnid[index, 0])]
            kinds = (model.actuator_trntype, model.actuator_dyntype, model.actuator_gaintype, model.actuator_biastype)
            gain, bias = model.actuator_gainprm[index], model.actuator_biasprm[index]
            kp, kd = -float(bias[1]) + 0.0, -float(bias[2]) + 0.0
            plain = (
                tuple(int(kind[index]) for kind in kinds) == SERVO
                and model.actuator_gear[index].tolist() == [1.0] + [0.0] * 5
            )
            if not plain or model.actuator_ctrllimited[index] or bias[0] or gain[0] != (kp or kd) or gain[1:].any():
                raise EngineError("mujoco", f"the actuator of {joint!r} is not a position or velocity controller")
            limit = None
            if model.actuator_forcelimited[index]:
                lower, limit = model.actuator_forcerange[index].tolist()
                if lower != -limit:
                    raise EngineError("mujoco", f"the effort limit of {joint!r}'s actuator is not the same both ways")
            found.append(EngineServo(joint, kp, kd, limit))
        return tuple(found)

    def _pairs(self) -> tuple[EnginePair, ...]:
        """The explicit pairs, sorted; MuJoCo's own inverse masses turn its accelerations back into forces."""
        model = self._model
        found = []
        for pair in range(model.npair):
            ends = (int(model.pair_geom1[pair]), int(model.pair_geom2[pair]))
            first, second = sorted(self._names["GEOM"][end] for end in ends)
            sliding, other_sliding, torsion, roll, other_roll = model.pair_friction[pair].tolist()
            if sliding != other_sliding or roll != other_roll:
                raise EngineError("mujoco", f"the explicit pair of {first!r} and {second!r} is not isotropic")
            inverse_mass = sum(float(model.body_invweight0[model.geom_bodyid[end]][0]) for end in ends)
            solref, solimp = tuple(model.pair_solref[pair].tolist()), tuple(model.pair_solimp[pair].tolist())
            condim = int(model.pair_dim[pair])
            law = CommonLaw.of(float(model.opt.timestep), self._sidecar.settings_between(first, second))
            stored = surface(condim, (sliding, torsion, roll), solref, solimp, law, inverse_mass)
            found.append(EnginePair(first, second, stored, float(model.pair_margin[pair])))
        return tuple(sorted(found, key=lambda actual: (actual.first, actual.second)))
