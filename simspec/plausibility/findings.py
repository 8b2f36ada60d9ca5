"""The rules of plausibility and what they find."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from simspec.errors import Location


class Grade(StrEnum):
    """How certain it is that a finding is a mistake of the model."""

    WARNING = "warning"
    """No sound model has it, or hardly any; ``simspec check --strict`` fails for it."""
    NOTE = "note"
    """Sound models have it too; the figure is worth knowing."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule: its ``limit`` in words, ``why`` it matters and the way out (``hint``). ``warned``: ``simspec check`` prints
    the same among the warnings of the spec, and does not repeat it."""

    code: str
    limit: str
    why: str
    hint: str
    warned: bool = False


RULES: Final[Mapping[str, Rule]] = MappingProxyType(
    {
        rule.code: rule
        for rule in (
            Rule(
                "mass-outside",
                "the centre of mass is outside the convex hull of the link's shapes by more than 5 % of the link's size",
                "no distribution of mass within the shapes has its centre there, so that the link swings and tips otherwise "
                "than its shapes suggest",
                "the centre of mass is given in the link's frame: check its place, or the place and the unit of the shapes",
            ),
            Rule(
                "inertia-too-large",
                "along some axis the second moment of the mass about its centre exceeds m·a·b by more than the factor 2.25; "
                "a, b: how far the shapes reach from it along both directions, at least 5 % of their size",
                "no distribution of mass within the shapes has such an inertia; the link turns too slowly for a given torque",
                "compute the inertia from the shapes (leave it out where a mass is given), or check its unit: kg m²",
            ),
            Rule(
                "inertia-too-small",
                "a principal moment is below a tenth of the homogeneous solid's of the same mass and shapes",
                "the mass would be concentrated near its centre; the link turns too fast for a given torque, and explicit "
                "damping and control become unstable",
                "compute the inertia from the shapes (leave it out where a mass is given), or check its unit: kg m²",
            ),
            Rule(
                "density-high",
                "the mass over the volume of all shapes exceeds 22,590 kg/m³, the density of osmium",
                "no material is so dense: the mass is in another unit, or the shapes are",
                "masses are in kg, lengths in m",
            ),
            Rule(
                "density-low",
                "the mass over the volume of the shapes is below 20 kg/m³, and a closed shell of plastic (1,000 kg/m³) around "
                "that volume would be thinner than 0.3 mm; or it is below 1.2 kg/m³, the density of air",
                "the link is lighter than foam: the mass is a placeholder or in another unit, or the shapes are",
                "masses are in kg, lengths in m",
            ),
            Rule(
                "mass-tiny",
                "the mass that a joint moves, with all that hangs on it, is less than 0.1 g",
                "contact and joint limits of so light a body are stiff for solvers: it jitters, or tunnels",
                "a mass of some grams, or a fixed joint",
            ),
            Rule(
                "mass-ratio",
                "the masses of two bodies that a joint joins differ by more than 1,000 times",
                "iterative solvers of engines in maximal coordinates converge slowly there; reduced coordinates do not",
                "a larger mass for the light body, or a fixed joint",
            ),
            Rule(
                "size",
                "the shapes of a moving link span more than 10 m, or those of a whole model less than 1 cm or more than 20 m",
                "a mesh in millimetres is taken for metres, or scaled twice",
                "the scale or unit of the mesh",
            ),
            Rule(
                "no-collision",
                "a moving body with mass and visual shapes has no collision shape",
                "nothing can touch it: it passes through other bodies and the ground",
                "collision shapes; collision: true on a visual one",
            ),
            Rule(
                "shapes-apart",
                "the bounding boxes of a body's collision and visual shapes share less than a quarter of the smaller one, or "
                "their sizes differ by more than 2.5 times",
                "contact happens where nothing is seen",
                "the origin and the scale of both",
            ),
            Rule(
                "shape-twice",
                "two collision shapes of one body have the same kind, size and place",
                "contact is computed twice, and a mass from density counts twice",
                "remove one of them",
            ),
            Rule(
                "detached",
                "the shapes of a body and of its carrier are separated by more than 2 cm and 5 % of the model's size",
                "the body floats in mid-air: the origin of the joint is missing, or in another frame",
                "the origin of the joint, in the parent's frame",
            ),
            Rule(
                "axis-apart",
                "the axis of a hinge passes the shapes that it turns by more than 5 cm and a quarter of their size; a warning "
                "where it passes those of the parent by as much",
                "the body swings about a line in the air",
                "the origin of the joint, in the parent's frame",
            ),
            Rule(
                "overlap-start",
                "two shapes that may touch overlap at the initial positions by more than a tenth of the smaller one's inner "
                "radius",
                "contact separates them in the first step: the model jumps or jams",
                "the place of one of them; or contact: exclude",
                warned=True,
            ),
            Rule(
                "overlap-neighbours",
                "a body and what carries it overlap at the initial positions by more than a quarter of the smaller one's "
                "inner radius, where the parent is fixed to the world by more than 2 mm",
                "simspec excludes contact between neighbours; a loader that does not has them push each other away, above all "
                "where the parent is fixed to the world",
                "smaller shapes near the joint, or an exclusion in the file",
            ),
            Rule(
                "pass-through",
                "within its range a joint moves a body into what carries it, deeper than initially by more than a tenth of "
                "the body's size",
                "contact between neighbours is excluded: the body passes through without a sign",
                "the direction of the axis, the place of the joint, or its limits",
            ),
            Rule(
                "self-collision",
                "bodies of one model that may touch, and do not initially, overlap within the ranges of the joints by more "
                "than 1 mm and a twentieth of the smaller one's inner radius",
                "the joint cannot reach all of its range, and a planner that knows its limits alone runs into it",
                "narrower limits; or contact: exclude where the shapes are only rough",
            ),
            Rule(
                "axis-length",
                "the length of a joint's axis differs from 1 by more than a thousandth",
                "simspec and most loaders normalise it; one that does not scales positions and efforts by it",
                "an axis of length 1",
            ),
            Rule(
                "limits-equal",
                "lower and upper limit of a joint are equal",
                "the joint cannot move; some loaders take equal limits for none",
                "a fixed joint, or the range that is meant",
            ),
            Rule(
                "limits-narrow",
                "a hinge turns by less than 4°",
                "a range in radians was taken for degrees: 57 times too narrow",
                "deg or rad behind the numbers; the angle unit of the file",
            ),
            Rule(
                "limits-wide",
                "a hinge turns by more than two full turns, and not a whole number of half turns (a warning where a limit is "
                "more than two turns from zero), or a slide moves by more than 5 m and 1.5 times the model's size",
                "a range in degrees was taken for radians, or one in millimetres for metres",
                "deg or rad, mm or m behind the numbers; the unit of the file",
            ),
            Rule(
                "rating-zero",
                "the effort or velocity rating of a joint is 0",
                "simspec takes it as unknown; an engine or controller that obeys it can never move the joint",
                "the rating of the motor",
            ),
            Rule(
                "mesh-names",
                "different collision meshes have the same file name in different folders",
                "a loader that names meshes by their file name gives two links the same mesh",
                "another name for one of the files",
            ),
            Rule(
                "mesh-surface",
                "a collision mesh is open, or wound inwards",
                "it encloses no volume: a loader that computes mass, or inside and outside, from it fails or guesses",
                "close the mesh, or turn its faces outwards",
            ),
            Rule(
                "mesh-concave",
                "the convex hull of a collision mesh has more than 1.5 times its volume",
                "the hull is what touches: drawers, cups and gaps are filled",
                "as: pieces; or several convex shapes",
                warned=True,
            ),
        )
    }
)


@dataclass(frozen=True, slots=True)
class PlausibilityFinding:
    """One finding of a rule. ``element``: the body, joint or pair it is about; ``message`` with the figure in words;
    ``value`` in ``unit``; ``path``: dotted, in the world; ``severity``: how far beyond the limit, to sort by (1: at it);
    ``positions``: of joints (rad, m), at which it was found, where it depends on them."""

    rule: str
    grade: Grade
    element: str
    message: str
    value: float
    unit: str
    severity: float
    path: str = ""
    location: Location | None = None
    positions: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the ranges of the joints were searched: ``positions`` looked at of ``planned`` ones, of ``joints`` that move;
    ``left_out``: joints that were not moved, and why; ``cut_short``: why not all was looked at."""

    positions: int = 0
    planned: int = 0
    joints: int = 0
    left_out: Mapping[str, str] = field(default_factory=dict)
    cut_short: str = ""


@dataclass(frozen=True)
class Plausibility:
    """The findings of all rules about one model; they are sorted by rule in the order of :data:`RULES`, the worst first.
    ``skipped``: rules that could not be applied, and why."""

    findings: tuple[PlausibilityFinding, ...] = ()
    sampling: Sampling = Sampling()
    skipped: Mapping[str, str] = field(default_factory=dict)

    @property
    def warnings(self) -> tuple[PlausibilityFinding, ...]:
        """Findings that ``--strict`` fails for."""
        return tuple(finding for finding in self.findings if finding.grade is Grade.WARNING)

    @property
    def notes(self) -> tuple[PlausibilityFinding, ...]:
        """All others."""
        return tuple(finding for finding in self.findings if finding.grade is Grade.NOTE)


def ordered(findings: Sequence[PlausibilityFinding]) -> tuple[PlausibilityFinding, ...]:
    """Findings by rule, warnings before notes, the worst of each first."""
    place = {code: index for index, code in enumerate(RULES)}
    grades = list(Grade)
    return tuple(
        sorted(
            findings,
            key=lambda finding: (place[finding.rule], grades.index(finding.grade), -finding.severity, finding.path),
        )
    )
