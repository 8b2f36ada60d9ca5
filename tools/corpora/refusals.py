"""Why files are refused: the reasons of all refusals, grouped and counted."""

from __future__ import annotations

import collections
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from models import Model
from run import stored

KINDS = 5
"""Example files of a reason."""


def reason(message: str) -> str:
    """A message without what differs from file to file: names, numbers, places."""
    text = message.splitlines()[0] if message else ""
    text = re.sub(r"'[^']*'", "'…'", text)
    text = re.sub(r"\[[^\]]*\]", "[…]", text)
    text = re.sub(r"(/?[\w.@+-]+)?(/[\w.@+-]+){2,}", "…", text)
    text = re.sub(r"[-+]?\d[\d,]*\.?\d*(e[-+]?\d+)?", "#", text)
    return re.sub(r"(#[, ]*)+", "# ", text).strip()[:140]


def why(answer: dict[str, Any]) -> list[str]:
    """The reasons of a refused file, or that it ended without an answer."""
    if "late" in answer:
        return ["no answer in time"]
    if "died" in answer:
        return ["the process died"]
    if "crash" in answer:
        return [f"crash: {answer['crash'].strip().splitlines()[-1][:120]}"]
    if answer.get("imported") is False:
        return list(dict.fromkeys(reason(problem["message"]) for problem in answer["problems"]))
    return []


def listed(models: Sequence[Model], results: Path) -> str:
    """A table of the reasons of all refusals, by language."""
    counts: dict[tuple[str, str], list[str]] = collections.defaultdict(list)
    alone: collections.Counter[tuple[str, str]] = collections.Counter()
    totals: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    losses: dict[tuple[str, str], list[str]] = collections.defaultdict(list)
    for model in models:
        answer = stored(results, "import", model)
        if answer is None:
            continue
        reasons = why(answer)
        kind = "refused" if reasons else "imported" if answer.get("imported") else "no importer"
        if kind == "imported" and answer["losses"]["physics"]:
            kind = "imported with losses of physics"
        totals[model.language][kind] += 1
        example = f"{model.package}: {model.name}"
        for text in reasons:
            counts[model.language, text].append(example)
        if len(reasons) == 1:
            alone[model.language, reasons[0]] += 1
        for text in dict.fromkeys(_kind_of_loss(text) for text in answer.get("lost", ())):
            losses[model.language, text].append(example)
    lines = ["# Refusals", ""]
    for language, counter in sorted(totals.items()):
        lines.append(f"- {language}: {', '.join(f'{kind} {count}' for kind, count in counter.most_common())}")
    lines += ["", "| language | files | alone | reason | examples |", "|---|---|---|---|---|"]
    for (language, text), files in sorted(counts.items(), key=lambda item: (item[0][0], -len(item[1]))):
        shown = "; ".join(files[:KINDS])
        lines.append(f"| {language} | {len(files)} | {alone[language, text]} | {text.replace('|', '/')} | {shown} |")
    lines += ["", "## Losses of physics", "", "| language | files | what | examples |", "|---|---|---|---|"]
    for (language, text), files in sorted(losses.items(), key=lambda item: (item[0][0], -len(item[1]))):
        lines.append(f"| {language} | {len(files)} | {text.replace('|', '/')} | {'; '.join(files[:KINDS])} |")
    return "\n".join(lines) + "\n"


def _kind_of_loss(text: str) -> str:
    what, _, because = text.partition(": ")
    parts = [re.sub(r"\[[^\]]*\]", "", part) for part in re.sub(r"\[[^\]]*\]", "", what).split("/")]
    return f"{'/'.join(parts[-2:])}: {reason(because)}"
