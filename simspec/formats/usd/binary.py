"""The text of a stage as other files of USD: binary (``.usdc``), and a package (``.usdz``) that holds one binary file. usd-core
writes them: the same text gives the same bytes, in one release of usd-core."""

from __future__ import annotations

from typing import Final

from simspec.errors import Problem, SpecError
from simspec.scratch import scratch_folder

TEXT: Final = ".usda"
BINARY: Final = ".usdc"
PACKAGE: Final = ".usdz"
INSIDE: Final = "world.usdc"
"""The file in a package. Meshes are prims of it, so that nothing else is in the package and no path leads out of it."""


def encoded(text: str, suffix: str) -> bytes:
    """The bytes of a file of this kind. Raises SpecError where usd-core is not installed."""
    if suffix == TEXT:
        return text.encode()
    try:
        from pxr import Sdf
    except ImportError:
        hint = f"pip install 'simspec[usd]'; {TEXT} needs nothing"
        raise SpecError([Problem(f"{suffix} is written by usd-core, which is not installed", hint=hint)]) from None
    layer = Sdf.Layer.CreateAnonymous(TEXT)
    with scratch_folder("usd") as folder:
        inside = folder / INSIDE
        if not (layer.ImportFromString(text) and layer.Export(str(inside))):
            raise ValueError("usd-core does not take the text that simspec wrote")
        if suffix == BINARY:
            return inside.read_bytes()
        package = folder / f"package{PACKAGE}"
        with Sdf.ZipFileWriter.CreateNew(str(package)) as writer:
            writer.AddFile(str(inside), INSIDE)
        return package.read_bytes()
