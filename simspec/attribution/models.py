"""Whether each side's engine holds the world that it was given, as certificates have it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from simspec.attribution.configuration import Configuration
from simspec.engines.kit.process import DEADLINE
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.judge import judge_proof
from simspec.proof.verify import LEVELS, verify
from simspec.world.canonical import sha256

MODEL = ("L0", "L1", "L2", "L3", "L4")
"""Levels that say whether the models are equal."""
MOTION = ("L6",)
"""Levels that say whether motion without contact is."""
MEASURED = "L5"
"""The level of measured contact."""
CHEAP = tuple(level for level in LEVELS if level != MEASURED)
"""Levels that are proven when somebody asks for a proof here: all but the measured contact, which takes longest."""
MOST_FAULTS = 3
"""Faults that are told of a side; the others are counted."""


@dataclass(frozen=True)
class ModelProof:
    """What is proven of one side.

    engine    by label
    source    where the proof stands ("" where there is none)
    missing   why there is none ("" where there is one)
    levels    by level the number of checks, and the largest deviation of those that compare numbers
    faults    what did not hold, or was not compared though it should be, a line each; with none the proof is valid
    contact   what must be said of contact beside the verdict (:attr:`EngineProof.contact_words`), a line each
    """

    engine: str
    source: str = ""
    missing: str = ""
    levels: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    contact: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether there is a proof, and all of it holds."""
        return not self.missing and not self.faults

    def compared(self, levels: Sequence[str]) -> tuple[int, float]:
        """Of some levels the number of checks, and the largest deviation."""
        parts = [self.levels[level] for level in levels if level in self.levels]
        return sum(count for count, _ in parts), max((worst for _, worst in parts), default=0.0)


def proof_of(side: Configuration, certificate: Certificate | None, source: str, version: str | None) -> ModelProof:
    """What a certificate proves of a side whose engine is of ``version`` (None: not known)."""
    if certificate is None:
        return ModelProof(side.engine, missing=f"{source} has no certificate" if source else "no proof was asked for")
    if certificate.world_sha256 != sha256(side.world):
        return ModelProof(side.engine, missing=f"{source} is of another world")
    proof = certificate.engines.get(side.engine)
    if proof is None:
        return ModelProof(side.engine, missing=f"{source} does not contain {side.engine}")
    if version is not None and proof.version != version:
        return ModelProof(side.engine, missing=f"{source} is of {side.engine} {proof.version}, not {version}")
    faults = judge_proof(side.engine, proof, side.world)
    if (
        MEASURED in proof.not_compared
    ):  # no question of models: what is measured of contact is left out by --verify, too
        faults = [line for line in faults if not line.startswith(f"{MEASURED} ")]
    return ModelProof(side.engine, source, "", _levels(proof), tuple(faults), tuple(proof.contact_words))


def _levels(proof: EngineProof) -> dict[str, tuple[int, float]]:
    levels = {}
    for level in LEVELS:
        checks = proof.level(level)
        if checks:
            worst = max((check.worst for check in checks if check.worst is not None), default=0.0)
            levels[level] = (len(checks), worst)
    return levels


def prove(sides: Sequence[Configuration], deadline: float = DEADLINE) -> tuple[ModelProof, ...]:
    """Prove here that each side's engine holds its world, by all levels but L5. Raises UnsupportedError."""
    certificates: dict[tuple[str, str], Certificate] = {}
    for side in sides:
        key = (sha256(side.world), side.engine)
        if key not in certificates:
            pythons = {} if side.python is None else {side.engine: side.python}
            certificates[key] = verify(side.world, [side.engine], levels=CHEAP, pythons=pythons, deadline=deadline)
    return tuple(proof_of(side, certificates[sha256(side.world), side.engine], "proven here", None) for side in sides)


def model_lines(proofs: Sequence[ModelProof], same_values: bool, hint: str = "") -> list[str]:
    """Whether models and smooth motion are equal, in two lines. ``same_values``: whether the two worlds are the same."""
    if not proofs:
        return []
    faulty = [proof for proof in proofs if proof.faults]
    if faulty:
        return [f"models: NOT proven equal: {told_faults(proof)}" for proof in faulty]
    missing = list(dict.fromkeys(proof.missing for proof in proofs if proof.missing))
    if missing:
        return [f"models: not proven to be equal ({'; '.join(missing)}){hint}"]
    sources = ", ".join(dict.fromkeys(proof.source for proof in proofs))
    checks = [proof.compared(MODEL) for proof in proofs]
    told = "equal" if same_values else "each engine holds the values that it was given"
    lines = [
        f"models: {told}: L0 to L4, {' and '.join(str(count) for count, _ in checks)} checks, largest deviation "
        f"{max(worst for _, worst in checks):.2g} ({sources})"
    ]
    smooth = [proof.compared(MOTION) for proof in proofs]
    if all(count for count, _ in smooth):
        lines.append(f"motion without contact: as the oracle's, to {max(worst for _, worst in smooth):.2g} (L6)")
    else:
        lines.append("motion without contact: L6 was not compared")
    return lines + [f"contact in {proof.engine}: {words}" for proof in proofs for words in proof.contact]


def told_faults(proof: ModelProof) -> str:
    """The faults of a proof, the first few."""
    more = f" (and {len(proof.faults) - MOST_FAULTS} more)" if len(proof.faults) > MOST_FAULTS else ""
    return f"{proof.engine}: {'; '.join(proof.faults[:MOST_FAULTS])}{more}"
