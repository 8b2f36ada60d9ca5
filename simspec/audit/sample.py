"""A file of one body, which ``simspec engines doctor`` lets an engine load that audits and runs no world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from simspec.audit.audit import DEADLINE, loaded
from simspec.audit.meaning import meaning_of
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.language.foreign import ImportOptions

BODY: Final = "stone"
MASS: Final = 2.0
"""kg of it; exact in single precision, too."""
SAMPLES: Final[Mapping[str, tuple[str, str]]] = {
    "urdf": (
        "stone.urdf",
        '<robot name="stone"><link name="base"/><link name="stone"><inertial><mass value="2"/>'
        '<inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="turn" type="continuous"><parent link="base"/><child link="stone"/><axis xyz="0 0 1"/></joint></robot>\n',
    ),
    "mjcf": (
        "stone.xml",
        '<mujoco><worldbody><body name="stone"><freejoint/><inertial pos="0 0 0" mass="2" diaginertia=".02 .02 .02"/>'
        "</body></worldbody></mujoco>\n",
    ),
}
"""By language: the name of the file, and its text."""


def load_sample(engine: str, python: str | None = None) -> tuple[str, float]:
    """The version of an engine that has loaded a sample, and the seconds that it took. Raises EngineError where it does not
    load it, or gives the body another mass."""
    language = next((known for known in SAMPLES if known in find_engine(engine).FOREIGN), None)
    if language is None:
        raise EngineError(engine, f"no sample: it loads none of {', '.join(SAMPLES)}")
    with scratch_folder("sample") as folder:
        name, text = SAMPLES[language]
        file = folder / name
        file.write_text(text, encoding="utf-8")
        found = loaded(engine, meaning_of(file, ImportOptions()), python, DEADLINE)
    if found.error is not None or found.reply is None or found.read_back is None:
        raise found.error or EngineError(engine, "gave no model of a file with one body")
    masses = [body.inertial.mass for body in found.read_back.bodies if body.name == BODY]
    if masses != [MASS]:
        raise EngineError(engine, f"a body of {MASS:g} kg has {', '.join(f'{mass:.9g}' for mass in masses) or 'no'} kg")
    return found.reply.versions["engine_version"], found.seconds
