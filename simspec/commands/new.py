"""``simspec new``: write a starter spec, small and commented, that runs in every engine."""

from __future__ import annotations

import re
from pathlib import Path

from simspec.arguments import print_json
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.outputs.targets import NEVER
from simspec.outputs.writing import write_file
from simspec.report.screen import say

STARTER = """\
# yaml-language-server: $schema=simspec.schema.json
# (simspec schema --out simspec.schema.json writes it: your editor then completes and checks as you type)
simspec: 1
name: NAME
description: A pendulum with a damped hinge and a ball that drops beside it
# bare numbers are SI (m, kg, s, rad, N); other units are written out
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 1 s}
contact:
  friction_cone: elliptic
  materials:
    slick: {friction: 0, restitution: 0}
bodies:
  # a big fixed box is a floor that every engine treats alike
  floor:
    fixed: true
    shapes:
      - {box: {size: [4, 4, 0.2]}, pose: {xyz: [0, 0, -0.1]}, material: slick}
  # the origin of a body's frame is its joint; mass and inertia follow from shape and density, or are given
  rod:
    joint:
      type: hinge
      origin: {xyz: [0, 0, 1]}
      axis: [0, 1, 0]
      damping: 0.01
      position: 45 deg
    shapes:
      - {box: {size: [0.04, 0.04, 0.5]}, pose: {xyz: [0, 0, -0.25]}, density: 1 g/cm^3, material: slick}
  # a body without parent and joint moves freely
  ball:
    pose: {xyz: [1, 0, 0.5]}
    shapes:
      - {sphere: {radius: 50 mm}, density: 1 g/cm^3, material: slick}
record: {every: 10 ms, channels: [pose, velocity, contacts, energy]}
# what must be true of every run; simspec run exits 1 when it is not
expect:
  - energy_never_rises: {tolerance: 1 %}
  - position: {body: ball, xyz: [1, 0, 0.05], tolerance: 5 mm}
"""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


def new(name: str, as_json: bool) -> int:
    """Write the starter spec into the working folder."""
    path = write_starter(name, Path())
    if as_json:
        print_json({"file": path})
    else:
        say(f"wrote {path}; now: simspec run {path} --all-engines")
    return EXIT_OK


def write_starter(name: str, folder: Path) -> Path:
    """Write ``name``.yaml into ``folder``. Raises SpecError for a name that cannot be one, and when the file exists."""
    if not _NAME.fullmatch(name):
        clean = re.sub(r"[^A-Za-z0-9_-]+", "-", name.removesuffix(".yaml")).strip("-")
        clean = clean if _NAME.fullmatch(clean) else f"scenario-{clean}".strip("-")
        raise SpecError(
            [
                Problem(
                    f"{name!r} is not a valid scenario name",
                    allowed="letters, digits, _ and -, starting with a letter or _",
                    hint=f"simspec new {clean}",
                )
            ]
        )
    path = folder / f"{name}.yaml"
    write_file(path, STARTER.replace("NAME", name), NEVER)
    return path
