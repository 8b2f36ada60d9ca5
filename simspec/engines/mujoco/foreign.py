"""A URDF or MJCF file as MuJoCo's own compiler makes it, by ``MjModel.from_xml_path``.

Facts marked *measured*: mujoco 4.0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.kit.foreign import MESH, UNNAMED, Effect, EngineAddition, Reads, support
from simspec.engines.mujoco.readback import CONE_NAMES, HALVED, JOINT_KINDS, SHAPE_KINDS, VISIBLE_GROUPS
from simspec.errors import EngineError
from simspec.formats.kit.contract import tensor
from simspec.world import frames
from simspec.world.types import Body, EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

MEASURED: Final = "4.0.1"
URDF_EFFECTS: Final = (
    Effect("joint.velocity_limit", "velocity limit", "drops the velocity limits of joints"),
    Effect(
        "joint.type",
        "free root",
        "fixes the root to the world; --profile floating keeps it free",
        profiles=("fixed-base",),
    ),
)
"""Effects of MuJoCo on plain URDF."""
FOREIGN: Final[Mapping[str, Reads]] = {
    "urdf": Reads("mujoco.MjModel.from_xml_path(file)", (".urdf",), "robot", version=MEASURED, effects=URDF_EFFECTS),
    "mjcf": Reads("mujoco.MjModel.from_xml_path(file)", (".xml", ".mjcf"), "mujoco", defines=True, version=MEASURED),
}
FOREIGN_ADDITIONS: Final[Mapping[str, EngineAddition]] = {
    "timestep": EngineAddition(None, "default", "2 ms, unless the file says another"),
    "cone": EngineAddition(None, "default", "the pyramid, unless the file says another"),
    "integrator": EngineAddition(None, "default", "Euler, unless the file says another"),
    "density": EngineAddition(None, "default", "density of the medium in which bodies move; 0: none"),
    "disabled_equalities": EngineAddition(0, "physics", "constraints of the file that are switched off"),
}
"""MuJoCo's additions that a file need not state."""
WORLD: Final = "world"
"""MuJoCo's body for what is fixed to the world."""
INTEGRATORS: Final = {0: "Euler", 1: "RK4", 2: "implicit", 3: "implicitfast"}
OTHER_KINDS: Final = {1: "heightfield", 8: "signed distance field"}
"""mjtGeom numbers of shapes that simspec does not have."""
MESH_GEOM: Final = 7


def load(mujoco: Any, file: Path, log: list[str]) -> ReadBack:
    """MuJoCo's model of a file. Raises EngineError where it refuses it."""
    mujoco.set_mju_user_warning(log.append)
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise EngineError("mujoco", f"refuses the file: {error}") from error
    return _Loaded(mujoco, model).read_back()


class _Loaded:
    def __init__(self, mujoco: Any, model: Any):
        self._mujoco, self._model = mujoco, model
        self._shift = [self._anchor(body) for body in range(model.nbody)]

    def _name(self, kind: str, index: int) -> str:
        return self._mujoco.mj_id2name(self._model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}"), index) or ""

    def _body_name(self, index: int) -> str:
        return self._name("BODY", index) or UNNAMED.format(index)

    def _anchor(self, body: int) -> Vector3:
        """The place of a body's last joint in its frame, where body frames are reported."""
        model = self._model
        last = int(model.body_jntadr[body] + model.body_jntnum[body]) - 1
        if not model.body_jntnum[body] or JOINT_KINDS[int(model.jnt_type[last])] == "free":
            return (0.0, 0.0, 0.0)
        return _vector(model.jnt_pos[last])

    def read_back(self) -> ReadBack:
        model = self._model
        option = model.opt
        bodies = tuple(body for index in range(1, model.nbody) for body in self._chain(index))
        shapes = self._shapes(0)
        if shapes:
            bodies = (Body(WORLD, WORLD, Inertial(0.0), Joint("", "fixed"), shapes), *bodies)
        inventory: dict[str, EngineValue] = {
            "timestep": float(option.timestep),
            "cone": CONE_NAMES[int(option.cone)],
            "integrator": INTEGRATORS.get(int(option.integrator), str(int(option.integrator))),
            "density": float(option.density),
            "disabled_equalities": int(model.neq - np.count_nonzero(model.eq_active0)),
        }
        gravity = _vector(option.gravity)
        if int(option.disableflags) & int(self._mujoco.mjtDisableBit.mjDSBL_GRAVITY):
            gravity = (0.0, 0.0, 0.0)
        return ReadBack(bodies, gravity, float(option.timestep), CONE_NAMES[int(option.cone)], inventory=inventory)

    def _chain(self, index: int) -> Iterator[Body]:
        """A body; with several joints, after bodies without mass that carry the joints before the last."""
        model, name = self._model, self._body_name(index)
        above = int(model.body_parentid[index])
        parent = self._body_name(above) if above else None
        turn = frames.normalise(tuple(model.body_quat[index].tolist()))
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        start = _vector(model.jnt_pos[first]) if count > 1 else self._shift[index]
        place = frames.add(_vector(model.body_pos[index]), frames.rotate(turn, start))
        origin = Pose(frames.subtract(place, self._shift[above]), turn)
        moments = _vector(model.body_inertia[index])
        principal = frames.normalise(tuple(model.body_iquat[index].tolist()))
        centre = frames.subtract(_vector(model.body_ipos[index]), self._shift[index])
        inertial = Inertial(float(model.body_mass[index]), centre, tensor(moments, principal))
        root = self._body_name(int(model.body_rootid[index]))
        if not count:
            yield Body(name, root, inertial, Joint("", "fixed", parent, origin), self._shapes(index))
            return
        for joint in range(first, first + count):
            last = joint == first + count - 1
            actual = self._joint(joint, parent, origin)
            text = name if last else f"{name}/{actual.name or joint - first}"
            yield Body(text, root, inertial if last else Inertial(0.0), actual, self._shapes(index) if last else ())
            parent = text
            if not last:
                step = frames.subtract(_vector(model.jnt_pos[joint + 1]), _vector(model.jnt_pos[joint]))
                origin = Pose(step)

    def _joint(self, joint: int, parent: str | None, origin: Pose) -> Joint:
        model = self._model
        kind = JOINT_KINDS[int(model.jnt_type[joint])]
        start, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        name = self._name("JOINT", joint)
        if kind == "free":
            x, y, z, *quaternion = model.qpos0[start : start + 7].tolist()
            turn = frames.normalise((quaternion[0], quaternion[1], quaternion[2], quaternion[3]))
            return Joint(name, kind, None, position=(x, y, z, *turn))
        lower, upper = (model.jnt_range[joint] - model.qpos0[start]).tolist()
        effort = float(model.jnt_actfrcrange[joint][1]) if model.jnt_actfrclimited[joint] else None
        scalar = kind != "ball"
        return Joint(
            name,
            kind,
            parent,
            origin,
            _vector(model.jnt_axis[joint]) if scalar else (0.0, 0.0, 0.0),
            (lower, upper) if model.jnt_limited[joint] and scalar else None,
            None,
            effort,
            damping=float(model.dof_damping[dof]),
            dry_friction=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
            spring_stiffness=float(model.jnt_stiffness[joint]),
            spring_rest=float(model.qpos_spring[start] - model.qpos0[start]) if scalar else 0.0,
        )

    def _shapes(self, body: int) -> tuple[Shape, ...]:
        model = self._model
        first = int(model.body_geomadr[body])
        shapes = (self._shape(geom, self._shift[body]) for geom in range(first, first + int(model.body_geomnum[body])))
        return tuple(shapes)

    def _shape(self, geom: int, shift: Vector3) -> Shape:
        model = self._model
        number = int(model.geom_type[geom])
        kind = SHAPE_KINDS.get(number, OTHER_KINDS.get(number, MESH))
        pose = Pose(
            frames.subtract(_vector(model.geom_pos[geom]), shift),
            frames.normalise(tuple(model.geom_quat[geom].tolist())),
        )
        size: tuple[float, ...] = ()
        if number == MESH_GEOM:
            size = support(self._vertices(int(model.geom_dataid[geom])))
        elif kind in HALVED:
            numbers = zip(model.geom_size[geom].tolist(), HALVED[kind], strict=False)
            size = tuple(2.0 * value if halved else value for value, halved in numbers)
        friction = model.geom_friction[geom].tolist()
        shape = Shape(
            self._name("GEOM", geom),
            kind,
            size,
            pose,
            collision=self._collides(geom),
            visual=int(model.geom_group[geom]) in VISIBLE_GROUPS,
        )
        return dataclasses.replace(shape, surfaces=(Surface(friction[0], friction[1], friction[2]),))

    def _collides(self, geom: int) -> bool:
        """Whether a geom's bits let it touch any geom of the file, or another like itself."""
        model = self._model
        local = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        return bool(((local[0] & model.geom_conaffinity) | (local[1] & model.geom_contype)).any())

    def _vertices(self, mesh: int) -> Any:
        """The vertices of a mesh's convex hull, else all: in the geom's frame, which MuJoCo puts at the centre of mass."""
        model = self._model
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.asarray(model.mesh_vert[start : start + count], dtype=float)
        graph = int(model.mesh_graphadr[mesh])
        if graph < 0:
            return vertices
        hull = int(model.mesh_graph[graph])
        return vertices[model.mesh_graph[graph + 2 + hull : graph + 2 + 2 * hull]]


def _vector(values: Any) -> Vector3:
    x, y, z = values.tolist()
    return (x + 0.0, y + 0.0, z + 0.0)
