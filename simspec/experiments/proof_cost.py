"""What the proofs of a sweep will cost, from what proofs in the store took."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median

from simspec.errors import SpecError
from simspec.experiments.index import Index
from simspec.experiments.plan import Cell
from simspec.experiments.store import Store
from simspec.stored import StoredCertificate, read_as

MOST_READ = 200
"""Certificates of a store that are read for it, the last ones by name."""


@dataclass(frozen=True, slots=True)
class ProofsLeft:
    """Proofs that are still to be made: ``models`` by engine, at most (sets of values that differ in what no proof looks at
    share one); ``seconds`` of wall time of one by engine, None where none was made."""

    models: Mapping[str, int]
    seconds: Mapping[str, float | None]

    @property
    def count(self) -> int:
        """Models of all engines."""
        return sum(self.models.values())

    @property
    def total(self) -> float | None:
        """Seconds of all, one after the other; None where those of an engine are not known."""
        total = 0.0
        for engine, count in self.models.items():
            each = self.seconds[engine]
            if count and each is None:
                return None
            total += count * (each or 0.0)
        return total


def proof_seconds(index: Index, store: Store | None) -> dict[str, float]:
    """By engine, the median wall time of the proofs in a store; those that cannot be read are made anew by the sweep."""
    seconds: dict[str, list[float]] = {}
    for key in sorted(set(index.certificates.values()))[-MOST_READ:] if store is not None else ():
        text = store.certificate_text(key) if store is not None else None
        try:
            certificate = None if text is None else read_as(StoredCertificate, text, key)
        except SpecError:
            continue
        for engine, proof in certificate.engines.items() if certificate is not None else ():
            seconds.setdefault(engine, []).append(proof.seconds)
    return {engine: median(took) for engine, took in seconds.items()}


def proofs_left(cells: Iterable[Cell], index: Index, seconds: Mapping[str, float]) -> ProofsLeft:
    """The proofs that cells still need; ``seconds``: of one, by engine, where that is known."""
    proven: set[tuple[str, str]] = set()
    needed: set[tuple[str, str]] = set()
    engines: dict[str, None] = {}
    for cell in cells:
        engines[cell.engine] = None
        (proven if cell.key in index.certificates else needed).add((cell.engine, repr(cell.overrides)))
    left = needed - proven
    models = {engine: sum(model[0] == engine for model in left) for engine in engines}
    return ProofsLeft(models, {engine: seconds.get(engine) for engine in engines})
