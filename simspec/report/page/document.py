"""The page: one HTML file, whose content security policy lets it load nothing, and run its own program alone."""

from __future__ import annotations

import base64
import functools
import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import Problem, SpecError, clipped, visible
from simspec.files import resource_folder
from simspec.formats.kit.text import environment
from simspec.proof.certificate import Certificate
from simspec.report import differences
from simspec.report.certificate import certificate_notes, certificate_tables
from simspec.report.differences import angle, inconclusive_note, not_compared_words, tolerances
from simspec.report.page.packing import FARTHEST, PackedNumbers, ShownFrames, choose_frames
from simspec.report.page.playback import charts, is_drawn, scene_data
from simspec.report.problems import not_run_table
from simspec.report.studies import StoredStudy, expectations, final_table, results, shown_of
from simspec.report.table import BAD, GOOD, PLAIN, WARNING, Table, html_data, length, listed, number
from simspec.report.verdict import NBSP, VerdictPart
from simspec.report.verdict import verdict as study_verdict
from simspec.runner.run import Run
from simspec.runner.unphysical import together
from simspec.world.canonical import sha256

# Verdict of a study in sentences.

MARKS = {GOOD: "✓", WARNING: "!", BAD: "✗", PLAIN: "·"}
"""Marks in addition to the colour, so that the meaning does not depend on colour vision."""
MOST_FAILED = 5
"""Failed expectations, and failed checks, that are named."""
LONGEST_REASON = 300


@dataclass(frozen=True)
class Sentence:
    """One thing that is said, and whether it is good."""

    tone: str
    text: str

    @property
    def mark(self) -> str:
        return MARKS.get(self.tone, MARKS[PLAIN])


MOST_SENTENCES = 5
"""Sentences of the verdict, above the playback."""
RANK = {BAD: 0, WARNING: 1, GOOD: 2}
"""Tones, the worst first."""


def short_verdict(stored: StoredStudy) -> list[Sentence]:
    """A summary, and the verdict of the command line in at most four further sentences."""
    groups: dict[str, list[VerdictPart]] = {}
    label = ""
    for part in study_verdict(stored.study, {}, None):
        label = part.label or label
        groups.setdefault("model" if label in ("accepted", "contact law") else label, []).append(part)
    sentences = [
        Sentence(
            min((part.tone for part in parts), key=lambda tone: RANK.get(tone, len(RANK))),
            f"{name.capitalize()}: {'; '.join(_labelled(part, name) for part in parts)}.".replace(NBSP, " "),
        )
        for name, parts in groups.items()
    ]
    return [summary(stored.study), *sentences][:MOST_SENTENCES]


def _labelled(part: VerdictPart, group: str) -> str:
    return part.text if part.label in ("", group) else f"{part.label}: {part.text}"


def remarks(study: Study) -> list[Sentence]:
    """The results of a study in all sentences: models, failures, differences, expectations, repeats, speed."""
    makers = (_models, _failures, _differences, _expectations, _repeats, _speed)
    return [sentence for sentences in makers for sentence in sentences(study)]


def summary(study: Study) -> Sentence:
    """The answer in one sentence: models, motions, expectations."""
    failed = [name for name, run in study.runs.items() if run.failed is not None]
    certificate, verdicts = study.certificate, {diff.verdict for diff in study.diffs}
    if certificate is not None and any(name in study.runs for name, _ in certificate.failures()):
        return Sentence(BAD, "The engines do not have the same model: the runs below are not comparable.")
    if failed:
        return Sentence(BAD, f"{listed(failed)} did not finish.")
    model, proven = _model(study)
    unmet = sum(not outcome.passed for outcomes in study.outcomes.values() for outcome in outcomes)
    tail = f", and {unmet} expectation{'s' if unmet > 1 else ''} failed." if unmet else "."
    if _not_physical(study):
        tail, unmet = f"; the motion is not physical{tail}", unmet + 1
    tone = BAD if unmet else WARNING
    if not study.diffs:
        return Sentence(_worst(not proven, bool(unmet)), f"{model}{tail}")
    if OUT in verdicts:
        first = min((out for diff in study.diffs if (out := diff.first_out) is not None), key=_when)
        return Sentence(tone, f"{model}; their motions part at {_when(first):.4g} s{tail}")
    if all(diff.not_compared for diff in study.diffs):
        if _chaotic(study.diffs):
            return Sentence(tone, f"{model}; their own noise leaves no time at which motions can be compared{tail}")
        return Sentence(tone, f"{model}; nothing but the beginning was recorded that could be compared{tail}")
    if INCONCLUSIVE in verdicts:
        return Sentence(tone, f"{model}; whether they move alike is inconclusive, because of their own noise{tail}")
    times = {diff.compared_until for diff in study.diffs}
    then = f"{model}, and move alike"
    if _chaotic(study.diffs):
        then += f" until {min(times):.4g} s, where chaos begins" + (" in some of them" if len(times) > 1 else "")
    return Sentence(_worst(not proven, bool(unmet)), f"{then}{tail}")


def _model(study: Study) -> tuple[str, bool]:
    """The state of the models in words, and whether all of them were compared with the spec's."""
    certificate, alone = study.certificate, len(study.runs) == 1
    if certificate is None:
        return "The model was not checked" if alone else "The models were not compared", False
    if not study.runs.keys() <= certificate.engines.keys():
        return "Not every engine's model was compared with the spec's", False
    model = "The engine has the spec's model" if alone else "The engines have the same model"
    if any(certificate.engines[name].approximations for name in study.runs):
        model += ", with approximations that the spec accepts"
    return model, True


def _worst(unchecked: bool, unmet: bool) -> str:
    return BAD if unmet else WARNING if unchecked else GOOD


def _when(body: object) -> float:
    first_out = getattr(body, "first_out", None)
    return float(first_out) if first_out is not None else float("inf")


def _models(study: Study) -> Iterator[Sentence]:
    certificate = study.certificate
    if certificate is None:
        yield Sentence(WARNING, "Models: not compared. There is no certificate for these runs.")
        return
    proven = [name for name in study.runs if name in certificate.engines and certificate.engines[name].valid]
    if proven:
        count = sum(check.count for name in proven for check in certificate.engines[name].checks)
        yield Sentence(GOOD, f"Models: proven equal to the spec in {listed(proven)}, by {count:,} comparisons.")
    yield from _unproven(study, certificate)
    for name, proof in certificate.engines.items():
        if name in study.runs and proof.approximations:
            features = listed(sorted(proof.approximations))
            yield Sentence(WARNING, f"Models: {name} differs from the spec as the spec accepts: {features}.")
        if name in study.runs and proof.declared.declared:
            yield Sentence(WARNING, f"Contact: {name}: {proof.declared.words}.")


def _unproven(study: Study, certificate: Certificate) -> Iterator[Sentence]:
    for name in study.runs:
        if name not in certificate.engines:
            yield Sentence(WARNING, f"Models: {name} was not checked; the certificate does not contain it.")
            continue
        failed = [check for check in certificate.engines[name].checks if not check.passed]
        if failed:
            named = ", ".join(f"{check.level} {check.name}" for check in failed[:MOST_FAILED])
            more = f" and {len(failed) - MOST_FAILED} more" if len(failed) > MOST_FAILED else ""
            yield Sentence(BAD, f"Models: {name} does not have the spec's model. Failed: {named}{more}.")


def _failures(study: Study) -> Iterator[Sentence]:
    for name, run in study.runs.items():
        if run.failed is not None:
            until = f" Its records end at {run.time[-1]:.4g} s." if run.recorded else ""
            yield Sentence(BAD, f"Run: {name} failed: {clipped(run.failed, LONGEST_REASON)}.{until}")
    for line in _not_physical(study):
        yield Sentence(BAD, f"Motion: not physical: {line}.")


def _not_physical(study: Study) -> list[str]:
    return together({name: run.unphysical for name, run in study.runs.items() if run.recorded})


def _differences(study: Study) -> Iterator[Sentence]:
    """The pairs that agree, and those that were not compared, in a sentence for each time up to which they were; the others
    each in one."""
    alike = sorted((diff for diff in study.diffs if diff.verdict == WITHIN), key=_reach)
    for (_, chaotic), group in itertools.groupby(alike, _reach):
        same = list(group)
        chaos = ", beyond which the engines' own noise has outgrown that" if chaotic else ""
        largest = max((diff.worst.position_largest for diff in same if diff.worst is not None), default=0.0)
        turned = max((diff.worst_angle.angle_largest for diff in same if diff.worst_angle is not None), default=0.0)
        until = f"until {same[0].compared_until:.4g} s{chaos}"
        text = f"Motion: within {tolerances(same[0])} of each other {until}: {_pairs(same)}."
        yield Sentence(GOOD, f"{text} Largest difference: {length(largest)}, {angle(turned)}.")
    nothing = [diff for diff in study.diffs if diff.verdict == INCONCLUSIVE and diff.not_compared]
    for given in dict.fromkeys(map(not_compared_words, nothing)):
        same = [diff for diff in nothing if not_compared_words(diff) == given]
        yield Sentence(WARNING, f"Motion: {_pairs(same)}: {given}.")
    for diff in study.diffs:
        if diff.verdict == INCONCLUSIVE and not diff.not_compared and (note := inconclusive_note(diff)) is not None:
            yield Sentence(WARNING, f"Motion: {note}.")
        if (out := diff.first_out) is not None:
            cause = {"contact": "after a contact", "free motion": "in free motion"}.get(out.cause, out.cause)
            noise = f"; the engines' own noise is then at most {length(out.floor)}" if out.floor is not None else ""
            yield Sentence(
                WARNING,
                f"Motion: {_pair(diff)} part at {_when(out):.4g} s, {cause}: {out.body} is the first to differ by more "
                f"than {length(diff.tolerance)} or {diff.angle_tolerance:g} rad ({out_words(out)}){noise}.",
            )


def _reach(diff: Diff) -> tuple[float, bool]:
    """How far two runs were compared, those that go furthest first, and whether chaos ended it."""
    return -diff.compared_until, diff.horizon is not None


def _pairs(diffs: Sequence[Diff]) -> str:
    return ", ".join(_pair(diff) for diff in diffs)


def _chaotic(diffs: Sequence[Diff]) -> bool:
    return any(diff.horizon is not None for diff in diffs)


def _pair(diff: Diff) -> str:
    return f"{diff.first.split()[0]} – {diff.second.split()[0]}"


def _expectations(study: Study) -> Iterator[Sentence]:
    outcomes = [(name, outcome) for name, outcomes in study.outcomes.items() for outcome in outcomes]
    if not outcomes:
        return
    failed = [(name, outcome) for name, outcome in outcomes if not outcome.passed]
    if not failed:
        yield Sentence(GOOD, f"Expectations: all {len(outcomes)} met.")
        return
    named = "; ".join(
        f"{outcome.kind} in {name} ({number(outcome.measured, outcome.unit)}, bound {number(outcome.bound, outcome.unit)})"
        for name, outcome in failed[:MOST_FAILED]
    )
    more = f"; and {len(failed) - MOST_FAILED} more" if len(failed) > MOST_FAILED else ""
    yield Sentence(BAD, f"Expectations: {len(failed)} of {len(outcomes)} failed: {named}{more}.")


def _repeats(study: Study) -> Iterator[Sentence]:
    same = [name for name, floor in study.floors.items() if floor.bitwise is True]
    other = [name for name, floor in study.floors.items() if floor.bitwise is False]
    without = [name for name, run in study.runs.items() if name not in study.floors and run.failed is None]
    if same:
        verb = "repeats" if len(same) == 1 else "repeat"
        yield Sentence(GOOD, f"Repeatability: {listed(same)} {verb} the run to the last bit.")
    if other:
        yield Sentence(WARNING, f"Repeatability: a repeated run gave other bits in {listed(other)}.")
    if without:
        yield Sentence(
            WARNING, f"Repeatability: not measured in {listed(without)}: noise and differences cannot be separated."
        )


def _speed(study: Study) -> Iterator[Sentence]:
    factors = {name: factor for name, run in study.runs.items() if (factor := run.cpu_factor) is not None}
    if factors:
        ordered = sorted(factors.items(), key=lambda item: -item[1])
        figures = ", ".join(f"{name} {factor:.3g}" for name, factor in ordered)
        yield Sentence(GOOD, f"Speed: simulated time over processor time of the steps: {figures}.")


# The page's program and style, made by npm and esbuild of ``page/src`` (``make page-bundle``).

LIBRARIES = ("three", "uplot")
"""Libraries that the program contains, each with its licence next to it."""


@dataclass(frozen=True)
class Bundle:
    """Script and style sheet, and the licences of the libraries in them, by name."""

    script: str
    style: str
    licences: dict[str, str]


@functools.cache
def bundle() -> Bundle:
    """The committed bundle. Raises FileNotFoundError where the installation is incomplete."""
    folder = resource_folder("page") / "bundle"
    read = {name: (folder / name).read_text(encoding="utf-8") for name in ("report.js", "report.css")}
    licences = {name: (folder / f"LICENSE-{name}.txt").read_text(encoding="utf-8") for name in LIBRARIES}
    return Bundle(read["report.js"], read["report.css"], licences)


# Sections: a study as a part of a page.

FACTS = ("engine_version", "simspec", "python_version", "numpy_version", "platform", "artifacts_sha256", "started")
"""Facts of a run's provenance that a page shows."""


@dataclass(frozen=True)
class Section:
    """One study on a page: ``scene`` is what its playback and plots are drawn from, None where no run recorded anything;
    ``charts``: plots of a study's figures (``page/src/data.ts``); ``description``: a sentence about it, or nothing.
    A page is named after the parts where it is not None, else after all."""

    name: str
    verdict: tuple[Sentence, ...]
    notes: tuple[str, ...]
    certificate: tuple[Table, ...]
    certificate_notes: tuple[str, ...]
    results: tuple[Table, ...]
    details: tuple[Table, ...]
    provenance: Table
    scene: dict[str, Any] | None
    caption: str
    charts: tuple[dict[str, Any], ...] = ()
    description: str | None = None
    remarks: tuple[Sentence, ...] = ()
    """Further sentences, below the playback."""


def section(stored: StoredStudy, packed: PackedNumbers) -> Section:
    """A study as a part of a page; its numbers go into ``packed``."""
    study = stored.study
    shown = [run for run in study.runs.values() if run.recorded]
    scene, caption = None, ""
    if shown:
        frames = choose_frames(study.world, shown)
        scene = scene_data(study.world, shown, frames, packed)
        scene["plots"] = [chart.data(packed) for chart in charts(study, shown, frames)]
        caption = _caption(frames, shown, scene)
    certificate = study.certificate
    notes = [*stored.notes, *(note for diff in study.diffs for note in diff.notes)]
    return Section(
        name=visible(study.world.name),
        verdict=tuple(short_verdict(stored)),
        remarks=tuple(remarks(study)),
        notes=tuple(map(visible, dict.fromkeys(notes))),
        certificate=tuple(certificate_tables(certificate)) if certificate is not None else (),
        certificate_notes=tuple(map(visible, certificate_notes(certificate))) if certificate is not None else (),
        results=tuple(
            table
            for table in (
                differences.matrix(study.diffs),
                not_run_table(stored.left_out),
                results(study.runs),
                expectations(study.outcomes),
                differences.repeatability(study.floors),
                differences.differences(study.diffs),
                final_table(study.runs, shown_of(next(iter(study.runs.values())))),
            )
            if table is not None
        ),
        details=tuple(part for diff in study.diffs for part in differences.diff_tables(diff)),
        provenance=_provenance(stored),
        scene=scene,
        caption=caption,
    )


def _caption(frames: ShownFrames, runs: list[Run], scene: dict[str, Any]) -> str:
    """How what is drawn differs from what was computed."""
    parts = [
        f"Drawn positions are rounded to {1e3 * frames.step:.2g} mm; every figure and plot is computed from the runs."
    ]
    if len(runs) > 1:
        parts.append(
            "Overlaid, what is at the same place has one mixed, greyish colour; differences may be drawn larger than they are, "
            "from the first engine shown."
        )
    if frames.every > 1:
        parts.append(f"Plots and playback show every {frames.every}th record.")
    if not all(is_drawn(shape) for body in runs[0].world.bodies for shape in body.shapes):
        parts.append(f"Shapes of more than {FARTHEST:g} m are not drawn.")
    if frames.beyond:
        parts.append("Bodies that leave the scene are drawn at its edge.")
    forces = [(run["forces"], run["engine"]) for run in scene["runs"] if run["forces"] is not None]
    if forces:
        largest = max(local["largest"] for local, _ in forces)
        seldom = max(local["every"] for local, _ in forces)
        when = "" if seldom == 1 else f", drawn for every {seldom}th frame or more"
        parts.append(f"Bars are contact forces, as long as their square roots (longest: {largest:.3g} N){when}.")
    if scene["ghost"] is not None:
        parts.append("The grey ghost is where the targets of the driven joints would have their bodies.")
    for run, count in zip(runs, frames.shown, strict=True):
        if count < len(frames.rows):
            parts.append(f"{run.engine} stays where its records end, at {run.time[frames.rows[count - 1]]:.4g} s.")
    return visible(" ".join(parts))


def _provenance(stored: StoredStudy) -> Table:
    """The provenance of the runs, from which they can be repeated."""
    study = stored.study
    rows = Table("Provenance", "", *study.runs)
    for fact in FACTS:
        values = [run.provenance.get(fact) for run in study.runs.values()]
        if any(value is not None for value in values):
            rows.add(fact.replace("_", " "), *("–" if value is None else str(value) for value in values))
    settings = [run.provenance.get("settings") or {} for run in study.runs.values()]
    rows.add(
        "settings", *("\n".join(f"{name}: {value}" for name, value in setting.items()) or "–" for setting in settings)
    )
    rows.add("steps", *(str(run.provenance.get("steps", "–")) for run in study.runs.values()))
    rows.add("timestep", *(f"{run.world.physics.timestep:g} s" for run in study.runs.values()))
    rows.add("world sha256", *[sha256(study.world)] * len(study.runs))
    return rows


TEMPLATE = "page/report.html.j2"
MARK = "<!-- made by simspec -->"
"""The beginning of a page, after its doctype."""
MOST_STUDIES = 6
"""Browsers draw in some eight places at most."""
_ESCAPED = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


Part = StoredStudy | Section | Callable[[PackedNumbers], Sequence[Section]]
"""A stored study, a part that was made already, or what makes parts whose numbers go into the page's."""


def page(studies: Sequence[Part]) -> str:
    """The report of some studies, or of parts that were made already, as one HTML file. The same studies give the same text.

    Raises SpecError where there are more than ``MOST_STUDIES``.
    """
    if not 0 < len(studies) <= MOST_STUDIES:
        message = f"a page has 1 to {MOST_STUDIES} studies"
        raise SpecError([Problem(message, found=str(len(studies)), hint="write several pages")])
    packed = PackedNumbers()
    sections: list[Section] = []
    for stored in studies:
        if isinstance(stored, Section):
            sections.append(stored)
        else:
            sections += [section(stored, packed)] if isinstance(stored, StoredStudy) else stored(packed)
    if sum(part.scene is not None for part in sections) > MOST_STUDIES:
        raise SpecError([Problem(f"a page plays at most {MOST_STUDIES} studies back", hint="write several pages")])
    return _text(sections, packed)


def is_page(content: bytes) -> bool:
    """Whether simspec wrote this page."""
    return MARK.encode() in content[:200]


def _text(sections: Sequence[Section], packed: PackedNumbers) -> str:
    made = bundle()
    script, style = _inside("script", made.script), _inside("style", made.style)
    policy = (
        f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; base-uri 'none'; form-action 'none'"
    )
    scenes = [part.scene for part in sections if part.scene is not None]
    named = [part for part in sections if part.description is not None] or sections
    numbers, places = itertools.count(), itertools.count()
    return str(
        environment()
        .get_template(TEMPLATE)
        .render(
            mark=Markup(MARK),
            policy=policy,
            style=Markup(style),
            script=Markup(script),
            title=" and ".join(dict.fromkeys(part.name for part in named)),
            descriptions=list(dict.fromkeys(part.description for part in named if part.description)),
            parts=[
                (part, next(numbers) if part.scene is not None else None, next(places) if part.charts else None)
                for part in sections
            ],
            scenes=Markup(_json({"scenes": scenes, "charts": [part.charts for part in sections if part.charts]})),
            packed=Markup(_json(packed.entries)),
            licences=made.licences,
            html=html_data,
        )
    )


def _json(value: Any) -> str:
    """JSON that ends no script element, whatever its strings are."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False).translate(_ESCAPED)


def _inside(element: str, text: str) -> str:
    """A program or style that can stand in its element. Raises ValueError where it would end that."""
    if f"</{element}" in text.lower() or "<!--" in text:
        raise ValueError(f"the bundle contains what ends a {element} element")
    return text


def _hash(text: str) -> str:
    """A source expression of a content security policy for exactly this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
