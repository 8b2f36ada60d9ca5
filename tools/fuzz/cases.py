"""Cases: the same changed files for the same number on every machine, with decoy files next to them."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from judge import Watch, judged
from mutations import BYTES, OUTSIDE, TEXT, changed
from seeds import LARGEST, MESHES, SUFFIX, Seed, companions, seeds
from warm import Forked

KINDS = {"usd": ("usd", "usd", "usd", "usdc", "usdz"), "meshes": MESHES}
"""Kinds of files of a language, where it has several."""
BINARY = ("stl", "glb", "usdc", "usdz", "ply", "msh")
MESH_SPEC = """simspec: 1
name: mesh
contact: {materials: {m: {friction: 1}}}
bodies: {b: {mass: 1 kg, joint: {type: free}, shapes: [{mesh: {file: changed%s}, material: m}]}}
"""
WARM = {
    "xacro": ("xacro", "yaml", "simspec.imports.xacro"),
    "mjcf": ("mujoco",),
    "usd": ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.Sdf"),
    "meshes": ("trimesh", "collada", "trimesh.exchange.obj", "trimesh.exchange.gltf"),
}
"""Modules that readers of a language import."""


@dataclass
class Finding:
    """The defects of a case."""

    case: int
    changes: list[str]
    outcome: str
    wrong: list[str]


@dataclass
class Fuzz:
    """The cases of one language in a folder of their own."""

    language: str
    folder: Path
    more: Sequence[Seed] = ()

    def files(self, case: int) -> tuple[str, dict[str, bytes], list[str]]:
        """The name of the file that is imported, all files, and what was changed."""
        chance = random.Random(f"{self.language} {case}")
        kind = chance.choice(KINDS.get(self.language, (self.language,)))
        all_seeds = [*seeds(kind), *self.more]
        seed = chance.choice(all_seeds)
        binary = kind in BINARY and not seed.content.startswith((b"solid", b"#usda", b"ply\nformat ascii"))
        others = [seed.content for seed in all_seeds]
        content, changes = changed(seed.content, chance, others, BYTES if binary else TEXT)
        name = f"changed{SUFFIX[kind]}"
        files = {**companions(), **seed.companions, name: content}
        if chance.random() < 0.1 and not binary:  # a file that it names is changed instead, or too
            other = chance.choice(sorted(files))
            files[other], named = changed(files[other], chance, others, BYTES if other.endswith(".stl") else TEXT)
            changes += [f"{other}: {change}" for change in named]
        if self.language == "meshes":
            files["mesh.yaml"] = (MESH_SPEC % SUFFIX[kind]).encode()
            name = "mesh.yaml"
        return name, files, changes

    def place(self, case: int) -> tuple[Path, str, list[str]]:
        """Write the files of a case; the project's folder, the file's name, the changes."""
        shutil.rmtree(self.folder, ignore_errors=True)
        project, outside = self.folder / "project", self.folder / "outside"
        for made in (project / "folder", outside, self.folder / "tmp"):
            made.mkdir(parents=True)
        name, files, changes = self.files(case)
        for where, content in files.items():
            target = project / where
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content.replace(OUTSIDE, str(outside).encode()))
        (project / "pyproject.toml").touch()
        (outside / "package.xml").write_text("<package/>")
        for end, content in companions().items():
            suffix = end.removeprefix("part")
            (outside / f"secret{suffix}").write_bytes(content)
            (project / f"link{suffix}").symlink_to(f"../outside/secret{suffix}")
            (project / f"loop{suffix}").symlink_to(f"loop{suffix}")
            os.mkfifo(project / f"fifo{suffix}")
        (project / "linked").symlink_to("../outside")
        return project, name, changes

    def begin(self) -> None:
        """Import a valid file in this process: caches are filled once for all cases, which are forked from here."""
        from simspec.language.load import load

        here = Path.cwd()
        project, _, _ = self.place(0)
        kind = KINDS.get(self.language, (self.language,))[0]
        seed = seeds(kind)[0]
        for where, content in {**companions(), **seed.companions, f"changed{SUFFIX[kind]}": seed.content}.items():
            (project / where).parent.mkdir(parents=True, exist_ok=True)
            (project / where).write_bytes(content)
        name = "mesh.yaml" if self.language == "meshes" else f"changed{SUFFIX[kind]}"
        if self.language == "meshes":
            (project / name).write_text(MESH_SPEC % SUFFIX[kind])
        try:
            os.chdir(project)
            load(name).resolve()
        finally:
            os.chdir(here)

    def attempt(self, case: int) -> tuple[str, Finding | None]:
        """The outcome of a case, and what was wrong with it."""
        project, name, changes = self.place(case)
        with contextlib.closing(Watch(self.folder / "outside")) as watch:
            outcome, wrong = judged(project, name, watch)
        return outcome, Finding(case, changes, outcome, wrong) if wrong else None


def warmed(language: str) -> None:
    """Import what is needed, before there are cases, and let simspec's own readers be forked from here."""
    import simspec.commands.files
    import simspec.imports.writing
    import simspec.resolve
    import simspec.resolve.warnings  # noqa: F401

    names = (
        {name for words in WARM.values() for name in words} if language == "simspec" else set(WARM.get(language, ()))
    )
    for name in sorted(names | set(WARM["meshes"])):
        __import__(name)
    subprocess.Popen = Forked  # type: ignore[misc]


def corpus(folder: Path | None, language: str, most: int) -> list[Seed]:
    """Files of a folder, each by itself."""
    if folder is None:
        return []
    found = sorted(path for path in folder.rglob(f"*{SUFFIX.get(language, '.none')}") if path.is_file())
    small = [path for path in found if path.stat().st_size < LARGEST]
    random.Random(0).shuffle(small)
    return [Seed(path.read_bytes()) for path in small[:most]]
