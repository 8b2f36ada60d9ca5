"""Contact in MJCF: the law of a pair as MuJoCo's numbers, the surfaces of materials, and explicit pairs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

from simspec.dialects.kit.sidecar import Target
from simspec.dialects.mujoco.sidecar import COULOMB, MATERIAL_CLASS, VISUAL_CLASS
from simspec.errors import Problem, UnsupportedError
from simspec.formats.mjcf.bodies import dimensions, margins_of
from simspec.formats.mjcf.tree import Attributes, MjcfDefault, MjcfPair, Value
from simspec.world.contact_pairs import meeting_laws, shape_pairs, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, Hardness, Pair, PairContact, Surface, World

SPRING_IMPEDANCE = 1e-4
"""MuJoCo's smallest. A contact of impedance d feels (1 − d) of the load in addition to its reference: at 1e-4 it is a
spring-damper that gives way to all of it, whatever the number of points that share it."""
NATIVE_HARDNESS: Attributes = (("solref", (0.02, 1.0)), ("solimp", (0.9, 0.95, 0.001, 0.5, 2.0)))
"""MuJoCo's own defaults."""
COMPLIANT = ("time-constant", "stiffness")

ROUNDING = 1e-9
"""Decades by which a needed ``impratio`` may be above a power of ten that counts as enough."""
CUSHION_START = 0.01
CUSHION_SHAPE = (0.5, 2.0)
"""Impedance of a frictional contact at first touch, and midpoint and power of its rise over ``friction_cushion`` metres.
A soft first touch carries what the associated cone adds to the normal force: a slider floats in it instead of hopping. A
rise that begins flat (power 2) keeps fast sliders calm: of μ = 1, pushed at 1.6 times the limit, 0.5 % of friction is missing,
at power 1 2.4 % (measured, 1 ms)."""


def is_coulomb(target: Target) -> bool:
    """Whether the setting ``friction`` selects Coulomb's law."""
    return target.settings["friction"] == COULOMB


def _impedance(value: float) -> tuple[float, ...]:
    return (value, value, 0.001, 0.5, 2.0)


def reference(error_reduction: float, restitution: float, timestep: float) -> tuple[float, float]:
    """``solref`` of the law v' = −e v + β r / dt over one step."""
    return (0.0 - error_reduction / (timestep * timestep), 0.0 - (1.0 + restitution) / timestep)


# --- hardness: a row each -----------------------------------------------------------------------------------------


def _common(world: World, target: Target, surface: Surface, inverse_mass: float) -> Attributes:
    """Under friction with a cushion, which what bounces cannot have: a step that ends in it would take most of the bounce."""
    beta, dt = float(target.settings["contact_error_reduction"]), world.physics.timestep
    solref = reference(beta, surface.restitution or 0.0, dt)
    impedance, cushion = (float(target.settings[name]) for name in ("contact_impedance", "friction_cushion"))
    solimp = _impedance(impedance)
    elliptic = world.contact.friction_cone == "elliptic"
    if surface.friction and not surface.restitution and cushion and elliptic and not is_coulomb(target):
        solimp = (CUSHION_START, impedance, cushion, *CUSHION_SHAPE)
    return (("solref", solref), ("solimp", solimp))


def _time_constant(world: World, target: Target, surface: Surface, inverse_mass: float) -> Attributes:
    """MuJoCo's own form: r̈ = −(2/T) v − r/(T ζ)²; its two numbers are T and ζ."""
    spring = _of(surface)
    solref = (spring.time_constant, spring.damping_ratio)
    return (("solref", solref), ("solimp", _impedance(SPRING_IMPEDANCE)))


def _stiffness(world: World, target: Target, surface: Surface, inverse_mass: float) -> Attributes:
    """MuJoCo's numbers are accelerations: forces times the inverse masses of both bodies; the depth under a load is
    (1 − d) times the load over them."""
    spring, yielding = _of(surface), inverse_mass * (1.0 - SPRING_IMPEDANCE)
    solref = (0.0 - spring.stiffness * yielding, 0.0 - spring.damping * yielding)
    return (("solref", solref), ("solimp", _impedance(SPRING_IMPEDANCE)))


def _native(world: World, target: Target, surface: Surface, inverse_mass: float) -> Attributes:
    return NATIVE_HARDNESS


HARDNESS: Mapping[str, Callable[[World, Target, Surface, float], Attributes]] = {
    "common": _common,
    "time-constant": _time_constant,
    "stiffness": _stiffness,
    "native": _native,
}
"""``solref`` and ``solimp`` by kind of hardness, from (world, target, surface, sum of both inverse masses in 1/kg)."""


def _of(surface: Surface) -> Hardness:
    return surface.hardness or Hardness()


def contact_reference(world: World, target: Target, surface: Surface, inverse_mass: float = 1.0) -> Attributes:
    """``solref`` and ``solimp`` of a surface; ``inverse_mass`` (1/kg) of both bodies together."""
    return HARDNESS[_of(surface).kind](world, target, surface, inverse_mass)


def limit_reference(world: World, target: Target) -> Attributes:
    """How hard position limits are; a stop is inelastic."""
    return (
        ("solreflimit", reference(float(target.settings["limit_error_reduction"]), 0.0, world.physics.timestep)),
        ("solimplimit", _impedance(float(target.settings["limit_impedance"]))),
    )


def joint_references(world: World, target: Target) -> Attributes:
    """How hard position limits and dry friction are; dry friction has no spring."""
    return (*limit_reference(world, target), *dry_reference(world, target))


def dry_reference(world: World, target: Target) -> Attributes:
    """How hard dry friction is; it has no spring."""
    return (
        ("solreffriction", reference(0.0, 0.0, world.physics.timestep)),
        ("solimpfriction", _impedance(float(target.settings["dry_friction_impedance"]))),
    )


def equality_reference(world: World) -> Attributes:
    """Parameters that take back the whole violation in a step, as hard as MuJoCo allows; the engine's module makes it exact."""
    dt = world.physics.timestep
    return (("solref", reference(1.0, 0.0, dt)), ("solimp", _impedance(HARDEST)))


HARDEST = 0.9999
"""The largest impedance that MuJoCo takes."""


def friction_reference(world: World, target: Target, kind: str) -> tuple[float, float]:
    """``solreffriction`` of explicit pairs: slip is taken back at ``friction_rate``, without a spring; under coulomb at once.

    MuJoCo divides by the impedance, and what comes of it is a share d of that: near one, d changes nothing; for a spring
    the rate is multiplied by d beforehand. On a spring nothing hops, and slip is taken back as fast as is stable. A native
    contact has no reference of its own for friction.
    """
    if kind == "native":
        return (0.0, 0.0)
    if is_coulomb(target):
        return (0.0, -1.0 / world.physics.timestep)
    fastest = float(target.settings["friction_share"]) / world.physics.timestep
    if kind in COMPLIANT:
        return (0.0, 0.0 - fastest * SPRING_IMPEDANCE)
    return (0.0, 0.0 - min(float(target.settings["friction_rate"]), fastest))


def friction_hardness(world: World, target: Target) -> float:
    """``impratio``: the one number for the world; larger where friction rests on springs, or has moments."""
    low, high = float(target.settings["impratio"]), float(target.settings["high_impratio"])
    laws = meeting_laws(world).values()
    if any(law.friction and law.hardness.kind in COMPLIANT for law in laws):
        return high
    return max(low, min(high, moment_hardness(world.physics.timestep, laws)))


def moment_hardness(timestep: float, laws: Iterable[PairContact]) -> float:
    """The ``impratio`` that friction moments need: MuJoCo makes them softer than friction by (μ/c)². At 0.5 ms a ball of μ = 1
    stops spinning and rolling within 2 % from 0.01 (μ/c)² on, for c of 0.1 to 1 mm, and 10 to 50 % late at a tenth of it; at
    2 ms a hundredth of that is enough (measured). A power of ten, so that files say a plain number.
    """
    arms = [
        coefficient / law.friction
        for law in laws
        for coefficient in (law.torsional_friction, law.rolling_friction)
        if coefficient and law.friction
    ]
    if not arms:
        return 0.0
    decades = math.log10(0.01 * (5e-4 / (min(arms) * timestep)) ** 2)
    return 10.0 ** math.ceil(decades - ROUNDING)


# --- numbers of shapes and of pairs -------------------------------------------------------------------------------


def pair_defaults(world: World, target: Target) -> Attributes:
    """Attributes of explicit pairs that state nothing else."""
    return (
        ("condim", 3),
        ("margin", 0.0),
        ("gap", 0.0),
        *contact_reference(world, target, Surface()),
        ("solreffriction", friction_reference(world, target, "common")),
    )


def default_classes(world: World, target: Target) -> tuple[MjcfDefault, ...]:
    """One class for each material, and the class of shapes that only show."""
    rows = [MjcfDefault(VISUAL_CLASS, (("geom", (("contype", 0), ("conaffinity", 0), ("group", 2))),))]
    for material in world.contact.materials:
        number = target.plan.numbers[material.name, 0]
        friction = (number.friction or 0.0, number.torsional_friction or 0.0, number.rolling_friction or 0.0)
        surface: Attributes = (("condim", dimensions(number)), ("friction", friction))
        # no cushion: without an explicit pair's own reference for friction it does not help
        solref = contact_reference(world, target, dataclasses.replace(number, friction=0.0))
        rows.append(MjcfDefault(MATERIAL_CLASS + material.name, (("geom", (*surface, *solref)),)))
    return tuple(rows)


def pairs_needed(world: World, target: Target) -> dict[Pair, str]:
    """Pairs of materials whose law numbers of shapes cannot carry, each with the reason."""
    found = {}
    for pair, law in meeting_laws(world).items():
        if pair in target.plan.missed:
            found[pair] = "which the numbers of their materials' shapes cannot give together"
        elif law.hardness.kind == "stiffness":
            found[pair] = "which have a stiffness that depends on the masses of both bodies"
        elif law.margin is not None:
            found[pair] = "which have a margin of their own"
        elif pair in target.pair_settings:
            found[pair] = "which have settings of their own"
        elif is_coulomb(target):
            continue  # friction has a reference of its own in every contact
        elif law.friction and law.hardness.kind in COMPLIANT:
            found[pair] = "which are compliant and have friction, whose rate is not the spring's"
        elif law.friction and law.restitution and world.contact.friction_cone == "elliptic":
            found[pair] = "which have both restitution and friction, and would bounce sideways"
    return found


def explicit_pairs(world: World, target: Target) -> tuple[tuple[MjcfPair, ...], bool]:
    """Rows of explicit pairs, and whether all that should be listed are.

    Listed are every two shapes that may touch and whose law needs it (``pairs_needed``), and every two with friction: they
    alone have a reference of their own for friction (not under the pyramid, where MuJoCo ignores it, nor where hardness
    is native, nor under coulomb). The latter only up to ``explicit_pairs_limit``. Raises UnsupportedError when even the
    former are more. A plan that names its explicit pairs has these alone.
    """
    laws = meeting_laws(world)
    needed = pairs_needed(world, target)
    elliptic = world.contact.friction_cone == "elliptic" and not is_coulomb(target)
    wished = [
        pair
        for pair, law in laws.items()
        if pair in needed or (elliptic and law.friction and law.hardness.kind != "native")
    ]
    counts: dict[str, int] = {}
    for body in world.bodies:
        for shape in solid_shapes(body):
            counts[shape.material] = counts.get(shape.material, 0) + 1
    chosen = target.plan.explicit
    if chosen is not None:
        return _rows(world, target, laws, [pair for pair in laws if pair in chosen]), set(wished) <= set(chosen)
    limit = int(target.settings["explicit_pairs_limit"])

    def too_many(pairs: list[Pair]) -> bool:
        # an upper bound that needs no look at single bodies, so that a pile of thousands costs nothing
        return sum(counts[first] * counts[second] / (1 + (first == second)) for first, second in pairs) > limit

    if not too_many(wished):
        return _rows(world, target, laws, wished), True
    if too_many(list(needed)):
        raise UnsupportedError([_too_many_pairs(pair, why, limit) for pair, why in needed.items()])
    return _rows(world, target, laws, list(needed)), False


def _rows(world: World, target: Target, laws: Mapping[Pair, PairContact], pairs: list[Pair]) -> tuple[MjcfPair, ...]:
    shared, margins = dict(pair_defaults(world, target)), margins_of(world)
    inverse = inverse_masses(world)
    rows = []
    for pair in pairs:
        law, local_target = laws[pair], target.between(pair)
        surface = Surface(
            law.friction, law.torsional_friction, law.rolling_friction, law.restitution, hardness=law.hardness
        )
        for first, second in shape_pairs(world, [pair]):
            weight = inverse[first] + inverse[second] if law.hardness.kind == "stiffness" else 1.0
            values: dict[str, Value] = {
                "condim": dimensions(surface),
                "friction": (
                    *(law.friction, law.friction),
                    *(law.torsional_friction, law.rolling_friction, law.rolling_friction),
                ),
                **dict(contact_reference(world, local_target, surface, weight)),
                "solreffriction": friction_reference(world, local_target, law.hardness.kind),
            }
            if margin := margins[first] + margins[second] if law.margin is None else law.margin:
                values["margin"] = margin
            local = tuple((name, value) for name, value in values.items() if shared.get(name) != value)
            rows.append(MjcfPair(first, second, local))
    return tuple(rows)


def inverse_masses(world: World) -> dict[str, float]:
    """MuJoCo's inverse mass (1/kg) of each collision shape's body: 1/m of a free one, 0 of what cannot move.

    NaN for bodies of mechanisms, whose inverse mass depends on all their tree.
    """
    static = rigid_groups(world)
    parents = {body.joint.parent for body in world.bodies}

    def of(body: Body) -> float:
        if static[body.name] == "world":
            return 0.0
        single = body.joint.kind == "free" and body.name not in parents
        return 1.0 / body.inertial.mass if single else float("nan")

    return {shape.name: of(body) for body in world.bodies for shape in solid_shapes(body)}


def _too_many_pairs(pair: Pair, why: str, limit: int) -> Problem:
    return Problem(
        f"in MuJoCo every two shapes of these materials, {why}, need an explicit pair, and here all that do may be more than "
        f"explicit_pairs_limit ({limit})",
        f"contact.pairs.{pair[0]}.{pair[1]}",
        hint="give the material of the many bodies a law of its own friction, restitution and hardness alone that is the "
        "larger of both materials' values, or raise engines.mujoco.settings.explicit_pairs_limit",
        code="E104",
    )


# Unsupported laws of materials that meet, and unsupported combinations of settings.

MOST_PER_STEP = 4.0
"""Of k dt²/m + 2 c dt/m: where the semi-implicit step of an oscillator, v' = v − dt (k r + c v)/m, r' = r + dt v', stops being
stable (its characteristic polynomial at −1)."""


def _faults(world: World, law: PairContact) -> Iterator[tuple[str, str, str]]:
    """The faults of a law: quantity, message, hint."""
    pyramid = world.contact.friction_cone != "elliptic"
    hardness, dt = law.hardness, world.physics.timestep
    if pyramid:
        for name in ("torsional_friction", "rolling_friction"):
            if getattr(law, name):
                yield name, f"under MuJoCo's pyramid {name.replace('_', ' ')} is wrong (measured)", _ELLIPTIC
        if law.friction and hardness.kind in COMPLIANT:
            yield "hardness", "under MuJoCo's pyramid friction of compliant contact does not stick", _ELLIPTIC
    if law.restitution and hardness.kind != "common":
        yield (
            "restitution",
            f"MuJoCo does not support restitution with {hardness.kind} hardness",
            "set the restitution to zero",
        )
    if hardness.kind == "time-constant" and hardness.time_constant < 2.0 * dt:
        yield (
            "hardness",
            "MuJoCo raises a time constant below two timesteps to two",
            f"at least {2.0 * dt:g} s, or a smaller timestep",
        )


_ELLIPTIC = "use friction_cone: elliptic"


def check_friction(target: Target) -> list[Problem]:
    """Settings that are incompatible with Coulomb's law."""
    if not is_coulomb(target) or target.settings["solver"] != "pgs":
        return []
    return [
        Problem(
            "MuJoCo's solver pgs does not converge to Coulomb's law: a slider is off by 47 % and hops 133 mm (measured)",
            "engines.mujoco.settings.friction",
            found="friction: coulomb with solver: pgs",
            hint="solver: newton or cg",
            code="E104",
        )
    ]


def check_laws(world: World) -> list[Problem]:
    """Unsupported laws of materials that meet."""
    laws = meeting_laws(world)
    problems = [
        Problem(message, f"contact.pairs.{first}.{second}.{name}", hint=hint, code="E104")
        for (first, second), law in laws.items()
        for name, message, hint in _faults(world, law)
    ]
    springs = {pair: law.hardness for pair, law in laws.items() if law.hardness.kind == "stiffness"}
    inverse = inverse_masses(world) if springs else {}
    dt = world.physics.timestep
    for pair, spring in springs.items():
        weights = {inverse[name] + inverse[two]: (name, two) for name, two in shape_pairs(world, [pair])}
        for weight, shapes in weights.items():
            if math.isnan(weight):
                message = (
                    "MuJoCo's stiffness is known between free single bodies and what cannot move, not for mechanisms"
                )
                hint = "use {time_constant, damping_ratio}"
            elif spring.stiffness * weight * dt * dt + 2.0 * spring.damping * weight * dt >= MOST_PER_STEP:
                message = (
                    "the spring is too hard for the timestep and these masses: MuJoCo's steps would amplify its motion"
                )
                hint = "a smaller timestep, less stiffness or less damping"
            else:
                continue
            problems.append(
                Problem(
                    message,
                    f"contact.pairs.{pair[0]}.{pair[1]}.hardness",
                    found=" with ".join(shapes),
                    hint=hint,
                    code="E104",
                )
            )
            break
    return problems
