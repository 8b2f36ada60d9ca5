"""Libraries that read robot files and are no engines of simspec: how a user calls them, what they make of a file, and what they
are known to do to plain files. The facts are those of Pinocchio 4.1.0, yourdfpy 0.0.60 and usd-core 26.11.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.kit.foreign import (
    MESH,
    REFUSED,
    Effect,
    EngineLink,
    Reads,
    bodies_of_links,
    distinct_names,
    support,
)
from simspec.formats.kit.contract import tensor
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack, Shape, Vector3

WORLD: Final = "world"
"""The body that stands for what a reader has merged into the world."""
FIXED: Final = Effect(
    "joint.type", "free root", "fixes the root to the world, unless it is given a joint", profiles=("fixed-base",)
)
PINOCCHIO_MJCF: Final = (
    Effect(REFUSED, "several trees", "refuses files with several trees: it reads the first"),
    Effect("gravity", "gravity other than 9.81 m/s² down", "reads no gravity: 9.81 m/s² along -z"),
    Effect("joint.origin.xyz", "on a fixed root that stands elsewhere", "puts a fixed root at the origin"),
    Effect("joint.damping", "damping of a ball joint", "drops the damping of ball joints"),
    Effect("joint.spring_stiffness", "spring of a hinge or a slide", "drops the springs of joints", seen="elsewhere"),
)
DESCRIBED: Final[Mapping[str, str]] = {"Fixed": "fixed", "Revolute": "hinge", "Prismatic": "slide", "Spherical": "ball"}


@dataclass(frozen=True, slots=True)
class AuditLibrary:
    """A library: its ``title``, the ``module`` to import, how it is called for each language, and what it makes of a file."""

    title: str
    module: str
    reads: Mapping[str, Reads]
    load: Callable[[Path, str], ReadBack]


def _vector(values: Any) -> Vector3:
    x, y, z = np.asarray(values, dtype=float).ravel().tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def _placed(matrix: Any) -> Pose:
    """The pose of a homogeneous matrix (4, 4)."""
    m = np.eye(4) if matrix is None else np.asarray(matrix, dtype=float)
    return Pose(_vector(m[:3, 3]), frames.from_matrix(tuple(map(tuple, m[:3, :3].tolist()))))  # type: ignore[arg-type]


def _six(m: Any) -> tuple[float, float, float, float, float, float]:
    t = np.asarray(m, dtype=float).tolist()
    return (t[0][0], t[1][1], t[2][2], t[0][1], t[0][2], t[1][2])


def _ends(lower: float, upper: float) -> tuple[float, float] | None:
    return (float(lower), float(upper)) if math.isfinite(lower) or math.isfinite(upper) else None


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _pinocchio(file: Path, language: str) -> ReadBack:
    import pinocchio

    build = pinocchio.buildModelFromUrdf if language == "urdf" else pinocchio.buildModelFromMJCF
    model = build(str(file))
    model = model[0] if isinstance(model, tuple) else model
    geometry = None
    if language == "urdf":
        kind = pinocchio.GeometryType.COLLISION
        geometry = pinocchio.buildGeomFromUrdf(model, str(file), kind, package_dirs=str(file.parent))
    called = {0: WORLD}
    for frame in model.frames:
        owner = int(frame.parentJoint)
        if frame.type == pinocchio.FrameType.BODY and owner not in called:
            called[owner] = frame.name  # the first body of a joint is the one that it moves
    shapes: dict[int, list[Shape]] = {}
    for object_ in geometry.geometryObjects if geometry is not None else ():
        shapes.setdefault(int(object_.parentJoint), []).append(_coal(object_))
    bodies = []
    for index in range(model.njoints):
        inertia = model.inertias[index]
        inertial = Inertial(float(inertia.mass), _vector(inertia.lever), _six(inertia.inertia))
        parent = int(model.parents[index])
        name, above = called[index], None if parent == 0 else called[parent]
        if index == 0:
            if inertial.mass or 0 in shapes:
                bodies.append(Body(name, name, inertial, Joint("", "fixed"), tuple(shapes.get(0, ()))))
            continue
        joint = _pinocchio_joint(model, index, above)
        bodies.append(Body(name, name, inertial, joint, tuple(shapes.get(index, ()))))
    unreadable = {"armature": "URDF has none"} if language == "urdf" else {"shapes": "they are not built from MJCF"}
    unreadable["spring_stiffness"] = "it has no springs"
    return ReadBack(tuple(bodies), _vector(model.gravity.linear), 0.0, unreadable=unreadable)


def _pinocchio_joint(model: Any, index: int, parent: str | None) -> Joint:
    joint, at = model.joints[index], model.jointPlacements[index]
    place = _placed(at.homogeneous)
    short, name = joint.shortname(), model.names[index]
    q, v = int(joint.idx_q), int(joint.idx_v)
    if "FreeFlyer" in short:
        return Joint(name, "free", position=(*place.position, *place.quaternion))
    if "Spherical" in short:
        return Joint(name, "ball", parent, place, damping=float(model.damping[v]), armature=float(model.armature[v]))
    rotates = "JointModelR" in short or "Revolute" in short
    return Joint(
        name,
        "hinge" if rotates else "slide",
        parent,
        place,
        _axis(model, joint),
        _ends(model.lowerPositionLimit[q], model.upperPositionLimit[q]) if joint.nq == 1 else None,
        _finite(model.upperVelocityLimit[v]),
        _finite(model.upperEffortLimit[v]),
        damping=float(model.damping[v]),
        dry_friction=float(model.upperDryFrictionLimit[v]),
        armature=float(model.armature[v]),
    )


def _axis(model: Any, joint: Any) -> Vector3:
    """The axis of a hinge or a slide, from the motion of its joint at unit speed."""
    data = joint.createData()
    position, velocity = np.zeros(model.nq), np.zeros(model.nv)
    position[joint.idx_q] = 1.0 if joint.nq == 2 else 0.0  # an unbounded hinge has the cosine and the sine
    velocity[joint.idx_v] = 1.0
    joint.calc(data, position, velocity)
    motion = np.asarray(data.S).ravel()
    return _vector(motion[3:] if np.any(motion[3:]) else motion[:3])


def _coal(entry: Any) -> Shape:
    """A shape of the library's collision geometry, in the frame of its joint."""
    actual, pose = entry.geometry, _placed(entry.placement.homogeneous)
    kind = type(actual).__name__
    match kind:
        case "Box":
            size = tuple(float(2.0 * value) for value in actual.halfSide)
        case "Sphere":
            size = (float(actual.radius),)
        case "Cylinder" | "Capsule":
            size = (float(actual.radius), float(2.0 * actual.halfLength))
        case _:
            kind, size = MESH, support(np.array(actual.vertices()))
    return Shape(entry.name, kind.lower(), size, pose, visual=False)


def _yourdfpy(file: Path, language: str) -> ReadBack:
    import yourdfpy  # type: ignore[import-untyped, unused-ignore]

    robot = yourdfpy.URDF.load(str(file), load_meshes=True, build_collision_scene_graph=True).robot
    joints = {joint.child: joint for joint in robot.joints}
    bodies = []
    for link in robot.links:
        joint, actual = joints.get(link.name), link.inertial
        inertial = Inertial(0.0)
        if actual is not None:
            place = _placed(actual.origin)
            turned = frames.rotate_inertia(place.quaternion, _six(actual.inertia))
            inertial = Inertial(float(actual.mass), place.position, turned)
        shapes = tuple(
            _yourdfpy_shape(entry, file, solid)
            for group, solid in ((link.collisions, True), (link.visuals, False))
            for entry in group
        )
        bodies.append(Body(link.name, link.name, inertial, _yourdfpy_joint(joint), shapes))
    unreadable = {"armature": "URDF has none", "spring_stiffness": "URDF has none"}
    return ReadBack(tuple(bodies), (0.0, 0.0, 0.0), 0.0, unreadable=unreadable)


def _yourdfpy_joint(joint: Any) -> Joint:
    if joint is None:
        return Joint("", "fixed")
    kinds = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "floating": "free"}
    kind, place = kinds.get(joint.type, joint.type), _placed(joint.origin)
    if kind == "free":
        return Joint(joint.name, kind, position=(*place.position, *place.quaternion))
    if kind == "fixed":
        return Joint(joint.name, kind, joint.parent, place)
    limit, dynamics = joint.limit, joint.dynamics
    ends = None if limit is None or limit.lower is None or joint.type == "continuous" else (limit.lower, limit.upper)
    return Joint(
        joint.name,
        kind,
        joint.parent,
        place,
        _vector(joint.axis),
        ends,
        None if limit is None else limit.velocity,
        None if limit is None else limit.effort,
        damping=0.0 if dynamics is None else float(dynamics.damping or 0.0),
        dry_friction=0.0 if dynamics is None else float(dynamics.friction or 0.0),
    )


def _yourdfpy_shape(entry: Any, file: Path, solid: bool) -> Shape:
    geometry = entry.geometry
    if geometry.box is not None:
        kind, size = "box", tuple(map(float, geometry.box.size))
    elif geometry.sphere is not None:
        kind, size = "sphere", (float(geometry.sphere.radius),)
    elif geometry.cylinder is not None:
        kind, size = "cylinder", (float(geometry.cylinder.radius), float(geometry.cylinder.length))
    else:
        import trimesh

        kind, size = MESH, support(np.array(trimesh.load_mesh(file.parent / geometry.mesh.filename).vertices))
    return Shape(entry.name, kind, size, _placed(entry.origin), collision=solid, visual=not solid)


def _usd(file: Path, language: str) -> ReadBack:
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(file))
    found = UsdPhysics.LoadUsdPhysicsFromRange(stage, ["/"])
    groups = {kind.name: list(zip(*rows, strict=True)) for kind, rows in found.items()}
    joined: dict[str, tuple[str, Any]] = {}
    for kind, word in DESCRIBED.items():
        for _, stored in groups.get(f"{kind}Joint", ()):
            if not stored.excludeFromArticulation:
                joined[str(stored.body1)] = (word, stored)
    shapes: dict[str, list[Shape]] = {}
    for kind in ("Sphere", "Cube", "Cylinder", "Capsule", "Plane", "Mesh"):
        for path, stored in groups.get(f"{kind}Shape", ()):
            shapes.setdefault(str(stored.rigidBody), []).append(_usd_shape(kind, stored, stage.GetPrimAtPath(path)))
    rigid = [(str(path), actual) for path, actual in groups.get("RigidBody", ())]
    named = dict(
        zip((path for path, _ in rigid), distinct_names([_called(stage, path) for path, _ in rigid]), strict=True)
    )
    links = []
    placed: dict[str, Pose] = {}
    waiting = list(rigid)
    while waiting:
        path, stored = waiting.pop(0)
        word, described = joined.get(path, ("free", None))
        above = str(described.body0) if described is not None else ""
        if above in named and above not in placed:
            waiting.append((path, stored))
            continue
        pose = Pose(_vector(stored.position), _turn(stored.rotation))
        if described is not None:  # where it is with its joint at zero: bodies stand where they are at the start
            first = Pose(_vector(described.localPose0Position), _turn(described.localPose0Orientation))
            second = Pose(_vector(described.localPose1Position), _turn(described.localPose1Orientation))
            pose = frames.compose(frames.compose(placed.get(above, Pose()), first), frames.inverse(second))
        placed[path] = pose
        joint, anchor = _usd_joint(stage, word, described)
        inertial = _usd_inertial(UsdPhysics.MassAPI(stage.GetPrimAtPath(path)))
        links.append(
            EngineLink(named[path], named.get(above), pose, inertial, joint, anchor, tuple(shapes.get(path, ())))
        )
    if "" in shapes:
        static = replace(EngineLink(WORLD, None, Pose(), Inertial(0.0), Joint("", "fixed")), shapes=tuple(shapes[""]))
        links.insert(0, static)
    (scene,) = (actual for _, actual in groups["Scene"])
    gravity = _vector(np.array(scene.gravityDirection) * scene.gravityMagnitude)
    unreadable = dict.fromkeys(("armature", "dry_friction", "velocity_limit", "effort_limit"), "UsdPhysics has none")
    return ReadBack(bodies_of_links(links), gravity, 0.0, unreadable=unreadable)


def _called(stage: Any, path: str) -> str:
    return str(stage.GetPrimAtPath(path).GetName())


def _turn(actual: Any) -> tuple[float, float, float, float]:
    w, (x, y, z) = actual.GetReal(), actual.GetImaginary()
    return frames.normalise((float(w), float(x), float(y), float(z)))


def _usd_inertial(actual: Any) -> Inertial:
    moments, turn = actual.GetDiagonalInertiaAttr().Get(), _turn(actual.GetPrincipalAxesAttr().Get())
    centre = _vector(actual.GetCenterOfMassAttr().Get())
    return Inertial(float(actual.GetMassAttr().Get()), centre, tensor(_vector(moments), turn))


def _usd_joint(stage: Any, kind: str, actual: Any) -> tuple[Joint, Vector3]:
    """A joint, and its place in its body. Drives are read in SI units, angles in radians."""
    if actual is None:
        return Joint("", kind), (0.0, 0.0, 0.0)
    anchor, name = _vector(actual.localPose1Position), _called(stage, str(actual.primPath))
    if kind not in SCALAR_JOINTS:
        return Joint(name, kind), anchor
    degrees = math.pi / 180.0 if kind == "hinge" else 1.0
    unit = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}[str(actual.axis.name)[-1]]
    limit, drive = actual.limit, actual.drive
    bounded = limit.enabled and math.isfinite(limit.lower) and abs(limit.lower) < 1e30
    stiffness, damping, rest = (
        (drive.stiffness / degrees, drive.damping / degrees, drive.targetPosition * degrees)
        if drive.enabled
        else (0.0, 0.0, 0.0)
    )
    joint = Joint(
        name,
        kind,
        axis=frames.rotate(_turn(actual.localPose1Orientation), unit),
        position_limits=(limit.lower * degrees, limit.upper * degrees) if bounded else None,
        damping=damping,
        spring_stiffness=stiffness,
        spring_rest=rest,
    )
    return joint, anchor


def _usd_shape(kind: str, actual: Any, prim: Any) -> Shape:
    pose = Pose(_vector(actual.localPos), _turn(actual.localRot))
    size: tuple[float, ...] = ()
    match kind:
        case "Sphere":
            size = (float(actual.radius),)
        case "Cube":
            kind, size = "box", tuple(float(2.0 * value) for value in actual.halfExtents)
        case "Cylinder" | "Capsule":
            size = (float(actual.radius), float(2.0 * actual.halfHeight))
        case "Mesh":
            size = support(np.array(prim.GetAttribute("points").Get(), dtype=float))
    return Shape(str(prim.GetName()), kind.lower(), size, pose, visual=False)


LIBRARIES: Final[Mapping[str, AuditLibrary]] = {
    "pinocchio": AuditLibrary(
        "Pinocchio",
        "pinocchio",
        {
            "urdf": Reads("pinocchio.buildModelFromUrdf(file)", (".urdf",), "robot", version="4.1.0", effects=(FIXED,)),
            "mjcf": Reads(
                "pinocchio.buildModelFromMJCF(file)", (".xml",), "mujoco", version="4.1.0", effects=PINOCCHIO_MJCF
            ),
        },
        _pinocchio,
    ),
    "yourdfpy": AuditLibrary(
        "yourdfpy",
        "yourdfpy",
        {"urdf": Reads("yourdfpy.URDF.load(file)", (".urdf",), "robot", version="0.0.60", effects=(FIXED,))},
        _yourdfpy,
    ),
    "usd-core": AuditLibrary(
        "usd-core",
        "pxr",
        {"usd": Reads("UsdPhysics.LoadUsdPhysicsFromRange(stage, ['/'])", (".usda", ".usdc"), "", version="26.11")},
        _usd,
    ),
}
"""Libraries by their name in the registry of packages."""
