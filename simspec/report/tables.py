"""Tables for papers and spreadsheets: CSV and LaTeX, from a study or from the results of a sweep."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

from simspec.analysis.intervals import Interval, Spread
from simspec.analysis.tables import ResultTable
from simspec.comparison.runs import QUANTITIES, summary
from simspec.comparison.study import Study
from simspec.errors import visible

DIGITS = 4
"""Significant digits in LaTeX; CSV has all of them."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of a text that a spreadsheet takes for a formula: names come from specs of strangers."""
ESCAPED = {
    "\\": r"\textbackslash{}",
    **{character: rf"\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "−": "$-$",
    "µ": r"\textmu{}",
}
"""Characters that LaTeX would obey, or does not have in every font."""


def csv_text(table: ResultTable) -> str:
    """A table as CSV (RFC 4180, UTF-8): numbers whole, nothing for None. Texts that a spreadsheet would run begin with an
    apostrophe."""
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\r\n")
    writer.writerow([_field(name) for name in table.columns])
    for row in table.rows():
        writer.writerow([_field(value) for value in row.values()])
    return written.getvalue()


def _field(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    text = visible(str(value))
    return f"'{text}" if text.startswith(FORMULA) else text


def latex_text(table: ResultTable, caption: str = "", label: str = "", heads: Mapping[str, str] | None = None) -> str:
    """A table in LaTeX (packages booktabs and textcomp). ``heads``: what stands above a column in place of its name.
    Numbers have
    four significant digits; spreads are medians with their interval."""
    aligned = "".join("r" if _is_number(values) else "l" for values in table.columns.values())
    lines = [r"\begin{table}", r"\centering"]
    lines += [rf"\caption{{{latex_escaped(caption)}}}"] if caption else []
    lines += [rf"\label{{{''.join(c for c in label if c.isalnum() or c in ':-.')}}}"] if label else []
    lines += [rf"\begin{{tabular}}{{{aligned}}}", r"\toprule"]
    lines += [" & ".join(latex_escaped((heads or {}).get(name, name)) for name in table.columns) + r" \\", r"\midrule"]
    lines += [" & ".join(_cell(value) for value in row.values()) + r" \\" for row in table.rows()]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def latex_escaped(text: str) -> str:
    """A text in which LaTeX obeys nothing."""
    return "".join(ESCAPED.get(character, character) for character in visible(text))


def _is_number(values: Sequence[Any]) -> bool:
    told = [value for value in values if value is not None]
    return bool(told) and all(
        isinstance(one, int | float | Spread | Interval) and not isinstance(one, bool) for one in told
    )


def _cell(value: Any) -> str:
    if value is None:
        return "--"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(value)
    return latex_escaped(str(value))


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "--" if math.isnan(value) else ("$" if value > 0 else "$-") + r"\infty$"
    mantissa, _, exponent = f"{value:.{DIGITS}g}".partition("e")
    if exponent:
        return rf"${mantissa} \cdot 10^{{{int(exponent)}}}$"
    return f"${mantissa}$" if value < 0 else mantissa


def runs_table(study: Study) -> ResultTable:
    """A row for each run of a study: engine, whether it failed, what it expected, speed, and its quantities at the end."""
    columns: dict[str, list[Any]] = {}
    names = [f"{name}, {unit}" if unit else name for name, unit in QUANTITIES]
    for label, run in study.runs.items():
        outcomes = study.outcomes.get(label, ())
        told = summary(run)
        row = {
            "engine": label,
            "version": run.provenance.get("engine_version"),
            "failed": run.failed,
            "passed": sum(one.passed for one in outcomes),
            "expected": len(outcomes),
            "real_time_factor": run.real_time_factor,
            "cpu_factor": run.cpu_factor,
            "end_to_end_factor": run.end_to_end_factor,
            **{name: told.get(plain) for name, (plain, _) in zip(names, QUANTITIES, strict=True)},
        }
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    return ResultTable(columns)


def differences_table(study: Study) -> ResultTable:
    """A row for each pair of engines and body of a study."""
    columns: dict[str, list[Any]] = {}
    for diff in study.diffs:
        for body in diff.bodies:
            said = body if body.compared else None
            row = {
                "first": diff.first,
                "second": diff.second,
                "body": body.body,
                "verdict": body.verdict,
                "largest, m": said and said.position_largest,
                "rms, m": said and said.position_rms,
                "largest angle, rad": said and said.angle_largest,
                "time of largest, s": said and said.time_of_largest,
                "time of largest angle, s": said and said.time_of_largest_angle,
                "first out, s": body.first_out,
                "first out of": " and ".join(body.exceeded) or None,
                "cause": body.cause or None,
                "noise, m": body.floor,
                "compared until, s": diff.compared_until,
            }
            for name, value in row.items():
                columns.setdefault(name, []).append(value)
    return ResultTable(columns)


def study_tables(study: Study, form: str) -> dict[str, str]:
    """Every table of a study by the name of its file: ``runs`` and ``differences``, as ``csv`` or ``tex``. Raises
    ValueError for
    another form."""
    if form not in ("csv", "tex"):
        raise ValueError(f"no form of tables: {form}")
    tables = {"runs": runs_table(study), "differences": differences_table(study)}
    captions = {
        "runs": f"Runs of {study.world.name}",
        "differences": f"Differences between engines in {study.world.name}",
    }
    return {
        f"{name}.{form}": csv_text(table) if form == "csv" else latex_text(table, captions[name], f"tab:{name}")
        for name, table in tables.items()
        if len(table)
    }
