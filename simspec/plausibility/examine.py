"""All rules over one spec and its world."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from simspec.errors import Location
from simspec.language import trees
from simspec.language.load import Spec
from simspec.plausibility.findings import Finding, Plausibility, ordered
from simspec.plausibility.joints import joint_findings, mesh_findings
from simspec.plausibility.masses import mass_findings
from simspec.plausibility.places import Places
from simspec.plausibility.sweep import sweep
from simspec.world.types import World


def examine(spec: Spec, world: World) -> Plausibility:
    """What is implausible about the model of ``spec``, whose resolved world is ``world``."""
    foreign = of_robot_files(spec)
    swept, sampling = sweep(world)
    findings = [
        *mass_findings(world, foreign),
        *Places(world, foreign).findings(),
        *swept,
        *joint_findings(spec, world),
        *mesh_findings(spec),
    ]
    return Plausibility(ordered([_located(finding, spec.locate) for finding in findings]), sampling)


def of_robot_files(spec: Spec) -> Callable[[str], bool]:
    """Whether a body, by its name in the world, comes from a robot file: there shapes, masses and joints are meant to be those
    of one mechanism, while a spec that is written by hand may be a sketch, with shapes that are only seen."""
    if spec.source.imported is not None:
        return lambda name: True
    models = tuple(
        f"{name}/"
        for name, _, bodies in trees.placed(spec.source)
        if any(source.imported is not None for source in (bodies.source, *bodies.files))
    )
    return lambda name: name.startswith(models)


def _located(finding: Finding, locate: Callable[[str], Location | None]) -> Finding:
    if finding.location is not None:
        return finding
    return dataclasses.replace(finding, location=locate(finding.path))
