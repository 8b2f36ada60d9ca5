"""PyBullet's own dump of the world that it holds (a ``.bullet`` file), and the colliders of links in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from simspec.engines.pybullet.bullet_file import Block, plain, read_blocks
from simspec.engines.pybullet.simulation import Simulation
from simspec.errors import EngineError
from simspec.scratch import scratch_folder

COLLIDER: Mapping[str, str] = {
    "contactProcessingThreshold": "",
    "anisotropicFriction": "",
    "hitFraction": "",
    "ccdSweptSphereRadius": "",
    "ccdMotionThreshold": "",
    "hasAnisotropicFriction": "",
    "collisionFlags": "",
    "internalType": "",
    "checkCollideWith": "",
    "collisionFilterGroup": "in apart.LINK",
    "collisionFilterMask": "in apart.LINK",
    "friction": "a surface of the read-back, from getDynamicsInfo",
    "rollingFriction": "a surface of the read-back, from getDynamicsInfo",
    "restitution": "a surface of the read-back, from getDynamicsInfo",
    "contactStiffness": "a surface of the read-back, from getDynamicsInfo",
    "contactDamping": "a surface of the read-back, from getDynamicsInfo",
    "worldTransform": "state, compared by poses",
    "interpolationWorldTransform": "state of the last step",
    "interpolationLinearVelocity": "state of the last step",
    "interpolationAngularVelocity": "state of the last step",
    "deactivationTime": "state",
    "activationState1": "state; whether a body may sleep is in the calls",
    "islandTag1": "state",
    "companionId": "state",
    "uniqueId": "a label",
}
"""Members of a collider in the dump: "" = in the inventory, else why not."""
STATE = frozenset(name for name, why in COLLIDER.items() if why.startswith("state"))


def dump(sim: Simulation) -> list[Block]:
    """The blocks of the dump."""
    with scratch_folder("bullet") as place:
        return dump_of(sim.bullet, sim.client, place)


def dump_of(bullet: Any, client: int, folder: Path) -> list[Block]:
    """The same of a client, by a file in a folder of the caller's. Raises EngineError where it cannot be read."""
    path = folder / "world.bullet"
    bullet.saveBullet(str(path), physicsClientId=client)
    try:
        return read_blocks(path.read_bytes())
    except (OSError, ValueError) as error:
        raise EngineError("pybullet", f"its dump of the world cannot be read: {error}") from error


def colliders(sim: Simulation, blocks: list[Block]) -> Iterator[tuple[tuple[int, int], int, dict[str, Any]]]:
    """Every collider of the dump: the id of its tree and its link, the address of its shape, and its members."""
    bodies = [block.address for block in blocks if block.code == "MBDY"]
    if len(bodies) != len(sim.trees):
        raise EngineError("pybullet", f"holds {len(bodies)} bodies of links, {len(sim.trees)} were loaded")
    tree_of = {address: tree.uid for address, tree in zip(bodies, sim.trees, strict=True)}
    for block in blocks:
        if block.code == "MBLC":
            for row in block.rows:
                uid = tree_of.get(int(row["m_multiBody"]))
                if uid is None:
                    raise EngineError("pybullet", "holds a collider of no body")
                held = row["m_colObjData"]
                yield (uid, int(row["m_link"])), int(held["m_collisionShape"]), plain(held, STATE)
