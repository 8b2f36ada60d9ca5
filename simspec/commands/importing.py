"""``simspec import``: a robot file of another language as a spec, with the list of what it does not carry."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from typing import Any, Final

from simspec.arguments import print_json
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.imports.writing import copies, from_folder, is_unchanged, spec_text, too_long
from simspec.language.beginning import AT_LIMITS, listed
from simspec.language.foreign import Imported, is_foreign, suffixes
from simspec.language.load import Spec, load
from simspec.language.losses import counts, grouped, of_physics, problems
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

DESCRIPTION: Final = re.compile(r"[a-z0-9_]+_description")
"""Names of modules of the package robot_descriptions."""


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
    path, more_packages = find_robot(file)
    options = robot_files.options(*more_packages)
    if out is not None:
        demand([_not_over_the_source(out, path), file_problem(out, is_unchanged)])
    if meshes is not None:
        demand([folder_problem(meshes, MESHES, [path])])
    spec = load(path, allow_outside=allow_outside, options=options)
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
        called = from_folder(imported, folder)
    else:
        sources, called = copies(imported, meshes, folder)
    text = spec_text(imported, path.name, called)
    if meshes is not None:
        contents = {name: read_bytes(source, LARGEST_MESH, links=True) for name, source in sources.items()}
        write_folder(contents, meshes, MESHES)
    if out is not None:
        write_file(out, text, is_unchanged)
    if as_json:
        print_json(_data(imported, path, out, text))
        return EXIT_OK
    if out is None:
        sys.stdout.write(text)
    _show(imported, path, out)
    return EXIT_OK


def imported_of(spec: Spec) -> Imported:
    """What the importer made of a spec that is a foreign file."""
    imported = spec.source.imported
    if imported is None:
        raise ValueError(f"{spec.name} is not imported")
    return imported


def find_robot(name: str) -> tuple[Path, tuple[str, ...]]:
    """The file that is meant, and folders of packages that belong to it: a path, or the name of a module of the package
    robot_descriptions. Raises SpecError where there is neither."""
    path = Path(name)
    if path.is_file():
        if not is_foreign(path.name):
            allowed = ", ".join(suffixes())
            raise SpecError([Problem(f"{name}: not a file of a language that simspec imports", allowed=allowed)])
        return path, ()
    if not DESCRIPTION.fullmatch(name):
        hint = "is a folder" if path.is_dir() else "no such file"
        raise SpecError(
            [Problem(f"{name}: {hint}", allowed="a file, or a name of robot_descriptions (panda_description)")]
        )
    return described(name)


def described(name: str) -> tuple[Path, tuple[str, ...]]:
    """The file of a robot of robot_descriptions, and the folder that its package is in."""
    if importlib.util.find_spec("robot_descriptions") is None:
        hint = "pip install robot_descriptions"
        raise SpecError([Problem(f"{name}: no such file, and robot_descriptions is not installed", hint=hint)])
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError as error:
        if error.name != f"robot_descriptions.{name}":
            raise
        raise SpecError([Problem(f"{name}: robot_descriptions has no such robot")]) from None
    except Exception as error:  # it fetches by git, which fails in ways of its own
        raise SpecError([Problem(f"{name}: robot_descriptions cannot fetch it: {error}")]) from None
    # its files are called LANGUAGE_PATH, its folders PACKAGE_PATH and REPOSITORY_PATH
    known = [str(path) for word, path in sorted(vars(module).items()) if word.endswith("_PATH")]
    fitting = [Path(text) for text in known if is_foreign(Path(text).name)]
    if not fitting:
        raise SpecError([Problem(f"{name}: in no language that simspec imports", found=", ".join(known))])
    return fitting[0], (str(Path(module.PACKAGE_PATH).parent),)


def _not_over_the_source(out: Path, path: Path) -> Problem | None:
    same = out.exists() and out.samefile(path)
    return Problem(f"{out}: is the file that is imported", hint="use a new file name") if same else None


def _data(imported: Imported, path: Path, out: Path | None, text: str) -> dict[str, Any]:
    return {
        "source": path,
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
        "repairs": [
            {
                "rule": repair.rule,
                "file": repair.location.file,
                "line": repair.location.line,
                "what": repair.what,
                "path": repair.path,
            }
            for repair in imported.repairs
        ],
        "read": {str(file): digest for file, digest in imported.read.items()},
    }


def _show(imported: Imported, path: Path, out: Path | None) -> None:
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
        here = (
            "" if all(file.is_relative_to(project) for file in imported.files.values()) else " (with --allow-outside)"
        )
        say(f"wrote {out}; now: simspec check {out}{here}")
    if imported.starts:
        say(f"{AT_LIMITS}: {listed(imported.starts)}", error=out is None)
    said = counts(imported)
    line = f"{path.name}: {said['carried']} carried, {said['carried_but_unused']} without effect, {said['lost']} lost"
    say(f"{line} ({said['lost_of_physics']} of physics)", error=out is None)
