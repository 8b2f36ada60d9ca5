"""What is at work in each engine of a sweep: parts of the key under which its runs are stored."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from simspec.distribution import own_version
from simspec.engines.kit.installed import instances
from simspec.errors import EngineError

UNKNOWN = "not queried"


def versions_of(labels: Iterable[str], pythons: Mapping[str, str] = MappingProxyType({})) -> dict[str, dict[str, str]]:
    """By label: the versions of simspec, of the engine, and of the numpy beside it, by the names that a run's provenance gives
    them. An engine whose interpreter is not to be started (``pythons`` contains it, without a value) has the version
    ``UNKNOWN``, under which nothing is stored. Raises EngineError for an engine that is not there."""
    labels = list(labels)
    used = {label: python for label in labels if (python := pythons.get(label)) is not None}
    closed = [label for label in labels if label in pythons and label not in used]
    known = {one.label: one for one in instances(used, [label for label in labels if label not in closed])}
    versions = {label: {"simspec": own_version(), "engine_version": UNKNOWN} for label in closed}
    for label in labels:
        if label in closed:
            continue
        one = known[label]
        if one.version is None or one.problem is not None:
            raise EngineError(label, one.problem or "not installed")
        versions[label] = {"simspec": own_version(), "engine_version": one.version}
        if one.numpy is not None:
            versions[label]["numpy_version"] = one.numpy
    return versions
