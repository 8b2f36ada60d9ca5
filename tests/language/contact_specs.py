"""Specs whose contact law is the test's own."""

from __future__ import annotations

from pathlib import Path

HEAD = """simspec: 1
name: law
contact:
  materials: {rubber: {friction: 0.5}, steel: {friction: 0.4}}
"""


BODIES = """bodies:
  floor: {fixed: true, shapes: [{box: {size: [4, 4, 0.2]}, material: steel}]}
  ball: {pose: {xyz: [0, 0, 1]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
engines:
  mujoco: {accept: [contact.friction.impact]}
  mjx: {accept: [contact.friction.impact]}
  mjwarp: {accept: [contact.friction.impact]}
"""


def written(folder: Path, contact: str, bodies: str = BODIES) -> Path:
    """A spec whose ``contact`` begins on line 5."""
    path = folder / "law.yaml"
    path.write_text(HEAD + contact + "\n" + bodies, encoding="utf-8")
    return path
