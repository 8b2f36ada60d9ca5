"""Contents of a folder, to be compared before and after; and every kind of target that simspec must not replace."""

from __future__ import annotations

import hashlib
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

MINE = "a file of the user\n"


def picture(root: Path) -> dict[str, tuple]:
    """Every entry below ``root``, links and pipes not followed: type, permissions, content."""
    found = {}
    for place, folders, files in os.walk(root):
        for name in [*folders, *files]:
            path = Path(place) / name
            mode = os.lstat(path).st_mode
            content = ""
            if stat.S_ISREG(mode):
                content = hashlib.sha256(path.read_bytes()).hexdigest()
            elif stat.S_ISLNK(mode):
                content = os.readlink(path)
            found[path.relative_to(root).as_posix()] = (oct(mode), content)
    return found


def stray(root: Path) -> list[str]:
    """Files that a writer has left behind."""
    return [path.as_posix() for path in root.rglob(".simspec*")]


def _file(root: Path) -> str:
    (root / "notes.txt").write_text(MINE)
    return "notes.txt"


def _folder(root: Path) -> str:
    (root / "thesis").mkdir()
    (root / "thesis" / "chapter.tex").write_text(MINE)
    return "thesis"


def _hidden(root: Path) -> str:
    (root / "repository" / ".git").mkdir(parents=True)
    return "repository"


def _fifo(root: Path) -> str:
    os.mkfifo(root / "pipe")
    return "pipe"


def _socket(root: Path) -> str:
    here = os.open(".", os.O_RDONLY)
    try:
        os.chdir(root)  # a socket's path has a hundred characters at most
        socket.socket(socket.AF_UNIX).bind("socket")
    finally:
        os.chdir(here)
        os.close(here)
    return "socket"


def _link_to_file(root: Path) -> str:
    (root / "link-to-file").symlink_to(_file(root))
    return "link-to-file"


def _link_to_folder(root: Path) -> str:
    (root / "link-to-folder").symlink_to(_folder(root))
    return "link-to-folder"


def _link_to_empty(root: Path) -> str:
    (root / "empty").mkdir()
    (root / "link-to-empty").symlink_to("empty")
    return "link-to-empty"


def _dangling(root: Path) -> str:
    (root / "dangling").symlink_to("nowhere")
    return "dangling"


def _loop(root: Path) -> str:
    (root / "loop").symlink_to("loop")
    return "loop"


def _below_file(root: Path) -> str:
    return f"{_file(root)}/out"


def _below_fifo(root: Path) -> str:
    return f"{_fifo(root)}/out"


def _below_link_outside(root: Path) -> str:
    outside = root.parent / "outside"
    outside.mkdir(exist_ok=True)
    (root / "leads-outside").symlink_to(outside)
    return "leads-outside/out"


def _below_dangling(root: Path) -> str:
    return f"{_dangling(root)}/out"


def _below_loop(root: Path) -> str:
    return f"{_loop(root)}/out"


def _linked_marker(root: Path) -> str:
    place = root / "linked-marker"
    place.mkdir()
    (place / "notes.txt").write_text(MINE)
    (root / "marker.json").write_text('{"simspec_folder": 1, "kind": "compiled", "files": ["notes.txt"]}')
    (place / "simspec-folder.json").symlink_to("../marker.json")
    return "linked-marker"


def marked(text: str, name: str) -> Callable[[Path], str]:
    """A folder whose marker is ``text``."""

    def make(root: Path) -> str:
        (root / name).mkdir()
        (root / name / "notes.txt").write_text(MINE)
        (root / name / "simspec-folder.json").write_text(text)
        return name

    return make


def _by_name(root: Path) -> str:
    """A folder that looks like simspec's by its files' names, and is not."""
    place = root / "generated" / "fall"
    place.mkdir(parents=True)
    for name in ("world.json", "certificate.json", "provenance.json", "bodies.parquet", "report.json"):
        (place / name).write_text(MINE)
    return "generated/fall"


def _stage_by_name(root: Path) -> str:
    """A folder of a stage's name, which is not one: it must be left alone too."""
    (root / ".simspec-0123456789abcdef").mkdir()
    (root / ".simspec-0123456789abcdef" / "mine.txt").write_text(MINE)
    return "thesis" if (root / "thesis").exists() else _folder(root)


KINDS: dict[str, Callable[[Path], str]] = {
    "file": _file,
    "folder": _folder,
    "folder with only a hidden folder": _hidden,
    "pipe": _fifo,
    "socket": _socket,
    "link to a file": _link_to_file,
    "link to a folder": _link_to_folder,
    "link to an empty folder": _link_to_empty,
    "dangling link": _dangling,
    "link to itself": _loop,
    "below a file": _below_file,
    "below a pipe": _below_fifo,
    "below a link that leads outside": _below_link_outside,
    "below a dangling link": _below_dangling,
    "below a loop": _below_loop,
    "marker is a link": _linked_marker,
    "marker is not JSON": marked("<<<<<<< HEAD\n", "conflict"),
    "marker of another form": marked('{"simspec_folder": 99, "kind": "compiled", "files": []}', "newer"),
    "marker is a list": marked("[]", "list"),
    "marker with more": marked('{"simspec_folder": 1, "kind": "compiled", "files": [], "more": 1}', "more"),
    "marker names files outside": marked(
        '{"simspec_folder": 1, "kind": "compiled", "files": ["../notes.txt"]}', "reaching"
    ),
    "marker of another kind": marked('{"simspec_folder": 1, "kind": "other", "files": []}', "other"),
    "looks like simspec's by its names": _by_name,
    "next to a folder of a stage's name": _stage_by_name,
    "device": lambda root: "/dev/null",
    "full device": lambda root: "/dev/full",
    "empty path": lambda root: "",
    "working folder": lambda root: ".",
    "its parent": lambda root: "..",
    "parent through a folder": lambda root: f"{_folder(root)}/..",
    "grandparent": lambda root: "../..",
    "root": lambda root: "/",
    "working folder by its whole path": lambda root: str(root),
    "its parent by the whole path": lambda root: str(root.parent),
    "home": lambda root: str(Path.home()),
    "a name that is too long": lambda root: "x" * 300,
    "a path that is too long": lambda root: "/".join(["x" * 200] * 25),
    "through a folder that is missing": lambda root: "missing/../out/..",
}
"""Each makes a target below ``root``, the working folder, and returns how a user names it."""
