"""Whether a certificate that lies on a disk proves a world: judged from its figures, never from what it says of itself.

Somebody may have edited it, it may be of another world, of another simspec, or of a time when less was compared. What an edit
can say is held against what the world demands: the parts (``proof/expected.py``), how often each was compared, how closely at
least, and each figure of contact behind the checks of level L5.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import version

from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.precision import DOUBLE
from simspec.engines.kit.registry import engines
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import TEXT_TOLERANCE
from simspec.proof.comparator import FIELD, HULL, SINGLE
from simspec.proof.contact.run import PROBES, contact_checks, laws
from simspec.proof.expected import judge as judge_checks
from simspec.proof.expected import title
from simspec.proof.lacking import TITLES, not_checked_parts, of_files_alone
from simspec.proof.precision import PRECISIONS
from simspec.proof.probes import FEW_STATES, LARGE, STATES
from simspec.world.canonical import sha256
from simspec.world.kinematics import layout_of, rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import World

READ_BACK = ("L1", "L2", "L3", "L4")
COARSEST: Mapping[str, float] = {
    "L0": TEXT_TOLERANCE,
    **dict.fromkeys(READ_BACK, PRECISIONS[DOUBLE].model),
    "L5": 1.0,  # in units of each figure's own tolerance
    "L6": 1e-2,
    "L7": 1e-2,
}
"""The largest tolerance that a check of each level may have; of what is read back from an engine in single precision, that of
its numbers. L6 and L7: relative, the larger of 1e-9 and 100 × the round-off floor, or 2e-3 for joints held by dry friction; a
motion whose floor is above 1e-4 proves nothing."""


def judge(certificate: Certificate, world: World) -> list[str]:
    """Why ``certificate`` does not prove that its engines hold ``world``, a line each; [] when it does."""
    if certificate.world_sha256 != sha256(world):
        return ["it belongs to another world"]
    faults = []
    if certificate.simspec != version("simspec"):
        faults.append(f"it was made by simspec {certificate.simspec}, this is {version('simspec')}")
    if not certificate.engines:
        faults.append("it contains no engine")
    for name, proof in certificate.engines.items():
        faults += [f"{name}: {line}" for line in judge_proof(name, proof, world)]
    return faults


def judge_proof(engine: str, proof: EngineProof, world: World) -> list[str]:
    """The same for one engine, by name or label. What it is said not to be asked for must be what it declares to lack."""
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
        if coarsest is None:
            faults.append(f"unknown level {check.level!r}")
        elif check.tolerance > coarsest:
            faults.append(f"{title(check.level, check.name)}: a tolerance of {check.tolerance:g}, at most {coarsest:g}")
    twice = [(check.level, check.name) for check in proof.checks]
    faults += sorted({f"{title(*part)} is duplicated" for part in twice if twice.count(part) > 1})
    faults += _counts(proof, world, lacking)
    faults += _contact(proof, world)
    return faults


def _counts(proof: EngineProof, world: World, lacking: Mapping[str, str]) -> Iterator[str]:
    """Checks that compared less than this world has."""
    groups = rigid_groups(world)
    moving = sum(groups[body.name] != "world" for body in world.bodies)
    states = STATES if layout_of(world).nv <= LARGE else FEW_STATES
    least = {(level, "bodies"): 1 for level in ("L0", "L1")}
    least |= {(level, name): moving for level in ("L0", "L1") for name in ("mass", "centre of mass", "inertia tensor")}
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


def _contact(proof: EngineProof, world: World) -> Iterator[str]:
    """Probes that this world has and the certificate does not, and checks of L5 that are not those of its figures."""
    if "L5" in proof.not_compared or proof.files_alone:
        return
    there = {(figure.probe, figure.subject) for figure in proof.contact}
    for law in laws(world):
        subject = f"{law.pair.first}, {law.pair.second}"
        for name, probe in PROBES.items():
            if probe.applies(law) and (name, subject) not in there:
                yield f"L5 {name}: no figure of {subject}"
    made = {check.name: (check.count, check.worst) for check in contact_checks(proof.contact)}
    told = {check.name: (check.count, check.worst) for check in proof.level("L5") if check.passed}
    for name in sorted(made.keys() | told.keys()):
        if made.get(name) != told.get(name):
            yield f"L5 {name}: does not follow from its figures"
