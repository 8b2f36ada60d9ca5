"""Up to which timestep models are proven, and which checks fail beyond: read from the certificates of the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.text import Text

from simspec.experiments.sweep import REFUSED
from simspec.proof.certificate import Certificate
from simspec.proof.checks import Check
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, milliseconds

MOST_SHOWN = 3
"""Checks of one model that are named; the others are counted."""


@dataclass(frozen=True)
class Proof:
    """What is known of an engine's model at a timestep: ``proven``, None where nobody verified it (``why``), and the checks
    that failed."""

    proven: bool | None
    why: str = ""
    failed: tuple[Check, ...] = ()


def certified_tables(done: Done) -> list[Shown]:
    """``certified``: up to which timestep each engine's model is proven; ``certified.checks``: what fails, and by how much."""
    proofs = _proofs(done)
    columns = ("engine", "certified up to", "first that is not", "certified again at")
    limits = table(f"{done.sweep.name}: Up to which timestep the model is proven", *columns)
    checks = table(f"{done.sweep.name}: Checks of the proof that fail", "timestep", "engine", "checks", right=(0,))
    records: list[Record] = []
    for engine in done.engines:
        own = dict(sorted(proofs.get(engine, {}).items()))
        largest, first, again = _limit(own)
        nothing = "nothing was verified" if own else "no runs"
        limits.add_row(
            engine,
            nothing if all(proof.proven is None for proof in own.values()) else _step(largest, "no timestep"),
            _step(first, "–"),
            ", ".join(map(milliseconds, again)) or "–",
        )
        records.append({"engine": engine, "limit": largest, "first_invalid": first, "later_valid": list(again)})
    below: list[Record] = []
    for engine in done.engines:
        for timestep, proof in sorted(proofs.get(engine, {}).items()):
            if proof.proven is not True:
                told = proof.why if proof.proven is None else words(proof.failed)
                checks.add_row(milliseconds(timestep), engine, Text(told))
            below += _records(timestep, engine, proof)
    if not checks.row_count:
        checks.add_row("–", "–", "none")
    checks.caption = (
        "Worst deviation and tolerance, in units of the quantity's own scale; the worst in relation to it first"
    )
    return [Shown("certified", limits, records), Shown("certified.checks", checks, below)]


def _proofs(done: Done) -> dict[str, dict[float, Proof]]:
    """By engine and timestep. Several models of one timestep (values of the sweep) count as one: proven where all are."""
    found: dict[str, dict[float, dict[str, Proof]]] = {}
    for cell, row in done.runs():
        models = found.setdefault(cell.engine, {}).setdefault(row.timestep, {})
        if row.failed is not None and row.failed.startswith(REFUSED):
            models[row.failed] = Proof(None, row.failed)
            continue
        key = done.outcome.index.certificates.get(cell.key)
        name = key or "not verified"
        if name not in models:
            models[name] = _proof(done, key)
    return {engine: {step: _all(list(own.values())) for step, own in steps.items()} for engine, steps in found.items()}


def _proof(done: Done, key: str | None) -> Proof:
    """The verdict of a certificate. Raises SpecError where it is damaged."""
    text = done.store.certificate_text(key) if key is not None else None
    if text is None:
        return Proof(None, "not verified")
    certificate = Certificate.from_json(text, f"the certificate {key}")
    return Proof(certificate.valid, "", tuple(check for _, check in certificate.failures()))


def _all(proofs: Sequence[Proof]) -> Proof:
    failed = tuple(dict.fromkeys(check for proof in proofs for check in proof.failed))
    if any(proof.proven is False for proof in proofs):
        return Proof(False, "", failed)
    return next((proof for proof in proofs if proof.proven is None), proofs[0])


def _limit(proofs: Mapping[float, Proof]) -> tuple[float | None, float | None, tuple[float, ...]]:
    """The largest timestep such that it and all smaller ones are proven, the first that is not, and later ones that are."""
    steps = sorted(proofs)
    first = next((step for step in steps if proofs[step].proven is not True), None)
    good = [step for step in steps if first is None or step < first]
    again = tuple(step for step in steps if first is not None and step > first and proofs[step].proven is True)
    return (good[-1] if good else None), first, again


def words(failed: Sequence[Check]) -> str:
    """Failed checks, the worst first, each with its figure."""
    if not failed:
        return "nothing was compared"
    ordered = sorted(failed, key=lambda check: -_excess(check))
    told = [_figure(check) for check in ordered[:MOST_SHOWN]]
    more = len(ordered) - MOST_SHOWN
    return "; ".join([*told, *([f"and {more} more"] if more > 0 else [])])


def _excess(check: Check) -> float:
    """How many times its tolerance a check's worst deviation is."""
    if check.worst is None or not check.tolerance:
        return float("inf")
    return check.worst / check.tolerance


def _figure(check: Check) -> str:
    where = f" ({check.where})" if check.where else ""
    if check.worst is None:
        detail = f": {check.detail}" if check.detail else ""
        return f"{check.level} {check.name}{where}{detail}"
    return f"{check.level} {check.name}: {number(check.worst)}, tolerance {number(check.tolerance)}{where}"


def _step(timestep: float | None, none: str) -> str:
    return none if timestep is None else milliseconds(timestep)


def _records(timestep: float, engine: str, proof: Proof) -> list[Record]:
    about = {"timestep": timestep, "engine": engine, "proven": proof.proven}
    if not proof.failed:
        return [about]
    return [
        {**about, "level": one.level, "check": one.name, "worst": one.worst, "tolerance": one.tolerance}
        | {"where": one.where}
        for one in proof.failed
    ]
