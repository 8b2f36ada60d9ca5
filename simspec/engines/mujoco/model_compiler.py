"""The compiler of model files as a program of its own: a file in, the compiled model out, as plain data.

Started by ``imports/child.py``, it reads a request from standard input (:func:`read_request`) and writes JSON to standard
output: ``{"version": ..., "model": ...}``, or ``{"error": ...}`` where the file is refused. It imports nothing of simspec,
and the engine only when it runs: importers find it by an entry point and start it in a process of bounded time and memory.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import struct
import sys
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

PR_SET_PDEATHSIG = 1
"""Of Linux's prctl(2)."""

SECTIONS = {
    "bodies": "body",
    "joints": "joint",
    "geoms": "geom",
    "sites": "site",
    "meshes": "mesh",
    "hfields": "hfield",
    "pairs": "pair",
    "excludes": "exclude",
    "equalities": "equality",
    "tendons": "tendon",
    "actuators": "actuator",
    "keys": "key",
}
"""Lists of MjSpec, and the name of an element of each in the answer."""
IN_BODIES = ("joints", "geoms", "sites")
"""Those of which each body has its own."""
ARRAYS = {
    "body": "parentid weldid mocapid pos quat ipos iquat mass inertia jntadr jntnum gravcomp contype conaffinity",
    "jnt": "type bodyid qposadr dofadr pos axis limited range stiffness stiffnesspoly actfrclimited actfrcrange actgravcomp "
    "margin springyield",
    "dof": "armature damping dampingpoly frictionloss",
    "geom": "type bodyid dataid matid pos quat size rgba group contype conaffinity condim priority friction solmix solref "
    "solimp margin gap fluid adhesion surfacevel",
    "mat": "rgba",
    "mesh": "pos quat scale vertadr vertnum",
    "hfield": "nrow ncol size adr",
    "pair": "geom1 geom2 dim friction margin gap solref solimp solreffriction",
    "exclude": "signature",
    "site": "bodyid pos quat",
    "eq": "type obj1id obj2id objtype active0 data solref solimp",
    "tendon": "adr num limited range stiffness damping frictionloss armature lengthspring actfrclimited "
    "stiffnesspoly dampingpoly springyield",
    "wrap": "type objid prm",
    "actuator": "trntype trnid gear dyntype gaintype biastype gainprm biasprm ctrllimited ctrlrange forcelimited forcerange "
    "actnum armature damping delay",
    "key": "time qpos qvel ctrl",
}
"""Parts of the compiled model in the answer, by the beginnings of their names. Fields that a version does not have are left
out."""
NUMBERS = ("nq", "nv", "nu", "nbody", "njnt", "ngeom", "nmocap", "nflex", "nplugin", "nkey")
OPTIONS = "timestep gravity wind density viscosity integrator cone impratio disableactuator"


MOST_HEIGHTS = 2**18
"""Heights of a model's height fields together; those of more are left out of the answer."""
POSTURES, MOST_COORDINATES = 6, 300
"""Configurations at which the stability of dampers and springs is looked at, and the most coordinates of a model for that."""


MEMORY_OF_A_STATE = 2**28
"""Bytes that the engine is given for one state of a large model (measured: 2,000 free bodies need under 64 MiB)."""


class ModelCompiler:
    """How importers start this program."""

    PROGRAM: ClassVar[Path] = Path(__file__)
    EXTRA: ClassVar[str] = "mujoco"
    """The extra of simspec that installs what it needs."""

    @classmethod
    def version(cls) -> str | None:
        """The installed version of the engine; None where it is not installed."""
        from simspec.engines.mujoco.engine import MuJoCo  # not needed by the program itself

        return MuJoCo.version()


def read_request(stream: BinaryIO) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The request, and the files by their names, the main one first: a length (8 bytes, little-endian), as much JSON with
    ``files`` (names and sizes), then the files one after the other."""
    (size,) = struct.unpack("<Q", stream.read(8))
    content = json.loads(stream.read(size))
    return content, {name: stream.read(length) for name, length in content["files"]}


def compiled(spec: Any, model: Any) -> dict[str, Any]:
    """The compiled model as plain data: arrays by name, and for each element its name and its place in the text."""
    import mujoco

    arrays = {}
    for prefix, names in ARRAYS.items():
        for name in names.split():
            value = getattr(model, f"{prefix}_{name}", None)
            if value is not None:
                arrays[f"{prefix}_{name}"] = value.tolist()
    if model.nhfielddata <= MOST_HEIGHTS:  # single precision, as the shortest decimals that give it
        arrays["hfield_data"] = [float(str(share)) for share in model.hfield_data]
    for name in ("qpos0", "qpos_spring"):
        arrays[name] = getattr(model, name).tolist()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    arrays |= {"reference_position": data.xpos.tolist(), "reference_quaternion": data.xquat.tolist()}
    _within_limits(model, data)
    mujoco.mj_kinematics(model, data)
    arrays |= {"initial_position": data.xpos.tolist(), "initial_quaternion": data.xquat.tolist()}
    options = {}
    for name in OPTIONS.split():
        value = getattr(model.opt, name)
        options[name] = value.tolist() if hasattr(value, "tolist") else value
    options["disabled"] = _flags("mjtDisableBit", model.opt.disableflags)
    options["enabled"] = _flags("mjtEnableBit", model.opt.enableflags)
    return {
        "arrays": arrays,
        "numbers": {name: int(getattr(model, name)) for name in NUMBERS},
        "options": options,
        "elements": _elements(spec),
        "meshes": {int(mesh.id): _mesh(mesh, model) for mesh in spec.meshes},
        "hfields": {int(field.id): field.file for field in spec.hfields},
        "stable_step": stable_step(model),
    }


def _within_limits(model: Any, data: Any) -> None:
    """Put joints whose reference is beyond their limits at the nearest limit, where limits are on."""
    import mujoco

    off = int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    if model.opt.disableflags & off:
        return
    along = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for joint, at in enumerate(model.jnt_qposadr):
        if model.jnt_limited[joint] and int(model.jnt_type[joint]) in along:
            low, high = model.jnt_range[joint]
            data.qpos[at] = min(max(data.qpos[at], low), high)


def _flags(enumeration: str, bits: int) -> list[str]:
    """The names of the bits that are set, as files call them."""
    import mujoco

    flags = getattr(mujoco, enumeration).__members__.items()
    return [name.split("_", 1)[1].lower() for name, flag in flags if name[2:5] in ("DSB", "ENB") and bits & int(flag)]


def _elements(spec: Any) -> dict[str, list[list[Any]]]:
    """Name, line (0: unknown) and number of each element, by kind."""
    bodies = _bodies(spec)
    rows: dict[str, list[list[Any]]] = {}
    for plural, kind in SECTIONS.items():
        if plural == "bodies":
            elements = bodies
        elif plural in IN_BODIES:
            elements = [element for body in bodies for element in getattr(body, plural)]
        else:
            elements = getattr(spec, plural, [])
        rows[kind] = []
        for element in elements:
            word = element.info.rpartition("line ")[2].split(",")[0].strip()
            rows[kind].append([element.name, int(word) if word.isdigit() else 0, int(element.id)])
    return rows


def _bodies(spec: Any) -> list[Any]:
    """All bodies, the world first. MjSpec's own lists take a time that grows with the square of their length (measured: 4.6 s
    for 14,400 geoms); those of single bodies are short."""
    bodies, waiting = [], [spec.worldbody]
    while waiting:
        bodies.append(waiting.pop())
        waiting += reversed(bodies[-1].bodies)
    return bodies


def _mesh(mesh: Any, model: Any) -> dict[str, Any]:
    """A mesh: its file, what is done to the vertices of that, the number of its faces, of vertices of its hull (of all,
    where no hull was made), and how far it extends along the axes that the engine gave it (m)."""
    first, count = int(model.mesh_vertadr[mesh.id]), int(model.mesh_vertnum[mesh.id])
    vertices = model.mesh_vert[first : first + count]
    return {
        "file": mesh.file,
        "scale": [float(value) for value in mesh.scale],
        "refpos": [float(value) for value in mesh.refpos],
        "refquat": [float(value) for value in mesh.refquat],
        "faces": int(model.mesh_facenum[mesh.id]),
        "hull": int(model.mesh_graph[graph]) if (graph := int(model.mesh_graphadr[mesh.id])) >= 0 else count,
        "extent": (vertices.max(axis=0) - vertices.min(axis=0)).tolist(),
    }


def stable_step(model: Any) -> float | None:
    """The longest timestep (s) at which dampers and springs of joints and fixed tendons, and a viscous fluid, that are explicit
    in time do not diverge, at the reference configuration and some others; None where there are none, no coordinates, or more
    than is looked at.

    While 2 dt D + dt² K < 4 M no deviation grows; the largest eigenvalues of M⁻¹ D and M⁻¹ K bound it from the safe side.
    """
    import mujoco
    import numpy as np

    if not 0 < model.nv <= MOST_COORDINATES:  # the matrices below are dense
        return None
    damping, stiffness = np.array(model.dof_damping), np.zeros(model.nv)
    for joint, kind in enumerate(model.jnt_type):
        count = {0: 0, 1: 3}.get(int(kind), 1)
        stiffness[model.jnt_dofadr[joint] : model.jnt_dofadr[joint] + count] = model.jnt_stiffness[joint]
    along = np.zeros((model.ntendon, model.nv))
    for tendon in range(model.ntendon):
        for part in range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon]):
            if model.wrap_type[part] == int(mujoco.mjtWrap.mjWRAP_JOINT):
                along[tendon, model.jnt_dofadr[model.wrap_objid[part]]] += model.wrap_prm[part]
    array = np.diag(damping), np.diag(stiffness)
    damping = array[0] + along.T @ (np.array(model.tendon_damping)[:, None] * along)
    stiffness = array[1] + along.T @ (np.array(model.tendon_stiffness)[:, None] * along)
    if not (damping.any() or stiffness.any() or model.opt.viscosity):
        return None
    data, generator, shortest = mujoco.MjData(model), np.random.default_rng(0), np.inf
    for posture in range(POSTURES):
        for joint, at in enumerate(model.jnt_qposadr):
            if posture and model.jnt_type[joint] > 1 and model.jnt_limited[joint]:
                data.qpos[at] = generator.uniform(*model.jnt_range[joint])
            elif posture and model.jnt_type[joint] > 1:
                data.qpos[at] = model.qpos0[at] + generator.normal()
        mujoco.mj_fwdPosition(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        damped = damping + _viscous(model, data)
        try:
            inverse = np.linalg.inv(np.linalg.cholesky(mass))
        except np.linalg.LinAlgError:
            return None  # round-off of masses of very different size: resolving the spec checks it
        by_damping, by_stiffness = (
            max(0.0, float(np.linalg.eigvalsh(inverse @ values @ inverse.T).max())) for values in (damped, stiffness)
        )
        # 2 dt d + dt² k = 4
        step = 4.0 / (by_damping + np.sqrt(by_damping**2 + 4.0 * by_stiffness))
        shortest = min(shortest, float(step))
    return shortest


def _viscous(model: Any, data: Any) -> Any:
    """D (nv, nv) of what is linear in velocity of the forces of a fluid on boxes of the bodies' inertia."""
    import mujoco
    import numpy as np

    total = np.zeros((model.nv, model.nv))
    for body in range(1, model.nbody if model.opt.viscosity else 0):
        mass, moments = model.body_mass[body], model.body_inertia[body]
        if mass <= 0.0 or not model.body_weldid[body]:
            continue
        size = np.sqrt(6.0 * np.maximum(moments.sum() - 2.0 * moments, 0.0) / mass).mean()
        moving, turning = np.zeros((2, 3, model.nv))
        mujoco.mj_jacBodyCom(model, data, moving, turning, body)
        total += np.pi * size * model.opt.viscosity * (3.0 * moving.T @ moving + size**2 * turning.T @ turning)
    return total


def dynamics(model: Any, count: int, seed: int, spread: float) -> list[dict[str, Any]]:
    """In ``count`` random states (qpos, qvel): the mass matrix, the bias force with the weights as they are, the passive force
    without them, and every body's frame in the world. Positions are about the reference (standard deviation ``spread``, rad or
    m), rotations are any."""
    import mujoco
    import numpy as np

    data = mujoco.MjData(model)
    generator = np.random.default_rng(seed)
    answers = []
    for _ in range(count):
        data.qpos[:] = model.qpos0 + spread * generator.normal(size=model.nq)
        for kind, at in zip(model.jnt_type, model.jnt_qposadr, strict=True):
            if int(kind) in (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)):
                begin = at + 3 if kind == mujoco.mjtJoint.mjJNT_FREE else at
                data.qpos[begin : begin + 4] = generator.normal(size=4)
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = generator.normal(size=model.nv)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        by_actuators = model.jnt_actgravcomp[model.dof_jntid].astype(bool)
        compensating = np.where(by_actuators, 0.0, data.qfrc_gravcomp)
        answers.append(
            {
                "qpos": data.qpos.tolist(),
                "qvel": data.qvel.tolist(),
                "mass": mass.tolist(),
                "bias": (data.qfrc_bias - data.qfrc_gravcomp).tolist(),
                "passive": (data.qfrc_passive - compensating).tolist(),
                "position": data.xpos.tolist(),
                "quaternion": data.xquat.tolist(),
            }
        )
    return answers


def _model(spec: Any) -> Any:
    """The compiled model. The engine guesses the memory of one state by the square of the coordinates: for 1,000 free
    bodies it is refused below 900 MiB, and compiling needs little of it. Where it does not get that, simspec sets an amount."""
    try:
        return spec.compile()
    except ValueError as error:
        if "Could not allocate memory" not in str(error):
            raise
    spec.memory = MEMORY_OF_A_STATE
    return spec.compile()


def answer(requested: dict[str, Any], files: dict[str, bytes]) -> dict[str, Any]:
    """Compile the first of the files; the others are what it names. Raises what the engine raises."""
    import mujoco

    (_, main), *others = files.items()
    models = {name: content for name, content in others if name.endswith(".xml")}
    assets = {name: content for name, content in others if name not in models}
    spec = mujoco.MjSpec.from_string(main.decode(), include=models, assets=assets)
    model = _model(spec)
    answered: dict[str, Any] = {"version": mujoco.mj_versionString(), "model": compiled(spec, model)}
    if "random" in requested and model.nv:
        answered["dynamics"] = dynamics(model, *requested["random"])
    return answered


def finite_json(value: Any) -> str:
    """Plain data as JSON. Raises ValueError where a number is not finite."""
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError("a number of the compiled model is not finite") from None


def prepare() -> None:
    """Limit this process: CPU time (s) and memory (bytes) as the command line says. Then import what is needed, since later it
    may load no code."""
    seconds, memory = int(sys.argv[1]), int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    import mujoco  # noqa: F401
    import numpy.random  # noqa: F401  # numpy imports it when it is first used


def main() -> None:
    """Answer one request."""
    memory = int(sys.argv[2])
    dup = os.dup(1)
    os.dup2(2, 1)  # output of the engine is not the answer
    try:
        answered = answer(*read_request(sys.stdin.buffer))
        text = finite_json(answered)
    except MemoryError:
        text = json.dumps({"error": "it takes more memory than is allowed"})
    except Exception as error:  # any error of the engine is its answer to the file
        # so it says that it got no memory while it was copying elements (measured: 48,400 bodies)
        unknown = (
            "unknown exception" in str(error) and f": mostly that {memory / 2**20:.0f} MiB of memory are not enough"
        )
        text = json.dumps({"error": f"{error}{unknown or ''}"})
    with os.fdopen(dup, "wb") as stream:
        stream.write(text.encode())
