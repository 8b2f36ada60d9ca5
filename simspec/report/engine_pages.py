"""The pages docs/reference/engines/NAME.md: declarations of each engine, and figures of committed certificates and studies;
and their index, docs/reference/engines.md.

Nothing of it depends on what is installed, so that whether it is current has one answer on every machine.
"""

from __future__ import annotations

import collections
import dataclasses
import functools
import inspect
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from simspec.compiler import WORLD_FILE, needed_decisions
from simspec.engines.kit.capabilities import Deviation
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import auditors, engines, format_of, how_to_install, loaders
from simspec.errors import UnsupportedError
from simspec.generated import CERTIFICATE_FILE
from simspec.outputs.files import read_bytes
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.report.certificate import level_title, strain
from simspec.report.matrix import NOT_YET, SIGNATURE, WORDS, support, word
from simspec.report.study.pages import tables_text
from simspec.report.table import markdown_cell, markdown_rows
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.canonical import from_plain
from simspec.world.types import World

# Measured figures of an engine: deviations in the committed certificates, and the published study of all engines.

STUDY = "docs/records/studies/every-engine"
"""The study that has every engine that can be had, each scenario of it in one run of one machine."""
LINK = "../../records/studies/every-engine/study.md"
LARGEST = 64 * 2**20
"""Bytes of a study that are read."""
HEADS = (
    "scenario, timestep",
    "a step, processor time",
    "× real time",
    "all that is expected holds",
    "the same run again",
    "gap",
)
NOTE = """Gap: the mean distance of all bodies from {first}'s, {length:g} ms after both began in the same state; mean of
{windows} such windows."""


def closeness(name: str, certificates: Mapping[str, Certificate]) -> Iterator[str]:
    """For each level of the certificates how much was compared, and which deviation is the largest share of its tolerance."""
    checks = [
        (scenario, check)
        for scenario, certificate in certificates.items()
        if name in certificate.engines
        for check in certificate.engines[name].checks
    ]
    rows = []
    for level in sorted({check.level for _, check in checks}):
        of_level = [(scenario, check) for scenario, check in checks if check.level == level]
        scenarios, count = {scenario for scenario, _ in of_level}, sum(check.count for _, check in of_level)
        title = level_title(level, [check for _, check in of_level])
        rows.append([title, str(len(scenarios)), f"{count:,}", _nearest(of_level)])
    heads = ("level", "scenarios", "comparisons", "nearest to what is tolerated")
    yield from (*markdown_rows(heads, rows, right=(1, 2)), "") if rows else ()


def _nearest(checks: Iterable[tuple[str, Check]]) -> str:
    """The check whose deviation is the largest share of its tolerance; one that failed comes first."""
    scenario, check = max(checks, key=lambda entry: strain(entry[1]) if entry[1].count else math.inf)
    if check.passed and not check.worst:
        return "equal"
    what = f"{check.name}, {scenario}"
    if not check.count:
        return f"{what}: nothing was compared"
    if check.worst is None:
        return f"{what}: different in kind"
    return f"{what}: {check.worst:.2g} of {check.tolerance:.2g}"


def study_of(root: Path) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """The records of the published study's tables, by sweep and name; empty where it is not published."""
    stored = tables_text(root / STUDY)
    if stored is None:
        return {}
    sweeps = json.loads(stored[1])["sweeps"]
    return {sweep: {table["name"]: table["records"] for table in tables} for sweep, tables in sweeps.items()}


def compared(name: str, study: Mapping[str, Mapping[str, list[dict[str, Any]]]]) -> Iterator[str]:
    """How an engine does in each sweep of the study, at its smallest timestep, with a row for each of its versions."""
    rows = list(_rows(name, study))
    if rows:
        gaps = [row for tables in study.values() for row in tables.get("attribution", ()) if "gap.all" in row]
        yield from (f"In the [study of every engine]({LINK}), at each scenario's smallest timestep:", "")
        yield from (*markdown_rows(HEADS, rows, right=(1, 2, 5)), "")
        if gaps:
            text = NOTE.format(first=gaps[0]["first"], length=1e3 * gaps[0]["length"], windows=gaps[0]["windows"])
            yield from (text, "")


def _rows(name: str, study: Mapping[str, Mapping[str, list[dict[str, Any]]]]) -> Iterator[Sequence[str]]:
    for sweep, tables in study.items():
        speeds = [row for row in tables.get("speed.cpu_factor", ()) if "elsewhere" not in row]
        if not speeds:
            continue
        smallest = min(row["timestep"] for row in speeds)
        for row in speeds:
            label = row["engine"]
            if row["timestep"] != smallest or label.partition("@")[0] != name:
                continue
            version = f", {label}" if label != name else ""
            seconds, gap = smallest / row["median"], _of(tables, "attribution", label).get("gap.all")
            yield (
                f"{sweep}{version}, {1e3 * smallest:g} ms",
                f"{1e3 * seconds:.3g} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.3g} µs",
                f"{row['median']:.3g}",
                _holds(_of(tables, "validity", label)),
                _of(tables, "determinism", label, smallest).get("result", "–"),
                "–" if gap is None else f"{gap:.2g} m",  # none of the first engine, and of those without an explanation
            )


def _of(
    tables: Mapping[str, list[dict[str, Any]]], table: str, label: str, timestep: float | None = None
) -> dict[str, Any]:
    """The row of an engine in a table; {} where there is none."""
    rows = (row for row in tables.get(table, ()) if row.get("engine") == label)
    return next((row for row in rows if timestep in (None, row.get("timestep"))), {})


def _holds(row: Mapping[str, Any]) -> str:
    if not row:
        return "–"
    limit, beyond = row["limit"], row["first_invalid"]
    if limit is None:
        return f"not at {1e3 * beyond:g} ms: {row['missed']}" if beyond is not None else "–"
    return f"up to {1e3 * limit:g} ms" if beyond is not None else f"up to {1e3 * limit:g} ms at least"


LARGEST_CERTIFICATE = 64 * 2**20
"""Bytes of a certificate that are read."""
INDEX = "engines.md"
INDEX_HEAD = f"""# Engines

> With this page you can find the page of an engine and the meaning of its entries.

{SIGNATURE}

All features side by side: the [support matrix](support-matrix.md). Levels of a certificate: [proof.md](../concepts/proof.md).
`simspec engines doctor` checks the installations of this machine.
"""
AUDITS_ONLY = "`simspec audit` compares its models of robot files with the files; simspec runs no world in it"
PLACES = re.compile(r" \(and \d+ more places?\)")
LEVELS = (*WORDS.values(), NOT_YET)


def page_names() -> tuple[str, ...]:
    """Paths of the pages, from the folder of the index: the index, and a page of each engine."""
    return (INDEX, *(f"engines/{name}.md" for name in loaders()))


def is_page(page: bytes) -> bool:
    """Whether a page was written by :func:`pages`, in whatever version."""
    head = page[:400].decode("utf-8", "replace")
    return head.startswith("# ") and f"\n\n{SIGNATURE}\n" in head


def pages(root: Path) -> dict[str, str]:
    """The pages by :func:`page_names`, with the certificates below ``root / "generated"`` and the published study of every
    engine, where these are there. Raises SpecError for files that are damaged."""
    certificates, study = _certificates(root), study_of(root)
    made = {INDEX: _index(certificates)}
    for name, engine in engines().items():
        title = engine.TITLE or name
        ability = f"> With this page you can look up the features, settings, deviations and certificates of {title}."
        lines = [f"# {title}", "", ability, "", SIGNATURE, "", *_about(engine), "", *_facts(engine, certificates), ""]
        measured = [*closeness(name, certificates), *compared(name, study)]
        lines += ["## Measured", "", *measured] if measured else []
        lines += [*_support(engine), *_settings(engine), *_deviations(engine), *_certified(engine, certificates, root)]
        made[f"engines/{name}.md"] = "\n".join(lines).rstrip() + "\n"
    return made | {f"engines/{name}.md": _audit_page(engine) for name, engine in auditors().items()}


def _index(certificates: Mapping[str, Certificate]) -> str:
    """The engines that are proven by running them, those whose files alone are proven, and those that audit, with links."""
    lines = [INDEX_HEAD]
    for title, files_only in (("Engines that run", False), ("Files only", True)):
        lines += [f"## {title}", ""]
        if files_only:
            lines += ["simspec writes their files and compares them with the world; no test runs the program.", ""]
        rows = []
        for name, engine in engines().items():
            if bool(engine.FILES_ALONE) is files_only:
                proofs = _proofs(name, certificates).values()
                valid = f"{sum(proof.valid for proof in proofs)} of {len(proofs)}" if proofs else "–"
                rows.append([f"[{engine.TITLE or name}](engines/{name}.md)", engine.PRECISION, _levels(engine), valid])
        heads = ("engine", "precision", f"of {len(Feature)} features", "valid certificates")
        lines += [*markdown_rows(heads, rows, right=(3,)), ""]
    if auditors():
        about = "`simspec audit` compares their models of robot files with the files; simspec runs no world in them."
        lines += ["## Audits only", "", about, ""]
        lines += [f"- [{engine.TITLE or name}](engines/{name}.md)" for name, engine in auditors().items()]
    return "\n".join(lines).rstrip() + "\n"


def _proofs(name: str, certificates: Mapping[str, Certificate]) -> dict[str, EngineProof]:
    """The proofs of an engine by scenario."""
    return {scenario: made.engines[name] for scenario, made in certificates.items() if name in made.engines}


def _levels(engine: type[Engine]) -> str:
    """How many features an engine has at each level, in words."""
    counts = collections.Counter(_plain_word(entry) for entry in support(engine).values())
    return ", ".join(f"{counts[level]} {level}" for level in LEVELS if counts[level])


def _about(engine: type[Engine]) -> list[str]:
    """The docstring of the class, its roles and literals as Markdown."""
    text = inspect.cleandoc(engine.__doc__ or "")
    text = re.sub(r":[a-z]+:`~?([^`]+)`", r"`\1`", text)
    return [" ".join(paragraph.split()).replace("``", "`") for paragraph in text.split("\n\n")]


def _facts(engine: type[Engine], certificates: Mapping[str, Certificate]) -> list[str]:
    versions = {proof.version for proof in _proofs(engine.NAME, certificates).values()}
    proven = f"files only (L0) where it is not installed, which is no valid certificate: {engine.FILES_ALONE}"
    rows = {
        "name": f"`{engine.NAME}`",
        "computes in": f"{engine.PRECISION} precision",
        "version that the certificates are of": ", ".join(sorted(versions)),
        "install": f"`{how_to_install(engine)}`" if how_to_install(engine) else "",
        "licence terms": _licences(engine),
        "proven": proven if engine.FILES_ALONE else "",
        "packages of Debian": "; ".join(f"{name}: {use}" for name, use in engine.NEEDS.debian),
        "reads": f"`{format_of(engine)}` (dialect `{engine.DIALECT}`)",
        f"of {len(Feature)} features": _levels(engine),
        "lacks": "; ".join(f"{capability} ({reason})" for capability, reason in engine.LACKS.items()),
    }
    return ["| | |", "|---|---|", *(f"| {name} | {markdown_cell(text)} |" for name, text in rows.items() if text)]


def _licences(engine: type[Engine]) -> str:
    """The terms that are accepted before it is installed."""
    return "; ".join(f"{terms.covers}: {terms.name}, {', '.join(terms.addresses)}" for terms in engine.LICENCES)


def _audit_page(engine: type[Engine]) -> str:
    """The page of an engine by which robot files are audited, and which runs no world."""
    title = engine.TITLE or engine.NAME
    ability = (
        f"> With this page you can look up the values of robot files that an audit compares with those of {title}."
    )
    lines = [f"# {title}", "", ability, "", SIGNATURE, "", *_about(engine), "", f"{AUDITS_ONLY}.", ""]
    facts = {"name": f"`{engine.NAME}`", "computes in": f"{engine.PRECISION} precision"}
    facts |= {"install": f"`{how_to_install(engine)}`", "an installation": engine.INSTALLS}
    facts |= {"licence terms": _licences(engine)}
    facts |= {f"loads {language}": f"`{reads.how}`" for language, reads in engine.FOREIGN.items()}
    lines += ["| | |", "|---|---|", *(f"| {name} | {markdown_cell(text)} |" for name, text in facts.items() if text)]
    lines += ["", "## Values in addition to those of the file", ""]
    rows = [[f"`{name}`", added.changes, markdown_cell(added.why)] for name, added in engine.FOREIGN_ADDITIONS.items()]
    return "\n".join([*lines, *markdown_rows(("value", "severity", "meaning"), rows)]).rstrip() + "\n"


def _plain_word(entry: Any) -> str:
    return word(entry).split(",")[0] if entry.level is not Level.VIA_API else WORDS[Level.VIA_API]


def _support(engine: type[Engine]) -> Iterator[str]:
    """Features that the engine lacks or approximates, each reason once."""
    table = support(engine)
    for title, words in (
        ("Not supported", (WORDS[Level.UNSUPPORTED],)),
        ("Not implemented yet", (NOT_YET,)),
        ("Approximate, where a spec accepts it", (WORDS[Level.APPROXIMATE],)),
        ("Computed outside of the engine, where a spec requests it", (WORDS[Level.OUTSIDE],)),
    ):
        found = [(feature, entry) for feature, entry in table.items() if _plain_word(entry) in words]
        if found:
            yield from (f"## {title}", "")
            features: dict[str, list[str]] = {}
            for feature, entry in found:
                features.setdefault(" ".join(entry.how.split()), []).append(f"`{feature.value}`")
            yield from (f"- {', '.join(names)}: {reason}" for reason, names in features.items())
            yield ""


def _settings(engine: type[Engine]) -> Iterator[str]:
    if engine.SETTINGS:
        rows = [
            [f"`{name}`", f"`{setting.default}`", setting.group, markdown_cell(setting.meaning)]
            for name, setting in engine.SETTINGS.items()
        ]
        heads = ("setting", "default", "acts on", "meaning")
        yield from ("## Solver settings", "", *markdown_rows(heads, rows), "")


def _deviations(engine: type[Engine]) -> Iterator[str]:
    """Known deviations from the contact law: each reason once, with the probes that it is measured by."""
    if not engine.CONTACT_DEVIATIONS:
        return
    yield from ("## Known deviations from the contact law", "")
    yield from (
        "Widest measured deviation of each contact probe, by reason; a size without % is in the unit of its figure. Sizes by",
        f"friction, restitution, timestep and ratio of masses: {_deviation_table(engine)}.",
        "",
    )
    reasons: dict[str, dict[str, list[Deviation]]] = {}
    for deviation in engine.CONTACT_DEVIATIONS:
        reasons.setdefault(" ".join(deviation.why.split()), {}).setdefault(deviation.probe, []).append(deviation)
    for reason, probes in reasons.items():
        rows = []
        for probe, deviations in probes.items():
            widest = max(deviations, key=lambda entry: entry.size)
            size = f"{100.0 * widest.size:.3g} %" if widest.relative else f"{widest.size:.3g}"
            rows.append([probe, size, markdown_cell(_where(widest)), f"{len(deviations):,}"])
        table = markdown_rows(("probe", "widest", "where", "entries"), rows, right=(1, 3))
        yield from (f"**{reason[:1].upper()}{reason[1:]}.**", "", *table, "")


def _deviation_table(engine: type[Engine]) -> str:
    """A link to the table of deviations; where the engine has those of another, a name without a link."""
    folder = Path(inspect.getfile(engine)).parent
    name = "contact_deviations.csv"
    return f"[`{name}`](../../../simspec/engines/{folder.name}/{name})" if (folder / name).is_file() else f"`{name}`"


def _where(deviation: Deviation) -> str:
    parts = (
        f"friction from {deviation.friction:g}" if deviation.friction else "",
        f"restitution from {deviation.restitution:g}" if deviation.restitution else "",
        f"timestep from {1e3 * deviation.timestep:.3g} ms" if deviation.timestep else "",
        f"cone {deviation.friction_cone}" if deviation.friction_cone else "",
        f"hardness {deviation.hardness}" if deviation.hardness else "",
        f"`{deviation.setting[0]}: {str(deviation.setting[1]).lower()}`" if deviation.setting else "",
        f"releases before {deviation.until}" if deviation.until else "",
    )
    return ", ".join(part for part in parts if part) or "everywhere"


def _certified(engine: type[Engine], certificates: Mapping[str, Certificate], root: Path) -> Iterator[str]:
    """In how many scenarios of the library each level was compared, and why others have no certificate of it."""
    if not certificates:
        return
    proofs = _proofs(engine.NAME, certificates)
    yield from ("## Certificates", "")
    valid = sum(proof.valid for proof in proofs.values())
    levels: collections.Counter[str] = collections.Counter()
    failed: collections.Counter[str] = collections.Counter()
    for proof in proofs.values():
        levels.update({check.level for check in proof.checks})
        failed.update({check.level for check in proof.checks if not check.passed})
    text = ", ".join(
        f"{level} in {count}" + (f" ({failed[level]} failed)" if failed[level] else "")
        for level, count in sorted(levels.items())
    )
    compared = f" Compared: {text}." if text else ""
    yield f"{valid} of {len(proofs)} certificates are valid, of {len(certificates)} scenarios of the library.{compared}"
    if lacking := sorted(set(certificates) - set(proofs)):
        yield from ("", "Without it, each for the first reason that there is:", "")
        reasons: dict[str, list[str]] = {}
        for name in lacking:
            reasons.setdefault(_refusal(engine, _world(root / "generated" / name / WORLD_FILE)), []).append(name)
        yield from (f"- {', '.join(names)}: {' '.join(why.split())}" for why, names in reasons.items())
    yield ""


@functools.cache
def _world(file: Path) -> World:
    """The world that a scenario of the library was compiled from."""
    world: World = from_plain(World, json.loads(read_bytes(file, LARGEST_CERTIFICATE)))
    return world


def _refusal(engine: type[Engine], world: World) -> str:
    """Why an engine does not take a world: a feature that it does not support, else one that the world does not accept."""
    every = tuple(feature.value for feature in Feature)
    options = dataclasses.replace(world.options(engine.NAME), accept=every, outside=every)
    others = tuple(options for options in world.engines if options.engine != engine.NAME)
    for tried in (dataclasses.replace(world, engines=(*others, options)), world):
        try:
            needed_decisions(tried, engine.NAME)
        except UnsupportedError as error:
            return PLACES.sub("", error.problems[0].message)
    if engine.FILES_ALONE:
        return "it is supported, and a proof of files only (L0) is no valid certificate: none is kept"
    return "it is supported, and was not certified yet"


def _certificates(root: Path) -> dict[str, Certificate]:
    """The certificates of the library's scenarios, by name."""
    files = sorted((root / "generated").glob(f"*/{CERTIFICATE_FILE}"))
    texts = {file: read_bytes(file, LARGEST_CERTIFICATE).decode("utf-8", "replace") for file in files}
    return {file.parent.name: Certificate.from_json(text, str(file)) for file, text in texts.items()}
