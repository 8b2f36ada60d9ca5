"""The picture of docs/records/stacking.md and the README, from the published study.

    python tools/study_images.py docs/records/studies/koerber-2021

Needs matplotlib (extra plots).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from simspec.report.figures import deviation_over_timestep
from simspec.report.study.pages import tables_text

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "images" / "stacking.png"
SWEEP, TABLE = "robot", "validity.deviations"
TOLERANCE = 0.01
"""m: that of every placement."""


def main(folder: Path) -> None:
    stored = tables_text(folder)
    if stored is None:
        raise SystemExit(f"{folder} is not a study")
    tables = json.loads(stored[1])["sweeps"][SWEEP]
    (records,) = [table["records"] for table in tables if table["name"] == TABLE]
    PICTURE.write_bytes(deviation_over_timestep(records, TOLERANCE)[".png"])
    print(f"{PICTURE.relative_to(ROOT)}: {len(records)} records, {PICTURE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
