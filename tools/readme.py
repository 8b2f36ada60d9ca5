"""Fill the blocks of the README and of docs/sweeps.md: files as they are, commands with the output that they give now.

    python tools/readme.py [README.md] [docs/sweeps.md]

Commands of the README work each in a folder of its own; those of docs/sweeps.md one after the other in one folder, with the
spec that stands in the page.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(<!-- (file|output|spec): (.*?) -->\n```\w*\n)(.*?)(```)", re.DOTALL)


def fill(found: re.Match[str], place: Path) -> str:
    """One block, made anew; commands work in the folder ``place``."""
    head, kind, what, text, end = found.groups()
    if kind == "file":
        return head + (ROOT / what).read_text(encoding="utf-8") + end
    if kind == "spec":
        (place / what).write_text(text, encoding="utf-8")
        return found.group()
    command = [sys.executable, "-m", *shlex.split(what)]
    environment = {**os.environ, "COLUMNS": "110"}
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=True)
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    return head + "$ " + what + "\n" + "\n".join(lines).strip() + "\n" + end


def fill_page(page: str, together: bool) -> str:
    """A page with its blocks made anew; ``together``: its commands work in one folder."""
    with tempfile.TemporaryDirectory() as root:

        def in_place(found: re.Match[str]) -> str:
            place = Path(root) if together else Path(tempfile.mkdtemp(dir=root))
            if not (place / "specs").exists():
                (place / "specs").symlink_to(ROOT / "specs")
            return fill(found, place)

        return BLOCK.sub(in_place, page)


def main() -> int:
    for name, together in (("README.md", False), ("docs/sweeps.md", True)):
        path = ROOT / name
        if len(sys.argv) == 1 or name in sys.argv[1:]:
            path.write_text(fill_page(path.read_text(encoding="utf-8"), together), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
