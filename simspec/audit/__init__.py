"""Findings of an audit: differences between the model in an engine and the meaning of the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from simspec.errors import Location
from simspec.plausibility.findings import Plausibility


class What(StrEnum):
    """The engine's treatment of a part of a file."""

    CHANGED = "changed"
    DROPPED = "dropped"
    ADDED = "added"
    MERGED = "merged"
    """A body is part of the one that it is fixed to."""
    REFUSED = "refused"
    """The engine does not load the file, and says so."""
    DIED = "died"
    """The engine's process ended, or did not answer in time."""


class FindingSeverity(StrEnum):
    """The effect of a finding on a simulation of the file."""

    PHYSICS = "physics"
    """The engine's model is another than the file's."""
    RATING = "rating"
    """A limit of effort or velocity, which no engine enforces by itself."""
    APPEARANCE = "appearance"
    DEFAULT = "default"
    """The file leaves it open, and engines choose for themselves."""
    INFORMATION = "information"
    """Another form of the same model."""


SILENT = (FindingSeverity.PHYSICS,)
"""Severities that an audit fails for."""


@dataclass(frozen=True, slots=True)
class AuditFinding:
    """One thing: ``element`` and ``quantity`` (words of the language: ``upper``, ``joint.axis``), the place in the file,
    and both values as texts. ``size``: their difference, relative or in ``unit``, where that is a number."""

    engine: str
    what: What
    severity: FindingSeverity
    element: str
    quantity: str
    file_value: str = ""
    engine_value: str = ""
    location: Location | None = None
    why: str = ""
    size: float | None = None

    @property
    def silent(self) -> bool:
        """Whether the audit fails for it."""
        return self.severity in SILENT


@dataclass(frozen=True, slots=True)
class EngineAudit:
    """One engine's result for a file. ``how``: how it was loaded; ``version``: of the engine; ``log``: its warnings.
    ``compared``: how many values were held against the file's; ``loaded``: whether it took the file."""

    engine: str
    how: str
    loaded: bool
    findings: tuple[AuditFinding, ...] = ()
    compared: int = 0
    version: str = ""
    seconds: float = 0.0
    log: tuple[str, ...] = ()

    @property
    def silent(self) -> tuple[AuditFinding, ...]:
        """Findings that the audit fails for."""
        return tuple(finding for finding in self.findings if finding.silent)

    @property
    def died(self) -> bool:
        """Whether the engine's process did not live to answer."""
        return any(finding.what is What.DIED for finding in self.findings)


@dataclass(frozen=True, slots=True)
class CompiledProof:
    """The proof's result for the same file, compiled by simspec: ``valid`` None where it was not compiled, and ``why``."""

    engine: str
    valid: bool | None
    why: str = ""


@dataclass(frozen=True)
class FileAudit:
    """The audit of one file. ``meaning``: the model that engines were compared with; ``defects``: why simspec does not import
    the file as it is; ``losses``: elements and attributes that its import does not carry; ``skipped``: engines that do not read
    it, with the reason; ``plausibility``: implausible values of the model of the file, independent of engines; they do not fail
    the audit; ``missing``: engines without a result yet, in an audit that goes on or was interrupted."""

    file: str
    language: str
    meaning: str
    engines: tuple[EngineAudit, ...]
    compiled: tuple[CompiledProof, ...] = ()
    defects: tuple[str, ...] = ()
    losses: int = 0
    losses_of_physics: int = 0
    skipped: Mapping[str, str] = field(default_factory=dict)
    bodies: int = 0
    plausibility: Plausibility = field(default_factory=Plausibility)
    missing: tuple[str, ...] = ()

    @property
    def died(self) -> bool:
        """Whether an engine died."""
        return any(engine.died for engine in self.engines)

    @property
    def clean(self) -> bool:
        """Whether nothing was changed in silence, and nothing failed."""
        wrong = any(engine.silent for engine in self.engines)
        return not wrong and not any(compiled.valid is False for compiled in self.compiled)


@dataclass(frozen=True, slots=True)
class FindingGroup:
    """Findings of one engine that say the same of several elements."""

    engine: str
    what: What
    severity: FindingSeverity
    quantity: str
    findings: tuple[AuditFinding, ...]

    @property
    def worst(self) -> AuditFinding:
        """The one that is furthest off."""
        return max(self.findings, key=lambda finding: finding.size or 0.0)


def grouped(findings: Sequence[AuditFinding]) -> list[FindingGroup]:
    """Findings by engine, kind and quantity, the gravest first."""
    groups: dict[tuple[str, What, FindingSeverity, str], list[AuditFinding]] = {}
    for finding in findings:
        key = (finding.engine, finding.what, finding.severity, finding.quantity)
        groups.setdefault(key, []).append(finding)
    order = list(FindingSeverity)
    made = [FindingGroup(*key, tuple(members)) for key, members in groups.items()]
    return sorted(made, key=lambda group: order.index(group.severity))
