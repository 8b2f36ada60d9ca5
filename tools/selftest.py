"""Runs the complete self-test and puts its tables into docs/records/self-test.md.

``python tools/selftest.py [ENGINE ...] [--world NAME ...] [--go-on]``: with engines or worlds named, only theirs are made anew;
with ``--go-on`` what a run that was stopped has left, what missed something, and what is kept of another version. Results are
kept by engine and world, each with the version of the engine and the date. Printed are missed changes, and declarations of
something inert that no change needs; exits 1 when a change was missed, and the table says so.
"""

from __future__ import annotations

import argparse
import datetime
import gzip
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from packaging.version import Version

from simspec.engines.kit.registry import engines, find_engine, version_of
from simspec.project import load_project
from simspec.proof.complete import CompleteTest, Verdict, complete_self_test
from simspec.report.certificate import COLUMNS, inert_reasons

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "self-test.md"
RESULTS = ROOT / "docs" / "records" / "selftest.json.gz"
BEGIN, END = "<!-- complete self-test: made by tools/selftest.py -->", "<!-- end of complete self-test -->"
Results = dict[str, dict[str, dict[str, Any]]]
"""By engine and world: ``version``, ``date``, ``seconds``; ``rows``: counts by kind of change; ``inert``: counts by reason."""


def of_world(version: str, verdicts: Sequence[Verdict], seconds: float) -> dict[str, Any]:
    """The stored result of a world in an engine."""
    found = CompleteTest(tuple(verdicts))
    return {
        "version": version,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "seconds": round(seconds),
        "rows": {kind: dict(zip(COLUMNS, counts, strict=True)) for _, kind, counts in found.rows()},
        "inert": {why: count for _, why, count in inert_reasons(found)},
    }


def interpreters() -> dict[str, str]:
    """By label. An engine that this interpreter lacks has its name, too: for the newest environment ``NAME@VERSION``."""
    labelled = dict(load_project().known_interpreters())
    versions = {label: Version(label.partition("@")[2]) for label in labelled if "@" in label}
    newest = {label.partition("@")[0]: labelled[label] for label in sorted(versions, key=versions.__getitem__)}
    return {name: python for name, python in newest.items() if find_engine(name).version() is None} | labelled


def measure(engine: str, worlds: Sequence[str], results: Results, go_on: bool = False) -> None:
    """Test ``worlds`` (none named: all) in an engine, and write each as soon as it is done. ``go_on``: but those that are kept
    of this version of it, with nothing missed."""
    kept = results.setdefault(engine, {})
    pythons = interpreters()
    version = str(version_of(engine, pythons.get(engine)))
    sound = {
        world for world, entry in kept.items() if entry["version"] == version and not entry["rows"]["all"]["missed"]
    }
    done = sound if go_on else set()

    def keep(world: str, verdicts: Sequence[Verdict], seconds: float) -> None:
        kept[world] = of_world(version, verdicts, seconds)
        write(results)
        for verdict in verdicts:
            if verdict.verdict == "missed":
                print(
                    "MISSED",
                    engine,
                    world,
                    verdict.file,
                    verdict.place,
                    verdict.kind,
                    verdict.change,
                    verdict.why,
                    sep="  ",
                    flush=True,
                )

    found = complete_self_test(
        [engine],
        worlds=worlds,
        done=done,
        progress=lambda line: print(line, flush=True),
        keep=keep,
        pythons=pythons,
    )
    for row in found.unused.get(engine, ()):
        print("NOT NEEDED", engine, row, sep="  ")
    if not worlds:
        tried = {verdict.world for verdict in found.verdicts}
        results[engine] = {world: entry for world, entry in kept.items() if world in tried | done}
        write(results)


def summed(results: Results, engine: str) -> dict[str, Counter[str]]:
    """The counts of an engine by kind of change, over its worlds; that of all kinds last."""
    sums: dict[str, Counter[str]] = {}
    for entry in results[engine].values():
        for kind, counts in entry["rows"].items():
            sums.setdefault(kind, Counter()).update(counts)
    return {kind: sums[kind] for kind in (*(kind for kind in sums if kind != "all"), "all")}


def page_table(results: Results) -> str:
    """The tables of the page: a row for each engine and world, for each engine and kind of change, and why inert things are."""
    lines = _head("engine", "world", "date", "s", *COLUMNS, left=3)
    for engine, worlds in results.items():
        for record, entry in worlds.items():
            lines.append(
                _row(
                    f"{engine} {entry['version']}",
                    record,
                    entry["date"],
                    entry["seconds"],
                    *_counts(entry["rows"]["all"]),
                )
            )
    lines += _head("engine", "change", *COLUMNS, left=2)
    for engine in results:
        for kind, counts in summed(results, engine).items():
            lines.append(_row(f"**{engine}**" if kind == "all" else engine, kind, *_counts(counts)))
    lines += ["", "Declared inert, and confirmed by motion:", *_head("engine", "reason", "changes", left=2)]
    for engine, worlds in results.items():
        reasons = sum((Counter(record["inert"]) for record in worlds.values()), Counter[str]())
        lines += [_row(engine, why, count) for why, count in reasons.most_common()]
    return "\n".join([*lines, ""])


def _head(*names: str, left: int) -> list[str]:
    return ["", _row(*names), "|" + "---|" * left + "---:|" * (len(names) - left)]


def _row(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _counts(counts: dict[str, int] | Counter[str]) -> list[int]:
    return [counts[column] for column in COLUMNS]


def with_table(page: str, results: Results) -> str:
    """The page with its table made anew. Raises ValueError where the marks are not there."""
    before, mark, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (mark and end):
        raise ValueError(f"{PAGE} has no {BEGIN} ... {END}")
    return f"{before}{BEGIN}\n{page_table(results)}\n{END}{after}"


def read() -> Results:
    """The stored results; empty without a file."""
    kept: Results = json.loads(gzip.decompress(RESULTS.read_bytes())) if RESULTS.exists() else {}
    return kept


def write(results: Results) -> None:
    """Keep ``results``, and put them into the page."""
    results = dict(sorted(results.items()))
    RESULTS.write_bytes(gzip.compress((json.dumps(results, indent=1) + "\n").encode(), mtime=0))
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), results), encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("engines", nargs="*", metavar="ENGINE")
    parser.add_argument("--world", action="append", default=[], dest="worlds", metavar="NAME")
    parser.add_argument("--go-on", action="store_true")
    given = parser.parse_args()
    results = read()
    for engine in given.engines or [name for name in engines() if find_engine(name).version() is not None]:
        measure(engine, given.worlds, results, given.go_on)
    missed = sum(world["rows"]["all"]["missed"] for worlds in results.values() for world in worlds.values())
    print(f"missed: {missed}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
