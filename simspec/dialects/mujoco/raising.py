"""From an MJCF document and its sidecar back to the world that they mean to MuJoCo (level L0).

It shares no code with what lowers worlds. It knows the part of MJCF that simspec writes (defaults and classes, nested bodies,
at most one inertial for each body, primitive geoms, explicit pairs, one keyframe) and refuses, by ValueError, the rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Final, TypeVar

from simspec.dialects.mujoco.sidecar import (
    NO_RATING,
    Chain,
    CommonLaw,
    MujocoSidecar,
    chains,
    origins,
    read_assets,
    surface,
)
from simspec.formats.kit.contract import restore_frames, tensor
from simspec.formats.kit.text import finite_numbers
from simspec.formats.mjcf.bodies import world_name
from simspec.formats.mjcf.reading import MjcfBodyItem, MjcfDocument, MjcfItem
from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.world import frames
from simspec.world.actions import Fluid, InertiaBox, JointSum
from simspec.world.frames import vector6
from simspec.world.types import (
    POSITION_SIZE,
    VELOCITY_SIZE,
    Body,
    ConnectConstraint,
    Constraint,
    EnginePair,
    EngineServo,
    EngineValue,
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
    WeldConstraint,
)

UNREADABLE: Final = {"collision_group": "the file carries bit masks and excluded pairs, not the names of groups"}

# MJCF's own conventions, stated here again and not taken from what lowers worlds, so that one error cannot hide another
HALVED: Final[Mapping[str, tuple[bool, ...]]] = {
    "sphere": (False,),
    "box": (True, True, True),
    "cylinder": (False, True),
    "capsule": (False, True),
    "ellipsoid": (False, False, False),
}
"""Which numbers of a geom's size are half lengths."""
CONE_NAMES: Final = {"elliptic": "elliptic", "pyramidal": "pyramid-inscribed"}
GROUP_IS_VISUAL: Final = {"0": True, "2": True, "3": False, "4": False}
FLAG_WORDS: Final = {"true": True, "false": False, "enable": True, "disable": False}
OF_SUM: Final = {
    *("name", "limited", "range", "stiffness", "springlength", "damping", "frictionloss", "margin"),
    *("solreflimit", "solimplimit", "solreffriction", "solimpfriction"),
}
"""The attributes of a fixed tendon. Others would be efforts or inertia along it."""
SMALLEST_MOMENT: Final = 1e-15
"""kg m²: of two principal moments less the third, what a fluid's forces are computed with at least."""
IN_BODIES: Final = {"inertial", "joint", "geom", "site", "body"}
NO_OFFSET: Final = (0.0, 0.0, 0.0)
Meaning = TypeVar("Meaning")


def raise_document(document: MjcfDocument, sidecar: MujocoSidecar) -> ReadBack:
    """The model that the document holds, in the world's frames and order. Raises ValueError for what is not read."""
    raising = _Raising(document, sidecar)
    bodies = raising.bodies()
    order = [body.name for body in sidecar.bodies]
    if sorted(order) != sorted(bodies):
        missing, unknown = sorted(set(order) - set(bodies)), sorted(set(bodies) - set(order))
        raise ValueError(f"{document.file}: bodies missing {missing}, not in the sidecar {unknown}")
    named = tuple(
        dataclasses.replace(bodies[name], model=model) for name, model in zip(order, sidecar.models, strict=True)
    )
    return ReadBack(
        restore_frames(named, sidecar.offsets),
        _vector(document.option, "gravity"),
        raising.timestep,
        _word(document.option, "cone", CONE_NAMES),
        dict(UNREADABLE),
        raising.pairs(),
        raising.servos(),
        raising.settings(),
        constraints=raising.constraints(),
        sums=raising.sums(),
        frames=raising.frames(),
        fluid=raising.fluid,
    )


def _vector(item: MjcfItem, name: str) -> Vector3:
    x, y, z = item.numbers(name, 3)
    return (x, y, z)


def _turn(item: MjcfItem, name: str) -> Quaternion:
    w, x, y, z = item.numbers(name, 4)
    return frames.normalise((w, x, y, z))


def _word(item: MjcfItem, name: str, words: Mapping[str, Meaning]) -> Meaning:
    """The meaning of a word of an attribute."""
    text = item.text(name)
    if text not in words:
        raise item.refused(f"{name} is {text[:60]!r}, should be one of {', '.join(words)}")
    return words[text]


def _whole(item: MjcfItem, name: str) -> int:
    value = item.number(name)
    if value != int(value):
        raise item.refused(f"{name} is {value}, should be a whole number")
    return int(value)


def _weight(item: MjcfItem) -> float:
    """The share of its weight that a body has."""
    return 1.0 - item.number("gravcomp") if "gravcomp" in item.values else 1.0


class _Raising:
    """One document."""

    def __init__(self, document: MjcfDocument, sidecar: MujocoSidecar):
        self._document, self._sidecar = document, sidecar
        if document.includes:
            line = document.includes[0].line
            raise ValueError(f"{document.file}:{line}: <include>, and files that include others are not read")
        if document.unknown:
            element = document.unknown[0]
            raise ValueError(f"{document.file}:{element.line}: <{element.tag[:60]}> is not read here")
        if document.compiler.text("angle") != "radian":
            raise document.compiler.refused("only files with angles in radian are read")
        if document.world:
            raise document.world[0].refused("is in the world itself, which is not read")
        self.timestep = document.option.number("timestep")
        keys = document.section("keyframe")
        if len(keys) != 1:
            raise ValueError(f"{document.file}: {len(keys)} keyframes, not one")
        self._position, self._velocity = keys[0].numbers("qpos"), keys[0].numbers("qvel")
        self._nq = self._nv = 0
        self._sites = self._read_sites()
        self._law = CommonLaw.of(self.timestep, sidecar.settings)
        self._meshes, self._fields = read_assets(document)
        density, viscosity = (document.option.number(name) for name in ("density", "viscosity"))
        fluid = Fluid(density, viscosity, _vector(document.option, "wind"))
        self.fluid = None if fluid == Fluid() else fluid
        self._moving: set[str] = set()

    def _read_sites(self) -> dict[str, tuple[str, MjcfItem]]:
        """The sites by name, each with its body."""
        sites: dict[str, tuple[str, MjcfItem]] = {}
        for body in self._document.bodies:
            for site in body.all("site"):
                if (called := site.text("name")) in sites:
                    raise site.refused(f"there is another site {called!r}")
                sites[called] = (world_name(body.item.text("name")), site)
        return sites

    def bodies(self) -> dict[str, Body]:
        """Every body by name, in the file's frames."""
        names: list[str] = []
        raised: dict[str, Body] = {}
        rows = chains(self._sidecar)
        for body in self._document.bodies:
            others = {child.tag for child in body.item.element.children} - IN_BODIES
            if others:
                raise body.item.refused(f"holds what is not read: {sorted(others)}")
            parent = None if body.parent is None else names[body.parent]
            names.append(world_name(body.item.text("name")))
            if names[-1] in raised:
                raise body.item.refused(f"a second body {names[-1]!r}")
            chain = rows.get(names[-1], ((names[-1], frames.IDENTITY),))
            raised |= {entry.name: entry for entry in self._body(body, chain, parent)}
        if (self._nq, self._nv) != (len(self._position), len(self._velocity)):
            raise ValueError(
                f"{self._document.file}: the keyframe holds {len(self._position)} positions and {len(self._velocity)} "
                f"velocities, the joints {self._nq} and {self._nv}"
            )
        return raised

    def _body(self, body: MjcfBodyItem, chain: Chain, parent: str | None) -> Iterator[Body]:
        """A body, after those between its joints."""
        place = Pose(_vector(body.item, "pos"), _turn(body.item, "quat"))
        inertials = body.all("inertial")
        inertial = Inertial(0.0)
        if inertials:
            item = _only(inertials, body.item)
            moments = tensor(_vector(item, "diaginertia"), _turn(item, "quat"))
            inertial = Inertial(item.number("mass"), _vector(item, "pos"), moments)
        name, items = chain[-1][0], body.all("joint")
        box = self._box(inertials[0]) if inertial.mass and (items or parent in self._moving) else None
        if items or parent in self._moving:
            self._moving.update(called for called, _ in chain)
        shapes, weight = tuple(self._shape(geom) for geom in body.all("geom")), _weight(body.item)
        if not items and len(chain) == 1:
            if name not in self._sidecar.fixed_joints:
                raise body.item.refused("no joint, and the sidecar has no rigid joint of that body")
            weld = Joint(self._sidecar.fixed_joints[name], "fixed", parent, place)
            yield Body(name, "", inertial, weld, shapes, gravity_scale=weight, box=box)
            return
        if len(items) != len(chain):
            raise body.item.refused(f"{len(items)} joints, by the sidecar {len(chain)}")
        in_body = [Pose(_vector(item, "pos"), turn) for item, (_, turn) in zip(items, chain, strict=True)]
        if any(in_body[-1].position):
            raise items[-1].refused("is not at its body's origin")
        for item, (called, turn), origin in zip(items, chain, origins(place, in_body), strict=True):
            joint = self._joint(item, parent, origin, turn)
            last = called == name
            moved = Body(called, "", Inertial(0.0), joint)
            if last:
                moved = dataclasses.replace(moved, inertial=inertial, shapes=shapes, gravity_scale=weight, box=box)
            yield moved
            parent = called

    def _box(self, item: MjcfItem) -> InertiaBox | None:
        """The box on which a fluid acts, of a body with this inertial: the cuboid of its mass and moments."""
        if self.fluid is None:
            return None
        moments, mass = _vector(item, "diaginertia"), item.number("mass")
        squares = (6.0 / mass * max(sum(moments) - 2.0 * moment, SMALLEST_MOMENT) for moment in moments)
        a, b, c = (math.sqrt(square) for square in squares)
        return InertiaBox((a, b, c), _turn(item, "quat"))

    def _joint(self, item: MjcfItem, parent: str | None, origin: Pose, turn: Quaternion) -> Joint:
        """A joint; ``origin``: of its frame in what it moves against, ``turn``: the orientation of that in the body's."""
        kind = item.text("type")
        if kind not in (*SCALAR_JOINTS, *QUATERNION_JOINTS):
            raise item.refused(f"type is {kind[:60]!r}, should be hinge, slide, ball or free")
        if item.number("ref") != 0.0:
            raise item.refused("is not at zero")
        position, velocity = self._state(kind)
        velocity_limit, effort_limit = (None if rating == NO_RATING else rating for rating in item.numbers("user", 2))
        limits = None
        if _word(item, "limited", FLAG_WORDS):
            lower, upper = item.numbers("range", 2)
            limits = (lower, upper)
            if kind == "ball" and lower:
                raise item.refused("the range of a ball joint begins at 0")
        return Joint(
            item.text("name"),
            kind,
            parent,
            Pose() if kind == "free" else origin,
            frames.rotate(frames.conjugate(turn), _vector(item, "axis")) if kind in SCALAR_JOINTS else (0.0, 0.0, 0.0),
            limits if kind != "ball" else None,
            velocity_limit,
            effort_limit,
            damping=item.number("damping"),
            dry_friction=item.number("frictionloss"),
            armature=item.number("armature"),
            spring_stiffness=item.number("stiffness"),
            spring_rest=item.number("springref"),
            position=position,
            velocity=velocity,
            angular_damping=item.number("damping") if kind == "free" else 0.0,
            angular_armature=item.number("armature") if kind == "free" else 0.0,
            angle_limit=limits[1] if limits is not None and kind == "ball" else None,
        )

    def _state(self, kind: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Position and velocity of the next joint in the keyframe, as the world has them."""
        position = self._position[self._nq : self._nq + POSITION_SIZE[kind]]
        velocity = self._velocity[self._nv : self._nv + VELOCITY_SIZE[kind]]
        self._nq += POSITION_SIZE[kind]
        self._nv += VELOCITY_SIZE[kind]
        if (len(position), len(velocity)) != (POSITION_SIZE[kind], VELOCITY_SIZE[kind]):
            return position, velocity  # the keyframe is too short, which is said when all joints are counted
        if kind == "free":
            w, x, y, z, rates = *position[3:], velocity[3:]
            turn = frames.normalise((w, x, y, z))
            spin = frames.rotate(turn, (rates[0], rates[1], rates[2]))
            return (*position[:3], *turn), (*velocity[:3], *spin)
        if kind == "ball":
            w, x, y, z = position
            return frames.normalise((w, x, y, z)), velocity
        return position, velocity

    def _shape(self, geom: MjcfItem) -> Shape:
        kind = geom.text("type")
        size: tuple[float, ...] = ()
        if ("mesh" in geom.values) != (kind == "mesh"):
            raise geom.refused("a mesh is named by what is none, or not named")
        if ("hfield" in geom.values) != (kind == "hfield"):
            raise geom.refused("a height field is named by what is none, or not named")
        if kind == "mesh":
            size = self._hull(geom)
        elif kind == "hfield":
            kind, size = "heightfield", self._field(geom)
        elif kind != "plane":
            if kind not in HALVED:
                raise geom.refused(f"type is {kind[:60]!r}, which is not read")
            halved = HALVED[kind]
            values = geom.numbers("size", len(halved))
            size = tuple(2.0 * value if half else value for value, half in zip(values, halved, strict=True))
        collides = geom.text("contype") != "0" or geom.text("conaffinity") != "0"
        surfaces: tuple[Surface, ...] = (
            (self._surface(geom, geom.numbers("friction", 3), self._law),) if collides else ()
        )
        red, green, blue, alpha = geom.numbers("rgba", 4)
        return Shape(
            geom.text("name"),
            kind,
            size,
            Pose(_vector(geom, "pos"), _turn(geom, "quat")),
            "",
            collides,
            _word(geom, "group", GROUP_IS_VISUAL),
            (red, green, blue, alpha),
            surfaces,
            margin=geom.number("margin") if collides else 0.0,
            surface_velocity=vector6(geom.numbers("surfacevel", 6)) if "surfacevel" in geom.values else (0.0,) * 6,
        )

    def _hull(self, geom: MjcfItem) -> tuple[float, ...]:
        name = geom.text("mesh")
        if name not in self._meshes:
            raise geom.refused(f"there is no mesh {name[:60]!r}")
        return self._meshes[name]

    def _field(self, geom: MjcfItem) -> tuple[float, ...]:
        name = geom.text("hfield")
        if name not in self._fields:
            raise geom.refused(f"there is no height field {name[:60]!r}")
        return self._fields[name]

    @staticmethod
    def _surface(item: MjcfItem, friction: tuple[float, ...], law: CommonLaw, inverse_mass: float = 1.0) -> Surface:
        numbers = (item.numbers("solref", 2), item.numbers("solimp", 5))
        return surface(_whole(item, "condim"), friction, *numbers, law, inverse_mass)

    def pairs(self) -> tuple[EnginePair, ...]:
        """The explicit pairs, sorted."""
        inverse = self._inverse_masses()
        actual = []
        for pair in self._document.section("contact"):
            if pair.tag != "pair":
                continue
            first, second = sorted((pair.text("geom1"), pair.text("geom2")))
            if first not in inverse or second not in inverse:
                raise pair.refused(f"{first!r} with {second!r}, one of which is missing")
            value, two, torsion, roll, other_roll = pair.numbers("friction", 5)
            if value != two or roll != other_roll:
                raise pair.refused(f"{first!r} with {second!r} is not isotropic")
            weight = inverse[first] + inverse[second]
            law = CommonLaw.of(self.timestep, self._sidecar.settings_between(first, second))
            surface_actual = self._surface(pair, (value, torsion, roll), law, weight)
            actual.append(EnginePair(first, second, surface_actual, pair.number("margin")))
        return tuple(sorted(actual, key=lambda pair: (pair.first, pair.second)))

    def settings(self) -> dict[str, EngineValue]:
        """The solver settings that the file itself holds, as ``settings.NAME``, without the sidecar."""
        option, flags = self._document.option, self._document.flags
        values: dict[str, EngineValue] = {"solver": option.text("solver").lower()}
        values |= {name: _whole(option, name) for name in ("iterations", "ls_iterations", "noslip_iterations")}
        values |= {name: option.number(name) for name in ("tolerance", "ls_tolerance", "ccd_tolerance", "impratio")}
        values |= {name: _word(flags, name, FLAG_WORDS) for name in ("warmstart", "island", "multiccd")}
        if values["impratio"] != self._sidecar.settings.get("impratio"):
            # the file has one, whichever of the two settings it comes from
            values["high_impratio"] = values["impratio"]
        return {f"settings.{name}": value for name, value in values.items()}

    def servos(self) -> tuple[EngineServo, ...]:
        """The actuators: position with kp and kv, velocity with kv; all on one joint, without gear."""
        actual = []
        for item in self._document.section("actuator"):
            if item.tag not in ("position", "velocity") or _word(item, "ctrllimited", FLAG_WORDS):
                raise item.refused("not an actuator that is read")
            stated = item.values
            if item.numbers("gear") != (1.0, 0.0, 0.0, 0.0, 0.0, 0.0) or ("kp" in stated) != (item.tag == "position"):
                raise item.refused("a gear, or a missing or superfluous kp")
            limit = None
            if _word(item, "forcelimited", FLAG_WORDS):
                lower, limit = item.numbers("forcerange", 2)
                if lower != -limit:
                    raise item.refused("the effort limit is not the same both ways")
            stiffness = item.number("kp") if "kp" in stated else 0.0
            actual.append(EngineServo(item.text("joint"), stiffness, item.number("kv"), limit))
        return tuple(actual)

    def constraints(self) -> tuple[Constraint, ...]:
        """The equalities: of two joints, whose first follows the second, and of two sites."""
        actual: list[Constraint] = []
        for item in self._document.section("equality"):
            name = item.text("name")
            if item.values.get("active", "true") != "true":
                raise item.refused("is not active")
            if item.tag == "joint":
                offset, ratio, *more = item.numbers("polycoef", 5)
                if any(more):
                    raise item.refused("is not linear")
                actual.append(FollowConstraint(name, item.text("joint1"), item.text("joint2"), ratio, offset))
                continue
            if item.tag not in ("connect", "weld") or item.values.get("torquescale", "1") != "1":
                raise item.refused("not a constraint that is read")
            ends = self._of_sites(item)
            if missing := [end for end in ends if end not in self._sites]:
                raise item.refused(f"there is no site {missing[0]!r}")
            (first, near), (second, far) = (self._end(*self._sites[end]) for end in ends)
            if item.tag == "connect":
                actual.append(ConnectConstraint(name, first, second, near.position, far.position))
            else:
                actual.append(WeldConstraint(name, first, second, frames.compose(near, frames.inverse(far))))
        return tuple(sorted(actual, key=lambda constraint: constraint.name))

    @staticmethod
    def _of_sites(item: MjcfItem) -> tuple[str, str]:
        """The names of the sites that an equality is of."""
        return item.text("site1"), item.text("site2")

    def frames(self) -> tuple[Frame, ...]:
        """The sites that no constraint is of: named frames."""
        equalities = [item for item in self._document.section("equality") if item.tag != "joint"]
        used = [name for item in equalities for name in self._of_sites(item)]
        if twice := sorted({name for name in used if used.count(name) > 1}):
            raise ValueError(f"{self._document.file}: several constraints are of the site {twice[0]!r}")
        free = self._sites.keys() - set(used)
        return tuple(Frame(name, *self._end(*self._sites[name])) for name in sorted(free))

    def sums(self) -> tuple[JointSum, ...]:
        """The fixed tendons, whose lengths are sums of joint positions."""
        joint_sums: list[JointSum] = []
        for item in self._document.section("tendon"):
            if item.tag != "fixed" or not item.values.keys() <= OF_SUM:
                raise item.refused("not a tendon that is read")
            if item.number("margin"):
                raise item.refused("has a margin")
            weights: dict[str, float] = {}
            for part in item.element.children:
                if part.tag != "joint" or part.attributes.keys() != {"joint", "coef"}:
                    raise item.refused(f"holds <{part.tag[:60]}>, which is not read")
                if (joint := part.attributes["joint"]) in weights:
                    raise item.refused(f"holds {joint!r} twice")
                (weights[joint],) = finite_numbers(part.attributes["coef"], 1)
            lower, upper = item.numbers("range", 2)
            limits = (lower, upper) if _word(item, "limited", FLAG_WORDS) else None
            rest = item.numbers("springlength")
            if len(rest) != 1:
                raise item.refused("has a spring that is slack over a range")
            numbers = item.number("stiffness"), rest[0], item.number("damping")
            friction = item.number("frictionloss")
            joint_sums.append(JointSum(item.text("name"), tuple(sorted(weights.items())), *numbers, limits, friction))
        return tuple(sorted(joint_sums, key=lambda joint_sum: joint_sum.name))

    def _end(self, body: str, site: MjcfItem) -> tuple[str, Pose]:
        """A site's body, and where it is in the world's frame of that."""
        place = frames.add(_vector(site, "pos"), self._sidecar.offsets.get(body, NO_OFFSET))
        return body, Pose(place, _turn(site, "quat"))

    def _inverse_masses(self) -> dict[str, float]:
        """1/m of the body of each geom; 0 of bodies without a joint up to the world."""
        inverse: dict[str, float] = {}
        moves: list[bool] = []
        for body in self._document.bodies:
            moves.append(bool(body.all("joint")) or (body.parent is not None and moves[body.parent]))
            inertials = body.all("inertial")
            mass = inertials[0].number("mass") if inertials else 0.0
            weight = 1.0 / mass if moves[-1] and mass > 0.0 else 0.0
            inverse.update((geom.text("name"), weight) for geom in body.all("geom"))
        return inverse


def _only(items: tuple[MjcfItem, ...], body: MjcfItem) -> MjcfItem:
    if len(items) != 1:
        raise body.refused(f"{len(items)} of <{items[0].tag}>, not one")
    return items[0]
