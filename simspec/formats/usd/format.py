"""The format ``usd``: one file with the schemas of UsdPhysics, ``world.usda``, or under a requested name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar, Final

from simspec.formats.kit.contract import Format, Loss, LossFate, PlainFiles, losses
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
from simspec.world.damping import without_implicit_damping
from simspec.world.kinematics import trees
from simspec.world.types import World

KINDS: Final = ("sphere", "box", "cylinder", "capsule", "plane", "mesh")
"""Kinds of shapes that the schemas have."""
_CUSTOM: Final = "simspec writes a custom attribute, which no other tool reads"
_SOLVER: Final = "UsdPhysics leaves it to the solver"
_COMBINED: Final = "Each shape has the number of its material; UsdPhysics does not define how two are combined"


def _between(world: World) -> Refinement | None:
    """Joints of one body that are not at one place, at right angles, slides before turns."""
    names = separate_carriers(world)
    return Refinement(Level.APPROXIMATE, "simspec inserts bodies of 1e-9 kg between the joints") if names else None


SUPPORT: Final[Table] = {
    **classes.file_language("UsdPhysics"),
    **exactly(Feature.LIMIT_POSITION, Feature.FRICTION, Feature.RESTITUTION),
    **shape_kinds("UsdPhysics", KINDS),
    Feature.SHAPE_MESH: exact("simspec writes a mesh with the approximation convexHull"),
    Feature.SHAPE_VISUAL: exact("Invisible shapes have the purpose guide"),
    Feature.INERTIA_FULL: exact("simspec writes principal moments and axes"),
    Feature.INERTIA_SINGULAR: approximate("UsdPhysics treats a moment of zero as unset: simspec writes 1e-12 kg m²"),
    Feature.MASSLESS: approximate("UsdPhysics treats a mass of zero as unset: simspec writes 1e-9 kg"),
    Feature.JOINT_SEVERAL: exact(
        "simspec writes one joint with several axes: translations before rotations, in the order X, Y, Z",
        refine=_between,
    ),
    Feature.DAMPING: exact("simspec writes the damping of a drive"),
    Feature.SPRING: exact("simspec writes the stiffness of a drive"),
    **for_each(
        via_api(_CUSTOM),
        *(*features.LIMIT_RATINGS, Feature.BALL_DAMPING, Feature.DRY_FRICTION, Feature.ARMATURE, Feature.BALL_SPRING),
        Feature.TIMESTEP,
    ),
    **for_each(never("UsdPhysics has no contact margins"), *features.MARGINS),
    Feature.SURFACE_VELOCITY: never("simspec writes no surface velocities into USD"),
    Feature.BALL_ARMATURE: never("simspec writes no armature of ball joints into USD"),
    Feature.GRAVITY_SCALE: never("simspec writes no gravity scale of single bodies into USD"),
    Feature.FREE_DAMPING: never("simspec writes no damping of free joints into USD"),
    Feature.FREE_ARMATURE: never("simspec writes no armature of free joints into USD"),
    Feature.INITIAL_POSITION: exact("The poses of bodies represent it"),
    Feature.INITIAL_VELOCITY: via_api(f"UsdPhysics has velocities of free bodies. Those of joints: {_CUSTOM}"),
    **for_each(approximate(_COMBINED), Feature.FRICTION_PAIRS, Feature.RESTITUTION_PAIRS),
    **for_each(
        never(_SOLVER),
        *(Feature.RESTITUTION_THRESHOLD, *features.HARDNESSES, Feature.IMPACT_FRICTION, *features.COUPLED_CONTACT),
        *features.CONES,
    ),
    **for_each(never("UsdPhysics has sliding friction only"), *features.MOMENTS),
    Feature.PASSING_PAIRS: never("UsdPhysics has no collision filters for pairs of materials"),
    Feature.COLLISION_GROUPS: exact("simspec writes collision groups"),
    Feature.EXCLUDED_PAIRS: exact("simspec writes filtered pairs"),
    Feature.KINEMATIC: approximate("simspec writes a kinematic body without its motion"),
    Feature.TOUCHING_PAIRS: exact("simspec writes joints with collisions enabled"),
    Feature.CONTROL: approximate(
        "simspec writes drives with the gains, effort limits and initial target of pd. Trajectories, gravity "
        "compensation, implicit laws, laws that act every few steps and laws without gains are lost"
    ),
    Feature.CONTROL_NATIVE: approximate("simspec writes drives with gains, effort limits and the initial target"),
    Feature.CONSTRAINT_LOOP: exact("simspec writes joints that are excluded from the articulation"),
    Feature.CONSTRAINT_COUPLING: never("UsdPhysics has no couplings of joints"),
    Feature.BALL_LIMIT: never("A cone of UsdPhysics limits the direction of an axis, not the rotation about it"),
    Feature.FRAME: exact("simspec writes an Xform within that of the body"),
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
            yield Loss(feature.value, LossFate.APPROXIMATED, _COMBINED, differing)


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

    def plain(self, world: World) -> PlainFiles:
        """``world.usda``."""
        world = without_implicit_damping(world)
        tree = stage_of(world, nested=self.profile == "nested")
        return PlainFiles(self.write(tree), losses(world, SUPPORT, more_losses(world)))

    def parts(self, world: types.World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``world.usda``."""
        return {WORLD: world.bodies}

    def single(self, plain: PlainFiles, suffix: str) -> bytes:
        """The stage as text, as a binary file, or as a package. Raises SpecError where usd-core is needed and not installed."""
        return encoded(plain.files[WORLD], suffix)

    def read(self, folder: Path) -> str:
        """The text of ``world.usda`` in ``folder``: its meaning is the importer's matter. Raises FileNotFoundError, and
        ValueError, which names the file, where it is no text of USD."""
        content = (folder / WORLD).read_text(encoding="utf-8")
        if not content.startswith("#usda "):
            raise ValueError(f"{WORLD}:1: a text of USD begins with #usda")
        return content
