"""Everything that PyBullet holds beside the fields of the read-back, and that can act.

Three sources, in this order: what PyBullet returns when asked, its own dump of the world's memory (a ``.bullet`` file: the
solver's numbers, the collision masks and flags of every link), and the calls made while loading, for what neither has
(``pybullet_calls.py``). What it must be says ``pybullet_expected.py``. Facts marked *measured*: pybullet 3.2.7.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from simspec.engines.kit.inventory import listed, named_set, sidecar_labels
from simspec.engines.pybullet.bullet_file import COLLIDER, Block, colliders, dump, plain
from simspec.engines.pybullet.simulation import Simulation
from simspec.engines.pybullet.trees import Tree, told_turn
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.world import frames
from simspec.world.types import EngineValue

WORLD: Mapping[str, str] = {
    "solverInfo.timeStep": "of the last step; the timestep is a field of the read-back",
    "gravity": "a field of the read-back",
}
"""Members of the world in the dump that are not in the inventory, with the reason."""
PARAMETERS: Mapping[str, str] = {
    "fixedTimeStep": "a field of the read-back",
    "gravityAccelerationX": "a field of the read-back",
    "gravityAccelerationY": "a field of the read-back",
    "gravityAccelerationZ": "a field of the read-back",
}
"""Keys of getPhysicsEngineParameters that are not in the inventory, with the reason."""
JOINT_INFO: Mapping[str, int] = {
    "damping": 6,
    "friction": 7,
    "lower": 8,
    "upper": 9,
    "max_force": 10,
    "max_velocity": 11,
}
"""Numbers of getJointInfo; those that a joint kind makes a field of the read-back are left out there."""
SURFACE: Mapping[str, int] = {
    "friction": 1,
    "restitution": 5,
    "rolling": 6,
    "spinning": 7,
    "damping": 8,
    "stiffness": 9,
}
"""Numbers of getDynamicsInfo."""
OF_THE_READ_BACK: Mapping[str | None, set[str]] = {"fixed": set(), "ball": {"damping"}, None: set()}
"""Which of these are fields of the read-back, by the kind of joint; of other kinds all are."""
ROUND = {8, 10}
"""Bullet's numbers of spheres and capsules, whose margin is their radius."""
UNCOUNTED = {"SHAP", "ARAY", "CONT", "CHAR", "MBDY", "MBLC"}
"""Blocks of the dump that are not counted: parts of others, contacts of the moment, and what has entries of its own."""
NEUTRAL = """<robot name="neutral">
<link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><sphere radius="1"/></geometry></collision></link>
<link name="link"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><sphere radius="1"/></geometry></collision></link>
<joint name="joint" type="spherical"><parent link="base"/><child link="link"/><axis xyz="1 0 0"/></joint></robot>
"""
"""A model that asks for nothing: what PyBullet holds of it are its own defaults."""


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name; links by the world's names (:func:`link_names`)."""
    p, client = sim.bullet, sim.client
    names = link_names(sim)
    held = p.getPhysicsEngineParameters(physicsClientId=client)
    found: dict[str, EngineValue] = {f"parameter.{key}": value for key, value in held.items() if key not in PARAMETERS}
    found.update(sidecar_labels(sim.sidecar.plain()))
    found["sidecar.bodies"] = listed(sim.names)
    # contacts are solved in the order in which the trees were loaded
    found["trees"] = listed([instance.bodies[0] for instance in sim.sidecar.instances])
    for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True):
        found[f"tree.{instance.bodies[0]}.model"] = instance.model
        for body, joint, shapes in zip(instance.bodies, instance.joints, instance.shapes, strict=True):
            found[f"body.{body}.joint"], found[f"body.{body}.shapes"] = joint, shapes
        for body, places in zip(instance.bodies, instance.visual_only, strict=True):
            found[f"body.{body}.visual_only"] = places
        for link in [link.link for link in tree.links] + [link for link, _ in tree.copies]:
            found[f"link.{names[tree.uid, link]}.layer"] = sim.layer[tree.uid, link]
    for frame in sim.sidecar.frames or ():
        found |= {f"body.{frame.name}.joint": frame.joint, f"body.{frame.name}.shapes": ()}
        found |= {f"body.{frame.name}.visual_only": (), f"body.{frame.name}.on": frame.parent}
    found["count.bodies"] = p.getNumBodies(physicsClientId=client)
    found["count.constraints"] = p.getNumConstraints(physicsClientId=client)
    for held in sim.held:
        info = p.getConstraintInfo(held.number, physicsClientId=client)
        found[f"constraint.{held.name}.max_force"] = info[10]
        found[f"constraint.{held.name}.erp"] = info[14]
        found[f"constraint.{held.name}.auxiliary"] = info[12]
    found["count.user_data"] = sum(p.getNumUserData(tree.uid, physicsClientId=client) for tree in sim.trees)
    blocks = dump(sim.bullet, sim.client)
    found.update(_world(blocks))
    masks = {}
    margins = _Margins(blocks)
    for key, shape, collider in colliders([tree.uid for tree in sim.trees], blocks):
        if key not in names:
            raise EngineError("pybullet", f"holds a link {key} that the sidecar does not name")
        if not p.getCollisionShapeData(*key, physicsClientId=client):
            continue  # without shapes nothing touches it
        name = names[key]
        masks[name] = (collider["collisionFilterGroup"], collider["collisionFilterMask"])
        found.update({f"collider.{name}.{member}": collider[member] for member, why in COLLIDER.items() if not why})
        found[f"shape.{name}.margins"] = margins.of(shape)
    for tree in sim.trees:
        found.update(_links(sim, tree, names))
    found.update(_calls(sim, names))
    found.update(_apart(masks, _disabled(sim, names)))
    return found


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """PyBullet's own values: of its world and of a base's and a link's collider that it was told nothing of."""
    p = sim.bullet
    client = p.connect(p.DIRECT)
    try:
        with scratch_folder("bullet") as place:
            (place / "neutral.urdf").write_text(NEUTRAL, encoding="utf-8")
            uid = p.loadURDF(str(place / "neutral.urdf"), physicsClientId=client)
            found = _world(dump(p, client))
            blocks = dump(p, client)
        for block in (block for block in blocks if block.code == "MBLC"):
            for row in block.rows:
                kind = "base" if int(row["m_link"]) < 0 else "link"
                held = plain(row["m_colObjData"])
                found.update({f"collider.{kind}.{member}": held[member] for member, why in COLLIDER.items() if not why})
        info = p.getJointInfo(uid, 0, physicsClientId=client)
        dynamics = p.getDynamicsInfo(uid, 0, physicsClientId=client)
        found.update({f"link.{name}": dynamics[place] for name, place in SURFACE.items()})
        found.update({f"joint.{name}": info[place] for name, place in JOINT_INFO.items()})
        held = p.getPhysicsEngineParameters(physicsClientId=client)
        found.update({f"parameter.{key}": value for key, value in held.items() if key not in PARAMETERS})
    finally:
        p.disconnect(physicsClientId=client)
    return found


def link_names(sim: Simulation) -> dict[tuple[int, int], str]:
    """The names of all links: a body's name for its own, ``BODY__MATERIAL.LAYER`` for one of its copies, ``BODY/world`` for the
    massless base that stands for the world below that root."""
    found = {}
    for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True):
        found.update({(tree.uid, link.link): sim.names[link.index] for link in tree.links})
        copies = zip(tree.copies, instance.copies, strict=True)
        found.update({(tree.uid, link): copy.link for (link, _), copy in copies})
        if tree.links[0].link >= 0:
            found[tree.uid, -1] = f"{sim.names[tree.links[0].index]}/world"
    return found


def _world(blocks: Iterable[Block]) -> dict[str, EngineValue]:
    """The solver's numbers, and how many things there are of each kind."""
    found: dict[str, EngineValue] = {}
    for block in blocks:
        if block.code == "DWLD":
            for name, value in plain(block.rows[0]).items():
                if name not in WORLD:
                    found[f"world.{name}"] = value
        if block.code not in UNCOUNTED:
            found[f"count.{block.code}"] = int(found.get(f"count.{block.code}", 0)) + len(block.rows)  # type: ignore[arg-type]
    return found


class _Margins:
    """The margins (m) that Bullet adds around the shapes of a link, of those that it rounds by none of their own."""

    def __init__(self, blocks: Iterable[Block]):
        self._at = {block.address: block.rows for block in blocks if block.code in ("SHAP", "ARAY")}

    def of(self, address: int) -> tuple[float, ...]:
        """Of the shape at an address, or of all the parts of a compound one, in their order."""
        rows = self._at.get(address)
        if rows is None:
            return ()
        names = rows.dtype.names or ()
        if "m_childShapePtr" in names:
            parts = self._at.get(int(rows[0]["m_childShapePtr"]), ())
            return tuple(margin for part in parts for margin in self.of(int(part["m_childShape"])))
        held = rows[0]["m_convexInternalShapeData"] if "m_convexInternalShapeData" in names else rows[0]
        if "m_collisionMargin" not in (held.dtype.names or ()):
            return ()
        kind = int(held["m_collisionShapeData"]["m_shapeType"])
        return () if kind in ROUND else (float(held["m_collisionMargin"]),)


def _links(sim: Simulation, tree: Tree, names: Mapping[tuple[int, int], str]) -> dict[str, EngineValue]:
    """Of every link what getDynamicsInfo and getJointInfo say beside the fields of the read-back."""
    p, client = sim.bullet, sim.client
    own = {link.link: link.kind for link in tree.links}
    found: dict[str, EngineValue] = {}
    for link in range(-1, p.getNumJoints(tree.uid, physicsClientId=client)):
        name, kind = names[tree.uid, link], own.get(link)
        dynamics = p.getDynamicsInfo(tree.uid, link, physicsClientId=client)
        found[f"link.{name}.body_type"] = dynamics[10]
        if not dynamics[0]:  # it only carries shapes, stands for the world, or is a fixed base
            found[f"link.{name}.mass"] = dynamics[0]
            found[f"link.{name}.inertia"] = tuple(dynamics[2])
            found[f"link.{name}.place"] = tuple(dynamics[3])
            found[f"link.{name}.turn"] = tuple(dynamics[4])
        found.update({f"link.{name}.{key}": dynamics[at] for key, at in SURFACE.items()})
        if link < 0:
            continue
        info = p.getJointInfo(tree.uid, link, physicsClientId=client)
        left_out = OF_THE_READ_BACK.get(kind, set(JOINT_INFO))
        found.update({f"joint.{name}.{key}": info[at] for key, at in JOINT_INFO.items() if key not in left_out})
        if kind is None:
            parent, own_frame = (p.getDynamicsInfo(tree.uid, at, physicsClientId=client) for at in (info[16], link))
            found[f"joint.{name}.type"] = info[2]
            found[f"joint.{name}.parent"] = names[tree.uid, info[16]]
            found.update(_weld(name, info, parent, own_frame))
    return found


def _weld(name: str, info: Any, parent: Any, own: Any) -> dict[str, EngineValue]:
    """Where a link that only carries shapes sits on its body: (0, 0, 0) and no turn, as distances in m and rad."""
    turn = frames.multiply(
        frames.multiply(told_turn(parent[4]), frames.conjugate(told_turn(info[15]))),
        frames.conjugate(told_turn(own[4])),
    )
    place = frames.add(tuple(parent[3]), frames.rotate(told_turn(parent[4]), tuple(info[14])))
    return {f"joint.{name}.place": _rounded(place), f"joint.{name}.turn": _rounded(turn[1:])}


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    """Zero where only round-off of frames put together is left (1e-12 m and rad, the tolerance of text)."""
    return tuple(0.0 if abs(value) <= 1e-12 else value for value in values)


def _calls(sim: Simulation, names: Mapping[tuple[int, int], str]) -> dict[str, EngineValue]:
    """The calls made while loading, under the function's name; pairs that do not touch are left to :func:`_apart`, masks and
    gravity to the dump and the read-back."""
    found: dict[str, EngineValue] = {}
    modes = {sim.bullet.VELOCITY_CONTROL: "velocity", sim.bullet.POSITION_CONTROL: "position"}
    loaded = iter(sim.trees)
    for function, positional, named in sim.calls:
        if function == "setPhysicsEngineParameter":
            found.update({f"calls.{function}.{key}": value for key, value in named.items()})
        elif function == "changeDynamics":
            name = names[positional[0], positional[1]]
            found.update({f"calls.{function}.{name}.{key}": value for key, value in named.items()})
        elif function in ("setJointMotorControl2", "setJointMotorControlMultiDof"):
            name = names[positional[0], positional[1]]
            found[f"calls.motor.{name}.mode"] = modes.get(positional[2], str(positional[2]))
            found.update({f"calls.motor.{name}.{key}": _value(value) for key, value in named.items()})
        elif function == "loadURDF":
            name = names[next(loaded).uid, -1]
            found[f"calls.{function}.{name}.flags"] = named["flags"]
            found[f"calls.{function}.{name}.useFixedBase"] = named["useFixedBase"]
        elif function not in ("setCollisionFilterPair", "setCollisionFilterGroupMask", "setGravity", "setTimeStep"):
            found[f"calls.{function}"] = int(found.get(f"calls.{function}", 0)) + 1  # type: ignore[arg-type]
    return found


def _value(value: Any) -> EngineValue:
    return tuple(value) if isinstance(value, (list, tuple)) else value


def _disabled(sim: Simulation, names: Mapping[tuple[int, int], str]) -> set[tuple[str, str]]:
    """The pairs of links that were told not to touch, both ways round."""
    found: dict[tuple[str, str], bool] = {}
    for function, positional, _ in sim.calls:
        if function == "setCollisionFilterPair":
            uid, other_uid, link, other_link, enabled = positional
            one, other = names[uid, link], names[other_uid, other_link]
            found[one, other] = found[other, one] = not enabled
    return {pair for pair, off in found.items() if off}


def _apart(masks: Mapping[str, tuple[int, int]], disabled: set[tuple[str, str]]) -> dict[str, EngineValue]:
    """Of every link the others that it does not touch, by Bullet's rule for masks and the pairs that were switched off."""
    kinds: dict[tuple[int, int], list[str]] = {}
    for name, kind in masks.items():
        kinds.setdefault(kind, []).append(name)
    by_kind = {
        (group, mask): frozenset(
            name
            for (other_group, other_mask), held in kinds.items()
            if not (group & other_mask and other_group & mask)
            for name in held
        )
        for group, mask in kinds
    }
    pairs: dict[str, set[str]] = {}
    for one, other in disabled:
        pairs.setdefault(one, set()).add(other)
    return {
        f"apart.{name}": named_set((by_kind[kind] | pairs.get(name, set())) - {name}) for name, kind in masks.items()
    }
