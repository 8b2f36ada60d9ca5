"""The support matrix: the declarations of each engine, with the format that it reads, for each feature."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from simspec.dialects.kit.contract import dialects
from simspec.engines.kit import capabilities
from simspec.engines.kit.capabilities import Capability, Deviation
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import auditors, engine_name, engines, find_engine, format_of, how_to_install
from simspec.engines.kit.settings import Setting
from simspec.formats.kit.contract import formats
from simspec.proof.contact.probe import ProbeFigure, ProbeLaw, widened
from simspec.proof.contact.run import PROBES
from simspec.proof.contact.scope import EFFECTS
from simspec.report.table import (
    BAD,
    DIM,
    GOOD,
    INFO,
    WARNING,
    Table,
    TableCell,
    markdown_cell,
    markdown_rows,
    passed_cell,
    shortened,
)
from simspec.support.declarations import Absence, Level, Support, combine
from simspec.support.features import MEANING, Feature
from simspec.world.types import Hardness, PairContact

if TYPE_CHECKING:
    from simspec.engines.kit.registry import EngineInstance


# Effects of contact that are absent in an engine: a declared deviation is so wide that an engine without the effect would pass
# (``proof/contact/declared.py``).

FRICTION, RESTITUTION, TIMESTEP = 0.5, 0.5, 1e-3
"""Of the laws that declarations are tried with, where a declaration does not start above these."""


def absent(engine: type[Engine]) -> list[tuple[str, str, str]]:
    """By effect: its name, under which law and settings it is absent from the least friction, restitution and timestep on,
    and why."""
    found: dict[tuple[str, str], list[Deviation]] = {}
    for deviation in engine.CONTACT_DEVIATIONS:
        settings = {} if deviation.setting is None else dict([deviation.setting])
        if any(
            widened(figure, law, (deviation,), settings).absent
            for law in _laws(deviation)
            for figure in _wanted(law)
            if figure.probe == deviation.probe and figure.without is not None
        ):
            found.setdefault((EFFECTS.get(deviation.probe, deviation.probe), deviation.why), []).append(deviation)
    return [(effect, "; ".join(_where(some)), why) for (effect, why), some in found.items()]


def _laws(deviation: Deviation) -> Iterator[ProbeLaw]:
    bounces = sorted({deviation.restitution, _usual(RESTITUTION, deviation.restitution, deviation.below[1])})
    for restitution, threshold in itertools.product(bounces, (0.0, 0.1)):
        pair = PairContact(
            "a",
            "b",
            _usual(FRICTION, deviation.friction, deviation.below[0]),
            restitution,
            restitution_threshold=threshold,
            torsional_friction=0.01,
            rolling_friction=0.001,
            hardness=Hardness(
                deviation.hardness or "common", time_constant=0.02, damping_ratio=1.0, stiffness=1e4, damping=100.0
            ),
        )
        yield ProbeLaw(
            pair, deviation.friction_cone or "elliptic", _usual(TIMESTEP, deviation.timestep, deviation.below[2])
        )


def _usual(usual: float, least: float, below: float) -> float:
    """The usual value, or where the declaration does not count for it one for which it does."""
    return max(least, below / 2.0) if usual >= below else max(least, usual)


@functools.cache
def _wanted(law: ProbeLaw) -> tuple[ProbeFigure, ...]:
    """The expected figures of every probe that applies. Thousands of declarations are tried with a few hundred laws, and the
    slides of one law are worked out step by step."""
    return tuple(figure for probe in PROBES.values() if probe.applies(law) for figure in probe.wanted(law))


def _where(some: list[Deviation]) -> Iterator[str]:
    """The conditions of declarations, each once, in words."""
    given: dict[str, list[float]] = {}
    for deviation in some:
        parts = [
            f"{deviation.setting[0]}: {deviation.setting[1]}" if deviation.setting else "",
            f"cone {deviation.friction_cone}" if deviation.friction_cone else "",
            f"hardness {deviation.hardness}" if deviation.hardness else "",
        ]
        key, least_of = ", ".join(filter(None, parts)), [deviation.friction, deviation.restitution, deviation.timestep]
        given[key] = [min(pair) for pair in zip(given.get(key, least_of), least_of, strict=True)]
    for key, (friction, restitution, timestep) in given.items():
        least = [
            f"μ ≥ {friction:g}" if friction > 1e-6 else "",
            f"e ≥ {restitution:g}" if restitution else "",
            f"timestep ≥ {1e3 * timestep:g} ms" if timestep else "",
        ]
        yield ", ".join(filter(None, [key, *least])) or "always"


MATRIX_FILE = "docs/reference/support-matrix.md"
WORDS = {
    Level.EXACT: "exact",
    Level.VIA_API: "exact, by API",
    Level.OUTSIDE: "on request",
    Level.APPROXIMATE: "approximate",
    Level.UNSUPPORTED: "no",
}
NOT_YET = "not yet"
FILES_ONLY = "files only"
"""The tier of an engine of which only the files are proven."""
SIGNATURE = "Generated from the declarations of formats and engines by `simspec engines --markdown`; do not edit."
"""The line by which a page is known to be simspec's, and may be replaced."""
HEAD = f"""# Support matrix

> With this page you can compare the features of all engines side by side.

{SIGNATURE}

| word | meaning |
|---|---|
| exact | the file represents it and the engine stores it |
| exact, by API | exact; simspec sets it through the engine's API, since the file cannot represent it |
| on request | exact; simspec computes it outside the engine at each step if the spec requests it by `engines.NAME.outside` |
| approximate | not exact; available only if the spec accepts it by `engines.NAME.accept` |
| no | not supported by the engine or its format (files only: or not implemented): an error that names the line of the spec |
| not yet | supported by the engine, but not implemented in simspec: the same error, and a test fails once it works |
| from V, before V | only in these versions of the engine: an error in others, except as stated in parentheses |
"""
TIERS = """Each engine has a tier. *Runs*: it loads files, steps, and reports states. *Proven*: simspec also compares the model
read back from the engine, and its dynamics. *Complete*: simspec also compares every number that the engine stores, so that
the self-test can plant changes. *Files only*: simspec's tests do not run the real program."""
CAPABILITIES = (
    "Abilities of an engine in addition to its core (load, read back, states, steps). simspec does not use "
    "those that an engine lacks."
)


def word(entry: Support) -> str:
    """How well a feature is supported, in a word or two."""
    name = NOT_YET if entry.absence is Absence.NOT_YET else WORDS[entry.level]
    since = f"from {entry.since}" + (" (before: approximate)" if entry.before else "") if entry.since else ""
    bounds = (since, f"before {entry.until}" if entry.until else "")
    return ", ".join(part for part in (name, *bounds) if part)


def support(engine: type[Engine]) -> Mapping[Feature, Support]:
    """The support of an engine together with the format that it reads."""
    return combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)


class Notes:
    """Numbered reasons below a table, each once, with the engines and features that refer to it."""

    def __init__(self, letter: str = "") -> None:
        self.letter = letter
        self._places: dict[str, dict[str, list[str]]] = {}

    def mark(self, reason: str, engine: str, feature: str) -> str:
        """The reference to a reason, for a cell of the table; empty without a reason."""
        if not reason:
            return ""
        self._places.setdefault(reason, {}).setdefault(engine, []).append(feature)
        return f" [{self.letter}{list(self._places).index(reason) + 1}]"

    def lines(self, anchors: bool = False) -> list[str]:
        """The list of reasons; ``anchors``: with a place for each engine and feature (see :func:`anchor`)."""
        made = []
        for number, (reason, places) in enumerate(self._places.items(), 1):
            marks = (anchor(engine, feature) for engine, features in places.items() for feature in features)
            links = "".join(f'<a id="{mark}"></a>' for mark in marks) if anchors else ""
            users = "; ".join(
                f"{engine}: {', '.join(f'`{f}`' for f in features)}" for engine, features in places.items()
            )
            begin = f"- [{self.letter}{number}]" if self.letter else f"{number}."
            made.append(f"{begin} {links}{markdown_cell(reason)} ({users})")
        return made


def tier(engine: type[Engine]) -> str:
    """How far simspec's support of an engine goes (``docs/design/adding-an-engine.md``)."""
    if engine.FILES_ALONE:
        return FILES_ONLY
    if {Capability.MASS_MATRIX, Capability.BIAS_FORCE} & engine.LACKS.keys():
        return "runs"
    return "proven" if Capability.INVENTORY in engine.LACKS else "complete"


def anchor(engine: str, feature: str) -> str:
    """The place in the page where it says how an engine has a feature."""
    return f"{engine}-{feature.replace('.', '-')}"


def engine_data() -> dict[str, Any]:
    """Every engine: format, installed version (None = not installed), settings, support."""
    return {
        name: {
            "format": format_of(engine),
            "tier": tier(engine),
            "version": engine.version(),
            "precision": engine.PRECISION,
            "capabilities": {capability.value: capability not in engine.LACKS for capability in Capability},
            "lacks": {capability.value: reason for capability, reason in engine.LACKS.items()},
            "install": how_to_install(engine),
            "settings": {
                key: {
                    "default": setting.default,
                    "meaning": setting.meaning,
                    "choices": list(setting.choices),
                    "by_pair": setting.by_pair is not None,
                }
                | ({"needs": {setting.needs[0]: list(setting.needs[1])}} if setting.needs else {})
                | _frictionless(setting)
                | ({} if setting.kinematic is None else {"kinematic": setting.kinematic})
                | ({} if setting.light is None else {"light": setting.light})
                for key, setting in engine.SETTINGS.items()
            },
            "support": {feature.value: _support_data(entry) for feature, entry in support(engine).items()},
        }
        for name, engine in engines().items()
    }


def _frictionless(setting: Setting) -> dict[str, Any]:
    """The default of worlds of free balls without friction, and the setting with which it is the ordinary one there, too."""
    if setting.frictionless is None:
        return {}
    unless = setting.frictionless_unless
    return {"frictionless": setting.frictionless} | ({"frictionless_unless": dict([unless])} if unless else {})


def _support_data(entry: Support) -> dict[str, Any]:
    """A declaration as plain values, without empty ones."""
    data: dict[str, Any] = {"level": entry.level.value, "how": entry.how}
    more = {
        "absence": entry.absence and entry.absence.value,
        "short": entry.short,
        "cases": [{"level": case.level or entry.level, "how": case.how, "short": case.short} for case in entry.cases],
        "since": entry.since,
        "until": entry.until,
        "before": WORDS[Level.APPROXIMATE] if entry.before else "",
    }
    return data | {key: value for key, value in more.items() if value}


def broken() -> dict[str, str]:
    """Formats, dialects and engines that are offered by installed packages and cannot be used, with the reason."""
    return {**formats().broken(), **dialects().broken(), **engines().broken(), **auditors().broken()}


def is_matrix(page: bytes) -> bool:
    """Whether a page was written by :func:`markdown`, in whatever version."""
    return page.startswith(HEAD[: HEAD.index(SIGNATURE) + len(SIGNATURE)].encode())


def markdown() -> str:
    """The page docs/reference/support-matrix.md."""
    tables = {name: support(engine) for name, engine in engines().items()}
    notes = Notes()
    rows = [
        [f"`{feature.value}`", markdown_cell(MEANING[feature])]
        + [word(table[feature]) + notes.mark(table[feature].how, name, feature.value) for name, table in tables.items()]
        for feature in Feature
    ]
    tiers = [[name, tier(engine), engine.PRECISION, format_of(engine)] for name, engine in engines().items()]
    lines = [HEAD, TIERS, "", *markdown_rows(("engine", "tier", "precision", "format"), tiers), ""]
    lines += markdown_rows(["feature", "meaning", *tables], rows)
    lines += ["", "## Notes", "", "Each reason appears once, with the engines and features that it applies to.", ""]
    lines += notes.lines(anchors=True)
    effects = [
        [name, effect, markdown_cell(where), markdown_cell(why)]
        for name, engine in engines().items()
        for effect, where, why in absent(engine)
    ]
    lines += ["", "## Absent effects of contact", "", ABSENT, ""]
    lines += [*markdown_rows(("engine", "absent effect", "where", "why"), effects), *_capabilities()]
    lines += [
        "",
        "## Solver settings",
        "",
        "A spec sets them by `engines.NAME.settings`. They do not change the model.",
        "",
    ]
    for name, engine in engines().items():
        settings = [_setting_row(key, setting) for key, setting in engine.SETTINGS.items()]
        lines += [f"### {name}", "", *markdown_rows(("setting", "default", "allowed", "meaning"), settings), ""]
    return "\n".join(lines).rstrip() + "\n"


def _setting_row(name: str, setting: Setting) -> list[str]:
    """The cells of a solver setting: its name, defaults, allowed values and meaning."""
    defaults = {
        "free balls without friction": setting.frictionless,
        "with kinematic bodies": setting.kinematic,
        "with constraints or dry friction in joints": setting.light,
    }
    default = [
        f"`{setting.default}`",
        *(f"{where}: `{value}`" for where, value in defaults.items() if value is not None),
    ]
    low, high = ("" if bound is None else f"{bound:g}" for bound in (setting.minimum, setting.maximum))
    allowed = [", ".join(setting.choices) or (f"{low} … {high}".strip() if low or high else "")]
    if setting.needs:
        allowed.append(f"with {setting.needs[0]}: {' or '.join(str(value).lower() for value in setting.needs[1])}")
    allowed += ["also by pair of materials"] if setting.by_pair else []
    return [f"`{name}`", "; ".join(default), "; ".join(filter(None, allowed)), markdown_cell(setting.meaning)]


ABSENT = (
    "Each engine declares deviations from the contact law (docs/records/contact.md). An effect is absent where a deviation is "
    "so wide that an engine with less than a tenth of the effect would pass. A certificate names the absent effects of its "
    "figures."
)


def _capabilities() -> list[str]:
    """The table of capabilities, with the reasons of missing ones below."""
    notes = Notes("c")
    rows = []
    for capability in Capability:
        cells = []
        for name, engine in engines().items():
            reason = engine.LACKS.get(capability)
            cells.append("yes" if reason is None else "no" + notes.mark(reason, name, capability.value))
        rows.append([f"`{capability}`", markdown_cell(capabilities.MEANING[capability]), *cells])
    table = markdown_rows(["capability", "meaning: the engine …", *engines()], rows)
    return ["", "## Capabilities", "", CAPABILITIES, "", *table, "", *notes.lines()]


# Short reasons of approximations, with a link to the whole.


def link(engine: str, feature: str) -> str:
    """Where the support matrix says how ``engine``, a name or a label, has ``feature``."""
    return f"{MATRIX_FILE}#{anchor(engine_name(engine), feature)}"


def short_reason(engine: str, feature: str, said: str) -> str:
    """A certificate's entry (``LEVEL: reason``) in one line: the short reason of the engine's declaration.

    The entry itself where that is no longer there: a certificate may be older than the engine.
    """
    level, _, how = said.partition(": ")
    engine = engine_name(engine)
    if engine not in engines() or feature not in list(Feature) or level not in list(Level):
        return said
    return support(engines()[engine])[Feature(feature)].brief(Level(level), how) or how


# Tables of engines on terminals.

SYMBOLS = {Level.EXACT: "✓", Level.VIA_API: "✓", Level.OUTSIDE: "+", Level.APPROXIMATE: "≈", Level.UNSUPPORTED: "·"}
LEGEND = "✓ exact   + by simspec's own forces, on request   ≈ approximate, to be accepted by name   · no"
MORE = "Reasons: simspec engines show NAME. Everything as data: simspec engines --json."
LONGEST_REMARK = 120
"""Characters of a remark in the list of engines."""
REMARK_WIDTH = 46
"""Columns of it: longer remarks have several lines."""


def engine_tables(instances: Sequence[EngineInstance], data: Mapping[str, Any]) -> list[Table]:
    """The engines with their versions, and symbols for what each proven engine of ``data`` supports: 80 columns wide."""
    versions = Table("Engines", "engine", "version", "reads", "")
    versions.columns[3].width = REMARK_WIDTH
    for instance in instances:
        remark = instance.problem or instance.python or ""
        versions.add(
            instance.label,
            instance.version or TableCell("none", BAD),
            instance.format,
            TableCell(shortened(remark, LONGEST_REMARK), BAD if instance.problem else DIM),
        )
    proven = {name: facts for name, facts in data.items() if facts["tier"] != FILES_ONLY}
    support = _symbols("feature", proven)
    for feature in Feature:
        levels = [Level(facts["support"][feature.value]["level"]) for facts in proven.values()]
        support.add(feature.value, *(TableCell(SYMBOLS[level], TONES[level]) for level in levels))
    abilities = _symbols("capability", proven)
    for capability in Capability:
        has = [facts["capabilities"][capability.value] for facts in proven.values()]
        abilities.add(capability.value, *(TableCell("✓", GOOD) if there else TableCell("·", BAD) for there in has))
    support.note, abilities.note = LEGEND, MORE
    return [versions, support, abilities]


def _symbols(first: str, data: Mapping[str, Any]) -> Table:
    """A table without rows whose heads are the names of engines from top to bottom."""
    height = max((len(name) for name in data), default=0)
    return Table("", first, *("\n".join(name.rjust(height)) for name in data))


def engine_table(name: str) -> list[Table]:
    """The features of an engine with their reasons, its capabilities and settings. Raises EngineError for an unknown engine."""
    engine = find_engine(name)
    title = f"{engine.TITLE or name} {engine.version() or '(not installed)'}: {tier(engine)}"
    features = Table(title, "feature", "", "")
    for feature, entry in support(engine).items():
        features.add(feature.value, TableCell(word(entry), TONES[entry.level]), entry.brief(entry.level) or "")
    abilities = Table("Capabilities", "capability", "", "")
    for capability in Capability:
        reason = engine.LACKS.get(capability)
        abilities.add(capability.value, passed_cell(reason is None, "yes", "no"), reason or "")
    settings = Table("Solver settings", "setting", "default", "meaning")
    for key, setting in engine.SETTINGS.items():
        settings.add(key, str(setting.default), setting.meaning)
    return [features, abilities, *([settings] if engine.SETTINGS else [])]


TONES = {
    Level.EXACT: GOOD,
    Level.VIA_API: GOOD,
    Level.OUTSIDE: INFO,
    Level.APPROXIMATE: WARNING,
    Level.UNSUPPORTED: BAD,
}
