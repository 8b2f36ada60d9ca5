"""docs/records/corpora.json.gz: the answers that the page is made of, under version control, so that another machine
goes on where one stopped. Answers of files whose content is another by now are left out."""

from __future__ import annotations

import gzip
import json
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from models import Model
from run import STAGES, place, stored

KEPT = Path(__file__).resolve().parents[2] / "docs" / "records" / "corpora.json.gz"
LONGEST = 240
"""Stored characters of a text: as many as the page and the list of refusals show."""


def keep(models: Sequence[Model], results: Path) -> None:
    """Write every answer there is, one file of a package a line."""
    lines = []
    for model in sorted(models, key=lambda model: (model.package, model.name)):
        answers = {stage: answer for stage in STAGES if (answer := stored(results, stage, model)) is not None}
        if answers:
            entry = {
                "package": model.package,
                "name": model.name,
                "key": model.key,
                **_clipped(answers, model.root.parent),
            }
            lines.append(json.dumps(entry, ensure_ascii=False, separators=(",", ":")))
    KEPT.write_bytes(gzip.compress(("[\n" + ",\n".join(lines) + "\n]\n").encode(), mtime=0))


def restore(models: Sequence[Model], results: Path) -> int:
    """Give a folder of results the kept answers that it lacks; how many these are."""
    if not KEPT.exists():
        return 0
    known = {entry["key"]: entry for entry in json.loads(gzip.decompress(KEPT.read_bytes()))}
    count = 0
    for model in models:
        for stage in STAGES:
            target = place(results, stage, model)
            if stage in known.get(model.key, {}) and not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(json.dumps(known[model.key][stage]), encoding="utf-8")
                count += 1
    return count


def _clipped(value: Any, folder: Path) -> Any:
    """``value`` with short texts, in which no path names this machine."""
    if isinstance(value, str):
        text = value.replace(f"{folder}/", "").replace(f"{KEPT.parents[1]}/", "")
        for place in (tempfile.gettempdir(), *(str(parent) for parent in KEPT.parents[2:-1])):
            text = re.sub(re.escape(place) + r"/(?:[\w.+@-]+/)*", "…/", text)
        return text[-LONGEST:] if text.startswith("Traceback") else text[:LONGEST]
    if isinstance(value, dict):
        return {name: _clipped(item, folder) for name, item in value.items()}
    return [_clipped(item, folder) for item in value] if isinstance(value, list) else value
