"""Fill the blocks of the README and of three other pages: files as they are, commands with the output that they give now.

    python tools/readme.py [README.md] [docs/tour.md] [docs/concepts/proof.md] [docs/guide/sweeps.md]

Commands of the README work each in a folder of its own; those of the other pages one after the other in one folder,
with the spec that stands in the page. ``output 4: COMMAND`` shows the first four lines. The engines of
``--all-engines`` must not depend on the user: engines in the user's data folder (MJX, MuJoCo Warp) are not seen, and the
machine has to have those of ``ENGINES``, no more and no less.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(<!-- (file|output(?: \d+)?|spec): (.*?) -->\n```\w*\n)(.*?)(```)", re.DOTALL)
ENGINES = ("dart", "drake", "mujoco", "ode", "pybullet", "rapier")
"""Engines of a page where a command takes all: those of CI, which so compares the pages with the outputs of today."""
ALL = "--all-engines"
PAGES = (
    ("README.md", False, 80),
    ("docs/tour.md", True, 80),
    ("docs/concepts/proof.md", True, 80),
    ("docs/guide/sweeps.md", True, 110),
)
"""Pages, whether their commands work in one folder, and the width of their terminal."""


def environment(empty: Path, columns: int = 80) -> dict[str, str]:
    """Of commands whose output is in a page: as wide as the page, and without the user's data and cache."""
    return {**os.environ, "COLUMNS": str(columns), "XDG_DATA_HOME": str(empty), "XDG_CACHE_HOME": str(empty)}


def simspec(words: Iterable[str], place: Path, columns: int = 80) -> str:
    """The output of a command that works in ``place``. If the command fails, ends the program with its messages."""
    command = ["simspec", *words]
    with tempfile.TemporaryDirectory() as empty:
        done = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=place,
            env=environment(Path(empty), columns),
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        said = f"{done.stdout}\n{done.stderr}".strip()
        sys.exit(f"{shlex.join(command)}: exit code {done.returncode}\n\n{said}")
    return done.stdout


def other_engines(installed: Iterable[str]) -> list[str]:
    """Differences between the engines of a machine and those of the pages, one line each."""
    here = set(installed)
    missing = [f"{name}: not installed, and the pages show it (make engines)" for name in ENGINES if name not in here]
    return missing + [f"{name}: installed, and the pages are without it" for name in sorted(here - set(ENGINES))]


def check_engines() -> None:
    """End the program where ``--all-engines`` would take other engines here than the pages show."""
    with tempfile.TemporaryDirectory() as place:
        instances = json.loads(simspec(["engines", "--json"], Path(place)))["instances"]
    if wrong := other_engines(instance["label"] for instance in instances if instance["version"]):
        sys.exit("\n".join(wrong))


def fill(found: re.Match[str], place: Path, columns: int) -> str:
    """One block, made anew; commands work in the folder ``place``, on a terminal of ``columns``."""
    head, kind, what, text, end = found.groups()
    if kind == "file":
        return head + (ROOT / what).read_text(encoding="utf-8") + end
    if kind == "spec":
        (place / what).write_text(text, encoding="utf-8")
        return found.group()
    lines = [line.rstrip() for line in simspec(shlex.split(what)[1:], place, columns).splitlines()]
    if shown := kind.removeprefix("output"):
        lines = lines[: int(shown)]
    return head + "$ " + what + "\n" + "\n".join(lines).strip() + "\n" + end


def fill_page(page: str, together: bool, columns: int) -> str:
    """A page with its blocks made anew; ``together``: its commands work in one folder."""
    with tempfile.TemporaryDirectory() as root:

        def in_place(found: re.Match[str]) -> str:
            place = Path(root) if together else Path(tempfile.mkdtemp(dir=root))
            if not (place / "specs").exists():
                (place / "specs").symlink_to(ROOT / "specs")
            return fill(found, place, columns)

        return BLOCK.sub(in_place, page)


def main() -> int:
    for name, together, columns in PAGES:
        path = ROOT / name
        if len(sys.argv) == 1 or name in sys.argv[1:]:
            page = path.read_text(encoding="utf-8")
            if any(ALL in found[3] for found in BLOCK.finditer(page)):
                check_engines()
            path.write_text(fill_page(page, together, columns), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
