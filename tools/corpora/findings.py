"""Remarks about single proofs that fail: measured by hand, and printed next to them on the page."""

from __future__ import annotations

FINDINGS = {
    ("mujoco", "cassie_v2.sdf"): (
        "feet and cranks start at 0 rad, with limits of −2.44 to −0.61 rad, and from there the loops that the rods close were "
        "found to let them turn by 0.007 rad: there is no motion within the limits to compare"
    ),
    ("mujoco", "cassie_wo_gearbox_spring.sdf"): (
        "off by 1.3e-9, where 1e-9 is tolerated; mass matrix and bias force agree. Loops are closed by two points of an axis, "
        "so that rows of the constraints are redundant, or nearly so: singular values of 1e-17 and of 7e-4"
    ),
}
"""By engine and file."""
ENGINE_TIME = ("no result within its deadline", "without a result", "code 137")
"""In the reasons of verdicts of time and memory, which say nothing of the model."""


def remark(engine: str, name: str, why: str, early: bool) -> str:
    """Remarks about a failed proof, by its engine, file and reason. ``early``: the proof is of an unknown state of the code,
    not repeated since."""
    known = FINDINGS.get((engine, name.rpartition("/")[2]))
    remarks = [known] if known else []
    if any(text in why for text in ENGINE_TIME):
        remarks.append("a verdict of time or memory: the engine gave no answer that could be compared")
    if early:
        remarks.append("of an earlier state of the code, not repeated since")
    return f" ({'; '.join(remarks)})" if remarks else ""
