"""Two files of one robot, in any languages: how what they mean differs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from simspec.audit.compare import Comparison
from simspec.audit.findings import Finding, Severity, What
from simspec.audit.meaning import Meaning, file_name, meaning_of
from simspec.audit.placed import match
from simspec.engines.kit.foreign import MESH
from simspec.errors import Problem, SpecError
from simspec.language.foreign import ImportOptions
from simspec.world.types import Body, ReadBack, Shape

SECOND = "B"


@dataclass(frozen=True)
class PairAudit:
    """How two files differ: ``findings`` have the first's value as ``file_value``, the second's as ``engine_value``; bodies are
    matched by name, those that only one file has are listed."""

    first: str
    second: str
    matched: int
    compared: int
    findings: tuple[Finding, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether both mean one model."""
        return not any(one.silent for one in self.findings) and not self.only_first and not self.only_second


def pair(
    first: tuple[Path, ImportOptions], second: tuple[Path, ImportOptions], allow_outside: bool = False
) -> PairAudit:
    """Compare two files, each with what is said to its importer. Raises SpecError where simspec does not read one of them, or
    they have no body in common."""
    meanings = [meaning_of(path, options, allow_outside) for path, options in (first, second)]
    names = file_name(*first), file_name(*second)
    for meaning in meanings:
        if not meaning.bodies:
            problems = meaning.defects or (Problem(f"{meaning.path}: simspec does not import files of this language"),)
            raise SpecError(problems)
    one, other = meanings
    matched = match(one.bodies, other.bodies)
    if not matched.own:
        raise SpecError([Problem(f"{names[0]} and {names[1]} have no body of the same name")])
    shared = frozenset(matched.own)
    partners = frozenset(body.name for body in matched.own.values())
    held = ReadBack(tuple(map(_told, other.bodies)), other.gravity or (0.0, 0.0, 0.0), 0.0)
    compared = Comparison(SECOND, dataclasses.replace(one, gravity=None), held, {}).run()
    findings = tuple(
        finding
        for finding in compared.findings
        if not (finding.quantity == "body" and finding.what in (What.DROPPED, What.ADDED, What.MERGED))
        and finding.severity is not Severity.DEFAULT
    )
    return PairAudit(
        *names,
        len(shared),
        compared.compared,
        findings,
        _rest(one, shared),
        _rest(other, partners),
        tuple(str(problem) for meaning in meanings for problem in meaning.defects),
    )


def _rest(meaning: Meaning, shared: frozenset[str]) -> tuple[str, ...]:
    return tuple(body.name for body in meaning.bodies if body.name not in shared)


def _told(body: Body) -> Body:
    """A body as an engine would tell it: meshes by their support functions."""
    return dataclasses.replace(body, shapes=tuple(_support(shape) for shape in body.shapes))


def _support(shape: Shape) -> Shape:
    if shape.kind != MESH:
        return shape
    import numpy as np

    from simspec.engines.kit.foreign import support

    return dataclasses.replace(shape, size=support(np.array(shape.size, dtype=float).reshape(-1, 3)))
