"""``simspec compile``: compile specs into their folders, or see whether these are current; ``simspec export``: plain
files for any tool."""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from simspec import generated, selection
from simspec.commands.loading import LoadedSpec, load_all, spec_file
from simspec.commands.options import names_alone, print_json
from simspec.commands.scenario_options import CompileOptions, ExportOptions
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError, more_places
from simspec.files import NotReadableError, read_bytes
from simspec.formats.kit.contract import Format, PlainFiles, formats
from simspec.formats.kit.text import json_text
from simspec.generated import GENERATED, CompiledSpec, Written
from simspec.outputs.targets import COMPILED, LARGEST_MARKER, PLAIN, check_folder, demand, file_problem, folder_problem
from simspec.outputs.writing import update_folder, write_file
from simspec.report.problems import export_losses_table, reader_lines
from simspec.report.screen import console, say
from simspec.selection import Selection
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.audit.exported import ReaderLoss
    from simspec.report.problems import WaysOut


def compile_specs(options: CompileOptions) -> int:
    """Compile specs, by default all of the folder ``specs``, for engines, or to plain files of a format."""
    if options.format_name is not None and (options.engine or options.explain):
        other = "--engine" if options.engine else "--explain"
        raise SpecError(
            [Problem(f"--format writes plain files for any tool, {other} is about those of engines", code="C101")]
        )
    names = options.specs or [str(path) for path in sorted(Path("specs").glob("*.yaml"))]
    if not names:
        raise SpecError([Problem("no SPEC given, and no specs/*.yaml in the working folder", code="C102")])
    if options.format_name is not None:
        shared = {name: getattr(options, name) for name in ExportOptions.TAKES if name not in ("specs", "profile")}

        return export(ExportOptions(specs=names, accept=options.accept, **shared))
    return _compile(options, names)


def _compile(options: CompileOptions, names: Sequence[str]) -> int:
    """Compile specs into their folders, or see whether these are current. The problems of all specs come together."""
    engines = selection.named(names_alone(options.chosen)) if options.chosen else selection.known()
    out, alone = options.out, options.out is not None and len(names) == 1
    if alone and out is not None and not options.check:
        check_folder(out, COMPILED, [spec_file(names[0])])
    loaded, problems = load_all(options, names)
    worlds = [entry.world.name for entry in loaded]
    twice = sorted({name for name in worlds if worlds.count(name) > 1})
    if twice:
        problems.append(
            Problem(f"several specs are called {', '.join(twice)}, and would write to one folder", code="C107")
        )
    folders = [out if alone and out is not None else (out or GENERATED) / name for name in worlds]
    sources = [entry.file for entry in loaded]
    refused = [] if options.check else [folder_problem(folder, COMPILED, sources) for folder in folders]
    if any(refused):
        demand([*problems, *refused])
    built, chosen = _built(loaded, engines, problems)
    if options.check:
        return _check(built, folders, options.as_json, engines.named)
    written = [generated.write(scenario, folder) for scenario, folder in zip(built, folders, strict=True)]
    results = list(zip(built, written, chosen, strict=True))
    if options.as_json:
        data = [
            {**_data(built, place, options.explain), "not_compiled": local.not_taken} for built, place, local in results
        ]
        print_json({"compiled": data, "warnings": [problem for entry in loaded for problem in entry.warnings]})
        return EXIT_OK
    for scenario, place, local in results:
        say(f"{place.folder}: {'written' if place.changed else 'already current'}, {', '.join(scenario.compiled)}")
        for line in local.lines():
            say(f"  not for {line}")
        if place.stored is not None and place.stored.reasons:
            dropped = "proofs dropped from certificate.json" if place.stored.kept else "certificate.json dropped"
            say(f"  {dropped}: {place.stored.reasons}; simspec verify proves anew")
        if options.explain:
            _explain(scenario)
    return EXIT_OK


def _built(
    loaded: Sequence[LoadedSpec], engines: Selection, problems: Sequence[Problem]
) -> tuple[list[CompiledSpec], list[Selection]]:
    """The compiled specs, and the engines of each. Raises SpecError with ``problems`` and those of all specs."""
    built: list[CompiledSpec] = []
    chosen: list[Selection] = []
    ways: dict[str, WaysOut] = {}
    every = list(problems)
    for spec, world, *_ in loaded:
        try:
            chosen.append(engines.for_world(world, spec.locate))
            built.append(generated.build(world, chosen[-1], spec.locate))
        except SpecError as error:
            from simspec.commands.check import is_writable
            from simspec.report.problems import ways_out

            every.extend(error.problems)
            name = spec.source.document.file
            found = ways_out(error.problems, name, engines.engines, world, engines.pythons, is_writable(spec))
            ways |= {name: found} if found is not None else {}
    if ways:
        from simspec.report.problems import briefly, with_endings

        raise with_endings(every, ways, briefly(every, ways, engines.engines))
    demand(every)
    return built, chosen


def _explain(built: CompiledSpec) -> None:
    """Print how engines realise a scenario."""
    from simspec.report.explain import control_table, forces_table, tables

    if built.world.controllers:
        console().print(control_table(built.world))
    if built.world.forces:
        console().print(forces_table(built.world))
    for compiled in built.compiled.values():
        for table in tables(built.world, compiled):
            console().print(table)


def _check(built: Sequence[CompiledSpec], folders: Sequence[Path], as_json: bool, named: bool) -> int:
    stale = [
        line
        for scenario, folder in zip(built, folders, strict=True)
        for line in generated.check(scenario, folder, named)
    ]
    versions = [line for folder in folders for line in generated.other_versions(folder)]
    if as_json:
        print_json({"stale": stale, "other_versions": versions})
        return EXIT_FAILED if stale else EXIT_OK
    for line in [*(f"other version: {line}" for line in versions), *stale]:
        say(line, error=True)
    if not stale:
        say(f"{len(built)} compiled specs are current")
    return EXIT_FAILED if stale else EXIT_OK


def _data(built: CompiledSpec, written: Written, explain: bool) -> dict[str, Any]:
    from simspec.report.explain import explained

    reasons = {name: explained(built.world, compiled) for name, compiled in built.compiled.items()} if explain else {}
    driving: dict[str, Any] = {"controllers": built.world.controllers} if explain else {}
    if explain and built.world.forces:
        driving["forces"] = built.world.forces
    return {
        "folder": written.folder,
        "changed": written.changed,
        "certificate": None if written.stored is None else written.stored.data(),
        "world_sha256": sha256(built.world),
        "engines": {
            name: {
                "format": compiled.format,
                "sha256": compiled.sha256,
                "files": sorted(compiled.files),
                "decisions": compiled.decisions,
            }
            | ({"explained": reasons[name]} if explain else {})
            for name, compiled in built.compiled.items()
        },
        **driving,
    }


# ``simspec export``, ``simspec compile --format``: plain files, and the list of what they do not carry. ``-o robot.SUFFIX``
# writes one file with the list alongside. The list names the hash of the file: an existing file is replaced where it is the one
# that its list names, which simspec wrote.

DEFAULT: Final = Path("plain")
"""Below it, NAME/FORMAT."""
LOSSES: Final = "losses.json"
LOSSES_SCHEMA: Final = 1
SIDECAR_SUFFIX: Final = ".losses.json"
"""Suffix of the list of a single file, after the name of the file."""
DIGEST: Final = "file_sha256"


@dataclass(frozen=True)
class Export:
    """One spec in plain files: where they go, and what they do not carry."""

    loaded: LoadedSpec
    format_name: str
    plain: PlainFiles
    folder: Path
    profile: str = ""
    """The layout of the files, where the format has several."""

    @functools.cached_property
    def readers(self) -> list[ReaderLoss]:
        """Known losses of programs that read the format."""
        from simspec.audit.exported import reader_losses

        return reader_losses(self.loaded.world, self.format_name, self.profile, self.plain.files)

    @property
    def files(self) -> Mapping[str, bytes]:
        """All files of the folder."""
        texts = {**self.plain.files, LOSSES: json_text(self.data())}
        return {name: content.encode() for name, content in texts.items()}

    def data(self) -> dict[str, Any]:
        """The content of ``losses.json``."""
        return {
            "schema": LOSSES_SCHEMA,
            "format": self.format_name,
            "world": self.loaded.world.name,
            "world_sha256": sha256(self.loaded.world),
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
        """A place in the spec. Its file is relative to the spec's folder, so that the text is the same on every machine."""
        location = self.loaded.spec.locate(path)
        if location is None:
            return {"path": path}
        file = os.path.relpath(location.file, self.loaded.file.parent)
        return {"path": path, "file": Path(file).as_posix(), "line": location.line}

    def refused(self) -> Iterator[Problem]:
        """Losses of the bodies, which ``--strict`` makes errors."""
        for loss in self.plain.losses:
            if loss.of_the_model:
                path = next(path for path in loss.paths if path.startswith("bodies."))
                more = more_places(loss.paths)
                yield Problem(
                    f"{self.format_name} does not carry {loss.feature}, which is {loss.fate.value}: {loss.how}{more}",
                    path,
                    self.loaded.spec.locate(path),
                    hint="leave it out of the spec, or run without --strict",
                    code="C108",
                )

    def show(self) -> None:
        """Print what the files do not carry, and the losses of programs that read them."""
        if self.plain.losses:
            console().print(export_losses_table(self.format_name, self.plain.losses, self.loaded.spec.locate))
        for line in reader_lines(self.format_name, self.readers):
            say(line)


def export(options: ExportOptions) -> int:
    """Write the plain files of specs, or see whether they are current. The problems of all specs come together."""
    name, out, profile = options.format_name, options.out, options.profile
    if name not in formats():
        raise SpecError([Problem(f"no format is called {name!r}", allowed=", ".join(sorted(formats())), code="E111")])
    language = formats()[name] if profile is None else formats()[name].in_profile(profile)
    single = out if out is not None and out.suffix.lower() in language.SINGLE else None
    if single is not None and len(options.specs) > 1:
        message = f"{single} is one file, and there are {len(options.specs)} specs"
        raise SpecError([Problem(message, hint="use a folder: --out DIR", code="C107")])
    exports: list[Export] = []
    problems: list[Problem] = []
    for spec in options.specs:
        loaded, failed = load_all(options, [spec])
        problems += failed
        for item in loaded:
            folder = DEFAULT / item.world.name / name if out is None else out
            folder = folder if out is None or len(options.specs) == 1 else out / item.world.name
            layout = profile or next(iter(language.PROFILES), "")
            try:
                exports.append(Export(item, name, language.plain(item.world), folder, layout))
            except SpecError as error:
                problems += error.problems
    folders = [entry.folder for entry in exports]
    twice = sorted({str(folder) for folder in folders if folders.count(folder) > 1})
    if twice:
        problems.append(Problem(f"several specs would write to one folder: {', '.join(twice)}", code="C107"))
    if options.strict:
        problems.extend(problem for entry in exports for problem in entry.refused())
    sources = [entry.loaded.file for entry in exports] if not options.check and single is None else []
    demand([*problems, *(folder_problem(folder, PLAIN, sources) for folder in folders if sources)])
    warnings = [problem for entry in exports for problem in entry.loaded.warnings]
    if single is not None:
        return _single(options, exports[0], language, single, warnings)
    if options.check:
        stale = [line for entry in exports for line in _stale(entry)]
        return _current(options, stale, f"plain files of {len(exports)} specs are current")
    rows = [(made, sorted(made.files), _write(made)) for made in exports]
    if options.as_json:
        data = [{**made.data(), "folder": made.folder, "files": files, "changed": new} for made, files, new in rows]
        print_json({"plain": data, "warnings": warnings})
        return EXIT_OK
    for made, files, new in rows:
        say(f"{made.folder}: {'written' if new else 'already current'}, {len(files)} files")
        made.show()
    return EXIT_OK


def _write(export: Export) -> bool:
    """Write the files; whether any changed."""

    def change(real: Path | None) -> Mapping[str, bytes] | None:
        return None if real is not None and generated.owned_files(real) == export.files else export.files

    return update_folder(change, export.folder, PLAIN) is not None


def _stale(export: Export) -> list[str]:
    extra = generated.owned_files(export.folder).keys() - export.files.keys()
    unknown = [f"not of this spec: {(export.folder / name).as_posix()}" for name in sorted(extra)]
    return generated.compare(export.files, export.folder) + unknown


def _current(options: ExportOptions, stale: Sequence[str], current: str) -> int:
    """Report whether files are current."""
    if options.as_json:
        print_json({"stale": stale})
    else:
        for line in stale:
            say(line, error=True)
        if not stale:
            say(current)
    return EXIT_FAILED if stale else EXIT_OK


# --- single files -----------------------------------------------------------------------------------------------------------


def _single(options: ExportOptions, export: Export, language: Format, path: Path, warnings: Sequence[Problem]) -> int:
    """Write one file and its list, or see whether they are current. Raises SpecError where one may not be written."""
    content = language.single(export.plain, path.suffix.lower())
    name = path.with_name(path.name + SIDECAR_SUFFIX)
    listed = {**export.data(), DIGEST: hashlib.sha256(content).hexdigest()}
    files = {path: content, name: json_text(listed).encode()}
    if options.check:
        stale = [f"not current: {place}" for place, wanted in files.items() if _stored(place) != wanted]
        return _current(options, stale, "the file is current")
    source = export.loaded.file
    same = path.exists() and source.exists() and path.samefile(source)
    over = Problem(f"{path}: is the spec that is exported", hint="use a new file name", code="C106") if same else None
    demand([file_problem(path, _named_by(name)), file_problem(name, _is_list), over])
    changed = any(_stored(place) != wanted for place, wanted in files.items())
    if changed:
        write_file(path, content, _named_by(name))
        write_file(name, files[name], _is_list)
    if options.as_json:
        names = sorted(place.name for place in files)
        row = {**export.data(), "folder": path.parent, "files": names, "changed": changed}
        print_json({"plain": [row], "warnings": warnings})
        return EXIT_OK
    say(f"{path}: {'written' if changed else 'already current'}")
    export.show()
    return EXIT_OK


def _named_by(path: Path) -> Callable[[bytes], bool]:
    """Whether a content is that of the file that a list names."""
    return lambda content: _export_data(_stored(path)).get(DIGEST) == hashlib.sha256(content).hexdigest()


def _is_list(content: bytes) -> bool:
    return {"schema", "format", "world_sha256", "losses", DIGEST} <= _export_data(content).keys()


def _export_data(content: bytes | None) -> dict[str, Any]:
    try:
        data = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _stored(path: Path) -> bytes | None:
    """The content of a file; None where there is none that can be read."""
    try:
        return read_bytes(path, LARGEST_MARKER)
    except (OSError, NotReadableError):
        return None
