"""Which proofs of a stored certificate still hold, when other engines are verified, or files are written anew.

An engine's proof is of its own files against the world and the oracle: no check compares two engines, so that one's proof says
the same whatever becomes of another's.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version

from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.judge import judge_proof
from simspec.world.canonical import sha256
from simspec.world.types import World


@dataclass(frozen=True)
class Stored:
    """What becomes of the certificate that was there: ``kept``, the proofs that hold, and ``dropped``, why each other one goes,
    by engine; ``unread``: why the file is no certificate that could be read, None where it is one, or there is none."""

    kept: Mapping[str, EngineProof] = field(default_factory=dict)
    dropped: Mapping[str, str] = field(default_factory=dict)
    unread: str | None = None

    def without(self, engines: Collection[str]) -> Stored:
        """The same of all other engines than those that are verified anew."""
        kept = {name: proof for name, proof in self.kept.items() if name not in engines}
        dropped = {name: why for name, why in self.dropped.items() if name not in engines}
        return Stored(kept, dropped, self.unread)

    def after(self, earlier: Stored) -> Stored:
        """What became of the certificate in two steps, of which this is the second."""
        dropped = {name: why for name, why in earlier.dropped.items() if name not in self.kept}
        return Stored(self.kept, dropped | dict(self.dropped), earlier.unread or self.unread)

    def lines(self) -> list[str]:
        """In words, a line each: what was kept of other engines, what was dropped and why."""
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


def still_holding(earlier: Certificate, world: World, files: Mapping[str, str], oracle: str | None = None) -> Stored:
    """Which proofs of ``earlier`` hold of ``world`` and its files as they are.

    ``files``: the hash of each engine's artifacts; ``oracle``: that of the certificate which they will stand in (None: their
    own).
    A proof holds while world, simspec, oracle and the engine's own files are those that it names. It is kept with whatever
    verdict it has, but not where it claims to be valid and its figures do not prove this world (:mod:`simspec.proof.judge`).
    """
    whole = None
    if earlier.world_sha256 != sha256(world):
        whole = "of another world"
    elif earlier.simspec != version("simspec"):
        whole = f"made by simspec {earlier.simspec}, this is {version('simspec')}"
    elif oracle is not None and earlier.oracle != oracle:
        whole = f"held against {earlier.oracle}, this is {oracle}"
    kept, dropped = {}, {}
    for name, proof in earlier.engines.items():
        why = whole or _stale(name, proof, world, files.get(name))
        if why is None:
            kept[name] = proof
        else:
            dropped[name] = why
    return Stored(kept, dropped)


def _stale(engine: str, proof: EngineProof, world: World, files: str | None) -> str | None:
    """Why a proof of this world is none of an engine's files, whose hash is ``files``; None when it is one."""
    if files is None:
        return "its files are not there"
    if files != proof.artifacts_sha256:
        return "its files are others than were verified"
    # what says itself that it is not valid claims nothing
    if proof.valid and (found := judge_proof(engine, proof, world)):
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return f"not valid, as it claims to be: {found[0]}{more}"
    return None
