"""Compiled files and JSON documents that tests write and damage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def write(files: Mapping[str, str], folder: Path) -> Path:
    """Write the files into an existing folder, and return it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def setting(value: Any, *path: Any) -> Callable[[Any], None]:
    """A function that puts ``value`` at the keys and indices of ``path`` in a document of dicts and lists."""

    def change(content: Any) -> None:
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = value

    return change


def program(path: Path, text: str) -> Path:
    """Write a program that can be started, in a folder that is made, and return it."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)
    return path
