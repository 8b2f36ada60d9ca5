"""A world of one body, whose plain files ``simspec engines doctor`` lets an engine load that audits and runs no world."""

from __future__ import annotations

from typing import Final

from simspec.audit.audit import DEADLINE, loaded
from simspec.audit.meaning import meaning_of
from simspec.compiler import write_folder
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.formats.kit.contract import formats
from simspec.language.foreign import ImportOptions
from simspec.world.types import Body, Contact, Inertial, Joint, Physics, World

MASS: Final = 2.0
"""kg; exact in single precision, too."""
STONE: Final = Body(
    "stone",
    "stone",
    Inertial(MASS, (0.0, 0.0, 0.0), (0.02, 0.02, 0.02, 0.0, 0.0, 0.0)),
    Joint("free", "free", position=(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
)
SAMPLE: Final = World("sample", (STONE,), Contact(), Physics((0.0, 0.0, -9.81), 1e-3, 1))


def load_sample(engine: str, python: str | None = None) -> tuple[str, float]:
    """The version of an engine that has loaded the sample, and the seconds that it took. Raises EngineError where it does not
    load it, or gives the body another mass."""
    reads = find_engine(engine).FOREIGN
    language = next((language for language in reads if language in formats()), None)
    if language is None:
        raise EngineError(engine, f"no sample: simspec writes no plain file of {', '.join(reads) or 'no language'}")
    with scratch_folder("sample") as folder:
        files = formats()[language].plain(SAMPLE).files
        write_folder(files, folder / "files")
        (file,) = (name for name in files if name.endswith(reads[language].suffixes))
        found = loaded(engine, meaning_of(folder / "files" / file, ImportOptions()), python, DEADLINE)
    if found.error is not None or found.reply is None or found.read_back is None:
        raise found.error or EngineError(engine, "gave no model of a file with one body")
    masses = [body.inertial.mass for body in found.read_back.bodies if body.name == STONE.name]
    if masses != [MASS]:
        raise EngineError(engine, f"a body of {MASS:g} kg has {', '.join(f'{mass:.9g}' for mass in masses) or 'no'} kg")
    return found.reply.versions["engine_version"], found.seconds
