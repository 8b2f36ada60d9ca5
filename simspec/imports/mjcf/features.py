"""What a compiled model has and a spec does not say, by name: found in the compiled numbers, so that what a class of defaults
gives is seen like what an element states, and what has no effect is not called a loss."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from simspec.imports.elements import HARDNESS_HINT, HOW_HARD, Element
from simspec.language.foreign import Severity

_LISTED: Final = "a distance at which contact is listed, without a force: nothing is felt of it"
_AT_CENTRE: Final = (
    "of a free body the language has it at the centre of mass, and the file at another point, the origin of its frame"
)
_PHYSICS, _INFORMATION = Severity.PHYSICS, Severity.INFORMATION


class Feature(NamedTuple):
    """``attributes``: where files say it, as ``tag/attribute``; ``*`` for an element itself."""

    attributes: str
    severity: Severity
    reason: str
    hint: str = ""


FEATURES: Final = {
    "body.mocap": Feature(
        "body/mocap",
        _INFORMATION,
        "a body that a program moves: here it stands where it is",
    ),
    "body.mocap_start": Feature(
        "body/pos body/quat",
        _INFORMATION,
        "a body that a program moves begins where the loop that holds it is closed: joints of the other body begin at their "
        "limits, since the reference is beyond them",
    ),
    "body.gravcomp": Feature(
        "body/gravcomp joint/actuatorgravcomp",
        _PHYSICS,
        "actuators with a largest effort take the weight away: in the language it is away, whatever they do",
    ),
    "joint.start": Feature(
        "joint/range joint/ref",
        _INFORMATION,
        "the reference position is beyond the limits: a run begins at the nearest limit",
        "position: of the joint, in the spec, or positions: where the model is placed",
    ),
    "joint.margin": Feature(
        "joint/margin",
        _INFORMATION,
        "the distance at which a limit begins to act is not in the language: limits are hard",
    ),
    "joint.effort_range": Feature(
        "joint/actuatorfrcrange joint/actuatorfrclimited", _PHYSICS, "limits of effort are symmetric in the language"
    ),
    "joint.free_damping": Feature("joint/damping freejoint/*", _PHYSICS, _AT_CENTRE),
    "joint.free_spring": Feature("joint/stiffness freejoint/*", _PHYSICS, "free bodies have no springs"),
    "joint.dry_friction": Feature("joint/frictionloss", _PHYSICS, "only hinges and slides have dry friction"),
    "joint.armature": Feature("joint/armature freejoint/*", _PHYSICS, _AT_CENTRE),
    "joint.ball_limit": Feature("joint/range joint/limited", _PHYSICS, "a ball whose largest angle is 0 is fixed"),
    "joint.polynomial": Feature(
        "joint/stiffness joint/damping", _PHYSICS, "springs and dampers are linear in the language"
    ),
    "joint.plastic": Feature("joint/springyield", _PHYSICS, "springs that yield are not in the language"),
    "geom.kind": Feature(
        "geom/type geom/mesh geom/hfield",
        _PHYSICS,
        "a collision shape of a kind that the language does not have yet; a height field that may move, or is too large",
    ),
    "geom.appearance": Feature(
        "geom/type geom/mesh geom/hfield",
        Severity.APPEARANCE,
        "a visual shape of a kind that the language does not have yet",
    ),
    "geom.hull": Feature(
        "geom/mesh",
        _PHYSICS,
        "a hull of more vertices than the language has: it is the hull of those that change it most",
    ),
    "geom.drawn_hull": Feature("geom/mesh", Severity.APPEARANCE, "a drawn mesh of more vertices than the language has"),
    "option.timestep": Feature(
        "option/timestep",
        _INFORMATION,
        "dampers and springs are explicit in time in the spec, and would diverge at the file's timestep: it has a shorter one",
        "less damping or stiffness, or more armature, allows a longer one",
    ),
    "geom.margin": Feature(
        "geom/margin geom/gap", _PHYSICS, "a gap beyond the margin: in the language no margin is negative"
    ),
    "pair.margin": Feature(
        "pair/margin pair/gap", _PHYSICS, "a gap beyond the margin: in the language no margin is negative"
    ),
    "geom.gap": Feature("geom/gap", _INFORMATION, _LISTED),
    "pair.gap": Feature("pair/gap", _INFORMATION, _LISTED),
    "geom.fluid": Feature(
        "geom/fluidshape geom/fluidcoef",
        _PHYSICS,
        "forces of a fluid on single shapes, with added mass and lift: the language has those on boxes of the bodies' inertia",
    ),
    "geom.adhesion": Feature("geom/adhesion pair/adhesion", _PHYSICS, "adhesion is not in the language"),
    "contact.softness": Feature(
        "geom/solref geom/solimp geom/solmix pair/solref pair/solimp pair/solreffriction",
        _INFORMATION,
        HOW_HARD,
        HARDNESS_HINT,
    ),
    "contact.pair": Feature(
        "pair/*", _PHYSICS, "the file lets two shapes touch whose bodies are joined rigidly; the language does not"
    ),
    "contact.uneven": Feature("pair/*", _PHYSICS, "friction of a pair is the same in every direction in the language"),
    "contact.materials": Feature(
        "geom/friction geom/condim geom/priority geom/contype geom/conaffinity",
        _PHYSICS,
        "more kinds of surfaces than a spec may have materials",
    ),
    "contact.scenario": Feature(
        "option/cone geom/condim geom/priority",
        _INFORMATION,
        "how different surfaces combine, and the friction cone, are said by the scenario that places a model",
        "contact: {combine: max} in the scenario",
    ),
    "contact.override": Feature(
        "option/o_margin option/o_solref option/o_solimp option/o_friction flag/override",
        _PHYSICS,
        "one law for all contacts, instead of their own",
    ),
    "option.fluid": Feature(
        "option/density option/viscosity option/wind",
        _PHYSICS,
        "of bodies that are welded, one of them without inertia of its own, the fluid acts on the box of all together",
    ),
    "equality": Feature(
        "equality/*",
        _PHYSICS,
        "the language has joints that follow one other linearly, and loops that the reference configuration closes",
    ),
    "equality.softness": Feature(
        "equality/solref equality/solimp", _INFORMATION, "how hard constraints are: those of the spec are rigid"
    ),
    "equality.inactive": Feature("equality/*", _INFORMATION, "a constraint that is switched off is left out"),
    "tendon": Feature(
        "tendon/*",
        _PHYSICS,
        "the language has springs, dampers and limits along sums of joint positions; not along ways through space, nor "
        "friction, inertia, springs with a slack range and limits that the sum begins beyond",
    ),
    "tendon.passive": Feature("tendon/*", _INFORMATION, "a tendon that exerts no force by itself"),
    "actuator": Feature(
        "actuator/*",
        _INFORMATION,
        "an actuator of no single hinge or slide, with a state, or with limits of its force that are not symmetric",
        "control: {robot: {joints: [JOINT], kp: KP, kd: KD, effort_limit: LIMIT}}",
    ),
    "actuator.inertia": Feature("actuator/*", _PHYSICS, "inertia and damping of actuators are not carried"),
    "key": Feature(
        "key/*",
        _INFORMATION,
        "a named state is carried where the file has one tree; joints beyond a limit are at the limit",
        "positions: where the model is placed",
    ),
    "key.driven": Feature(
        "key/time key/ctrl key/act key/mpos key/mquat",
        _INFORMATION,
        "states of actuators, inputs of those that a spec has not, and what a program moves are no part of a named state",
    ),
    "plugin": Feature("plugin/*", _PHYSICS, "plugins are programs: what they do is not known"),
}
"""Every feature. An attribute of one that the model does not have is carried: it says what holds anyway."""


@dataclass
class Features:
    """Those that a model has, each with the elements that have it."""

    having: dict[str, list[Element]] = field(default_factory=dict)

    carried: list[Element] = field(default_factory=list)
    """Elements of sections (constraints) that the spec says."""
    states: set[str] = field(default_factory=set)
    """Names of the keys that the spec has as states."""
    commanded: set[str] = field(default_factory=set)
    """Names of those of them whose inputs are commands of the spec's."""
    actuators: set[int] = field(default_factory=set)
    """Numbers of the actuators that the spec has."""
    framed: set[int] = field(default_factory=set)
    """The ``id`` of the elements of sites that the spec has as frames."""
    hints: dict[tuple[str, int], str] = field(default_factory=dict)
    """Ways out for single elements, by the feature and the ``id`` of the element."""
    _known: set[tuple[str, int]] = field(default_factory=set)
    """What :attr:`having` holds, by the ``id`` of the element: it is asked for each attribute of each element."""

    def add(self, name: str, element: Element, hint: str = "") -> None:
        """Say that an element has a feature; ``hint``: the way out for this one."""
        if hint:
            self.hints[name, id(element)] = hint
        if name not in FEATURES:
            raise KeyError(name)
        elements = self.having.setdefault(name, [])
        if not self.has(name, element):
            self._known.add((name, id(element)))
            elements.append(element)

    def carry(self, element: Element) -> None:
        """Say that an element of a section is carried, but for what its features say of attributes."""
        self.carried.append(element)

    def has(self, name: str, element: Element) -> bool:
        """Whether an element has a feature."""
        return (name, id(element)) in self._known
