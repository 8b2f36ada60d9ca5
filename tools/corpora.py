"""Robot files of other people's packages: each imported, certified in every engine, and audited as it is; docs/corpora.md.

    python tools/corpora.py --into DIR --fetch         installs the packages into DIR, never into the project
    python tools/corpora.py --into DIR --run           what is not in DIR/results yet; ended at any moment, it goes on there
    python tools/corpora.py --into DIR --run --seconds 1500 --most 20
    python tools/corpora.py --into DIR --write         docs/corpora.md from DIR/results

A file is asked about in a process of its own with a deadline, two at once. Files are never copied into the project.
"""

from __future__ import annotations

import argparse
import collections
import hashlib
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "corpora.md"
INSTALLED = {"pybullet_data": "pybullet_data", "drake": "pydrake"}
"""Packages of engines that are installed with simspec, and their modules."""
FETCHED = (
    "example-robot-data",
    "airo-models",
    "icub-models",
    "dm-control",
    "gymnasium-robotics",
    "robosuite",
    "robosuite-models",
)
"""Packages that are installed into a folder of their own, without what they depend on."""
PATTERNS = {".urdf": b"<robot", ".sdf": b"<sdf", ".xml": b"<mujoco"}
"""Ends of names, and what a file of the language contains."""
PART = re.compile(rb"<(worldbody|link|model|link\s)")
"""Without one of these a file is a part of another."""
SKIPPED = ("random_urdfs", "/test", "/tests/")
"""Folders that are left out: a thousand files alike, and files that are wrong on purpose."""
DEADLINE, ENGINE_DEADLINE = 240.0, 60.0
AT_ONCE = 2


@dataclass(frozen=True)
class Model:
    """A file of a package."""

    package: str
    root: Path
    path: Path

    @property
    def name(self) -> str:
        return self.path.relative_to(self.root).as_posix()

    @property
    def key(self) -> str:
        """The name of its result."""
        digest = hashlib.sha256(f"{self.package} {self.name}".encode() + self.path.read_bytes()).hexdigest()
        return digest[:20]


def fetch(folder: Path) -> None:
    """Install the packages."""
    for name in FETCHED:
        target = folder / "packages" / name
        if target.exists():
            continue
        words = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps"]
        done = subprocess.run([*words, "--target", str(target), name], check=False)
        print(f"{name}: {'installed' if done.returncode == 0 else 'not installable here'}", flush=True)


def roots(folder: Path) -> Iterator[tuple[str, Path]]:
    """Where each package's files are."""
    for name, module in INSTALLED.items():
        spec = find_spec(module)
        if spec is not None and spec.submodule_search_locations:
            yield name, Path(spec.submodule_search_locations[0])
    for name in FETCHED:
        if (folder / "packages" / name).is_dir():
            yield name, folder / "packages" / name


def models(folder: Path, most: int) -> list[Model]:
    """The files, at most ``most`` of each package and language, spread evenly over their names."""
    found: list[Model] = []
    for package, root in roots(folder):
        for suffix, word in PATTERNS.items():
            own = []
            for path in sorted(root.rglob(f"*{suffix}")):
                if any(part in path.as_posix() for part in SKIPPED) or path.is_symlink():
                    continue
                content = path.read_bytes()
                if word in content and PART.search(content):
                    own.append(Model(package, root, path))
            step = max(1.0, len(own) / most)
            found += [own[int(index * step)] for index in range(min(most, len(own)))]
    return found


def package_folders(root: Path) -> list[Path]:
    """Folders in which packages of a file's own kind of paths may be."""
    return [path for path in (root, *root.glob("*"), *root.glob("*/share")) if path.is_dir()]


def ask(model: Model, results: Path) -> dict[str, Any]:
    """The audit of a file, from a process of its own."""
    words = [sys.executable, "-m", "simspec", "audit", str(model.path), "--json", "--allow-outside"]
    words += ["--deadline", str(ENGINE_DEADLINE)]
    for folder in package_folders(model.root):
        words += ["--package-path", str(folder)]
    begun = time.perf_counter()
    try:
        done = subprocess.run(words, capture_output=True, timeout=DEADLINE, check=False, cwd=results)
        code, data = done.returncode, _parsed(done.stdout)
        told = done.stderr.decode(errors="replace")[-400:]
    except subprocess.TimeoutExpired:
        code, data, told = -1, None, f"no answer within {DEADLINE:g} s"
    result = {
        "package": model.package,
        "name": model.name,
        "code": code,
        "seconds": round(time.perf_counter() - begun, 2),
        "answer": data,
        "told": told,
    }
    part = results / f"{model.key}.part"
    part.write_text(json.dumps(result), encoding="utf-8")
    part.replace(results / f"{model.key}.json")
    return result


def _parsed(text: bytes) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None


def run(folder: Path, most: int, seconds: float) -> None:
    """Ask about every file that has no result yet, until time is up."""
    results = folder / "results"
    results.mkdir(parents=True, exist_ok=True)
    ends = time.monotonic() + seconds
    left = [model for model in models(folder, most) if not (results / f"{model.key}.json").exists()]
    print(f"{len(left)} files to do", flush=True)

    def one(model: Model) -> None:
        if time.monotonic() < ends:
            result = ask(model, results)
            print(f"{result['seconds']:7.1f} s  {result['code']:2d}  {model.package} {model.name}", flush=True)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        list(pool.map(one, left))


# --- the page ---------------------------------------------------------------------------------------------------------


def verdict(result: dict[str, Any]) -> dict[str, str]:
    """A row of the page."""
    row = {"package": result["package"], "file": result["name"], "seconds": f"{result['seconds']:.0f}"}
    answer = result["answer"]
    if not isinstance(answer, dict) or "files" not in answer:
        error = answer.get("error", answer) if isinstance(answer, dict) else {}
        told = str(error.get("message", result["told"]))
        kind = "no answer" if result["code"] < 0 else "no file of any engine"
        return {**row, "import": f"{kind}: {short(told)}", "certified": "", "audit": ""}
    one = answer["files"][0]
    if one["defects"]:
        row["import"] = f"refused: {short(one['defects'][0])}"
    elif not one["bodies"]:
        row["import"] = "refused: no importer"
    else:
        row["import"] = "whole" if not one["losses_of_physics"] else f"loses {one['losses_of_physics']} of physics"
    row["certified"] = ", ".join(f"{each['engine']} {WORDS[each['valid']]}" for each in one["compiled"])
    row["audit"] = ", ".join(f"{each['engine']} {audited(each)}" for each in one["engines"])
    return row


WORDS = {True: "yes", False: "**no**", None: "unsupported"}


def audited(engine: dict[str, Any]) -> str:
    """What an engine makes of the file itself, in a word."""
    if not engine["loaded"]:
        return "dies" if any(finding["what"] == "died" for finding in engine["findings"]) else "refuses"
    silent = sum(finding["severity"] == "physics" for finding in engine["findings"])
    return str(silent)


def short(text: str) -> str:
    """The first line of a message, without the place."""
    line = text.splitlines()[0] if text else ""
    line = re.sub(r"^\S+?:\d+:\d+: ", "", line)
    line = re.sub(r"(/[\w.@+-]+){3,}/", "…/", line)
    line = line.rpartition("]: ")[2] or line
    return line[:110].replace("|", "/").replace("<", "&lt;")


def write(folder: Path) -> None:
    """The page from all results."""
    results = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((folder / "results").glob("*.json"))]
    results.sort(key=lambda result: (result["package"], result["name"]))
    PAGE.write_text("\n".join([*head(results), *rows(results)]) + "\n", encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(results)} files")


def head(results: Sequence[dict[str, Any]]) -> list[str]:
    """The figures of all files."""
    read = [one for one in results if isinstance(one["answer"], dict) and "files" in one["answer"]]
    files = [one["answer"]["files"][0] for one in read]
    imported = [one for one in files if one["bodies"] and not one["defects"]]
    whole = [one for one in imported if not one["losses_of_physics"]]
    lines = [
        "# Robot files of other packages",
        "",
        "<!-- generated by tools/corpora.py: make corpora -->",
        "",
        f"{len(results)} files of {len({one['package'] for one in results})} packages that pip installs, each imported, "
        "certified (L0 to L4 and L6) and [audited](audit.md) as it is. `make corpora` asks about all files of the packages; "
        "this page has those that were asked so far, spread over packages and languages.",
        "",
        f"- {len(files)} are files that an engine reads; {len(imported)} of them are imported, {len(whole)} without a loss of "
        f"physics; {len(files) - len(imported)} are refused by name.",
    ]
    proven: dict[str, collections.Counter[Any]] = {}
    audits: dict[str, collections.Counter[str]] = {}
    causes: dict[str, collections.Counter[str]] = {}
    for one in files:
        for each in one["compiled"]:
            proven.setdefault(each["engine"], collections.Counter())[each["valid"]] += 1
        for each in one["engines"]:
            kind = audited(each)
            audits.setdefault(each["engine"], collections.Counter())[
                kind if not kind.isdigit() else str(bool(int(kind)))
            ] += 1
            quantities = {finding["quantity"] for finding in each["findings"] if finding["severity"] == "physics"}
            causes.setdefault(each["engine"], collections.Counter()).update(quantities - {"file"})
    lines += ["", "| engine | compiled by simspec: certified | not | unsupported |", "|---|---|---|---|"]
    lines += [f"| {name} | {count[True]} | {count[False]} | {count[None]} |" for name, count in sorted(proven.items())]
    lines += [
        "",
        "The same files as engines load them by themselves:",
        "",
        "| engine | as the file says | another model, in silence | refuses | dies |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {count['False']} | {count['True']} | {count['refuses']} | {count['dies']} |"
        for name, count in sorted(audits.items())
    ]
    lines += ["", "What differs, by the number of files:", ""]
    for name, count in sorted(causes.items()):
        told = ", ".join(f"{quantity} {number}" for quantity, number in count.most_common(12))
        lines.append(f"- {name}: {told or 'nothing'}")
    return lines


def rows(results: Sequence[dict[str, Any]]) -> list[str]:
    """A row for each file. Under `audit`: how many values each engine changes, drops or adds in silence."""
    lines = ["", "## File by file", "", "`audit`: values that each engine changes, drops or adds in silence.", ""]
    lines += ["| package | file | import | certified | audit | s |", "|---|---|---|---|---|---|"]
    for result in results:
        row = verdict(result)
        cells = (row[name] for name in ("package", "file", "import", "certified", "audit", "seconds"))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, required=True)
    parser.add_argument("--fetch", action="store_true")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--most", type=int, default=1000)
    told = parser.parse_args()
    folder = told.into.resolve()
    if folder.is_relative_to(ROOT):
        parser.error("--into must lie outside of the project")
    folder.mkdir(parents=True, exist_ok=True)
    if told.fetch:
        fetch(folder)
    if told.run:
        run(folder, told.most, told.seconds)
    if told.write:
        write(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
