"""docs/records/corpora.md: the outcome of every file, and the state of the aims."""

from __future__ import annotations

import collections
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from defects import DEFECTS, RULE, SDF_RULE
from findings import remark
from models import ENGINE_DEADLINE, ENGINES, Model
from refusals import why
from run import STAGES, stored

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "records" / "corpora.md"
SAME = 1e-9
"""Largest relative deviation of an imported MJCF file's dynamics from the original's."""
AIMS = {"mujoco": 98.0, "pybullet": 95.0, "dart": 95.0}
"""Per cent of imported URDF files that are to be certified."""
MARKS = {"certified": "yes", "apart": "without", "fails": "**no**", "refused": "–", "not tried": "·"}
RESTORED = "restored from docs/records/corpora.md"
"""In place of a state of the code: a verdict from this page, of which no more was kept."""
NO_SELF_COLLISION = "without contact between its own bodies"
MOST = 40
"""Reasons of refusals that are listed."""


@dataclass(frozen=True)
class File:
    """A file, and the answer of each stage (None: not tried). ``no_self_collision``: without contact between the
    model's own bodies, in the engines that refuse it otherwise."""

    model: Model
    imported: dict[str, Any] | None
    certified: dict[str, Any] | None
    no_self_collision: dict[str, Any] | None
    audited: dict[str, Any] | None
    defects: tuple[str, ...] = ()

    @property
    def is_imported(self) -> bool:
        return bool(self.imported and self.imported.get("imported"))

    @property
    def is_whole(self) -> bool:
        """Whether it is imported without a loss of physics."""
        return self.is_imported and not (self.imported or {})["losses"]["physics"]

    @property
    def proofs(self) -> dict[str, dict[str, Any]]:
        """Its proofs by engine; empty for a file that is not imported, or no longer."""
        proven = (self.certified or {}).get("proven") if self.is_imported else None
        return {entry["engine"]: entry for entry in proven or ()}

    @property
    def proofs_without_self_collision(self) -> dict[str, dict[str, Any]]:
        """Its proofs without contact between its own bodies, in engines that refuse it otherwise."""
        proven = (self.no_self_collision or {}).get("proven") or () if self.is_imported else ()
        return {
            entry["engine"]: entry
            for entry in proven
            if self.proofs.get(entry["engine"], {"valid": 0})["valid"] is None
        }

    def verdict(self, engine: str) -> str:
        """The verdict of the proof in an engine: one of ``VERDICTS``."""
        if engine not in self.proofs:
            return "not tried"
        valid = self.proofs[engine]["valid"]
        if valid is None:
            valid = self.proofs_without_self_collision.get(engine, {"valid": None})["valid"]
            return {True: "apart", False: "fails", None: "refused"}[valid]
        return "certified" if valid else "fails"

    @property
    def audits(self) -> dict[str, dict[str, Any]]:
        """Results of the audit by engine."""
        return {answer["engine"]: answer for answer in (self.audited or {}).get("audited") or ()}


def write(models: Sequence[Model], results: Path) -> None:
    """Write the page from all results."""
    files = [
        File(
            model,
            *(stored(results, stage, model) for stage in STAGES),
            tuple(DEFECTS[model.language](model.path, model.root)) if model.language in DEFECTS else (),
        )
        for model in sorted(models, key=lambda model: (model.package, model.name))
    ]
    files = [file for file in files if file.imported is not None]
    engines = [name for name in ENGINES if any(name in file.proofs or name in file.audits for file in files)]
    parts = (
        head(files, engines),
        aims(files),
        proofs(files, engines),
        audits(files, engines),
        originals(files),
        refused(files),
        table(files, engines),
    )
    PAGE.write_text("\n".join(line for part in parts for line in part) + "\n", encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(files)} files")


def head(files: Sequence[File], engines: Sequence[str]) -> Iterator[str]:
    answers = [
        answer
        for file in files
        for answer in (file.imported, file.certified, file.no_self_collision, file.audited)
        if answer
    ]
    states = {code for entry in answers for code in (entry["code"], *entry.get("older", ()))}
    requested = {stage: sum(getattr(file, stage) is not None for file in files) for stage in ("certified", "audited")}
    early = sum(code == RESTORED for entry in answers for code in (entry["code"], *entry.get("older", ())))
    restored = f"; {early} of them are verdicts of an earlier page, of states not kept" if early else ""
    states.discard(RESTORED)
    yield "# Robot files of other packages"
    yield ""
    yield "> With this page you can see how many robot files of published packages simspec imports and proves."
    yield ""
    yield "<!-- generated by tools/corpora: make corpora -->"
    yield ""
    yield (
        f"{len(files)} files of {len({file.model.package for file in files})} packages that pip installs. Each is imported; "
        f"its compiled files are certified in {', '.join(engines[:-1])} and {engines[-1]} (levels L0 to L4 and L6; "
        f"not in simspec's other engines), of which {requested['certified']} "
        f"of {sum(file.is_imported for file in files)} imported files were tried so far{_left(files)}; and each file itself is "
        f"[audited](../guide/audit.md), of which {requested['audited']} were. "
        "Tried files are spread over packages and languages. "
        f"`make corpora` goes on where it stopped. The answers are of {len(states)} states of simspec's code, from several "
        "days: repairs count only in files that were tried again (`--anew`, `--failed`). The answers are stored in "
        f"[corpora.json.gz](corpora.json.gz){restored}."
    )
    yield ""
    yield "| language | files | imported | without loss of physics | refused by name | no answer | not read yet |"
    yield "|---|---|---|---|---|---|---|"
    for language in sorted({file.model.language for file in files}):
        in_language = [file for file in files if file.model.language == language]
        kinds = collections.Counter(_kind(file) for file in in_language)
        whole = sum(file.is_whole for file in in_language)
        cells = (
            language,
            len(in_language),
            kinds["imported"],
            whole,
            kinds["refused"],
            kinds["failed"],
            kinds["unread"],
        )
        yield f"| {' | '.join(map(str, cells))} |"


def _left(files: Sequence[File]) -> str:
    """Numbers of bodies of the imported files that no engine has tried."""
    bodies = [(file.imported or {})["bodies"] for file in files if file.is_imported and file.certified is None]
    return f" (the others have {min(bodies)} to {max(bodies)} bodies)" if bodies else ""


def _kind(file: File) -> str:
    answer = file.imported or {}
    if any(word in answer for word in ("late", "died", "crash")):
        return "failed"
    return {True: "imported", False: "refused"}.get(answer.get("imported"), "unread")  # type: ignore[arg-type]


def aims(files: Sequence[File]) -> Iterator[str]:
    sound = [file for file in files if file.model.language == "urdf" and not file.defects]
    yield ""
    yield "## Aims"
    yield ""
    yield " ".join(RULE.split())
    yield ""
    yield " ".join(SDF_RULE.split())
    yield ""
    yield "| aim | of | measured | |"
    yield "|---|---|---|---|"
    yield _aim("URDF without hard defect is imported", 98.0, sum(file.is_imported for file in sound), len(sound))
    for engine, wanted in AIMS.items():
        requested = [file for file in sound if file.is_imported and engine in file.proofs]
        counts = collections.Counter(file.verdict(engine) for file in requested)
        excluded = f"{counts['no_self_collision']} of them {NO_SELF_COLLISION}, " if counts["apart"] else ""
        left = sum(file.verdict(engine) == "refused" and file.no_self_collision is None for file in requested)
        untried = f" ({left} of these not tried yet {NO_SELF_COLLISION})" if left else ""
        reasons = _features(requested, engine)
        more = f"{excluded}{counts['refused']} not supported and so named{untried}{reasons}, {counts['fails']} failed"
        certified = counts["certified"] + counts["apart"]
        yield _aim(f"of those that were tried, certified in {engine}", wanted, certified, len(requested), more)
    loaded = [file for file in files if file.model.language == "mjcf" and _loads(file)]
    yield _aim(
        "MJCF that MuJoCo loads, with bodies, without loss of physics",
        93.0,
        sum(file.is_whole for file in loaded),
        len(loaded),
        f"{sum(file.is_imported for file in loaded)} imported",
    )
    for language, wanted, of in (("sdf", 20, 23), ("usd", 68, 75)):
        in_language = [file for file in files if file.model.language == language]
        ruled = " without hard defect" if language in DEFECTS else ""
        requested = [file for file in in_language if not file.defects]
        repaired = sum(bool((file.imported or {}).get("repaired")) for file in in_language)
        more = [f"{repaired} more of all {len(in_language)} with rules of repair"] if repaired else []
        if ruled:
            more.insert(0, f"{len(in_language) - len(requested)} of {len(in_language)} have a hard defect")
        count = sum(file.is_imported for file in requested)
        what = f"{language.upper()}{ruled} is imported"
        yield _aim(what, 100.0 * wanted / of, count, len(requested), ", ".join(more))


def _features(files: Sequence[File], engine: str) -> str:
    """Missing features of files that an engine refuses, if stored: the first feature of each file."""
    counts: collections.Counter[str] = collections.Counter()
    for file in files:
        if file.verdict(engine) == "refused":
            why = file.proofs_without_self_collision.get(engine, file.proofs[engine])["why"]
            counts.update(re.findall(r"does not support ([\w.]+)", why)[:1])
    listed = ", ".join(f"{name} {count}" for name, count in counts.most_common(4))
    return f" ({listed})" if listed else ""


def _loads(file: File) -> bool:
    answer = file.imported or {}
    return bool(answer.get("loads") and answer.get("original_bodies"))


def _aim(what: str, wanted: float, count: int, total: int, more: str = "") -> str:
    measured = f"{100.0 * count / total:.1f} % ({count} of {total})" if total else "not measured"
    return f"| {what} | ≥ {wanted:.0f} % | {measured} | {more} |"


def proofs(files: Sequence[File], engines: Sequence[str]) -> Iterator[str]:
    yield ""
    yield "## What simspec compiles"
    yield ""
    count = sum(file.no_self_collision is not None for file in files)
    yield (
        "Features that an engine approximates, or that simspec adds to it, are accepted here. Of a file that an engine refuses "
        f"the same model {NO_SELF_COLLISION} (`contact.self_collision: false`, or `--no-self-collision`) is certified in "
        f"that engine, if self-collision is the missing feature; so far tried with {count} files. An engine has "
        f"{ENGINE_DEADLINE:g} s for a file, and had 60 in some earlier verdicts."
    )
    yield ""
    yield f"| engine | certified | certified {NO_SELF_COLLISION} | fails its proof | not supported, by name | not tried yet |"
    yield "|---|---|---|---|---|---|"
    for engine in engines:
        counts = collections.Counter(file.verdict(engine) for file in files if file.is_imported)
        kinds = ("certified", "apart", "fails", "refused", "not tried")
        yield f"| {engine} | {' | '.join(str(counts[kind]) for kind in kinds)} |"
    yield ""
    yield "Every proof that fails, none of them in silence: `simspec verify` prints these reasons, and ends with exit code 1."
    yield ""
    for file in files:
        for requested, answer, among in (
            ("", file.certified, file.proofs),
            (f", {NO_SELF_COLLISION}", file.no_self_collision, file.proofs_without_self_collision),
        ):
            for engine, proof in among.items():
                if proof["valid"] is False:
                    name, why = file.model.name, _cell(proof["why"])
                    text = remark(engine, name, why, (answer or {})["code"] == RESTORED)
                    yield f"- {engine}, {file.model.package} `{name}`{requested}: {why[:200]}{text}"
        for answer in (file.certified or {}, file.no_self_collision or {}) if file.is_imported else ():
            for word in ("late", "died", "crash", "again"):
                if word in answer:
                    yield f"- {file.model.package} `{file.model.name}`: {_ended(word, answer)}"


def _ended(word: str, answer: dict[str, Any]) -> str:
    last = answer["crash"].strip().splitlines()[-1][:120] if word == "crash" else ""
    texts = {"late": "no answer in time", "died": "the process died", "crash": f"an error: {last}"}
    return texts.get(word, "failed before a repair, not repeated yet")


def audits(files: Sequence[File], engines: Sequence[str]) -> Iterator[str]:
    yield ""
    yield "## The same files as engines load them by themselves"
    yield ""
    yield "| engine | as the file says | another model, in silence | refuses | dies |"
    yield "|---|---|---|---|---|"
    causes: dict[str, collections.Counter[str]] = {}
    for engine in engines:
        counts = collections.Counter(_audit(file.audits[engine]) for file in files if engine in file.audits)
        yield f"| {engine} | {counts['same']} | {counts['other']} | {counts['refuses']} | {counts['dies']} |"
        causes[engine] = collections.Counter(
            name for file in files if engine in file.audits for name in file.audits[engine]["silent"] if name != "file"
        )
    yield ""
    yield "Differences, by the number of files:"
    yield ""
    for engine, counter in causes.items():
        listed = ", ".join(f"{name} {number}" for name, number in counter.most_common(12))
        yield f"- {engine}: {listed or 'nothing'}"


def _audit(audit: dict[str, Any]) -> str:
    if not audit["loaded"]:
        return "dies" if audit["died"] else "refuses"
    return "other" if audit["silent"] else "same"


def originals(files: Sequence[File]) -> Iterator[str]:
    measured, unmeasured = [], []
    for file in files:
        deviations = (file.imported or {}).get("deviations")
        if isinstance(deviations, list):
            measured.append((max(deviations), file))
        elif deviations is not None:
            unmeasured.append((deviations, file))
    yield ""
    yield "## Imported MJCF against MuJoCo's own compiled model"
    yield ""
    close = sum(worst <= SAME for worst, _ in measured)
    largest = max((worst for worst, _ in measured if worst <= SAME), default=0.0)
    yield (
        f"Mass matrix, bias force, passive force and the place of every body in 3 random states: of {len(measured)} files "
        f"that move, {close} are equal to {SAME:g} (the largest deviation of these is {largest:.1e})."
    )
    yield ""
    for worst, file in sorted(measured, key=lambda entry: -entry[0]):
        if worst > SAME:
            deviations = ", ".join(
                f"{name} {value:.1e}"
                for name, value in zip(
                    ("M", "bias", "passive", "place"), (file.imported or {})["deviations"], strict=True
                )
            )
            lost = "; loses physics, and says so" if not file.is_whole else ""
            yield f"- {file.model.package} `{file.model.name}`: {deviations}{lost}"
    for text, file in unmeasured:
        yield f"- {file.model.package} `{file.model.name}`: not compared: {_cell(text)[:150]}"


def refused(files: Sequence[File]) -> Iterator[str]:
    counts: collections.Counter[tuple[str, str]] = collections.Counter()
    for file in files:
        counts.update((file.model.language, text) for text in why(file.imported or {}))
    yield ""
    yield "## Refused, by reason"
    yield ""
    yield "| language | files | reason |"
    yield "|---|---|---|"
    for (language, text), number in counts.most_common(MOST):
        yield f"| {language} | {number} | {_cell(text)} |"


def table(files: Sequence[File], engines: Sequence[str]) -> Iterator[str]:
    names = ", ".join(engines)
    yield ""
    yield "## File by file"
    yield ""
    yield (
        "`hard defect`: of URDF and SDF, by the rules above. `certified` and `audit` have one entry for each engine, in the "
        f"order {names}: yes, without ({NO_SELF_COLLISION}), **no**, – (not supported, by name; the engine does not read the "
        "language), · (not tried yet); "
        "audit: how many values an engine changes, drops or adds in silence, or that it refuses the file or dies. `s`: import, "
        "certify, audit, each with what earlier files left in the cache, on a busy machine; empty: not tried yet."
    )
    yield ""
    yield "| package | file | import | hard defect | certified | audit | s |"
    yield "|---|---|---|---|---|---|---|"
    for file in files:
        certified = " ".join(MARKS[file.verdict(name)] for name in engines)
        audited = " ".join(_number(file.audits.get(name)) for name in engines)
        seconds = " ".join(_seconds(answer) for answer in (file.imported, file.certified, file.audited))
        cells = (
            file.model.package,
            file.model.name.removeprefix("cmeel.prefix/share/"),
            _import(file),
            ", ".join(file.defects),
            certified if file.proofs else "",
            audited if file.audits else "",
            seconds.strip(),
        )
        yield f"| {' | '.join(map(_cell, cells))} |"


def _import(file: File) -> str:
    answer = file.imported or {}
    if _kind(file) == "unread":
        return "no importer yet"
    if file.is_imported:
        lost = answer["losses"]["physics"]
        return f"loses {lost} of physics" if lost else "whole"
    texts = why(answer)
    more = f" (and {len(texts) - 1} more)" if len(texts) > 1 else ""
    return f"refused: {texts[0][:100] if texts else ''}{more}"


def _number(audit: dict[str, Any] | None) -> str:
    if audit is None:
        return "–"
    return str(sum(audit["silent"].values())) if audit["loaded"] else _audit(audit)


def _seconds(answer: dict[str, Any] | None) -> str:
    seconds = (answer or {}).get("seconds", (answer or {}).get("late"))
    return "" if seconds is None else f"{seconds:.1f}" if seconds < 10.0 else f"{seconds:.0f}"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "/").replace("<", "&lt;")
