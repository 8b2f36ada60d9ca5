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
from simspec.report import differences
from simspec.report.certificate import certificate_notes, certificate_tables
from simspec.report.page.curves import charts
from simspec.report.page.packing import FARTHEST, Frames, Packed, choose_frames
from simspec.report.page.playback import is_drawn, scene_data
from simspec.report.page.words import Sentence, verdict
from simspec.report.problems import not_run_table
from simspec.report.stored_study import StoredStudy, world_hash
from simspec.report.studies import expectations, final_table, results, shown_of
from simspec.report.table import Table, html_data
from simspec.runner.run import Run

# The page's program and style, as npm and esbuild made them of ``page/src`` (``make page-bundle``).

LIBRARIES = ("three", "uplot")
"""What the program contains of others, each with its licence beside it."""


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


# One study as a part of a page.

FACTS = ("engine_version", "simspec", "python_version", "numpy_version", "platform", "artifacts_sha256", "started")
"""What a run says of itself that is shown, each under its own name."""


@dataclass(frozen=True)
class Section:
    """One study on a page: ``scene`` is what its playback and plots are drawn from, None where no run recorded anything;
    ``charts``: plots of a study's figures (``page/src/data.ts``); ``description``: what it shows, in a sentence, or nothing.
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


def section(stored: StoredStudy, packed: Packed) -> Section:
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
    return Section(
        name=visible(study.world.name),
        verdict=tuple(verdict(study)),
        notes=tuple(
            map(visible, dict.fromkeys([*stored.notes, *(note for diff in study.diffs for note in diff.notes)]))
        ),
        certificate=tuple(certificate_tables(certificate)) if certificate is not None else (),
        certificate_notes=tuple(map(visible, certificate_notes(certificate))) if certificate is not None else (),
        results=tuple(
            table
            for table in (
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


def _caption(frames: Frames, runs: list[Run], scene: dict[str, Any]) -> str:
    """How what is drawn differs from what was computed."""
    parts = [
        f"Drawn positions are rounded to {1e3 * frames.step:.2g} mm; every figure and plot is computed from the runs."
    ]
    if len(runs) > 1:
        parts.append("Overlaid, what is at the same place has one mixed, greyish colour.")
    if frames.every > 1:
        parts.append(f"Plots and playback show every {frames.every}th record.")
    if not all(is_drawn(shape) for body in runs[0].world.bodies for shape in body.shapes):
        parts.append(f"Shapes of more than {FARTHEST:g} m are not drawn.")
    if frames.beyond:
        parts.append("Bodies that leave the scene are drawn at its edge.")
    forces = [(run["forces"], run["engine"]) for run in scene["runs"] if run["forces"] is not None]
    if forces:
        largest = max(own["largest"] for own, _ in forces)
        seldom = max(own["every"] for own, _ in forces)
        when = "" if seldom == 1 else f", drawn for every {seldom}th frame or more"
        parts.append(f"Bars are contact forces, as long as their square roots (longest: {largest:.3g} N){when}.")
    if scene["ghost"] is not None:
        parts.append("The grey ghost is where the targets of the driven joints would have their bodies.")
    for run, count in zip(runs, frames.shown, strict=True):
        if count < len(frames.rows):
            parts.append(f"{run.engine} stays where its records end, at {run.time[frames.rows[count - 1]]:.4g} s.")
    return visible(" ".join(parts))


def _provenance(stored: StoredStudy) -> Table:
    """Where the runs came from: what it takes to do them again."""
    study = stored.study
    rows = Table("Provenance", "", *study.runs)
    for fact in FACTS:
        values = [run.provenance.get(fact) for run in study.runs.values()]
        if any(value is not None for value in values):
            rows.add(fact.replace("_", " "), *("–" if value is None else str(value) for value in values))
    settings = [run.provenance.get("settings") or {} for run in study.runs.values()]
    rows.add("settings", *("\n".join(f"{name}: {value}" for name, value in own.items()) or "–" for own in settings))
    rows.add("steps", *(str(run.provenance.get("steps", "–")) for run in study.runs.values()))
    rows.add("timestep", *(f"{run.world.physics.timestep:g} s" for run in study.runs.values()))
    rows.add("world sha256", *(world_hash(study) for _ in study.runs))
    return rows


TEMPLATE = "page/report.html.j2"
MARK = "<!-- made by simspec -->"
"""What a page begins with, after its doctype."""
MOST_STUDIES = 6
"""Browsers draw in some eight places at most."""
_ESCAPED = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


Part = StoredStudy | Section | Callable[[Packed], Sequence[Section]]
"""A stored study, a part that was made already, or what makes parts whose numbers go into the page's."""


def page(studies: Sequence[Part]) -> str:
    """The report of some studies, or of parts that were made already, as one HTML file. The same studies give the same text.

    Raises SpecError where there are more than ``MOST_STUDIES``.
    """
    if not 0 < len(studies) <= MOST_STUDIES:
        message = f"a page has 1 to {MOST_STUDIES} studies"
        raise SpecError([Problem(message, found=str(len(studies)), hint="write several pages")])
    packed = Packed()
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


def _text(sections: Sequence[Section], packed: Packed) -> str:
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
