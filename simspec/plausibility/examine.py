"""All rules over one spec and its world."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from simspec.errors import Location
from simspec.language.load import Spec
from simspec.plausibility.findings import Finding, Plausibility, ordered
from simspec.plausibility.joints import joint_findings, mesh_findings
from simspec.plausibility.masses import mass_findings
from simspec.plausibility.places import Places
from simspec.plausibility.sweep import sweep
from simspec.world.types import World


def examine(spec: Spec, world: World) -> Plausibility:
    """What is implausible about the model of ``spec``, whose resolved world is ``world``."""
    imported = any(source.imported is not None for source in spec.source.all())
    swept, sampling = sweep(world)
    findings = [
        *mass_findings(world),
        *Places(world, imported).findings(),
        *swept,
        *joint_findings(spec, world),
        *mesh_findings(spec),
    ]
    return Plausibility(ordered([_located(finding, spec.locate) for finding in findings]), sampling)


def _located(finding: Finding, locate: Callable[[str], Location | None]) -> Finding:
    if finding.location is not None:
        return finding
    return dataclasses.replace(finding, location=locate(finding.path))
