"""Whether a certificate that lies on a disk proves a world: judged from its figures, never from what it says of itself.

It may have been edited, it may be of another world, of another simspec, or of a time when less was compared. Every statement
that an edit can change is compared with the world's demands: the parts (``proof/expected.py``), how often each was compared,
how closely at least, and each figure of contact behind the checks of level L5.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engine_name, engines
from simspec.plugins import simspec_version
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import PRECISIONS, TEXT_TOLERANCE, Demands
from simspec.proof.comparator import FIELD, HULL, SINGLE
from simspec.proof.contact.run import contact_checks, figure_faults
from simspec.proof.contact.scope import scope
from simspec.proof.convergence import ORDER, WITHIN
from simspec.proof.expected import (
    NO_FRAMES,
    NOT_REQUESTED,
    TITLES,
    not_checked_parts,
    of_files_alone,
    realised,
    title,
    unreadable,
)
from simspec.proof.expected import judge as judge_checks
from simspec.proof.limits import TOLERANCE as STOPS_TOLERANCE
from simspec.proof.motion import MOTION
from simspec.proof.probes import FEW_STATES, LARGE, STATES
from simspec.proof.verify import prepare
from simspec.world.canonical import derived, sha256
from simspec.world.inertia import lumped
from simspec.world.kinematics import layout_of, rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import World

# The comparisons of levels L6 and L7 that a world's proof must contain, how often and how closely: planned anew from the
# world, as ``simspec verify`` plans it. It takes the oracle's motion, 0.1 to 7 s of processor time for the library's worlds.


@derived
def demanded(world: World, precision: str, order: int = 0) -> Demands:
    """By level and name the checks of L6 and L7 that a proof of ``world`` has, in numbers of ``precision``, by a method of
    integration of ``order`` (0: semi-implicit Euler)."""
    demands = (plan.demands() for plan in prepare(world, ("L6", "L7"), precision, order).plans.values())
    return dict(ChainMap(*demands))


READ_BACK = ("L1", "L2", "L3", "L4")
COARSEST: Mapping[str, float] = {
    "L0": TEXT_TOLERANCE,
    **dict.fromkeys(READ_BACK, PRECISIONS[DOUBLE].model),
    "L5": 1.0,  # in units of each figure's own tolerance
    "L6": STOPS_TOLERANCE,
    "L7": 1e-2,
}
"""The largest tolerance that a check of each level may have; of what is read back from an engine in single precision, that of
its numbers. L6 and L7: relative; the tolerance of each check follows from the world (``proof/demanded.py``), which is worked
out for a judgement that is ``thorough``."""


def judge(certificate: Certificate, world: World) -> list[str]:
    """Why ``certificate`` does not prove that its engines hold ``world``, a line each; [] when it does. Thorough."""
    if certificate.world_sha256 != sha256(world):
        return ["it belongs to another world"]
    faults = []
    if certificate.simspec != simspec_version():
        faults.append(f"it was made by simspec {certificate.simspec}, this is {simspec_version()}")
    if not certificate.engines:
        faults.append("it contains no engine")
    for name, proof in certificate.engines.items():
        faults += [f"{name}: {line}" for line in judge_proof(name, proof, world, thorough=True)]
    return faults


def judge_proof(engine: str, proof: EngineProof, world: World, thorough: bool = False) -> list[str]:
    """The same for one engine, by name or label. The parts listed as not checked must be those that it declares to lack.
    ``thorough``: also whether the checks of L6 and L7 are as many and as close as the world demands, which takes the
    oracle's motion (:func:`simspec.proof.judge.demanded`)."""
    known = engines().get(engine_name(engine))
    lacking = {} if known is None else not_checked_parts(world, known, proof.not_compared)
    alone = known is not None and bool(known.FILES_ALONE) and proof.files_alone
    if alone:
        lacking = of_files_alone(proof.not_compared, proof.not_checked["L1"])
    faults = judge_checks(world, proof.checks, proof.not_compared, lacking, proof.precision)
    faults += [proof.verdict] if alone else []
    faults += [
        f"{name} is listed as not checked ({why}), which {engine} does not declare"
        for name, why in proof.not_checked.items()
        if name in TITLES and name not in lacking
    ]
    faults += [
        f"{name} is neither checked nor listed as not checked" for name in lacking if name not in proof.not_checked
    ]
    numbers = DOUBLE if known is None else known.PRECISION
    if proof.precision != numbers:
        faults.append(f"it was held to {proof.precision} precision, {engine} computes in {numbers}")
    for check in proof.checks:
        coarsest = COARSEST.get(check.level)
        if check.level in READ_BACK:
            coarsest = PRECISIONS[numbers].model
        if coarsest is not None and known is not None and (check.level, check.name) == ("L4", HULL):
            coarsest = max(coarsest, known.HULL_PRECISION)
        if coarsest is not None and (check.level, check.name) == ("L4", FIELD):
            coarsest = max(coarsest, SINGLE)
        if (check.level, check.name) == ORDER:
            coarsest = WITHIN
        if coarsest is None:
            faults.append(f"unknown level {check.level!r}")
        elif check.tolerance > coarsest:
            faults.append(f"{title(check.level, check.name)}: a tolerance of {check.tolerance:g}, at most {coarsest:g}")
    twice = [(check.level, check.name) for check in proof.checks]
    faults += sorted({f"{title(*part)} is duplicated" for part in twice if twice.count(part) > 1})
    faults += _counts(proof, world, lacking)
    if known is not None:
        faults += _declarations(engine, known, proof, world)
    faults += _contact(engine, known, proof, world, lacking)
    if thorough and not proof.files_alone:
        faults += _motions(proof, world, known)
    return faults


def _declarations(engine: str, known: type[Engine], proof: EngineProof, world: World) -> Iterator[str]:
    """Approximations and fields that are not readable back, which follow from the world and what the engine declares."""
    given = realised(world, engine, proof.version)
    if given.refused:
        yield f"this world cannot be compiled for it: {given.refused}"
    else:
        yield from _compared("the accepted approximation", proof.approximations, given.approximations)
    fields = {name: why for name, why in proof.not_checked.items() if name not in TITLES}
    wanted = {} if proof.files_alone else unreadable(world, known.UNREADABLE)
    if "frames" in fields and world.frames:
        wanted["frames"] = NO_FRAMES  # whether an engine has some is seen by reading it back
    yield from _compared("the field that is not readable back", fields, wanted)


def _compared(what: str, given: Mapping[str, str], wanted: Mapping[str, str]) -> Iterator[str]:
    for name in sorted(given.keys() | wanted.keys()):
        if name not in given:
            yield f"{what} {name!r} is missing"
        elif name not in wanted:
            yield f"{what} {name!r} ({given[name]}), which this world and the engine do not have"
        elif given[name] != wanted[name]:
            yield f"{what} {name!r}: {given[name]!r}, should be {wanted[name]!r}"


def _motions(proof: EngineProof, world: World, known: type[Engine] | None) -> Iterator[str]:
    """Checks of L6 and L7 that are fewer or coarser than the world demands, or that it does not have."""
    method = None if known is None else known.method(world)
    demands = demanded(world, proof.precision, method.order if method else 0)
    made = {(check.level, check.name) for check in proof.checks}
    if ORDER in demands and MOTION in made and ORDER not in made:
        yield f"{title(*ORDER)}: no comparison was made, of a method of another order"
    for check in proof.checks:
        if check.level not in ("L6", "L7") or not check.passed:
            continue
        named, demand = title(check.level, check.name), demands.get((check.level, check.name))
        if demand is None:
            yield f"{named}: this world has no such check"
            continue
        if not demand.least <= check.count or (check.count > demand.count and demand.least == demand.count):
            yield f"{named}: {check.count} comparisons, this world has {demand.count}"
        if check.tolerance > demand.tolerance * (1.0 + 1e-9):
            yield f"{named}: a tolerance of {check.tolerance:g}, at most {demand.tolerance:g}"


def _counts(proof: EngineProof, world: World, lacking: Mapping[str, str]) -> Iterator[str]:
    """Checks that compared less than this world has."""
    groups = rigid_groups(world)
    moving = sum(groups[body.name] != "world" for body in world.bodies)
    states = STATES if layout_of(world).nv <= LARGE else FEW_STATES
    least = {(level, "bodies"): 1 for level in ("L0", "L1")}
    # engines have one inertia of a gathered rigid group, and a body without mass has no centre
    whole = lumped(world)
    weighed = [
        whole.get(body.name, body.inertial)
        for body in world.bodies
        if groups[body.name] == body.name or (groups[body.name] != "world" and body.name not in whole)
    ]
    weights = {
        "mass": len(weighed),
        "inertia tensor": len(weighed),
        "centre of mass": sum(inertial.mass > 0 for inertial in weighed),
    }
    least |= {(level, name): count for level in ("L0", "L1") for name, count in weights.items()}
    least |= {(level, name): len(world.bodies) for level in ("L0", "L2") for name in ("joint type", "parent")}
    least |= {("L2", name): states for name in ("pose, position", "pose, orientation", "body velocity")}
    solid = [SHAPES[shape.kind] for body in world.bodies for shape in body.shapes if shape.collision]
    least |= {(level, HULL): sum(kind.points for kind in solid) for level in ("L0", "L4")}
    least |= {(level, FIELD): sum(kind.grid for kind in solid) for level in ("L0", "L4")}
    if moving:
        least |= {("L3", name): states for name in ("mass matrix", "bias force", "gravity force")}
    counts = {(check.level, check.name): check.count for check in proof.checks}
    for part, count in least.items():
        if part[0] in lacking or title(*part) in lacking:
            continue
        if count and counts.get(part, 0) < count:
            yield f"{title(*part)}: {counts.get(part, 0)} comparisons, this world has {count}"


def _contact(
    engine: str, known: type[Engine] | None, proof: EngineProof, world: World, lacking: Mapping[str, str]
) -> Iterator[str]:
    """Figures that are not those of this world and engine, checks of L5 that are not those of the figures, and what is said of
    which kinds of contact were measured."""
    compared = not ("L5" in proof.not_compared or proof.files_alone)
    kinds = scope(world, (figure.probe for figure in proof.contact)) if compared else {}
    yield from _compared("the kind of contact", proof.contact_scope, kinds)
    if not compared or "L5" in lacking:
        if proof.contact:
            yield "L5: figures of contact, which is listed as not compared"
        return
    given = None if known is None else realised(world, engine, proof.version)
    between = (lambda pair: {}) if given is None else given.between
    yield from figure_faults(proof.contact, world, known, between, proof.version)
    made = {check.name: (check.count, check.worst) for check in contact_checks(proof.contact)}
    checks = {check.name: (check.count, check.worst) for check in proof.level("L5") if check.passed}
    for name in sorted(made.keys() | checks.keys()):
        if made.get(name) != checks.get(name):
            yield f"L5 {name}: does not follow from its figures"


# Which proofs of a stored certificate still hold, when other engines are verified, or files are written anew.
#
# An engine's proof is of its own files against the world and the oracle: no check compares two engines, so that one's proof
# says the same whatever becomes of another's.


@dataclass(frozen=True)
class StoredProofs:
    """The remains of the earlier certificate: ``kept``, the proofs that hold, and ``dropped``, why each other one goes,
    by engine; ``unread``: why the file is no certificate that could be read, None where it is one, or there is none."""

    kept: Mapping[str, EngineProof] = field(default_factory=dict)
    dropped: Mapping[str, str] = field(default_factory=dict)
    unread: str | None = None

    def without(self, engines: Collection[str]) -> StoredProofs:
        """The same of all other engines than those that are verified anew."""
        kept = {name: proof for name, proof in self.kept.items() if name not in engines}
        dropped = {name: why for name, why in self.dropped.items() if name not in engines}
        return StoredProofs(kept, dropped, self.unread)

    def after(self, earlier: StoredProofs) -> StoredProofs:
        """The remains of the certificate after two steps, of which this is the second."""
        dropped = {name: why for name, why in earlier.dropped.items() if name not in self.kept}
        return StoredProofs(self.kept, dropped | dict(self.dropped), earlier.unread or self.unread)

    def lines(self) -> list[str]:
        """In words, a line each: the proofs of other engines that were kept, and those that were dropped, with the reason."""
        shown = ", ".join(f"{name} {proof.version} ({proof.brief})" for name, proof in sorted(self.kept.items()))
        said = [f"kept from before, not verified now: {shown}"] if shown else []
        return [*said, f"dropped: {self.reasons}"] if self.reasons else said

    @property
    def reasons(self) -> str:
        """Why proofs were dropped, or all of them, in a line; empty where none was."""
        if self.unread is not None:
            return f"all that was there: {self.unread}"
        engines: dict[str, list[str]] = {}
        for name, why in sorted(self.dropped.items()):
            engines.setdefault(why, []).append(name)
        return "; ".join(f"{', '.join(names)}: {why}" for why, names in engines.items())

    def data(self) -> dict[str, object]:
        """The same as plain data."""
        kept = {
            name: {"version": proof.version, "valid": proof.valid, "verdict": proof.verdict}
            for name, proof in sorted(self.kept.items())
        }
        return {"kept": kept, "dropped": dict(self.dropped), "unread": self.unread}


def holding_proofs(
    earlier: Certificate, world: World, files: Mapping[str, str], oracle: str | None = None
) -> StoredProofs:
    """Which proofs of ``earlier`` hold of ``world`` and its files as they are.

    ``files``: the hash of each engine's artifacts; ``oracle``: that of the certificate which they will stand in (None: their
    own).
    A proof holds while world, simspec, oracle and the engine's own files are those that it names. It is kept with whatever
    verdict it has, but not where it claims to be valid and its figures do not prove this world (:mod:`simspec.proof.judge`).
    """
    whole = None
    if earlier.world_sha256 != sha256(world):
        whole = "of another world"
    elif earlier.simspec != simspec_version():
        whole = f"made by simspec {earlier.simspec}, this is {simspec_version()}"
    elif oracle is not None and earlier.oracle != oracle:
        whole = f"held against {earlier.oracle}, this is {oracle}"
    kept, dropped = {}, {}
    for name, proof in earlier.engines.items():
        why = whole or _stale(name, proof, world, files.get(name))
        if why is None:
            kept[name] = proof
        else:
            dropped[name] = why
    return StoredProofs(kept, dropped)


def _stale(engine: str, proof: EngineProof, world: World, files: str | None) -> str | None:
    """Why a proof of this world is none of an engine's files, whose hash is ``files``; None when it is one."""
    if files is None:
        return "its files are not there"
    if files != proof.artifacts_sha256:
        return "its files are others than were verified"
    # a proof that is not valid claims nothing
    if proof.valid and (found := judge_proof(engine, proof, world)):
        if left := [name for name, why in proof.not_compared.items() if why == NOT_REQUESTED]:
            return f"made without {', '.join(left)}, as by --quick"
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return f"not valid, as it claims to be: {found[0]}{more}"
    return None
