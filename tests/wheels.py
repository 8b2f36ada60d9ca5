"""Wheels without code, which pip installs from a folder instead of an index."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path


def write_wheel(folder: Path, name: str, version: str, *requires: str) -> None:
    """Write the wheel of a package with an empty module into an existing folder."""
    about = f"{name}-{version}.dist-info"
    required = "".join(f"Requires-Dist: {requirement}\n" for requirement in requires)
    files = {
        f"{name}.py": "",
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{required}",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{about}/RECORD"] = "".join(f"{path},,\n" for path in [*files, f"{about}/RECORD"])
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as wheel:
        for path, text in files.items():
            wheel.writestr(path, text)


def use_alone(folder: Path, setenv: Callable[[str, str], None]) -> None:
    """Let pip find packages in ``folder`` and nowhere else: no index, no settings of the user or the machine."""
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        setenv(name, "")
    words = {"NO_INDEX": "1", "FIND_LINKS": str(folder), "CONFIG_FILE": os.devnull, "DISABLE_PIP_VERSION_CHECK": "1"}
    for name, value in words.items():
        setenv(f"PIP_{name}", value)
