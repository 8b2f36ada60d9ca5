"""Joints that follow others, as constraints of the language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from simspec.imports.draft import Draft, plain
from simspec.imports.urdf.joints import Joint
from simspec.imports.urdf.table import INFORMATION, LOST, PHYSICS, attributes_unused
from simspec.language.vocabulary import SCALAR_JOINTS

LEADERS: Final = "missing-leaders"
RULES: Final = {LEADERS: "a joint that is to follow one that is not there moves on its own"}


def constraints(joints: Sequence[Joint], draft: Draft) -> dict[str, Any]:
    """The constraints of all joints that follow others, by the name of the joint that follows."""
    by_name = {joint.element.attributes["name"].strip(): joint for joint in joints}
    said: dict[str, Any] = {}
    for joint in joints:
        follow = _follow(joint, by_name, draft)
        if follow is not None:
            said[joint.name] = {"follow": follow}
    return said


def _follow(joint: Joint, by_name: Mapping[str, Joint], draft: Draft) -> dict[str, Any] | None:
    """What a joint follows; None for one that follows none, which says so."""
    found = joint.element.look("mimic")
    if not found:
        return None
    mimic = found[0]
    if joint.kind not in SCALAR_JOINTS:
        attributes_unused(mimic, f"a {joint.kind} joint has no position to follow with")
        return None
    with draft.collecting():
        name = mimic.need("joint")
        ratio, offset = mimic.number("multiplier", 1.0) or 0.0, mimic.number("offset", 0.0) or 0.0
        leader = by_name.get(name)
        why = ""
        if leader is None and draft.repairing(LEADERS):
            why = f"there is no joint {name[:80]}: this one moves on its own, by the rule {LEADERS}"
            draft.repaired(
                LEADERS, mimic, f"{joint.name} moves on its own: there is no joint {name[:80]}", ("model", "bodies")
            )
        elif leader is None:
            draft.defect(mimic, f"there is no joint {name[:80]!r}", LEADERS, RULES[LEADERS], found=name)
        elif leader is joint:
            draft.defect(mimic, "a joint cannot follow itself", found=name)
        elif leader.kind not in SCALAR_JOINTS:
            why = f"the joint {leader.name} is {leader.kind}, and has no position to be followed: this one moves on its own"
        elif ratio == 0.0:
            why = "with a multiplier of 0 the joint follows nothing: it moves on its own"
        else:
            mimic.take()
            draft.place(("model", "constraints", joint.name), mimic)
            data: dict[str, Any] = {"joint": joint.name, "leader": leader.name}
            data.update({"ratio": plain(ratio)} if ratio != 1.0 else {})
            data.update({"offset": plain(offset)} if offset else {})
            return data
        if why:
            mimic.set_aside(None, LOST, why, PHYSICS, "make the joint fixed" if ratio == 0.0 else "")
            for attribute in mimic.attributes:
                mimic.set_aside(attribute, LOST, why, INFORMATION)
    return None
