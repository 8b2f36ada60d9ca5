"""Bodies of a stage: their trees, the loops between them, and named frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from simspec.imports.draft import NOT_POSITIVE, Draft, nearest, numbers, plain, shown, tensor_words
from simspec.imports.elements import INFORMATION, names, outwards
from simspec.imports.usd.joints import Freedom, UsdJointRead
from simspec.imports.usd.shapes import SAME, PrimPlaces, UsdShapeRead, pose_data, quaternion
from simspec.imports.usd.stage import PREFIX, STALE, PrimRead, StageRead, agree
from simspec.language.moments import impossible, principal_moments
from simspec.world import frames
from simspec.world.inertia import combined_inertial, shape_part
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose, Vector3


@dataclass
class UsdLinkRead:
    """A body in its tree: its parent (None: the world) and the joint that moves it (None: it is free)."""

    prim: PrimRead
    parent: PrimRead | None = None
    joint: UsdJointRead | None = None
    children: list[UsdLinkRead] = field(default_factory=list)

    @property
    def joints(self) -> list[UsdJointRead]:
        """All joints that move it, from its parent outwards."""
        return [] if self.joint is None else [*self.joint.outer, self.joint]


def reverse(joint: UsdJointRead) -> None:
    """Take a joint from its other side: its coordinates stay what they are."""
    hint = "exchange physics:body0 and physics:body1"
    if joint.outer:
        message = "several joints of two bodies, the first of which is the one that they move"
        raise joint.prim.error(message, hint=hint, code="I101")
    joint.first, joint.second = joint.second, joint.first
    joint.in_first, joint.in_second = joint.in_second, joint.in_first
    if len(joint.freedoms) > 1 and joint.freedoms[-1].kind == "ball":
        message = "a joint with slides and three turns, whose first body is the one that it moves"
        raise joint.prim.error(message, hint=hint, code="I101")
    joint.freedoms = [_turned(freedom) for freedom in reversed(joint.freedoms)]


def _turned(freedom: Freedom) -> Freedom:
    x, y, z = freedom.axis
    start = freedom.start
    if freedom.kind == "ball" and start:
        start = frames.conjugate((start[0], start[1], start[2], start[3]))
    return replace(freedom, axis=(0.0 - x, 0.0 - y, 0.0 - z), start=start)


def trees(
    bodies: list[PrimRead], joints: list[UsdJointRead], roots: list[PrimRead]
) -> tuple[list[UsdLinkRead], list[UsdJointRead]]:
    """The roots of the trees, in the file's order, and the joints that are in none. ``roots``: those that the file names."""
    inside = [joint for joint in joints if not joint.outside]
    joints_of: dict[int, list[UsdJointRead]] = {}
    for joint in inside:
        for side in (joint.first, joint.second):
            if side is not None:
                joints_of.setdefault(id(side), []).append(joint)
    links: dict[int, UsdLinkRead] = {}
    used: set[int] = set()
    tops: list[UsdLinkRead] = []

    def grow(top: UsdLinkRead) -> None:
        waiting = [top]
        while waiting:
            link = waiting.pop(0)
            for joint in joints_of.get(id(link.prim), ()):
                other = joint.other(link.prim)
                if id(joint) in used or other is None or id(other) in links:
                    continue
                used.add(id(joint))
                if joint.second is link.prim:
                    reverse(joint)
                links[id(other)] = child = UsdLinkRead(other, link.prim, joint)
                link.children.append(child)
                waiting.append(child)

    def start(body: PrimRead, joint: UsdJointRead | None) -> None:
        if joint is not None:
            used.add(id(joint))
            if joint.second is None:
                reverse(joint)
        links[id(body)] = link = UsdLinkRead(body, None, joint)
        tops.append(link)
        grow(link)

    # a chain between two walls is one tree with a loop: the first wall holds it, by a fixed joint where there is one
    to_world = [joint for joint in inside if joint.first is None or joint.second is None]
    for joint in sorted(to_world, key=lambda joint_read: bool(joint_read.freedoms)):
        body = joint.first if joint.second is None else joint.second
        if body is not None and id(body) not in links:
            start(body, joint)
    for body in roots:
        if id(body) not in links:
            start(body, None)
    moved = {id(joint.second) for joint in inside}
    for body in (*(body for body in bodies if id(body) not in moved), *bodies):
        if id(body) not in links:
            start(body, None)
    order = {id(body): index for index, body in enumerate(bodies)}
    tops.sort(key=lambda link: order[id(link.prim)])
    return tops, [joint for joint in joints if id(joint) not in used]


def in_order(top: UsdLinkRead) -> list[UsdLinkRead]:
    """A tree's links, parents first, each with all below it before the next."""
    return outwards([top], lambda link: link.children)


def frame_in_body(joint: UsdJointRead) -> Pose:
    """The frame of a spec's body in the rigid frame of its prim: at the joint, with the prim's axes."""
    turning = any(freedom.kind in ("hinge", "ball") for freedom in joint.freedoms)
    return Pose(joint.in_second.position if turning else (0.0, 0.0, 0.0))


def origin_of(joint: UsdJointRead) -> Pose:
    """The body's frame in the parent's rigid frame, with the joint at zero."""
    zero = frames.compose(joint.in_first, frames.inverse(joint.in_second))
    return frames.compose(zero, frame_in_body(joint))


@dataclass
class UsdBodyRead:
    """A body: its prim, its shapes in its rigid frame, and where its frame in the spec is in that."""

    prim: PrimRead
    link: UsdLinkRead
    shapes: list[UsdShapeRead]
    name: str = ""
    model: str = ""
    frame: Pose = field(default_factory=Pose)
    fixed: bool = False

    @property
    def offset(self) -> Vector3:
        """The origin of the spec's frame in the prim's."""
        return self.frame.position

    @property
    def full(self) -> str:
        """The name with that of its model."""
        return f"{self.model}/{self.name}" if self.model else self.name


def loop_data(joint: UsdJointRead, bodies: Mapping[int, UsdBodyRead]) -> tuple[str, dict[str, Any]] | None:
    """The model that a loop is in ("": none), and its words; None for what the language does not say, which is then lost."""
    prim = joint.prim
    if joint.first is None or joint.second is None:
        reason = "a loop that is closed against the world is not supported"
        prim.lose(None, reason, hint="join it to a body that is fixed")
        return None
    kinds = [freedom.kind for freedom in joint.freedoms]
    first, second = bodies[id(joint.first)], bodies[id(joint.second)]
    if first.model != second.model:
        prim.lose(None, "a loop of two models is not supported")
        return None
    names = [first.name, second.name]
    here = frames.compose(frames.inverse(first.frame), joint.in_first)
    there = frames.compose(frames.inverse(second.frame), joint.in_second)
    if not kinds:
        pose = frames.compose(here, frames.inverse(there))
        said = Pose(prim.exactly("origin", pose.position), prim.turn("orientation", pose.quaternion))  # type: ignore[arg-type]
        return first.model, {"weld": {"bodies": names, "pose": pose_data(said)}}
    if kinds not in (["ball"], ["hinge"]):
        prim.lose(None, "loops are closed by fixed, spherical and revolute joints only")
        return None
    if kinds == ["hinge"]:
        prim.lose(
            "physics:axis",
            "a loop is held at the joint's point; nothing holds the direction of its axis, unless the other joints do",
        )
    at = prim.exactly("origin", here.position)
    second_at = prim.exactly("second_point", there.position)
    return first.model, {"connect": {"bodies": names, "at": numbers(at), "second_at": numbers(second_at)}}


def holder_of(data: dict[str, Any], model: str) -> dict[str, Any]:
    """The part of the data of a spec that has the bodies of a model ("": those of none)."""
    holder: dict[str, Any] = data.get("model") or (data["models"][model] if model else data)
    return holder


def constrain(data: dict[str, Any], model: str, name: str, words: dict[str, Any]) -> None:
    """Add a constraint of a model."""
    table = holder_of(data, model).setdefault("constraints", {})
    (given,) = names([name], list(table))
    table[given] = words


MARK = "simspec:frame"
"""The mark of frames that simspec writes: others have to stand elsewhere than their body."""


def add_frames(
    stage: StageRead,
    places: PrimPlaces,
    body_of: Mapping[str, PrimRead],
    bodies: Mapping[int, UsdBodyRead],
    data: dict[str, Any],
) -> None:
    """Put the frames of a stage into the data of its spec. ``body_of``: of paths the rigid body; ``bodies``: of the ``id`` of
    a prim the body that is made of it."""
    for prim in stage.used():
        holder = body_of.get(prim.where)
        if prim.tag != "Xform" or holder is None or holder is prim or id(holder) not in bodies or prim.look():
            continue
        marked = prim.flag(MARK, False)
        place = places.within(prim, holder).pose
        if place == SAME and not marked:
            continue
        body = bodies[id(holder)]
        around = holder_of(data, body.model)
        place_data = pose_data(frames.compose(frames.inverse(body.frame), place))
        (given,) = names([prim.called()], [*around.get("bodies", ()), *around.get("frames", ())])
        around.setdefault("frames", {})[given] = {"body": body.name, **({"pose": place_data} if place_data else {})}


# Mass properties of bodies of a stage.
#
# A mass of the body wins over densities, the body's numbers over those of its shapes; a density of a shape over that of the
# body, and that over one of a material. A mass or a moment of 0, a centre of mass at −∞ and a quaternion of 0 are not said.

MASS: Final = "PhysicsMassAPI"
DENSITY: Final = 1000.0
"""kg/m³ where nothing says a density."""
STANDS_FOR_NONE: Final = float(np.float32(1e-9))
"""kg, which simspec writes for a body without mass."""
OF_FILLING: Final = (
    *(
        "physics:density",
        "physics:mass",
        "newton:massModel",
        "newton:shellThickness",
        "mjc:shellinertia",
        "mjc:inertia",
    ),
)
"""Attributes of shapes that say how the body's mass follows from them."""
OF_BODY: Final = (
    *("physics:density", "physics:centerOfMass", "physics:diagonalInertia", "physics:principalAxes"),
    *("simspec:centre_of_mass", "simspec:inertia"),
)
"""Attributes of a body of which none is carried where it has no mass."""
INCOMPLETE: Final = "incomplete-inertial"
TRIANGLE: Final = "triangle-inequality"
AS_UNSAID: Final = "a mass or moments below 0 are as if they were not there: they follow from the shapes"


class MassReader:
    """Reads the mass properties of bodies."""

    def __init__(self, stage: StageRead, places: PrimPlaces, draft: Draft):
        self.stage, self.places, self.draft = stage, places, draft
        self.of_mass = stage.kilograms
        self.of_inertia = stage.kilograms * stage.metres**2
        self.of_density = stage.kilograms / stage.metres**3

    def read(self, body: UsdBodyRead, path: tuple[str, ...]) -> dict[str, Any]:
        """The words of a body. Raises SpecError for values that are not numbers."""
        prim, shapes, scale = body.prim, body.shapes, self.places.world(body.prim).scale
        prim.applies(MASS)
        mass = prim.real("physics:mass", 0.0) * self.of_mass
        if prim.stored("mass") == (0.0,) and mass == STANDS_FOR_NONE * self.of_mass:
            for name in OF_BODY:
                prim.value(name)
            return {}
        if mass < 0.0:
            if not self.draft.repairing(NOT_POSITIVE):
                raise prim.error(
                    "a mass below 0", found=f"{mass:g}", hint=self.draft.way_out(NOT_POSITIVE), code="I102"
                )
            prim.lose("physics:mass", f"replaced by the rule {NOT_POSITIVE}")
            self.draft.repaired(NOT_POSITIVE, prim, f"a mass of {mass:g} kg follows from the shapes", path)
            mass = 0.0
        mass = prim.exact("mass", mass) if mass else 0.0
        centre, moments = self._centre(prim, scale), self._moments(prim)
        if moments is not None and min(low := principal_moments(moments)) < 0.0 and self.draft.repairing(NOT_POSITIVE):
            prim.lose("physics:diagonalInertia", f"replaced by the rule {NOT_POSITIVE}")
            what = f"the principal moments {shown(low)} kg m² follow from the mass and the shapes"
            self.draft.repaired(NOT_POSITIVE, prim, what, path)
            moments = None
        solid = [shape for shape in shapes if shape.collision and (shape.sizes is None or shape.sizes[0] != "plane")]
        if mass and moments is not None:
            prim.ignore("physics:density", "the file gives the mass")
            for shape in shapes:
                for name in OF_FILLING:
                    shape.prim.ignore(name, "the body has its own mass")
            if centre is None:
                made = self._combined(prim, solid)
                centre = (0.0, 0.0, 0.0) if made is None else made[1]
            return _words(mass, frames.subtract(centre, body.offset), self._inertia(prim, moments, path))
        if moments is not None:
            prim.lose("physics:diagonalInertia", "the file does not say the mass: it follows from the shapes")
        if not solid:
            return self._bare(body, mass, centre, path)
        return self._from_shapes(body, solid, mass, centre, path)

    def _centre(self, prim: PrimRead, scale: Vector3) -> Vector3 | None:
        said = prim.reals("physics:centerOfMass", 3, infinite=True)
        if said is None or any(math.isinf(value) for value in said):
            return None
        rough = [value * factor * self.stage.metres for value, factor in zip(said, scale, strict=True)]
        return frames.vector3(prim.exactly("centre_of_mass", rough))

    def _moments(self, prim: PrimRead) -> tuple[float, ...] | None:
        """The tensor (xx, yy, zz, xy, xz, yz) in the prim's axes (kg m²); None where it is not said."""
        said = prim.reals("physics:diagonalInertia", 3)
        axes = prim.reals("physics:principalAxes", 4)
        whole = prim.value("newton:inertia")
        if isinstance(whole, list) and whole:  # the schema: it is in force in place of the others
            six = prim.reals("newton:inertia", 6) or ()
            return tuple(value * self.of_inertia for value in six)
        if said is None or not any(said):
            return None
        turn = frames.IDENTITY
        if axes is not None and any(axes):
            turn = quaternion(prim, "physics:principalAxes", axes)
        moments = tuple(value * self.of_inertia for value in said)
        tensor = frames.rotate_inertia(turn, (*moments, 0.0, 0.0, 0.0))
        stored = prim.stored("inertia", 6)
        if stored is not None and (agree(stored, tensor) or _stands_for(moments, stored)):
            return stored
        if stored is not None:
            prim.lose(PREFIX + "inertia", STALE, INFORMATION)
        return tensor

    def _inertia(self, prim: PrimRead, tensor: tuple[float, ...], path: tuple[str, ...]) -> dict[str, Any]:
        # moments of a thin plate in single precision may miss it in the last digit
        tensor = self._possible(prim, tensor, path)
        if not any(tensor[3:]):
            return {"principal": numbers(tensor[:3])}
        return tensor_words(tensor)

    def _possible(self, prim: PrimRead, tensor: tuple[float, ...], path: tuple[str, ...]) -> tuple[float, ...]:
        moments = principal_moments(tensor)
        why = impossible(moments)
        if why is None:
            return tensor
        low, middle, high = sorted(moments)
        over = high - low - middle
        message = f"physics:diagonalInertia: {why}"
        if low < 0.0:
            self.draft.defect(prim, message, NOT_POSITIVE)
            return tensor
        if over > 1e-5 * high:
            repair = f"the principal moments {low:g}, {middle:g}, {high:g} kg m² became those of the nearest body"
            if not self.draft.mend(TRIANGLE, prim, message, repair, (*path, "inertia")):
                return tensor
        return nearest(tensor, over / 3.0 * 1.000001)

    def _combined(
        self, prim: PrimRead, solid: Sequence[UsdShapeRead]
    ) -> tuple[float, Vector3, tuple[float, ...]] | None:
        """Mass, centre and tensor of shapes in the prim's rigid frame; None where one is a mesh, or there are none."""
        parts = []
        for shape in solid:
            if shape.sizes is None:
                return None
            kind, size = shape.sizes
            parts.append(shape_part(kind, size, shape.pose, self._density(shape, prim) * SHAPES[kind].volume(size)))
        if not any(part.mass for part in parts):
            return None
        inertial = combined_inertial(parts)
        return inertial.mass, inertial.centre_of_mass, inertial.inertia

    def _density(self, shape: UsdShapeRead, body: PrimRead) -> float:
        prim = shape.prim
        prim.applies(MASS)
        value = prim.real("physics:mass", 0.0) * self.of_mass if prim is not body else 0.0
        if value > 0.0 and shape.sizes is not None:
            return value / SHAPES[shape.sizes[0]].volume(shape.sizes[1])
        for holder in (prim, body):
            density = holder.real("physics:density", 0.0)
            if density > 0.0:
                return density * self.of_density
        material = self.stage.prims.get(shape.material)
        density = material.real("physics:density", 0.0) if material is not None else 0.0
        return density * self.of_density if density > 0.0 else DENSITY

    def _from_shapes(
        self,
        body: UsdBodyRead,
        solid: Sequence[UsdShapeRead],
        mass: float,
        centre: Vector3 | None,
        path: tuple[str, ...],
    ) -> dict[str, Any]:
        """The words of a body that does not say all."""
        prim = body.prim
        densities = [self._density(shape, prim) for shape in solid]
        if centre is not None:
            made = self._combined(prim, solid)
            if made is not None:
                total, middle, tensor = made
                factor = mass / total if mass else 1.0
                more = _steiner(mass or total, frames.subtract(middle, centre))
                moved = tuple(factor * value + two for value, two in zip(tensor, more, strict=True))
                return _words(mass or total, frames.subtract(centre, body.offset), self._inertia(prim, moved, path))
            prim.lose("physics:centerOfMass", "with meshes and without moments it follows from the shapes")
        if mass:
            made = self._combined(prim, solid) if len(set(densities)) > 1 else None
            if made is None:
                return {"mass": plain(mass)}
            densities = [mass / made[0] * density for density in densities]
        for shape, density in zip(solid, densities, strict=True):
            shape.data["density"] = plain(density)
        return {}

    def _bare(self, body: UsdBodyRead, mass: float, centre: Vector3 | None, path: tuple[str, ...]) -> dict[str, Any]:
        """A body without shapes that have a volume: its moments are not known."""
        if not mass:
            return {}
        message = "the body has a mass, but neither moments nor shapes that they follow from"
        repair = f"the moments are those of a ball of {mass:g} kg and 1000 kg/m³"
        if not self.draft.mend(INCOMPLETE, body.prim, message, repair, (*path, "inertia")):
            return {}
        radius = (mass / (4.0 / 3.0 * math.pi * DENSITY)) ** (1.0 / 3.0)
        moment = 0.4 * mass * radius * radius
        return _words(mass, frames.subtract(centre or (0.0, 0.0, 0.0), body.offset), {"principal": [moment] * 3})


def _words(mass: float, centre: Vector3, inertia: dict[str, Any]) -> dict[str, Any]:
    return {"mass": plain(mass), **({"centre_of_mass": numbers(centre)} if any(centre) else {}), "inertia": inertia}


def _steiner(m: float, lever: Vector3) -> tuple[float, ...]:
    x, y, z = lever
    return m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z


def _stands_for(moments: Sequence[float], tensor: Sequence[float]) -> bool:
    """Whether moments are those of ``tensor`` with 1e-12 kg m² for each of zero, as simspec writes them."""
    least = float(np.float32(1e-12))
    scale = max(moments)
    return least in moments and all(abs(value) <= scale * (1.0 + 1e-6) for value in tensor)
