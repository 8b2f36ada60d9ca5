"""``runs/NAME``: what is kept of a study, each part as soon as it is there.

The folder is shared: by runs of several engines, one after the other or at the same time, and by worlds that a spec had before.
What is of this world stays and counts; what is of another world stays, and is named as such.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec import generated
from simspec.comparison.floor import Floor, save_floor
from simspec.comparison.study import Arrivals, Study
from simspec.compiler import Compiled
from simspec.errors import SpecError
from simspec.generated import CERTIFICATE_FILE
from simspec.outputs.targets import COMPILED, RUN, STUDY, demand, existing_name_problem, folder_problem
from simspec.outputs.writing import Artifacts, change_file, open_folder, remove_file
from simspec.report.plain import NOT_RUN, PAGE_FILE, REPORT_FILE, REPORT_SCHEMA, study_data, text
from simspec.runner.run import Run
from simspec.runner.store import stored_runs
from simspec.selection import NotTaken
from simspec.stored import Report, read_as
from simspec.world.canonical import sha256
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate, EngineProof

COMPILED_FOLDER = "compiled"


class Results(Arrivals):
    """The results of one study of ``world`` in ``folder``. ``notes``: what there is to say of what was there before."""

    def __init__(self, world: World, folder: Path, not_run: Mapping[str, NotTaken] | None = None):
        """``not_run``: the engines that were asked for and left out."""
        self.notes: list[str] = []
        self._not_run = {name: str(why) for name, why in (not_run or {}).items()}
        self._world = world
        self._hash = sha256(world)
        self._folder = folder

    def demand(self, engines: list[str], specs: list[Path]) -> None:
        """Raise SpecError, with every problem, when one of the targets may not be written: before any work is done.

        ``specs``: the files that are read, which no target may hold.
        """
        demand([folder_problem(self._folder, STUDY, specs)])
        below = {COMPILED_FOLDER: COMPILED} | dict.fromkeys(engines, RUN)
        demand(folder_problem(self._folder / name, kind, specs) for name, kind in below.items())
        demand(existing_name_problem(self._folder, name) for name in (CERTIFICATE_FILE, REPORT_FILE))

    def compiled(self, compiled: Mapping[str, Compiled], files: Artifacts) -> None:
        open_folder(self._folder, STUDY)
        built = generated.Built(self._world, compiled, files)
        generated.write(built, self._folder / COMPILED_FOLDER)

    def certificate(self, certificate: Certificate) -> None:
        """Keep the proof, together with those of other engines of the same world."""

        def change(before: bytes | None) -> str:
            return certificate.joined(self._kept(before, certificate)).to_json()

        change_file(self._folder, STUDY, CERTIFICATE_FILE, change)

    def _kept(self, content: bytes | None, new: Certificate) -> Mapping[str, EngineProof]:
        """The proofs of an earlier certificate that still hold beside a new one."""
        from simspec.proof.certificate import Certificate
        from simspec.proof.judge import still_holding

        if content is None:
            return {}
        path = self._folder / CERTIFICATE_FILE
        try:
            earlier = Certificate.from_json(content.decode(errors="replace"), str(path))
        except SpecError as error:
            self.notes.append(f"{error.problems[0].message}; it was replaced")
            return {}
        files = generated.engine_hashes(generated.owned_files(self._folder / COMPILED_FOLDER))
        stored = still_holding(earlier, self._world, files, new.oracle)
        if others := stored.without(new.engines).reasons:
            self.notes.append(f"{path}: proofs dropped: {others}")
        return stored.kept

    def run(self, run: Run) -> None:
        run.save(self._folder / run.engine)

    def floor(self, floor: Floor) -> None:
        save_floor(floor, self._folder / floor.engine)

    def finish(self, study: Study, *, keep_page: bool = False) -> None:
        """Write the report, and look at what else there is in the folder. ``keep_page``: the page is written anew
        next."""
        open_folder(self._folder, STUDY)
        if study.certificate is None:
            self._drop_certificate()
        data = {**study_data(study), "world_sha256": self._hash, NOT_RUN: self._not_run}
        if not keep_page and remove_file(self._folder, STUDY, PAGE_FILE):
            self.notes.append(
                f"{self._folder / PAGE_FILE} was of earlier runs and was removed: simspec report writes it anew"
            )

        def change(before: bytes | None) -> str:
            # looked at while nobody else writes: a run that was stored meanwhile would be lost from the report
            return text(self._joined({**data, "other_runs": self._others(study)}, before))

        change_file(self._folder, STUDY, REPORT_FILE, change)

    def _others(self, study: Study) -> dict[str, dict[str, bool]]:
        """Stored runs of other engines than the study's, and whether they are of its world; notes tell of the others."""
        others: dict[str, dict[str, bool]] = {}
        for name, stored_hash in stored_runs(self._folder).items():
            if name in study.runs:
                continue
            same = stored_hash == self._hash
            others[name] = {"same_world": same}
            if not same:
                why = (
                    "cannot be read"
                    if stored_hash is None
                    else "is of another world (an earlier spec, or another --set)"
                )
                self.notes.append(f"{self._folder / name} {why}: it is kept and not compared")
        return others

    def _drop_certificate(self) -> None:
        """A study without proof leaves the certificate of this world, and removes that of another."""
        path = self._folder / CERTIFICATE_FILE
        try:
            old = generated.read_certificate(self._folder)
            if old is None or old.world_sha256 == self._hash:
                return
            why = "was of another world"
        except SpecError as error:
            why = f"could not be read ({error})"
        if remove_file(self._folder, STUDY, CERTIFICATE_FILE):
            self.notes.append(f"{path} {why} and was removed")

    def _joined(self, data: dict[str, Any], before: bytes | None) -> dict[str, Any]:
        """This study's report, with what the one before says of other engines in the same world."""
        if before is None:
            return data
        path = self._folder / REPORT_FILE
        try:
            old = read_as(Report, before, str(path))
        except SpecError as error:
            self.notes.append(f"{path} could not be read and was replaced: {error.problems[0].message}")
            return data
        if old.schema_ != REPORT_SCHEMA or old.world_sha256 != self._hash:
            return data
        kept = {name for name, facts in data["other_runs"].items() if facts["same_world"]} & old.runs.keys()
        for part, earlier in (("runs", old.runs), ("floors", old.floors)):
            data[part] = {name: one for name, one in earlier.items() if name in kept} | data[part]
        data["diffs"] = [
            diff for diff in old.diffs if {_engine(diff, "first"), _engine(diff, "second")} <= kept
        ] + data["diffs"]
        # an engine that is neither left out nor run now is still one that was asked for
        there = data["runs"].keys() | data["other_runs"].keys()
        data[NOT_RUN] = {name: why for name, why in (old.left_out | self._not_run).items() if name not in there}
        return data


def _engine(diff: dict[str, Any], side: str) -> str:
    """The engine of one side of a stored comparison, which is labelled by engine and version."""
    return str(diff.get(side, "")).split(" ")[0]
