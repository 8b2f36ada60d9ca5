"""Runs the complete self-test and puts its table into docs/proof.md: ``python tools/selftest.py [ENGINE ...]``.

Exits 1 when a change was missed; the table then lists it. With engines named, only their rows are made anew. Printed are missed
changes, and declarations of something inert that no change needs.
"""

from __future__ import annotations

import datetime
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "proof.md"
RESULTS = ROOT / "docs" / "selftest.json"
BEGIN, END = "<!-- complete self-test: made by tools/selftest.py -->", "<!-- end of complete self-test -->"
COLUMNS = ("planted", "caught", "refused", "inert", "missed")


def measure(engines: list[str]) -> dict[str, Any]:
    """What the command says of ``engines`` (none named: all), by engine, without the single changes."""
    command = [sys.executable, "-m", "simspec", "verify", "--self-test", "--complete", "--json"]
    for engine in engines:
        command += ["--engine", engine]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    if done.returncode not in (0, 1):
        raise SystemExit(done.returncode)
    answer = json.loads(done.stdout)
    for one in answer["mutations"]:
        if one["verdict"] == "missed":
            print(
                "MISSED",
                *(one[name] for name in ("engine", "world", "file", "place", "kind", "change", "why")),
                sep="  ",
            )
    for engine, rows in answer["unused"].items():
        for row in rows:
            print("NOT NEEDED", engine, row, sep="  ")
    return {
        engine: {
            "version": version,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "minutes": round(answer["seconds"] / 60.0 / len(answer["versions"])),
            "rows": [row for row in answer["rows"] if row["engine"] == engine],
            "inert": [row for row in answer["inert"] if row["engine"] == engine],
        }
        for engine, version in answer["versions"].items()
    }


def page_table(results: dict[str, Any]) -> str:
    """The table of the page: a row for each engine and kind of change, then why inert things are."""
    lines = ["", "| engine | change | " + " | ".join(COLUMNS) + " |", "|---|---|" + "---:|" * len(COLUMNS)]
    for engine, one in results.items():
        for row in one["rows"]:
            name = f"**{engine} {one['version']}**" if row["kind"] == "all" else engine
            lines.append(f"| {name} | {row['kind']} | " + " | ".join(str(row[column]) for column in COLUMNS) + " |")
    lines += [
        "",
        "Measured " + ", ".join(f"{one['date']} ({name}, {one['minutes']} min)" for name, one in results.items()) + ".",
    ]
    lines += ["", "Declared inert, and confirmed by motion:", "", "| engine | reason | changes |", "|---|---|---:|"]
    for engine, one in results.items():
        lines += [f"| {engine} | {row['reason']} | {row['count']} |" for row in one["inert"]]
    return "\n".join([*lines, ""])


def with_table(page: str, results: dict[str, Any]) -> str:
    """The page with its table made anew. Raises ValueError where the marks are not there."""
    before, mark, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (mark and end):
        raise ValueError(f"{PAGE} has no {BEGIN} ... {END}")
    return f"{before}{BEGIN}\n{page_table(results)}\n{END}{after}"


def main() -> int:
    kept = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    results = dict(sorted({**kept, **measure(sys.argv[1:])}.items()))
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), results), encoding="utf-8")
    missed = sum(row["missed"] for one in results.values() for row in one["rows"] if row["kind"] == "all")
    print(f"missed: {missed}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
