"""Links of SDF as bodies of the language: mass properties."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from simspec.imports import moments
from simspec.imports.elements import Element
from simspec.imports.sdf.aside import IN_LINK, set_aside
from simspec.imports.sdf.meshes import Meshes
from simspec.imports.sdf.shapes import DENSITY, Around, ShapeRead, read_shapes
from simspec.imports.sdf.surfaces import surface_of_link
from simspec.imports.sdf.values import Placement, at, finite_of, flag, flag_of, lost, pose_of, unused
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.types import Vector3

NO_INERTIAL: Final = "the file has no <inertial>; SDF then means 1 kg and a unit inertia"
UNIT_INERTIA: Final = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}


@dataclass
class LinkRead:
    """What a link says of its body, in the body's frame."""

    mass: dict[str, Any]
    shapes: list[ShapeRead]
    comment: str = ""
    inertial: Element | None = None
    repaired: str = ""
    """What the rule of :mod:`simspec.imports.moments` changed."""
    given: list[tuple[str, str, str]] = field(default_factory=list)
    """What rules gave the body: the rule, what it changed, and the word of the body where it is seen."""

    @property
    def is_massless(self) -> bool:
        """Whether the file says that it has no mass."""
        return (
            self.inertial is not None
            and not self.mass.get("mass", 0.0)
            and not any("density" in one.data for one in self.shapes)
        )


def read_link(link: Element, offset: Vector3, meshes: Meshes, folder: Path, *, static: bool) -> LinkRead:
    """A link, for a body whose frame is at ``offset`` in the link's; ``folder``: of its file. Where it is ``static``, a mass
    that is not in the file has no effect. Raises SpecError."""
    move = at((-offset[0], -offset[1], -offset[2]))
    density = _computed(link)
    shapes = read_shapes(link, Around(meshes, folder, move, density, surface_of_link(link), static))
    set_aside(link, IN_LINK)
    weight: dict[str, Any] = {} if flag_of(link, "gravity", True) or static else {"gravity_scale": 0.0}
    inertial = link.look("inertial")
    if density is not None:
        return LinkRead(weight, shapes, inertial=inertial[0])
    if inertial:
        mass, repaired = _inertial(inertial[0].take(), move, moments.RULE in meshes.repair)
        return LinkRead({**mass, **weight}, shapes, inertial=inertial[0], repaired=repaired)
    if static:
        return LinkRead({}, shapes)
    return LinkRead(
        {**weight, "mass": 1.0, **_centre(move), "inertia": {"principal": [1.0, 1.0, 1.0]}}, shapes, NO_INERTIAL
    )


def _computed(link: Element) -> float | None:
    """The density by which the link's inertia is to be computed from its collisions; None where the file gives the inertia."""
    for inertial in link.look("inertial"):
        if flag(inertial, inertial.word("auto") or "false"):
            inertial.take()
            if inertial.look("mass", "inertia", "pose"):
                raise inertial.error("an inertial that is computed and has numbers of its own is not supported")
            return finite_of(inertial, "density", DENSITY)
    return None


def _inertial(inertial: Element, move: Placement, repairing: bool) -> tuple[dict[str, Any], str]:
    """The words of the body, and what was repaired of them."""
    mass = finite_of(inertial, "mass", 1.0)
    pose = pose_of(inertial)
    if pose.relative_to:
        raise inertial.error("the pose of an inertial is relative to its link", found=pose.relative_to[:80])
    place = move.then(pose.placement)
    tensor = inertial.child("inertia")
    values = {
        key: UNIT_INERTIA[key] if tensor is None else finite_of(tensor, key, UNIT_INERTIA[key]) for key in UNIT_INERTIA
    }
    lost(
        next(iter(inertial.look("fluid_added_mass")), None),
        "simspec has no added mass: physics.fluid is drag and viscous resistance",
    )
    unused(next(iter(inertial.look("density")), None), "the file gives the mass")
    if not mass and not any(values.values()):
        return {}, ""
    six, repaired = _possible(inertial, tuple(values.values()), repairing)
    return {"mass": mass, **_centre(place), "inertia": inertia_data(six, place)}, repaired


def _possible(inertial: Element, tensor: tuple[float, ...], repairing: bool) -> tuple[tuple[float, ...], str]:
    """A tensor that breaks the triangle inequality as the nearest one that a body can have, and what that changed. Raises
    SpecError where the rule is not asked for; a tensor that is not positive is the language's to refuse."""
    before = principal_moments(tensor)
    why = impossible(before)
    if why is None or min(before) < 0.0:
        return tensor, ""
    if not repairing:
        raise inertial.error(why, hint=f"simspec import --repair {moments.RULE}: {moments.MEANING}")
    after = moments.nearest(tensor)
    return after, moments.became(before, principal_moments(after))


def _centre(place: Placement) -> dict[str, Any]:
    return {"centre_of_mass": list(place.pose.position)} if any(place.pose.position) else {}


def inertia_data(values: tuple[float, ...], place: Placement) -> dict[str, Any]:
    """An inertia (xx, yy, zz, xy, xz, yz) in axes turned by ``place``, as the language has it in the body's axes."""
    turned = place.pose.quaternion != frames.IDENTITY
    if not any(values[3:]):
        data: dict[str, Any] = {"principal": list(values[:3])}
        if turned:
            data.update({key: value for key, value in place.data().items() if key != "xyz"})
        return data
    if turned:
        values = frames.rotate_inertia(place.pose.quaternion, values)
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    return {"tensor": {name: value for name, value in zip(names, values, strict=True) if value or name[0] == name[1]}}
