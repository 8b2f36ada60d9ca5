"""``simspec compile --format``: plain files for any tool, and the list of what they do not carry."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simspec import generated
from simspec.arguments import spec_file
from simspec.audit.exported import ReaderLoss, reader_losses
from simspec.commands.single import only_one, write_single
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.formats.kit.contract import Format, Loss, Plain, formats
from simspec.formats.kit.text import json_text
from simspec.outputs.marker import PLAIN
from simspec.outputs.targets import demand, folder_problem
from simspec.outputs.writing import update_folder
from simspec.report.losses import losses_table, reader_lines
from simspec.report.plain import text
from simspec.report.screen import console, say
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.language.load import Spec
    from simspec.world.types import World

DEFAULT: Final = Path("plain")
"""Below it, NAME/FORMAT."""
LOSSES: Final = "losses.json"
LOSSES_SCHEMA: Final = 1


@dataclass(frozen=True)
class Export:
    """One spec in plain files: where they go, and what they do not carry."""

    spec: Spec
    world: World
    format_name: str
    plain: Plain
    source: Path
    """The file of the spec."""
    folder: Path
    profile: str = ""
    """The layout of the files, where the format has several."""

    @functools.cached_property
    def readers(self) -> list[ReaderLoss]:
        """What programs that read the format are known to do to the files."""
        return reader_losses(self.world, self.format_name, self.profile, self.plain.files)

    @property
    def files(self) -> Mapping[str, bytes]:
        """All files of the folder."""
        texts = {**self.plain.files, LOSSES: json_text(self.data())}
        return {name: content.encode() for name, content in texts.items()}

    def data(self) -> dict[str, Any]:
        """What ``losses.json`` says."""
        return {
            "schema": LOSSES_SCHEMA,
            "format": self.format_name,
            "world": self.world.name,
            "world_sha256": sha256(self.world),
            "losses": [
                {
                    "feature": loss.feature,
                    "fate": loss.fate.value,
                    "how": loss.how,
                    "places": [self._place(path) for path in loss.paths],
                }
                for loss in self.plain.losses
            ],
            "readers": [
                {
                    "reader": loss.reader.called,
                    "element": loss.element,
                    "what": loss.what,
                    "places": [self._place(f"bodies.{name}.{loss.element}") for name in loss.bodies],
                }
                for loss in self.readers
            ],
        }

    def _place(self, path: str) -> dict[str, Any]:
        """A place in the spec; its file as seen from the spec's folder, so that the text is the same on every machine."""
        location = self.spec.locate(path)
        if location is None:
            return {"path": path}
        file = os.path.relpath(location.file, self.source.parent)
        return {"path": path, "file": Path(file).as_posix(), "line": location.line}


def write_plain(
    names: Sequence[str],
    load: Callable[[str], tuple[Spec, World]],
    format_name: str,
    out: Path | None,
    *,
    check: bool,
    strict: bool,
    as_json: bool,
    warnings: Sequence[Problem] = (),
    profile: str | None = None,
) -> int:
    """Write the plain files of specs, or see whether they are current. The problems of all specs come together."""
    language = find_format(format_name)
    if profile is not None:
        language = language.in_profile(profile)
    single = out is not None and out.suffix.lower() in language.SINGLE
    if single and out is not None:
        only_one(names, out)
    problems: list[Problem] = []
    exports: list[Export] = []
    for name in names:
        try:
            spec, world = load(name)
            if out is None:
                folder = DEFAULT / world.name / format_name
            else:
                folder = out if len(names) == 1 else out / world.name
            layout = profile or next(iter(language.PROFILES), "")
            exports.append(Export(spec, world, format_name, language.plain(world), spec_file(name), folder, layout))
        except SpecError as error:
            problems.extend(error.problems)
    folders = [export.folder for export in exports]
    twice = sorted({str(folder) for folder in folders if folders.count(folder) > 1})
    if twice:
        problems.append(Problem(f"several specs would write to one folder: {', '.join(twice)}"))
    if strict:
        problems.extend(problem for export in exports for problem in _refused(export))
    refused = (
        []
        if check or single
        else [folder_problem(folder, PLAIN, [spec_file(name) for name in names]) for folder in folders]
    )
    demand([*problems, *refused])
    if single and out is not None:
        return write_single(
            exports[0], language, out, check=check, as_json=as_json, warnings=warnings, show=show_losses
        )
    if check:
        return _check(exports, as_json)
    changed = [_write(export) for export in exports]
    if as_json:
        data = [
            {**export.data(), "folder": export.folder, "files": sorted(export.files), "changed": new}
            for export, new in zip(exports, changed, strict=True)
        ]
        sys.stdout.write(text({"plain": data, "warnings": warnings}))
        return EXIT_OK
    for export, new in zip(exports, changed, strict=True):
        count = len(export.files)
        say(f"{export.folder}: {'written' if new else 'already current'}, {count} files")
        show_losses(export)
    return EXIT_OK


def show_losses(export: Export) -> None:
    """What the files do not carry, and which programs make something else of them."""
    if export.plain.losses:
        console().print(losses_table(export.format_name, export.plain.losses, export.spec.locate))
    for line in reader_lines(export.format_name, export.readers):
        say(line)


def find_format(name: str) -> Format:
    """The format of this name. Raises SpecError naming the known ones."""
    if name not in formats():
        raise SpecError([Problem(f"no format is called {name!r}", allowed=", ".join(sorted(formats())))])
    return formats()[name]


def _refused(export: Export) -> list[Problem]:
    """What ``--strict`` does not allow: that something of the bodies is lost."""
    return [_problem(export, loss) for loss in export.plain.losses if loss.of_the_model]


def _problem(export: Export, loss: Loss) -> Problem:
    path = next(path for path in loss.paths if path.startswith("bodies."))
    more = f" (and {len(loss.paths) - 1} more places)" if len(loss.paths) > 1 else ""
    return Problem(
        f"{export.format_name} does not carry {loss.feature}, which is {loss.fate.value}: {loss.how}{more}",
        path,
        export.spec.locate(path),
        hint="leave it out of the spec, or run without --strict",
    )


def _write(export: Export) -> bool:
    """Write the files; whether any changed."""

    def change(real: Path | None) -> Mapping[str, bytes] | None:
        return None if real is not None and generated.owned_files(real) == export.files else export.files

    return update_folder(change, export.folder, PLAIN) is not None


def _check(exports: Sequence[Export], as_json: bool) -> int:
    stale = []
    for export in exports:
        stale += generated.compare(export.files, export.folder)
        extra = generated.owned_files(export.folder).keys() - export.files.keys()
        stale += [f"not of this spec: {(export.folder / name).as_posix()}" for name in sorted(extra)]
    if as_json:
        sys.stdout.write(text({"stale": stale}))
    for line in () if as_json else stale:
        say(line, error=True)
    if not as_json and not stale:
        say(f"plain files of {len(exports)} specs are current")
    return EXIT_FAILED if stale else EXIT_OK
