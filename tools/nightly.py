"""Run everything that is too long for a commit, and write docs/records/nightly.md: each part, its outcome and its time.

python tools/nightly.py                    # all parts: hours
python tools/nightly.py --only slow kills  # some; the other rows of the page stay
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import time
from collections import deque
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "records" / "nightly.md"
PARTS = {
    "slow": ["make", "slow"],
    "certify": ["make", "certify"],
    "selftest": ["make", "selftest"],
    "kills": ["make", "kills"],
    "random-worlds": ["make", "random-worlds"],
    **{
        f"fuzz-{language}": ["make", "fuzz", f"LANGUAGE={language}"]
        for language in ("urdf", "xacro", "mjcf", "sdf", "usd", "meshes", "simspec")
    },
}
"""Commands, from the root of the project, by the name of their row."""
HEAD = """# Nightly checks

> With this page you can see when each exhaustive check last ran, and its outcome.

Exhaustive checks that no commit runs: every planted defect in every engine, killed commands, random worlds, damaged
files. Written by `make nightly`; each row has its own date.

| part | command | commit | date (UTC) | minutes | exit code | last line |
|---|---|---|---|---:|---:|---|
"""
ROW = re.compile(r"^\| ([\w-]+) \| `make.*$", re.MULTILINE)


def row(name: str, words: list[str], commit: str) -> tuple[str, int]:
    """One part: its row of the table, and its exit code. Its output is shown while it runs."""
    began, last = time.monotonic(), deque[str](maxlen=1)
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            sys.stdout.write(line)
            if line.strip():
                last.append(line.strip().strip("=").strip())
    minutes = (time.monotonic() - began) / 60
    said = (last[0] if last else "no output").replace("|", "\\|")[:160]
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M")
    cells = [name, f"`{' '.join(words)}`", f"`{commit}`", now, f"{minutes:.0f}", str(process.returncode), said]
    return f"| {' | '.join(cells)} |", process.returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART")
    chosen = parser.parse_args().only
    known = {match[1]: match[0] for match in ROW.finditer(PAGE.read_text(encoding="utf-8"))} if PAGE.is_file() else {}
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    codes = []
    for name in chosen:
        known[name], code = row(name, PARTS[name], commit)
        codes.append(code)
        rows = [known[part] for part in PARTS if part in known]
        PAGE.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")  # after each part, since the whole takes hours
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
