"""``simspec init``: a project with a spec, compiled files, a project file, checks before commits and a CI workflow.

Everything is made in memory and in a scratch folder first: where a spec is wrong or a target cannot be written, nothing is
written. A file that exists is kept.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from simspec import generated, selection
from simspec.commands.files import STARTER, find_robot, imported_of
from simspec.commands.options import names_alone, print_json
from simspec.commands.scenario_options import InitOptions
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.files import read_bytes, resource_folder, scratch_folder
from simspec.generated import CompiledSpec
from simspec.imports.writing import copies, spec_text
from simspec.language.load import Spec, load
from simspec.language.reference import schema_text
from simspec.meshes.reading import LARGEST_FILE as LARGEST_MESH
from simspec.outputs.targets import COMPILED, MESHES, NEVER, demand, file_problem, folder_problem
from simspec.outputs.writing import write_file, write_folder, write_private
from simspec.plugins import requirements
from simspec.report.screen import say
from simspec.selection import NotTaken, supporting

SPECS: Final = "specs"
SCHEMA: Final = "simspec.schema.json"
COMMENT: Final = f"# yaml-language-server: $schema=../{SCHEMA}\n"
IGNORED: Final = ".gitignore"
_ENGINES = re.compile(r"(?m)^  ENGINES: (.*)$")
_INSTALL = re.compile(r"(?m)^( +)run: pip install 'simspec-physics\[[a-z0-9,-]+\]'$")


@dataclass
class NewProject:
    """The files of a project by their paths in it, the compiled files of its spec, and engines that do not support the spec."""

    folder: Path
    spec: str
    files: dict[str, str] = field(default_factory=dict)
    meshes: dict[str, bytes] = field(default_factory=dict)
    compiled: CompiledSpec | None = None
    engines: Sequence[str] = ()
    not_taken: Mapping[str, NotTaken] = field(default_factory=dict)

    @property
    def mesh_folder(self) -> Path:
        """The folder of the meshes of an imported robot."""
        return self.folder / SPECS / f"{self.spec}-meshes"

    @property
    def compiled_folder(self) -> Path:
        """The folder of the compiled spec."""
        return self.folder / generated.GENERATED / (self.compiled.world.name if self.compiled else self.spec)


def init(options: InitOptions) -> int:
    """Make a project in a folder."""
    project = _project(options)
    kept = sorted(name for name in project.files if os.path.lexists(project.folder / name))
    new = {name: text for name, text in project.files.items() if name not in kept}
    folders: dict[Path, str] = {}
    if f"{SPECS}/{project.spec}.yaml" in new:
        folders |= {project.mesh_folder: MESHES} if project.meshes else {}
        folders |= {project.compiled_folder: COMPILED} if project.compiled is not None else {}
    demand(file_problem(project.folder / name, NEVER) for name in new)
    demand(folder_problem(folder, kind) for folder, kind in folders.items())
    if not options.dry_run:
        for name, text in new.items():
            write_file(project.folder / name, text, NEVER)
        if project.mesh_folder in folders:
            write_folder(project.meshes, project.mesh_folder, MESHES)
        if project.compiled is not None and project.compiled_folder in folders:
            generated.write(project.compiled, project.compiled_folder)
    written = [*new, *(f"{folder.relative_to(project.folder).as_posix()}/" for folder in folders)]
    _show(options, project, written, kept)
    return EXIT_OK


def _show(options: InitOptions, project: NewProject, written: Sequence[str], kept: Sequence[str]) -> None:
    following = _next(project, written)
    if options.as_json:
        data: dict[str, Any] = {"folder": project.folder, "written": written, "kept": kept, "engines": project.engines}
        refused = {name: why.reason for name, why in project.not_taken.items()}
        print_json({**data, "not_for": refused, "dry_run": options.dry_run, "next": following})
        return
    for name in written:
        say(f"{'would write' if options.dry_run else 'wrote'} {project.folder / name}")
    for name in kept:
        say(f"kept {project.folder / name}{_missing_lines(project, name)}")
    for name, why in project.not_taken.items():
        accepting = f"; simspec accept {SPECS}/{project.spec}.yaml --engine {name}" if why.acceptable else ""
        say(f"not for {name}: {why.reason}{accepting}")
    say(f"{'then' if options.dry_run else 'now'}: {following}")


def _next(project: NewProject, written: Sequence[str]) -> str:
    inside = "" if project.folder.resolve() == Path.cwd() else f"cd {project.folder} && "
    if f"{SPECS}/{project.spec}.yaml" not in written:
        return f"{inside}simspec check {SPECS}/*.yaml"
    spec = f"{SPECS}/{project.spec}.yaml"
    if project.compiled is None:
        return f"{inside}simspec accept {spec}"
    return f"{inside}simspec verify {spec} && simspec run {spec}"


def _missing_lines(project: NewProject, name: str) -> str:
    """The lines that a .gitignore that exists does not have."""
    if name != IGNORED:
        return ""
    there = (project.folder / name).read_text(encoding="utf-8", errors="replace").splitlines()
    wanted = [line for line in project.files[name].splitlines() if not line.startswith("#") and line not in there]
    return f"; add to it: {' '.join(wanted)}" if wanted else ""


# --- content ----------------------------------------------------------------------------------------------------------------


def _project(options: InitOptions) -> NewProject:
    workflow = (resource_folder("docs/examples") / "github-workflow.yml").read_text(encoding="utf-8")
    engines = names_alone(options.engine or _engines_of(workflow))
    folder = options.folder if options.folder is not None else Path()
    if os.path.lexists(folder) and not folder.is_dir():
        raise SpecError([Problem(f"{folder} is not a folder", code="C104")])
    project = _with_spec(options, NewProject(folder, "pendulum", engines=engines))
    templates = resource_folder("templates") / "project"

    def template(name: str) -> str:
        return (templates / name).read_text(encoding="utf-8")

    project.files |= {
        SCHEMA: schema_text(),
        "simspec.toml": template("simspec.toml").replace("ENGINES", json.dumps(list(project.engines))),
        ".pre-commit-config.yaml": template("pre-commit-config.yaml"),
        IGNORED: template("gitignore"),
        ".github/workflows/simspec.yml": workflow_for(workflow, project.engines),
    }
    if options.vscode:
        project.files[".vscode/settings.json"] = template("settings.json")
    return project


def _engines_of(workflow: str) -> list[str]:
    """The engines of the workflow in docs/examples."""
    found = _ENGINES.search(workflow)
    return [] if found is None else [word for word in found[1].split() if not word.startswith("-")]


def workflow_for(workflow: str, engines: Sequence[str]) -> str:
    """The workflow of docs/examples for other engines: those without an extra of simspec are installed by simspec."""
    lines = list(requirements())
    extras = [name for name in engines if any(f'extra == "{name}"' in line.replace("'", '"') for line in lines)]
    others = [name for name in engines if name not in extras]
    packages = f"pip install 'simspec-physics[{','.join(extras or ['proof'])}]'"

    def install(found: re.Match[str]) -> str:
        if not others:
            return f"{found[1]}run: {packages}"
        return f"{found[1]}run: |\n{found[1]}  {packages}\n{found[1]}  simspec engines install {' '.join(others)} --yes"

    text = _ENGINES.sub("  ENGINES: " + " ".join(f"--engine {name}" for name in engines), workflow)
    return _INSTALL.sub(install, text).replace(" Copy to .github/workflows/simspec.yml.", "")


def _with_spec(options: InitOptions, project: NewProject) -> NewProject:
    """The project with its spec, compiled for the engines that support it; without one where the folder has specs."""
    if options.robot is None and any((project.folder / SPECS).glob("*.yaml")):
        return project
    with scratch_folder("init") as scratch:
        place = scratch / "project"
        if options.robot is None:
            text = COMMENT + "".join(STARTER.splitlines(True)[2:]).replace("NAME", project.spec)
        else:
            project, text = _imported(options, project, place)
        path = f"{SPECS}/{project.spec}.yaml"
        meshes = {
            f"{project.mesh_folder.relative_to(project.folder)}/{name}": it for name, it in project.meshes.items()
        }
        write_private({path: text, **meshes}, place)
        project.files[path] = text
        return _compiled(project, load(str(place / path)))


def _compiled(project: NewProject, spec: Spec) -> NewProject:
    world = spec.resolve()
    compiled, project.not_taken = supporting(world, project.engines, spec.locate)
    if compiled:
        project.engines = tuple(compiled)
        chosen = replace(selection.named(project.engines), compiled=compiled)
        project.compiled = generated.build(world, chosen, spec.locate)
    return project


def _imported(options: InitOptions, project: NewProject, place: Path) -> tuple[NewProject, str]:
    """The project with the meshes of a robot file, which are copied; and the file as a spec for a project in ``place``."""
    named = find_robot(str(options.robot))
    spec = load(named, allow_outside=options.allow_outside, options=options.robot_files.options())
    imported = imported_of(spec)
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", str(imported.data["name"])).strip("-") or "robot"
    sources, called = copies(imported, place / SPECS / f"{name}-meshes", place / SPECS)
    meshes = {path: read_bytes(source, LARGEST_MESH, links=True) for path, source in sources.items()}
    return replace(project, spec=name, meshes=meshes), COMMENT + spec_text(imported, Path(named).name, called)
