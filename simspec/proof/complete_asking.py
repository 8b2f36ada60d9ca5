"""The same questions about many changed folders of files, in one process of an engine.

The process works on each apart (``engines/kit/attempts.py``): one that crashes is refused, and the next one follows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from simspec.compiler import write_folder
from simspec.dialects.kit.mutations import Files, Mutation
from simspec.engines.kit.process import Answer, Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.scratch import scratch_folder

Answers = Sequence[Answer] | EngineError
"""One for each operation, or the error of a process that ended over one plant alone."""
DEADLINE = 60.0
"""Seconds of one process, and ``EACH`` more for each operation in it, or ``SLOWER`` times what the unchanged files take."""
EACH = 0.5
LOST = 10.0
"""Seconds of CPU after which one operation is given up, or ``SLOWER`` times what the unchanged files take, beyond what the
engine may take to compile: some changed files
make an engine go round in circles (parents that are each other's)."""
SLOWER = 20.0


@dataclass(frozen=True)
class Plant:
    """Mutations that are made together, and the texts of the files that they change."""

    members: tuple[Mutation, ...]
    files: Mapping[str, str]

    @classmethod
    def of(cls, mutation: Mutation) -> Plant:
        """One mutation alone."""
        return cls((mutation,), {mutation.file: mutation.text})


def ask(
    engine: str,
    files: Files,
    plants: Sequence[Plant],
    operations: Sequence[Operation],
    longest: float,
    python: str | None = None,
) -> Iterator[tuple[Plant, Answers]]:
    """The answers to ``operations`` about ``files`` with each of ``plants``. ``longest``: s that one operation takes at most
    with the unchanged files."""
    if not plants:
        return
    compiling = find_engine(engine).COMPILING
    with scratch_folder("mutations") as place:
        asked = []
        lost = max(LOST, SLOWER * longest) + compiling
        for index, plant in enumerate(plants):
            folder = place / str(index)
            write_folder({**files, **plant.files}, folder)
            more = {"artifacts": str(folder), "attempt": True, "cpu_seconds": lost}
            asked += [
                dataclasses.replace(operation, parameters={**operation.parameters, **more}) for operation in operations
            ]
        count = len(operations)
        try:
            deadline = DEADLINE + max(EACH, SLOWER * longest) * len(asked) + compiling * len(plants)
            answers = call(engine, place, asked, python=python, deadline=deadline).answers
        except EngineError as error:
            failed = error
        else:
            for index, plant in enumerate(plants):
                yield plant, answers[index * count : (index + 1) * count]
            return
    if len(plants) == 1:
        yield plants[0], failed
        return
    # the whole process ended: what it was at is asked alone again, as it can have been ended by what came before
    at = failed.operation // count if failed.operation is not None else len(plants) // 2
    last = at + 1 if failed.operation is not None else at
    for part in (plants[:at], plants[at:last], plants[last:]):
        yield from ask(engine, files, part, operations, longest, python)
