"""The page: one HTML file, whose content security policy lets it load nothing, and run its own program alone."""

from __future__ import annotations

import base64
import functools
import hashlib
import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from simspec.errors import Problem, SpecError, visible
from simspec.files import resource_folder
from simspec.formats.kit.text import environment
from simspec.meshes.drawn import surfaces as surfaces_of
from simspec.report import differences
from simspec.report.certificate import certificate_notes, certificate_tables
from simspec.report.page.model import loads_note
from simspec.report.page.packing import FARTHEST, PackedNumbers, ShownFrames, choose_frames
from simspec.report.page.playback import charts, scene_data
from simspec.report.page.sentences import Sentence, remarks, short_verdict
from simspec.report.page.shapes import Surfaces, is_drawn, surfaces_note
from simspec.report.problems import not_run_table
from simspec.report.studies import StoredStudy, expectations, final_table, results, shown_of
from simspec.report.table import Table, html_data
from simspec.runner.run import Run
from simspec.world.canonical import sha256

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


CHARTS_NOTE = (
    "Bars are intervals of the mean (95 %), small dots single processes, dashed lines with hollow points figures from "
    "elsewhere. Plots over the same axis are linked: drag or press arrow keys; double-click or Escape: all of it; a click "
    "in the legend hides a line."
)


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
    provenance: Table | None
    scene: dict[str, Any] | None
    caption: str
    charts: tuple[dict[str, Any], ...] = ()
    charts_note: str = CHARTS_NOTE
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
        surfaces = surfaces_of(study.world)
        scene = scene_data(study.world, shown, frames, packed, surfaces)
        scene["plots"] = [chart.data(packed) for chart in charts(study, shown, frames)]
        caption = _caption(frames, shown, scene, surfaces)
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


def _caption(frames: ShownFrames, runs: list[Run], scene: dict[str, Any], surfaces: Surfaces) -> str:
    """How what is drawn differs from what was computed."""
    parts = [
        f"Drawn positions are rounded to {1e3 * frames.step:.2g} mm; every figure and plot is computed from the runs."
    ]
    if len(runs) > 1:
        parts.append(
            "Overlaid, each engine has one colour, and bodies at the same place a mixed, greyish one; with own colours, the "
            "first engine shown has those of its bodies, and the others are seen where they differ from it. Differences may be "
            "drawn larger than they are, from the first engine shown."
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
    if (fewer := surfaces_note(surfaces)) is not None:
        parts.append(fewer)
    if (arrows := loads_note(runs[0].world)) is not None:
        parts.append(arrows)
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


def page(studies: Sequence[Part], kind: str = "report") -> str:
    """The report of some studies, or of parts that were made already, as one HTML file. The same studies give the same text.
    ``kind``: the word that its title ends with.

    Raises SpecError where there are more than ``MOST_STUDIES``.
    """
    if not 0 < len(studies) <= MOST_STUDIES:
        message = f"a page has 1 to {MOST_STUDIES} studies"
        raise SpecError([Problem(message, found=str(len(studies)), hint="write several pages", code="R108")])
    packed = PackedNumbers()
    sections: list[Section] = []
    for stored in studies:
        if isinstance(stored, Section):
            sections.append(stored)
        else:
            sections += [section(stored, packed)] if isinstance(stored, StoredStudy) else stored(packed)
    if sum(part.scene is not None for part in sections) > MOST_STUDIES:
        raise SpecError(
            [Problem(f"a page plays at most {MOST_STUDIES} studies back", hint="write several pages", code="R108")]
        )
    return _text(sections, packed, kind)


def is_page(content: bytes) -> bool:
    """Whether simspec wrote this page."""
    return MARK.encode() in content[:200]


def _text(sections: Sequence[Section], packed: PackedNumbers, kind: str) -> str:
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
            kind=kind,
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
