"""Results for reading, where a whole report is too much: small tables in HTML for notebooks, lengths with a prefix."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from simspec.errors import visible


def html_table(title: str, head: Sequence[str], rows: Iterable[Sequence[object]], note: str = "") -> str:
    """A table with a caption, and a note below it. Names come from specs of strangers: nothing in them is markup."""
    heads = "".join(f"<th>{_text(one)}</th>" for one in head)
    body = "".join("<tr>" + "".join(f"<td>{_text(one)}</td>" for one in row) + "</tr>" for row in rows)
    above = f"<thead><tr>{heads}</tr></thead>" if head else ""
    below = f"<p>{_text(note)}</p>" if note else ""
    return f"<table><caption>{_text(title)}</caption>{above}<tbody>{body}</tbody></table>{below}"


def _text(value: object) -> str:
    return escape(visible(str(value)))


def length(value: float | None) -> str:
    """A length (m) with the prefix that suits it, e.g. ``3.2 mm``."""
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞"
    for factor, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm")):
        if abs(value) >= factor:
            return f"{value / factor:.3g} {unit}"
    return f"{value:.1e} m" if value else "0"
