"""What a study can show (``show``), by word."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simspec.report.study.attribution import attribution_tables
from simspec.report.study.case_cost import case_cost_tables
from simspec.report.study.cases import cases_tables
from simspec.report.study.certified import certified_tables
from simspec.report.study.conservation import conservation_tables
from simspec.report.study.consistency import consistency_tables
from simspec.report.study.contact import contact_tables
from simspec.report.study.cost import cost_tables
from simspec.report.study.determinism import determinism_tables
from simspec.report.study.displacement import displacement_tables
from simspec.report.study.distributions import distributions_tables
from simspec.report.study.divergence import divergence_tables
from simspec.report.study.done import Done, Shown
from simspec.report.study.failures import failures_tables
from simspec.report.study.over_time import over_time_tables
from simspec.report.study.penetration import penetration_tables
from simspec.report.study.playback import playback_tables
from simspec.report.study.quantities import quantities_tables
from simspec.report.study.sentences import with_sentences
from simspec.report.study.speed import load_tables, speed_tables
from simspec.report.study.unequal import unequal_tables
from simspec.report.study.validity import validity_tables

SHOWN: Mapping[str, Callable[[Done], list[Shown]]] = {
    "speed": speed_tables,
    "load": load_tables,
    "validity": validity_tables,
    "over_time": over_time_tables,
    "determinism": determinism_tables,
    "playback": playback_tables,
    "quantities": quantities_tables,
    "unequal": unequal_tables,
    "contact": contact_tables,
    "certified": certified_tables,
    "failures": failures_tables,
    "cases": cases_tables,
    "cost": cost_tables,
    "displacement": displacement_tables,
    "case_cost": case_cost_tables,
    "divergence": divergence_tables,
    "distributions": distributions_tables,
    "consistency": consistency_tables,
    "conservation": conservation_tables,
    "penetration": penetration_tables,
    "attribution": attribution_tables,
}
"""By the words of :data:`simspec.language.study.SHOWN`. A table's name begins with the word."""


def shown_of(done: Done) -> list[Shown]:
    """All that the study shows of a sweep."""
    return [with_sentences(shown) for word in done.sweep.words.show for shown in SHOWN[word](done)]
