"""What a proof does not check because an engine lacks what it takes (``Engine.LACKS``): parts of levels, with the reason.

Such a part is neither passed nor failed. A certificate says that it was not checked, and a stored one is held against what the
engine declares, so that nothing else can hide there.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.control.native import natives
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.proof.comparator import INVENTORY, INVENTORY_LEVEL
from simspec.proof.contact.size import NAME as SIZE
from simspec.proof.contact.size import size_trial
from simspec.proof.dry_friction import REST_CHECK, SLIDING_CHECK
from simspec.proof.expected import PARTS, expected, title
from simspec.proof.forces import FORCES_CHECK, PRESCRIBED_CHECK
from simspec.proof.sum_limits import BALLS_CHECK, STOPS_CHECK
from simspec.world.kinematics import frictional_coordinates
from simspec.world.types import ReadBack, World

MATRIX = "collision matrix"
NEEDS: Mapping[tuple[str, str], tuple[Capability, ...]] = {
    ("L3", "mass matrix"): (Capability.MASS_MATRIX,),
    ("L3", "bias force"): (Capability.BIAS_FORCE,),
    ("L3", "gravity force"): (Capability.BIAS_FORCE,),
    (INVENTORY_LEVEL, INVENTORY): (Capability.INVENTORY,),
    ("L4", MATRIX): (Capability.PAIR_DETECTION,),
    ("L5", SIZE): (Capability.PAIR_DETECTION,),
    ("L6", "motion"): (Capability.CONTACT_OFF,),
    ("L6", SLIDING_CHECK): (Capability.CONTACT_OFF,),
    ("L6", REST_CHECK): (Capability.CONTACT_OFF,),
    ("L6", STOPS_CHECK): (Capability.CONTACT_OFF,),
    ("L6", BALLS_CHECK): (Capability.CONTACT_OFF,),
    ("L7", "step response"): (Capability.CONTACT_OFF,),
    ("L7", FORCES_CHECK): (Capability.CONTACT_OFF,),
    ("L7", PRESCRIBED_CHECK): (Capability.CONTACT_OFF,),
}
"""What each part of a proof takes beside an engine's core."""
WITHOUT_FRICTION = (
    *(
        ("L6", "motion"),
        ("L6", STOPS_CHECK),
        ("L6", BALLS_CHECK),
        ("L7", "step response"),
        ("L7", FORCES_CHECK),
        ("L7", PRESCRIBED_CHECK),
    ),
)
"""The parts in which joints' dry friction is switched off, where a world has any."""
ASKED = ("L1", "L2", "L3", "L4", "L5", "L6", "L7")
"""The levels for which an engine is asked: all but that of the files."""
TITLES = frozenset({title(*part) for part in NEEDS} | {level for level, _ in NEEDS} | set(ASKED))
"""Every name under which a certificate says that a part was not checked."""


def unchecked(world: World, engine: type[Engine]) -> dict[tuple[str, str], str]:
    """The parts (level, name of a check) that ``engine`` cannot be asked for, with the reason that it declares."""
    parts = {}
    for part, capabilities in NEEDS.items():
        taken = [*capabilities]
        if part in WITHOUT_FRICTION and len(frictional_coordinates(world)):
            taken.append(Capability.DRY_FRICTION_OFF)
        reasons = [engine.LACKS[capability] for capability in taken if capability in engine.LACKS]
        if reasons:
            parts[part] = "; ".join(dict.fromkeys(reasons))
    return parts


def not_checked_parts(world: World, engine: type[Engine], not_compared: Mapping[str, str]) -> dict[str, str]:
    """The same as a certificate says it: by title, and by level where nothing of a level is left; without what ``not_compared``
    names, which this world does not have or nobody asked for."""
    lacking = unchecked(world, engine)
    wanted = expected(world)
    parts: dict[str, str] = {}
    for (level, name), why in lacking.items():
        if level in not_compared or title(level, name) in not_compared or wanted.get((level, name)):
            continue
        if (level, name) == ("L5", SIZE) and size_trial(world) is None:
            continue
        others = [part for part in PARTS if part[0] == level and part[1] and not wanted[part]]
        whole = (level, "") in PARTS and level in WHOLE and all(part in lacking for part in others)
        key = level if whole else title(level, name)
        parts[key] = "; ".join(dict.fromkeys([*parts[key].split("; "), why])) if key in parts else why
    return parts


def of_files_alone(not_compared: Mapping[str, str], why: str) -> dict[str, str]:
    """What is not checked of an engine that is not there, which ``why`` says: every level but that of the files, without those
    that ``not_compared`` names."""
    return {level: why for level in ASKED if level not in not_compared}


WHOLE = ("L3", "L6", "L7")
"""The levels that are made of named parts and nothing else."""


UNTOLD = "the engine is told none"
"""Why frames are not readable back."""


def not_checked(world: World, read_back: ReadBack) -> dict[str, str]:
    """What a read-back could not tell, with the reasons, sorted; of engines' own controllers and of frames only where the world
    has some."""
    left = unreadable(world, read_back.unreadable)
    if world.frames and read_back.frames is None:
        left["frames"] = UNTOLD
    return dict(sorted(left.items()))


def unreadable(world: World, declared: Mapping[str, str]) -> dict[str, str]:
    """Of the fields that an engine declares not to be readable back those that the world has."""
    own = natives(world)
    return {field: why for field, why in declared.items() if own or field != "control.native"}
