"""The files of models that an `<include>` names, and the two models that are known without a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from simspec.errors import Location, Problem, SpecError
from simspec.imports.elements import Element, parse
from simspec.imports.files import LIBRARY, PACKAGE, SCHEME, Files
from simspec.imports.packages import CONFIGURATIONS, MissingFileError
from simspec.imports.sdf.versions import NEWEST, OLDEST, Version, parsed
from simspec.language.foreign import suffixes
from simspec.language.sources import shown_path

ENDS: Final = (".sdf", ".world", ".xml")
"""Ends of names of files, where others are folders of models."""
MODELS: Final = "model://"
SUN: Final = "sun"
GROUND: Final = "ground_plane"
WITHOUT_FILES: Final = (SUN, GROUND)
"""Models of the public database that nearly every world includes, and that are known without it."""
GROUND_FRICTION: Final = 100.0
"""Of the database's model `ground_plane` (osrf/gazebo_models, `ground_plane/model.sdf`: `mu` 100 and `mu2` 50)."""
GROUND_TEXT: Final = f"""<sdf version="1.5"><model name="{GROUND}"><static>true</static><link name="link">
<collision name="collision"><geometry><plane><normal>0 0 1</normal></plane></geometry>
<surface><friction><ode><mu>{GROUND_FRICTION:g}</mu><mu2>{GROUND_FRICTION:g}</mu2></ode></friction></surface></collision>
<visual name="visual"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>
</link></model></sdf>"""
GROUND_NOTE: Final = (
    f"{MODELS}{GROUND} is not among the files: a fixed plane without an end, of friction {GROUND_FRICTION:g}, as the "
    "database has it in one direction; the 50 of the other exceed what nearly every surface has, and the smaller of two counts"
)
SUN_NOTE: Final = "simspec has no lights, and this model is one"
KNOWN: Final[Mapping[str, str]] = {GROUND: GROUND_TEXT}


def find_model(files: Files, uri: Element, folder: Path) -> Path | None:
    """The file of a URI: a file, or the folder of a model whose configuration names it; None for a model that is known without
    files and is not there. A path without a scheme starts from ``folder``, else is one in a package. Raises SpecError."""
    text = uri.text
    if text.lower().endswith(suffixes()) and not text.lower().endswith(ENDS):
        hint = f"use: {text} in a scenario, which places the robot"
        raise uri.error("only models in SDF can be included", found=text[:200], hint=hint)
    bare = text.removeprefix("./")
    by_path = SCHEME.fullmatch(text) is not None or text.startswith("/")
    is_file = "/" not in bare and text.lower().endswith(ENDS)
    wordings = [text] if by_path or is_file else [text, f"{MODELS}{bare}"]
    missing: list[SpecError] = []
    for wording in wordings:
        try:
            return _file(files, wording, uri, folder)
        except MissingFileError as error:
            missing.append(error)
    if called(text) in WITHOUT_FILES:
        return None
    raise missing[0 if "/" in bare else -1]


def called(text: str) -> str:
    """The name of the model that a URI means, in small letters."""
    match = LIBRARY.fullmatch(text)
    name = match[1] if match is not None else text.removeprefix(MODELS).strip("/")
    return re.sub(r"\s+", "_", unquote(name)).lower()


def _file(files: Files, text: str, uri: Element, folder: Path) -> Path:
    if text.lower().endswith(ENDS):
        return files.find(text, uri, folder)
    place = text.rstrip("/")
    try:
        configuration = files.find(f"{place}/{CONFIGURATIONS[0]}", uri, folder)
    except MissingFileError:
        if PACKAGE.fullmatch(place) is None and SCHEME.fullmatch(place) is not None:
            raise
        configuration = _older(files, place, uri, folder)
    shown = shown_path(configuration)
    choices: list[tuple[Version, str]] = []
    for child in parse(files.bytes_of(configuration, uri), shown).look("sdf"):
        version = parsed(child.attributes.get("version", "1.4"))
        if version is not None and OLDEST <= version <= NEWEST and child.text:
            choices.append((version, child.text))
    if not choices:
        raise SpecError([Problem("names no SDF file that simspec reads", location=Location(shown, 1, 1))])
    return files.find(f"{place}/{max(choices)[1]}", uri, folder)


def _older(files: Files, place: str, uri: Element, folder: Path) -> Path:
    """The configuration of a model under the name that it had before. Raises the error of the name that it has."""
    try:
        return files.find(f"{place}/{CONFIGURATIONS[1]}", uri, folder)
    except MissingFileError as error:
        problem = error.problems[0]
    hint = (problem.hint or "").replace(CONFIGURATIONS[1], CONFIGURATIONS[0])
    raise MissingFileError([uri.problem(problem.message, problem.found, hint=hint)])
