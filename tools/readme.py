"""Fill the README's blocks: files as they are, commands with the output that they give now.

python tools/readme.py
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
BLOCK = re.compile(r"(<!-- (file|output): (.*?) -->\n```\w*\n)(.*?)(```)", re.DOTALL)


def fill(found: re.Match[str]) -> str:
    head, kind, what, _, end = found.groups()
    if kind == "file":
        return head + (ROOT / what).read_text(encoding="utf-8") + end
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "specs").symlink_to(ROOT / "specs")
        command = [sys.executable, "-m", *shlex.split(what)]
        environment = {**os.environ, "COLUMNS": "110"}
        done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=True)
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    return head + "$ " + what + "\n" + "\n".join(lines).strip() + "\n" + end


def main() -> int:
    path = ROOT / "README.md"
    path.write_text(BLOCK.sub(fill, path.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
