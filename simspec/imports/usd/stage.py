"""A stage as prims that account for all that is authored on them, composed in a process of its own (``child.py``); and
properties of joints by engines' schemas."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Location, Problem, SpecError
from simspec.files import NotReadableError, parse_json
from simspec.imports.child import ChildError, Policy, run
from simspec.imports.draft import plain
from simspec.imports.elements import INFORMATION, Element
from simspec.imports.files import Files

# Lines of prims in a text; a binary file has none.

DEEPEST: Final = 1000
"""Brackets within each other up to which prims have lines."""
MAGIC: Final = b"#usda"
_TOKEN: Final = re.compile(
    rb"""(?P<skip>"{3}.*?"{3}|'{3}.*?'{3}|\#[^\n]*)"""
    rb"""|(?P<prim>\b(?:def|over|class)\b(?:[ \t]+[A-Za-z_][\w:]*)?[ \t]+"(?P<name>[^"\n]*)")"""
    # possessive: a long text takes no memory for ways back
    rb"""|(?P<string>"(?:[^"\\\n]++|\\.)*+"|'(?:[^'\\\n]++|\\.)*+')"""
    rb"""|(?P<bracket>[{}()\[\]])""",
    re.DOTALL,
)


def lines_of(content: bytes) -> Mapping[str, int]:
    """The line of each prim's declaration in a file, the first where there are several."""
    if not content.startswith(MAGIC):
        return {}
    lines: dict[str, int] = {}
    open_braces: list[str | None] = []
    path, pending, round_brackets = "", None, 0
    line, seen = 1, 0
    for token in _TOKEN.finditer(content):
        line += content.count(b"\n", seen, token.start())
        seen = token.start()
        bracket = token["bracket"]
        if token["name"] is not None and not round_brackets:
            pending = token["name"].decode("utf-8", "replace")
            lines.setdefault(f"{path}/{pending}", line)
        elif bracket in (b"(", b"["):
            round_brackets += 1
        elif bracket in (b")", b"]"):
            round_brackets = max(0, round_brackets - 1)
        elif bracket == b"{" and not round_brackets:
            open_braces.append(pending)
            if len(open_braces) > DEEPEST:
                break  # deeper than any stage that is read: paths would take the square of the text
            if pending is not None:
                path, pending = f"{path}/{pending}", None
        elif bracket == b"}" and not round_brackets and open_braces:
            name = open_braces.pop()
            if name is not None:
                path = path.removesuffix(f"/{name}")
    return lines


PROGRAM: Final = Path(__file__).with_name("child.py")
SECONDS: Final = 8
"""CPU time of the reader; the largest stage of the measured corpora takes 1 s, of which starting it 0.5 s."""
PATIENCE: Final = 60.0
"""s by the clock, on a busy machine."""
MEMORY: Final = 2 * 2**30
"""Bytes of addresses of the reader's process, of which usd-core itself takes 0.6 GB."""
PREFIX: Final = "simspec:"
"""How attributes of simspec's own begin."""
ROUNDING: Final = 1e-6
"""Largest relative deviation of a number that was computed from numbers of single precision (6e-8 each)."""
STALE: Final = "it does not agree with the schema's attributes, which have been changed since"


class PrimRead(Element):
    """A prim. ``attributes`` has a text for each attribute, relationship and applied schema, ``record`` their values.
    ``forgiving``: whether the rule that repairs quaternions is requested."""

    forgiving = False

    def __init__(self, record: Mapping[str, Any], location: Location, parent: PrimRead | None):
        self.record = record
        self.where: str = record["path"]
        self.name: str = self.where.rpartition("/")[2]
        self.schemas: tuple[str, ...] = tuple(record["schemas"])
        texts = {f"apiSchemas:{schema}": schema for schema in self.schemas}
        texts |= {name: _text(value) for name, value in record["attributes"].items()}
        texts |= {name: " ".join(targets)[:80] for name, targets in record["relationships"].items()}
        texts |= {f"variantSets:{name}": chosen for name, (chosen, _) in record.get("variants", {}).items()}
        super().__init__(record["type"] or "prim", texts, location, "", parent)
        self.used: bool = record["used"]

    @property
    def label(self) -> str:
        return self.name

    @property
    def path(self) -> str:
        return self.where

    @property
    def above(self) -> PrimRead | None:
        """The prim that this one is in."""
        return self.parent if isinstance(self.parent, PrimRead) else None

    def ancestors(self) -> Iterator[PrimRead]:
        """This prim, and those that it is in, from the inside."""
        prim: PrimRead | None = self
        while prim is not None:
            yield prim
            prim = prim.above

    def applies(self, schema: str) -> bool:
        """Whether a schema is applied; it is then carried."""
        if schema in self.schemas:
            self._taken.add(f"apiSchemas:{schema}")
            return True
        return False

    def instances(self, schema: str) -> list[str]:
        """The names under which a schema is applied (``PhysicsLimitAPI:rotX``)."""
        names = [name.partition(":")[2] for name in self.schemas if name.startswith(f"{schema}:")]
        for name in names:
            self._taken.add(f"apiSchemas:{schema}:{name}")
        return names

    def value(self, name: str) -> Any:
        """The value of an attribute, taken; None where it has none."""
        said = self.record["attributes"].get(name)
        if said is None:
            return None
        self._taken.add(name)
        if "connected" in said:
            raise self.error(f"{name} is connected to another attribute, which simspec does not follow", code="I104")
        if "value" not in said and said.get("samples"):
            message = f"{name} changes in time and has no default value"
            raise self.error(message, hint="give it a default value", code="I101")
        return said.get("value")

    def real(self, name: str, default: float, infinite: bool = False) -> float:
        """A number, taken. Raises SpecError for what is none, or not finite and not ``infinite``."""
        value = self.value(name)
        return default if value is None else self._number(name, value, infinite)

    def reals(self, name: str, count: int, infinite: bool = False) -> tuple[float, ...] | None:
        """Several numbers, taken; None where the attribute has no value. Raises SpecError for others."""
        value = self.value(name)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != count:
            raise self.error(f"{name} should be {count} numbers", found=str(value)[:80], code="I101")
        return tuple(self._number(name, item, infinite) for item in value)

    def _number(self, name: str, value: Any, infinite: bool) -> float:
        if value in ("inf", "-inf") and infinite:
            return float(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(f"{name} should be a finite number", found=str(value)[:80], code="I101")
        return float(value)

    def flag(self, name: str, default: bool) -> bool:
        """A flag, taken. Raises SpecError for what is none."""
        value = self.value(name)
        if value is not None and not isinstance(value, (bool, int)):
            raise self.error(f"{name} should be true or false", found=str(value)[:80], code="I101")
        return default if value is None else bool(value)

    def token(self, name: str, default: str = "") -> str:
        """A word, taken."""
        value = self.value(name)
        return value if isinstance(value, str) else default

    def targets(self, name: str) -> list[str]:
        """The paths that a relationship names, taken."""
        if name in self.record["relationships"]:
            self._taken.add(name)
        targets: list[str] = self.record["relationships"].get(name, [])
        return targets

    def array(self, name: str) -> NDArray[Any] | None:
        """The array of a mesh, taken; None where it has none."""
        said = self.record["attributes"].get(name)
        if said is None or "array" not in said:
            return None
        self._taken.add(name)
        kind, shape, text = said["array"]
        return np.frombuffer(base64.b64decode(text), kind).reshape(shape)

    def stored(self, name: str, count: int = 0) -> tuple[float, ...] | None:
        """Numbers that only simspec reads, taken; None where there are none. ``count`` 0: any."""
        value = self.value(PREFIX + name)
        values = [value] if isinstance(value, (int, float)) else value
        if not isinstance(values, list) or (count and len(values) != count):
            return None
        return tuple(self._number(PREFIX + name, item, False) for item in values)

    def stored_number(self, name: str) -> float | None:
        """One such number."""
        said = self.stored(name, 1)
        return None if said is None else said[0]

    def exact(self, name: str, rough: float) -> float:
        """One number of :meth:`exactly`."""
        return self.exactly(name, (rough,))[0]

    def exactly(self, name: str, rough: Sequence[float]) -> tuple[float, ...]:
        """The doubles of ``simspec:NAME``, where they are ``rough`` but for its single precision; else ``rough``."""
        said = self.stored(name, len(rough))
        if said is None:
            return tuple(rough)
        if agree(said, rough):
            return said
        self.lose(PREFIX + name, STALE, INFORMATION)
        return tuple(rough)

    def turn(self, name: str, rough: Sequence[float]) -> tuple[float, ...]:
        """The same of a quaternion, of which both signs are one rotation."""
        said = self.stored(name, 4)
        if said is not None and agree(said, [-value for value in rough]):
            return said
        return self.exactly(name, rough)

    def called(self) -> str:
        """The name in a spec: that of ``simspec:name`` where the prim's comes from it, else the prim's."""
        said = self.token(PREFIX + "name")
        plain = "".join(character if character.isalnum() and character.isascii() else "_" for character in said)
        if said and (self.name.startswith((plain, f"_{plain}"))):
            return said
        return self.name


def agree(first: Sequence[float], second: Sequence[float]) -> bool:
    """Whether numbers are the same but for rounding to single precision."""
    scale = max((abs(value) for value in (*first, *second)), default=0.0)
    return all(abs(value - two) <= ROUNDING * scale for value, two in zip(first, second, strict=True))


def _text(said: Mapping[str, Any]) -> str:
    return str(said.get("value", f"{said.get('length', 0)} items" if "length" in said else ""))[:80]


@dataclass
class StageRead:
    """A composed stage: prims in its order, by their paths."""

    root: PrimRead
    prims: dict[str, PrimRead]
    metres: float
    kilograms: float
    up: str
    default: str
    missing: list[str]
    """Files that are not there, where that is forgiven."""

    def used(self) -> Iterator[PrimRead]:
        """Prims that take part: active, defined, not abstract."""
        return (prim for prim in self.prims.values() if prim.used)


def read_stage(files: Files, forgive: bool) -> StageRead:
    """The stage of a file. ``forgive``: files that are not there are left out. Raises SpecError where it cannot be read."""
    content = files.content()
    here = Location(files.shown, 1, 1)
    requested = {"path": str(files.path.resolve()), "roots": [str(root) for root in files.roots], "forgive": forgive}
    try:
        limits = (str(SECONDS), str(MEMORY))
        answer = parse_json(run(PROGRAM, limits, json.dumps(requested).encode(), PATIENCE, policy_of(files)))
    except (ChildError, NotReadableError) as error:
        raise SpecError([Problem(f"usd-core gave no answer: {error}", location=here, code="I109")]) from None
    if "error" in answer:
        raise SpecError([_refused(answer, here)])
    files.read.update({Path(path): digest for path, digest in answer["read"].items()})
    return _stage(answer, files.shown, lines_of(content))


def policy_of(files: Files) -> Policy:
    """The reader opens files itself: those below the roots. A package is unpacked into the reader's own folder."""
    read = tuple(map(str, files.roots)) or ("/",)
    if files.path.suffix.lower() == ".usdz":
        return Policy("scratch", read, writes=True)
    return Policy("files", read)


def _refused(answer: Mapping[str, Any], here: Location) -> Problem:
    message, found = str(answer["error"]), str(answer["found"]) or None
    hint = None
    if "not installed" in message:
        hint = "pip install 'simspec-physics[usd]'"
    elif answer["missing"]:
        hint = "simspec import --repair missing-files: missing files are left out"
    elif message.startswith("leaves"):
        hint = "--allow-outside allows it"
    line, column = answer.get("at", (1, 1))
    return Problem(message, location=Location(here.file, line, max(1, column)), found=found, hint=hint, code="I109")


def _stage(answer: Mapping[str, Any], shown: str, lines: Mapping[str, int]) -> StageRead:
    here = Location(shown, 1, 1)
    top: dict[str, Any] = {"path": "/", "type": "stage", "schemas": [], "used": True, "relationships": {}}
    authored = [name for name, said in answer["authored"].items() if said]
    top["attributes"] = {name: {"type": "double", "value": answer[_UNITS[name]]} for name in authored}
    top["attributes"]["upAxis"] = {"type": "token", "value": answer["up"]}
    root = PrimRead(top, here, None)
    root.take()
    prims: dict[str, PrimRead] = {}
    for record in answer["prims"]:
        parent = prims.get(record["path"].rpartition("/")[0], root)
        place = Location(shown, lines[record["path"]], 1) if record["path"] in lines else parent.location
        prim = PrimRead(record, place, parent)
        prims[prim.where] = prim
        parent._children.append(prim)
    units = [root.real(name, answer[_UNITS[name]]) for name in _UNITS]
    if not all(unit > 0.0 and math.isfinite(unit) for unit in units):
        raise root.error("units should be above 0", found=str(units), code="I102")
    up = root.token("upAxis", answer["up"])
    if up not in ("Y", "Z"):
        raise root.error("not an axis that is up", found=up[:20], allowed="Y, Z", code="I101")
    return StageRead(root, prims, units[0], units[1], up, answer["default"], answer["missing"])


_UNITS: Final = {"metersPerUnit": "metres", "kilogramsPerUnit": "kilograms"}

# Properties of joints by schemas beyond UsdPhysics: armature, dampers and springs, dry friction, largest velocity and effort,
# where an axis stands and how fast it moves, which joint follows another, and which joints move one body one after the other.
# Angular numbers of ``newton:`` and ``physx:`` attributes are per degree, of ``mjc:`` attributes per radian: so their schemas.

ARMATURES: Final = ("physxJoint:armature", "newton:armature", "mjc:armature")
"""Attributes for the armature of a joint, the first of which holds."""
UNBOUNDED: Final = 1e9
"""Degrees or units of length beyond which a limit is none: files write the largest number that they have."""
COMPLIANCE: Final = "how hard a constraint is: those of the spec are rigid"
LARGEST_GAP: Final = 1e-3
"""rad or m that a joint may stand away from where the file says: in single precision, written by hand."""


@dataclass(frozen=True, slots=True)
class Units:
    """Of one axis, in SI: ``inertia`` (kg m² or kg), ``position`` (rad per degree, or m) and ``effort`` (N m or N)."""

    inertia: float
    position: float
    effort: float
    turns: bool


AXIS: Final = "PhysxJointAxisAPI"
"""A schema of words for one axis of a joint, which go before those of the joint."""


def armature(prim: PrimRead, units: Units, instance: str = "") -> float:
    """The armature (kg m² or kg), 0 where none is stated. ``instance``: the name of the axis in its attributes."""
    return first_of(prim, dict.fromkeys((f"physxJointAxis:{instance}:armature", *ARMATURES), units.inertia))


def _axis_friction(prim: PrimRead, instance: str) -> str:
    """The attribute of an axis for dry friction, where one number is that of rest and of motion; "" where none is said. Two
    numbers are lost."""
    prim.instances(AXIS)
    rest, motion = (f"physxJointAxis:{instance}:{word}FrictionEffort" for word in ("static", "dynamic"))
    if prim.real(rest, 0.0) == prim.real(motion, 0.0):
        return motion if prim.has(motion) else ""
    for name in (rest, motion):
        prim.lose(name, "dry friction is one number")
    return ""


def passive(prim: PrimRead, data: dict[str, Any], units: Units, degrees: bool, instance: str) -> None:
    """Add to a joint's words the damper, the spring and the dry friction that act in addition to its drive. ``degrees``: the
    unit of the rest position of ``mjc:springref``."""
    speed = units.effort if units.turns else units.effort / units.position
    damping = first_of(prim, {"newton:damping": units.effort / units.position, "mjc:damping": speed})
    if damping > 0.0:
        data["damping"] = plain(float(data.get("damping", 0.0)) + damping)
    names = (_axis_friction(prim, instance), "newton:friction", "mjc:frictionloss")
    friction = first_of(prim, dict.fromkeys(names, units.effort))
    if friction > 0.0 and "dry_friction" not in data:
        data["dry_friction"] = plain(friction)
    stiffness = prim.real("mjc:stiffness", 0.0) * speed
    if stiffness <= 0.0:
        return
    if "spring" in data:
        prim.lose("mjc:stiffness", "a joint has one spring, which is its drive")
        return
    rest = prim.real("mjc:springref", 0.0)
    rest *= math.pi / 180.0 if units.turns and degrees else 1.0 if units.turns else units.position
    data["spring"] = {"stiffness": plain(stiffness), **({"rest": plain(rest)} if rest else {})}


def first_of(prim: PrimRead, names: dict[str, float]) -> float:
    """The number (in SI) of the first of several attributes that the file has, all of which are taken; ``names``: with their
    units. The later ones are deprecated words of the same."""
    said = [prim.real(name, 0.0) * unit for name, unit in names.items() if prim.has(name)]
    return said[0] if said else 0.0


def of_ball(prim: PrimRead, data: dict[str, Any], units: Units) -> None:
    """Add to a ball's words its damper and armature. A ball has no dry friction and no largest velocity in the language."""
    damping = first_of(prim, {"newton:damping": units.effort / units.position, "mjc:damping": units.effort})
    if damping > 0.0 and "damping" not in data:
        data["damping"] = plain(damping)
    if said := armature(prim, units):
        data["armature"] = plain(said)
    for name in ("newton:friction", "mjc:frictionloss", "mjc:stiffness", "newton:velocityLimit"):
        none = math.inf if name == "newton:velocityLimit" else 0.0
        if prim.real(name, none, infinite=True) != none:
            prim.lose(name, "only hinges and slides have it in the language")


def ratings(prim: PrimRead, limits: dict[str, Any], units: Units, si: bool, instance: str) -> None:
    """Add to a joint's limits the largest velocity (rad/s or m/s) and effort (N m or N), where they have none. ``si``: whether
    the stage is in metres and kilograms, as the text of a URDF is."""
    axis = f"physxJointAxis:{instance}:maxJointVelocity"
    for name in (axis, "newton:velocityLimit", "physxJoint:maxJointVelocity"):
        most = prim.real(name, math.inf, infinite=True)
        if "velocity" not in limits and 0.0 < most < UNBOUNDED:
            limits["velocity"] = plain(most * units.position)
    effort = prim.real("urdf:limit:effort", 0.0) if si else 0.0
    if effort > 0.0 and "effort" not in limits:
        limits["effort"] = plain(effort)
    _actuator_range(prim, limits, units)


def _actuator_range(prim: PrimRead, limits: dict[str, Any], units: Units) -> None:
    """The range of the actuators' force at a joint, which is its largest effort where it is symmetric."""
    low, high = (f"mjc:actuatorfrcrange:{end}" for end in ("min", "max"))
    if not (prim.has(low) or prim.has(high)):
        return
    least, most = (prim.real(name, 0.0) * units.effort for name in (low, high))
    limited = prim.token("mjc:actuatorfrclimited", "auto")
    if limited == "false" or (limited == "auto" and least == most == 0.0):
        return
    if least == -most and most > 0.0:
        limits.setdefault("effort", plain(most))
        return
    for name in (low, high):
        prim.lose(name, "limits of effort are symmetric in the language")


@dataclass(frozen=True, slots=True)
class UsdMimic:
    """A joint that follows another: its position is ``ratio`` times that of the joint at the path ``leader``, plus ``offset``
    (rad or m)."""

    leader: str
    ratio: float
    offset: float


def mimic(prim: PrimRead, units: Units) -> UsdMimic | None:
    """The leader of a joint of one axis; None where it follows nothing, or in a way that the language does not have, which is
    then lost. ``newton:`` says q = c0 + c1 q', ``physx``  q + g q' + c = 0."""
    if prim.applies("NewtonMimicAPI") or prim.has("newton:mimicCoef1"):
        targets = prim.targets("newton:mimicJoint")
        offset, ratio = prim.real("newton:mimicCoef0", 0.0), prim.real("newton:mimicCoef1", 1.0)
        if not prim.flag("newton:mimicEnabled", True) or not targets:
            return None
        for name in ("mjc:coef2", "mjc:coef3", "mjc:coef4"):
            if prim.real(name, 0.0):
                prim.lose(name, "joints follow others linearly in the language")
        if ratio == 0.0:
            prim.lose("newton:mimicCoef1", "a joint that follows with a ratio of 0 stands still")
            return None
        return UsdMimic(targets[0], ratio, offset * units.position)
    for instance in prim.instances("PhysxMimicJointAPI"):
        start = f"physxMimicJoint:{instance}:"
        targets = prim.targets(f"{start}referenceJoint")
        gearing, offset = prim.real(f"{start}gearing", 1.0), prim.real(f"{start}offset", 0.0)
        prim.token(f"{start}referenceJointAxis")
        for name in ("naturalFrequency", "dampingRatio"):
            prim.lose(f"{start}{name}", COMPLIANCE, INFORMATION)
        if targets and gearing:
            return UsdMimic(targets[0], -gearing, -offset * units.position)
    return None


def velocity(prim: PrimRead, instance: str, units: Units) -> float:
    """How fast an axis moves initially (rad/s or m/s), 0 where it is not said."""
    return first_of(prim, dict.fromkeys(_names(instance, "velocity"), units.position))


def check_position(prim: PrimRead, instance: str, units: Units, start: float) -> None:
    """Tell where the file says that an axis stands elsewhere than its bodies do (``start``, rad or m)."""
    for name in _names(instance, "position"):
        if prim.has(name) and abs(prim.real(name, 0.0) * units.position - start) > LARGEST_GAP:
            prim.lose(name, "the bodies stand elsewhere, and a joint begins where they do")


def _names(instance: str, word: str) -> tuple[str, str]:
    return f"state:{instance}:physics:{word}", f"newton:{instance}:{word}"
