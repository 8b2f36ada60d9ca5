"""A separate cache folder for a test, empty but for the compiled parts of engines, each of which takes 5 to 15 s."""

from __future__ import annotations

from pathlib import Path

from simspec.outputs.files import cache_folder

COMPILED = "compiled"


def cache_home(place: Path) -> str:
    """A folder for XDG_CACHE_HOME in ``place``; compiled parts are linked to the cache of this process."""
    whole = cache_folder(COMPILED)
    assert whole is not None
    whole.mkdir(parents=True, exist_ok=True)
    folder = place / "cache" / "simspec"
    folder.mkdir(parents=True)
    (folder / COMPILED).symlink_to(whole)
    return str(folder.parent)
