"""The format ``usd``: one file with the schemas of UsdPhysics, ``world.usda``, or under a requested name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar, Final

from simspec.formats.kit.contract import Format, Loss, LossFate, Plain, losses
from simspec.formats.usd.joints import carriers, separate_carriers, several
from simspec.formats.usd.stage import model_of, stage_of
from simspec.formats.usd.text import BINARY, PACKAGE, TEXT, UsdStage, encoded, text
from simspec.support import classes, features
from simspec.support.declarations import (
    Level,
    Refinement,
    Table,
    approximate,
    exact,
    exactly,
    for_each,
    never,
    shape_kinds,
    via_api,
)
from simspec.support.features import Feature
from simspec.world import types
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import trees
from simspec.world.types import World

KINDS: Final = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
"""Kinds of shapes that the schemas have."""
_CUSTOM: Final = "in an attribute of simspec's own, which no other tool reads"
_SOLVER: Final = "UsdPhysics leaves it to the solver"
_COMBINED: Final = "each shape has its own material's number; UsdPhysics does not say how two are combined"


def _between(world: World) -> Refinement | None:
    """Joints of one body that are not at one place, at right angles, slides before turns."""
    names = separate_carriers(world)
    return Refinement(Level.APPROXIMATE, "bodies of 1e-9 kg stand between the joints") if names else None


SUPPORT: Final[Table] = {
    **classes.file_language("UsdPhysics"),
    **exactly(Feature.LIMIT_POSITION, Feature.FRICTION, Feature.RESTITUTION),
    **shape_kinds("UsdPhysics", KINDS),
    Feature.SHAPE_MESH: exact("as a mesh with the approximation convexHull"),
    Feature.SHAPE_VISUAL: exact("shapes that are not drawn have the purpose guide"),
    Feature.INERTIA_FULL: exact("principal moments and axes"),
    Feature.INERTIA_SINGULAR: approximate("a moment of zero means that none is said: 1e-12 kg m² stands for it"),
    Feature.MASSLESS: approximate("a mass of zero means that none is said: 1e-9 kg stands for it"),
    Feature.JOINT_SEVERAL: exact(
        "as one joint with several axes: slides before turns, turns in the order X, Y, Z", refine=_between
    ),
    Feature.DAMPING: exact("as the damping of a drive"),
    Feature.SPRING: exact("as the stiffness of a drive"),
    **for_each(
        via_api(_CUSTOM),
        *(*features.LIMIT_RATINGS, Feature.BALL_DAMPING, Feature.DRY_FRICTION, Feature.ARMATURE, Feature.BALL_SPRING),
        Feature.TIMESTEP,
    ),
    **for_each(never("simspec writes no margins into USD: UsdPhysics has none"), *features.MARGINS),
    Feature.SURFACE_VELOCITY: never("simspec writes no surfaces that move by themselves into USD"),
    Feature.BALL_ARMATURE: never("simspec writes no armature of balls into USD"),
    Feature.GRAVITY_SCALE: never("simspec writes no weights of single bodies into USD"),
    Feature.FREE_DAMPING: never("simspec writes no damping of free bodies into USD"),
    Feature.FREE_ARMATURE: never("simspec writes no armature of free bodies into USD"),
    Feature.INITIAL_POSITION: exact("by the places of the bodies"),
    Feature.INITIAL_VELOCITY: via_api("bodies that move freely have theirs; those of joints are " + _CUSTOM),
    **for_each(approximate(_COMBINED), Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
    **for_each(
        never(_SOLVER),
        *(Feature.RESTITUTION_THRESHOLD, *features.HARDNESSES, Feature.IMPACT_FRICTION, *features.COUPLED_CONTACT),
        *features.CONES,
    ),
    **for_each(never("UsdPhysics has sliding friction only"), *features.MOMENTS),
    Feature.PASSING_PAIRS: never("UsdPhysics does not say it of pairs of materials"),
    Feature.COLLISION_GROUPS: exact("as collision groups"),
    Feature.EXCLUDED_PAIRS: exact("as filtered pairs"),
    Feature.KINEMATIC: approximate("as a kinematic body, without its motion"),
    Feature.TOUCHING_PAIRS: exact("as joints with collisions"),
    Feature.CONTROL: approximate(
        "drives with the gains and effort limits of pd and the target at the start; without the trajectory, gravity "
        "compensation, implicit laws, laws that act every few steps, and laws without gains"
    ),
    Feature.CONTROL_NATIVE: approximate("drives with gains, effort limits and the target at the start"),
    Feature.CONSTRAINT_LOOP: exact("as joints that are excluded from the articulation"),
    Feature.CONSTRAINT_COUPLING: never("UsdPhysics has no couplings of joints"),
    Feature.BALL_LIMIT: never("a cone of UsdPhysics limits where an axis points, and lets the body turn about it"),
    Feature.FRAME: exact("an Xform in that of its body"),
}
"""The support of each feature in plain USD."""


def more_losses(world: World) -> Iterator[Loss]:
    """Losses of this world beyond the table: laws of pairs that are not the language's rule of the two materials."""
    left_out = carriers(several(world))
    differing = tuple(
        f"bodies.{body.name}"
        for bodies in trees(world).values()
        if model_of(bodies) is None
        for body in bodies
        if "/" in body.name or ("." in body.name and body.name not in left_out)
    )
    if differing:
        yield Loss(
            "body.name",
            LossFate.APPROXIMATED,
            "another name: bodies of several models are in one tree, or stand between joints",
            differing,
        )
    laws = {pair.first: pair for pair in world.contact.pairs if pair.first == pair.second}
    for feature, quantity in ((Feature.FRICTION_PAIRS, "friction"), (Feature.RESTITUTION_PAIRS, "restitution")):
        differing = tuple(
            f"contact.pairs.{law.first}.{law.second}.{quantity}"
            for law in meeting_laws(world).values()
            if law.first != law.second
            and getattr(law, quantity) != min(getattr(laws[law.first], quantity), getattr(laws[law.second], quantity))
        )
        if differing:
            yield Loss(feature.value, LossFate.APPROXIMATED, "each shape has its own material's number", differing)


WORLD: Final = "world.usda"


class Usd(Format):
    """USD with UsdPhysics, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "usd"
    SUPPORT: ClassVar[Table] = SUPPORT
    DRIVES: ClassVar[bool] = True
    PROFILES: ClassVar[tuple[str, ...]] = ("flat", "nested")
    SINGLE: ClassVar[tuple[str, ...]] = (TEXT, BINARY, PACKAGE)

    def write(self, tree: UsdStage) -> dict[str, str]:
        """``world.usda``. Raises ValueError for numbers that are not finite, or too large for single precision."""
        return {WORLD: text(tree)}

    def __init__(self, profile: str = PROFILES[0]):
        self.profile = profile
        """flat: bodies are siblings; nested: within their parents."""

    def in_profile(self, name: str) -> Format:
        """The format in this layout. Raises SpecError for a name that is not of ``PROFILES``."""
        return Usd(name) if name in self.PROFILES else super().in_profile(name)

    def plain(self, world: World) -> Plain:
        """``world.usda``."""
        tree = stage_of(world, nested=self.profile == "nested")
        return Plain(self.write(tree), losses(world, SUPPORT, more_losses(world)))

    def parts(self, world: types.World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``world.usda``."""
        return {WORLD: world.bodies}

    def single(self, plain: Plain, suffix: str) -> bytes:
        """The stage as text, as a binary file, or as a package. Raises SpecError where usd-core is needed and not installed."""
        return encoded(plain.files[WORLD], suffix)

    def read(self, folder: Path) -> str:
        """The text of ``world.usda`` in ``folder``: its meaning is the importer's matter. Raises FileNotFoundError, and
        ValueError, which names the file, where it is no text of USD."""
        content = (folder / WORLD).read_text(encoding="utf-8")
        if not content.startswith("#usda "):
            raise ValueError(f"{WORLD}:1: a text of USD begins with #usda")
        return content
