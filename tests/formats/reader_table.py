"""The record of what readers make of the plain files of five worlds: ``python -m tests.formats.reader_table`` writes it.

The table is made of the rules; ``tests/formats/test_readers.py`` holds the rules against the readers."""

from __future__ import annotations

from pathlib import Path

from simspec.audit.exported import reader_losses, readers
from simspec.engines.kit.foreign import REFUSED
from simspec.formats.kit.contract import formats
from tests.formats.exported_worlds import LAYOUTS, NAMES, exported_world

RECORD = Path(__file__).resolve().parents[2] / "docs/records/plain-file-readers.md"
COLUMNS = {
    "mass": ("mass", "centre_of_mass", "inertia", "body"),
    "joints": (
        "joint.type",
        "joint.damping",
        "joint.dry_friction",
        "joint.armature",
        "joint.spring_stiffness",
        "joints_held_by_motors",
    ),
    "limits": ("joint.limits", "limits_enforced", "joint.velocity_limit", "joint.effort_limit", "velocity_clamp"),
    "pose": ("joint.origin.xyz", "pose"),
    "shapes": ("shapes", "collision_margin", "self_collision"),
    "scene": ("gravity", "timestep", "linear_damping"),
}
"""Which quantities stand in which column."""
HEAD = """# What readers make of plain files

> With this page you can look up what a reader ignores in a file that simspec exports.

Made by `python -m tests.formats.reader_table` from the rules of each reader (`engines/NAME/`, `audit/libraries.py`), which
`tests/formats/test_readers.py` compares with the readers themselves: each loads every file by its plain loader, and every
difference from the world must be one that the rules foresee. Versions: the ones that the rules were measured with. Figures are
numbers of bodies, or `file` where the effect is of the whole file; `=` is as the world (but for what the format itself does not
carry, [plain files](../guide/plain-files.md)). The worlds are in `tests/formats/exported/`.
"""


def page() -> str:
    """The whole page."""
    lines = [HEAD]
    for language, profile in LAYOUTS:
        written = formats()[language]
        layout = written.in_profile(profile) if profile else written
        lines += [f"## {language}" + (f", profile `{profile}`" if profile else ""), ""]
        lines += ["| reader | world | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
        notes: dict[tuple[str, str, str], None] = {}
        for reader in readers(language):
            for name in NAMES:
                world = exported_world(name)
                losses = [
                    loss
                    for loss in reader_losses(world, language, profile, layout.plain(world).files)
                    if loss.reader.name == reader.name
                ]
                notes |= {(reader.short, loss.element, loss.what): None for loss in losses}
                if any(loss.element == REFUSED for loss in losses):
                    cells = ["refused"] * len(COLUMNS)
                else:
                    cells = [_cell(losses, quantities) for quantities in COLUMNS.values()]
                lines.append(f"| {reader.short} | {name} | " + " | ".join(cells) + " |")
        lines += ["", *(f"- {title}, `{element}`: {what}." for title, element, what in notes), ""]
    return "\n".join(lines)


def _cell(losses: list, quantities: tuple[str, ...]) -> str:
    texts = [
        f"{loss.element.removeprefix('joint.')} {len(loss.bodies) or 'file'}"
        for loss in losses
        if loss.element in quantities
    ]
    return ", ".join(texts) or "="


if __name__ == "__main__":
    RECORD.write_text(page(), encoding="utf-8")
