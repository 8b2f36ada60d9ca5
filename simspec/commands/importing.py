"""``simspec import``: a robot file of another language as a spec, with the list of what it does not carry."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from simspec.arguments import print_json
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.imports.writing import copies, from_folder, is_unchanged, spec_text, too_long
from simspec.language.beginning import AT_LIMITS, listed
from simspec.language.foreign import Imported, is_foreign, suffixes
from simspec.language.load import Spec, load
from simspec.language.losses import counts, grouped, of_physics, problems, repairs_data
from simspec.language.packages import PACKAGE, ROBOT, ROBOTS, NotCachedError, Package, is_packaged, is_robot, packaged
from simspec.language.sources import project_folder
from simspec.meshes.files import LARGEST_FILE as LARGEST_MESH
from simspec.outputs.marker import MESHES
from simspec.outputs.targets import demand, file_problem, folder_problem
from simspec.outputs.writing import write_file, write_folder
from simspec.reading import read_bytes
from simspec.report.imported import losses_table, repairs_table
from simspec.report.screen import console, say
from simspec.report.terminal import show_warnings
from simspec.robot_files import RobotFiles


def import_file(
    file: str,
    out: Path | None,
    *,
    meshes: Path | None,
    robot_files: RobotFiles,
    allow_outside: bool,
    strict: bool,
    as_json: bool,
) -> int:
    """Import ``file``, and print or write the spec. Raises SpecError with every problem."""
    named = find_robot(file)
    path = packaged(named, suffixes()).path if is_packaged(named) else Path(named)
    options = robot_files.options()
    if out is not None:
        demand([_not_over_the_source(out, path), file_problem(out, is_unchanged)])
    if meshes is not None:
        demand([folder_problem(meshes, MESHES, [path])])
    spec = load(named, allow_outside=allow_outside, options=options)
    imported = imported_of(spec)
    if (problem := too_long(imported, str(path))) is not None:
        raise SpecError([problem])
    spec.resolve()
    if strict and (of_physics(imported) or imported.suspicious):
        raise SpecError([*imported.suspicious, *problems(of_physics(imported))])
    if imported.made and meshes is None and out is not None:
        hint = f"--meshes {out.parent / f'{out.stem}-meshes'}"
        raise SpecError([Problem(f"{path.name} has meshes within itself, which a spec names as files", hint=hint)])
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
    if as_json:
        print_json(_data(imported, path, out, text, spec.source.package))
        return EXIT_OK
    if out is None:
        sys.stdout.write(text)
    _show(imported, path, out, spec.source.package)
    return EXIT_OK


def imported_of(spec: Spec) -> Imported:
    """What the importer made of a spec that is a foreign file."""
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
            raise SpecError([Problem(f"{name}: not a file of a language that simspec imports", allowed=allowed)])
    elif not is_robot(name):
        hint = "is a folder" if path.is_dir() else "no such file"
        allowed = f"a file, {PACKAGE}NAME/PATH, or a name of {ROBOTS} (panda_description)"
        raise SpecError([Problem(f"{name}: {hint}", allowed=allowed)])
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
        raise SpecError([Problem(f"{name}: {ROBOTS} cannot fetch it: {error}")]) from None


def _not_over_the_source(out: Path, path: Path) -> Problem | None:
    same = out.exists() and out.samefile(path)
    return Problem(f"{out}: is the file that is imported", hint="use a new file name") if same else None


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
    """What became of the file; on standard error where the spec is on standard output."""
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
