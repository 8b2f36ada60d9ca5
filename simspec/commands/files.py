"""Commands that write files: ``simspec new``, ``import``, ``fmt``, ``schema``; and generated files that are kept current."""

from __future__ import annotations

import functools
import importlib
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from simspec import project
from simspec.commands.options import print_json
from simspec.commands.scenario_options import FmtOptions, ImportFileOptions, NewOptions, SchemaOptions
from simspec.engines.kit import request
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.files import read_bytes
from simspec.imports.writing import copies, from_folder, is_unchanged, spec_text, too_long
from simspec.language import reference as language_schema
from simspec.language.beginning import AT_LIMITS, listed
from simspec.language.document import LARGEST_FILE, decode
from simspec.language.foreign import Imported, counts, grouped, is_foreign, of_physics, problems, repairs_data, suffixes
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.packages import PACKAGE, ROBOT, ROBOTS, NotCachedError, Package, is_packaged, is_robot, packaged
from simspec.language.sources import project_folder
from simspec.meshes.reading import LARGEST_FILE as LARGEST_MESH
from simspec.outputs import files as output_files
from simspec.outputs.targets import LARGEST_MARKER, MESHES, NEVER, check_file, demand, file_problem, folder_problem
from simspec.outputs.writing import write_file, write_folder
from simspec.report.problems import losses_table, repairs_table, show_warnings
from simspec.report.screen import console, say

STARTER = """\
# yaml-language-server: $schema=simspec.schema.json
# (simspec schema --out simspec.schema.json writes it: your editor then completes and checks as you type)
simspec: 1
name: NAME
description: A pendulum with a damped hinge and a ball that drops next to it
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


def new(options: NewOptions) -> int:
    """Write the starter spec into the working folder."""
    path = write_starter(options.name, Path())
    if options.as_json:
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
                    code="C103",
                )
            ]
        )
    path = folder / f"{name}.yaml"
    write_file(path, STARTER.replace("NAME", name), NEVER)
    return path


# --- import ---------------------------------------------------------------------------------------------------------------


def import_file(options: ImportFileOptions) -> int:
    """Import a robot file, and print or write the spec. Raises SpecError with every problem."""
    out, meshes, strict = options.out, options.meshes, options.strict
    named = find_robot(options.file)
    path = packaged(named, suffixes()).path if is_packaged(named) else Path(named)
    if out is not None:
        demand([_not_over_the_source(out, path), file_problem(out, is_unchanged)])
    if meshes is not None:
        demand([folder_problem(meshes, MESHES, [path])])
    spec = load(named, allow_outside=options.allow_outside, options=options.robot_files.options())
    imported = imported_of(spec)
    if (problem := too_long(imported, str(path))) is not None:
        raise SpecError([problem])
    spec.resolve()
    if strict and (of_physics(imported) or imported.suspicious):
        raise SpecError([*imported.suspicious, *problems(of_physics(imported))])
    if imported.made and meshes is None and out is not None:
        hint = f"--meshes {out.parent / f'{out.stem}-meshes'}"
        raise SpecError(
            [Problem(f"{path.name} has meshes within itself, which a spec names as files", hint=hint, code="I104")]
        )
    folder = out.parent if out is not None else Path()
    if meshes is None:
        called = from_folder(imported, folder, spec.source.package)
    else:
        sources, called = copies(imported, meshes, folder)
    text = spec_text(imported, path.name, called)
    if meshes is not None:
        contents = {name: read_bytes(source, LARGEST_MESH, links=True) for name, source in sources.items()}
        write_folder(contents, meshes, MESHES)
    if out is not None:
        write_file(out, text, is_unchanged)
    if options.as_json:
        print_json(_data(imported, path, out, text, spec.source.package))
        return EXIT_OK
    if out is None:
        sys.stdout.write(text)
    _show(imported, path, out, spec.source.package)
    return EXIT_OK


def imported_of(spec: Spec) -> Imported:
    """The result of the importer for a spec that is a foreign file."""
    imported = spec.source.imported
    if imported is None:
        raise ValueError(f"{spec.name} is not imported")
    return imported


def find_robot(name: str) -> str:
    """The robot file that is meant, as ``load`` takes it: a path, a file of an installed package, or a robot of
    robot_descriptions, which is fetched where it is not in the cache. Raises SpecError where there is none."""
    path = Path(name)
    if path.is_file() or is_packaged(name):
        if not is_foreign(name) and not name.startswith(ROBOT):
            allowed = ", ".join(suffixes())
            raise SpecError(
                [Problem(f"{name}: not a file of a language that simspec imports", allowed=allowed, code="I114")]
            )
    elif not is_robot(name):
        hint = "is a folder" if path.is_dir() else "no such file"
        allowed = f"a file, {PACKAGE}NAME/PATH, or a name of {ROBOTS} (panda_description)"
        raise SpecError([Problem(f"{name}: {hint}", allowed=allowed, code="C104")])
    else:
        name = f"{ROBOT}{name}"
    if name.startswith(ROBOT):
        try:
            packaged(name, suffixes())
        except NotCachedError:
            _fetch(name.removeprefix(ROBOT).partition("/")[0])
    return name


def _fetch(name: str) -> None:
    """Let robot_descriptions fetch a robot into its cache, which runs its code and git. Raises SpecError."""
    try:
        importlib.import_module(f"{ROBOTS}.{name}")
    except Exception as error:  # it fetches by git, which fails in ways of its own
        lines = str(error).splitlines() or ["no reason given"]
        why = next((line.partition("fatal:")[2].strip(" '") for line in lines if "fatal:" in line), lines[0])
        raise SpecError([Problem(f"{name}: {ROBOTS} cannot fetch it: {why}", code="I116")]) from None


def _not_over_the_source(out: Path, path: Path) -> Problem | None:
    same = out.exists() and out.samefile(path)
    return Problem(f"{out}: is the file that is imported", hint="use a new file name", code="C106") if same else None


def _data(imported: Imported, path: Path, out: Path | None, text: str, package: Package | None) -> dict[str, Any]:
    return {
        "source": path if package is None else package.named(path),
        "version": package.version if package is not None else None,
        "spec": out,
        "name": imported.data["name"],
        "text": text,
        "counts": counts(imported),
        "losses": [
            {
                "what": account.what,
                "file": account.location.file,
                "line": account.location.line,
                "severity": account.severity.value,
                "reason": account.reason,
                "hint": account.hint,
            }
            for account in imported.losses()
        ],
        "suspicious": imported.suspicious,
        "starts": [
            {"joint": start.joint, "state": start.state, "position": start.position, "instead_of": start.instead_of}
            for start in imported.starts
        ],
        "repairs": repairs_data(imported.repairs),
        "read": {(package and package.named(file)) or str(file): digest for file, digest in imported.read.items()},
    }


def _show(imported: Imported, path: Path, out: Path | None, package: Package | None) -> None:
    """Print the result of an import; on standard error where the spec is on standard output."""
    screen = console(error=out is None)
    if imported.suspicious:
        show_warnings(imported.suspicious)
    if imported.repairs:
        screen.print(repairs_table(imported.repairs))
    if lost := imported.losses():
        screen.print(losses_table(path.name, grouped(lost)))
    if out is not None:
        project = project_folder(out)
        folders = [project] if package is None else [project, package.root]
        inside = all(any(file.is_relative_to(folder) for folder in folders) for file in imported.files.values())
        here = "" if inside else " (with --allow-outside)"
        say(f"wrote {out}; now: simspec check {out}{here}")
    if imported.starts:
        say(f"{AT_LIMITS}: {listed(imported.starts)}", error=out is None)
    said = counts(imported)
    line = f"{path.name}: {said['carried']} carried, {said['carried_but_unused']} without effect, {said['lost']} lost"
    say(f"{line} ({said['lost_of_physics']} of physics)", error=out is None)


# --- fmt, schema ----------------------------------------------------------------------------------------------------------


def fmt(options: FmtOptions) -> int:
    """Lay out every file, or say which would change; nothing is written when one of them is no spec."""
    check = options.check
    problems: list[Problem] = []
    results: list[tuple[Path, bytes, str]] = []
    for path in options.files:
        if is_foreign(path.name):
            problems.append(
                Problem(f"{path} is no spec", hint=f"simspec import {path} -o {path.stem}.yaml", code="C105")
            )
            continue
        try:
            before = output_files.read_bytes(path, LARGEST_FILE)
            after = format_text(decode(before, str(path)), str(path))
            if not check and before != after.encode():
                check_file(path, before.__eq__)
        except FileNotFoundError:
            problems.append(Problem(f"{path}: no such file", code="C104"))
        except SpecError as error:
            problems.extend(error.problems)
        else:
            results.append((path, before, after))
    if problems:
        raise SpecError(problems)
    changed = [path for path, before, after in results if before != after.encode()]
    if not check:
        for path, before, after in results:
            if before != after.encode():
                write_file(path, after, before.__eq__)  # only over the very text that was laid out
    if options.as_json:
        print_json({"changed": changed, "written": not check})
    else:
        for path in changed:
            say(f"{path}: {'would change; simspec fmt writes it' if check else 'written'}")
    return EXIT_FAILED if check and changed else EXIT_OK


FILES = {
    name: f"{'simspec' if name == 'language' else name}.schema.json"
    for name in (*language_schema.LANGUAGES, "project", *request.SCHEMAS)
}
"""The name of the file of each schema."""


def schema(options: SchemaOptions) -> int:
    """Write a JSON Schema to ``--out`` (default: in ``schema/`` if it exists, else here; ``-``: standard output)."""
    of, out = options.of.value, options.out
    ours: Callable[[bytes], bool]
    if of in language_schema.LANGUAGES:
        wanted, ours = language_schema.schema_text(of), functools.partial(language_schema.is_schema, of=of)
    elif of == "project":
        wanted, ours = project.schema_text(), project.is_schema
    else:
        wanted, ours = request.schema_text(of), functools.partial(request.is_schema, of)
    if out is not None and str(out) == "-":
        sys.stdout.write(wanted)
        return EXIT_OK
    path = out if out is not None else (Path("schema") if Path("schema").is_dir() else Path()) / FILES[of]
    how = "simspec schema" if of == "language" else f"simspec schema --of {of}"
    return generated_files({path: (wanted, ours)}, options.check, options.as_json, how)


def generated_files(
    files: Mapping[Path, tuple[str, Callable[[bytes], bool]]], check: bool, as_json: bool, how: str
) -> int:
    """Write generated files, or see whether they are current: the content of each, and a function that says whether an existing
    file is one that this command wrote: no other is replaced. ``how``: the command that writes them."""
    given, codes = [], [EXIT_OK]
    for path, (wanted, ours) in files.items():
        entry, code = _generated_file(path, wanted, ours, check, as_json, how)
        given.append(entry)
        codes.append(code)
    if as_json:
        print_json(given[0] if len(given) == 1 else {"files": given})
    return max(codes)


def _generated_file(
    path: Path, wanted: str, ours: Callable[[bytes], bool], check: bool, as_json: bool, how: str
) -> tuple[dict[str, object], int]:
    if not check:
        check_file(path, ours)
    try:
        current = output_files.read_bytes(path, LARGEST_MARKER) == wanted.encode()
    except (FileNotFoundError, NotADirectoryError):
        current = False
    if not check and not current:
        write_file(path, wanted, ours)
    if as_json:
        pass
    elif check and not current:
        say(f"{path} is not current; {how} writes it", error=True)
    elif not check:
        say(f"{path}: {'already current' if current else 'written'}")
    entry: dict[str, object] = {"file": path, "current": current, "written": not check and not current}
    return entry, EXIT_FAILED if check and not current else EXIT_OK
