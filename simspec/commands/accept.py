"""``simspec accept``: write the entries into a spec that let engines have it, each with a short reason."""

from __future__ import annotations

import dataclasses
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simspec.commands.loading import load_spec
from simspec.commands.options import demand_trusted, engine_names, engines_at_work, print_json
from simspec.commands.scenario_options import AcceptOptions
from simspec.compiler import missing_options
from simspec.engines.kit.registry import engine_name
from simspec.errors import EXIT_OK, Problem, SpecError, UnsupportedError
from simspec.files import resource_folder
from simspec.language.document import read_text
from simspec.language.load import Spec
from simspec.outputs.writing import write_file
from simspec.report.matrix import link
from simspec.report.screen import say
from simspec.selection import NotTaken, Selection, named, refusal
from simspec.world.types import World


def accept(options: AcceptOptions) -> int:
    """Write the entries that the engines of ``--engine`` (without: the project's, or those installed) need into the file."""
    loaded = load_spec(options, options.spec, warn=False)
    words, pythons = options.chosen, options.interpreters()
    demand_trusted(engine_names(words), pythons)
    # by label: accepted features may depend on the version
    selection = named(engine_names(words), pythons) if words else engines_at_work(None, pythons)
    return accept_world(loaded.spec, loaded.world, selection, options.as_json)


def accept_world(spec: Spec, world: World, selection: Selection, as_json: bool) -> int:
    """Write the entries that engines need into the spec's file; existing entries stay. Unnamed engines that do not support
    the world at all are listed. Raises SpecError for scenarios of the library and for files that cannot be written,
    UnsupportedError with every feature that a named engine, or every engine, does not support at all."""
    path = _writable_file(spec)
    wanted: dict[str, dict[str, dict[str, str]]] = {}
    not_taken: dict[str, NotTaken] = {}
    for name in selection.engines:
        try:
            for key, features in missing_options(world, name, selection.pythons).items():
                wanted.setdefault(engine_name(name), {}).setdefault(key, {}).update(features)
        except UnsupportedError as error:
            located = [dataclasses.replace(problem, location=spec.locate(problem.path)) for problem in error.problems]
            not_taken[name] = refusal(located)
    if not_taken and (selection.named or not wanted):
        raise UnsupportedError([problem for refused in not_taken.values() for problem in refused.problems])
    wanted = {name: keys for name, keys in wanted.items() if keys}
    if wanted:
        before = read_text(path)
        after = edited(before, wanted)
        write_file(path, after, ours=lambda found: found == before.encode())
    if as_json:
        print_json({"file": path, "written": bool(wanted), "added": wanted, "not_taken": not_taken})
        return EXIT_OK
    for name, refused in not_taken.items():
        say(f"not for {name}: {refused}")
    for name, keys in wanted.items():
        for key, features in keys.items():
            for feature, why in features.items():
                say(f"engines.{name}.{key}: {feature}  # {why}")
                say(f"    {link(name, feature)}")
    say(f"{path}: {'written' if wanted else 'no entries missing'}")
    return EXIT_OK


def is_writable(spec: Spec) -> bool:
    """Whether entries can be written into the file of a spec."""
    try:
        _writable_file(spec)
    except SpecError:
        return False
    return True


def _writable_file(spec: Spec) -> Path:
    """The file of a spec that is the user's own."""
    path = spec.path
    if path is None:
        raise SpecError([Problem("a spec made in Python has no file to write")])
    if spec.source.imported is not None:
        hint = f"simspec import {path} -o {path.stem}.yaml; then simspec accept {path.stem}.yaml"
        raise SpecError([Problem(f"{path} is no spec, and is not changed", hint=hint)])
    if spec.source.package is not None:
        message = f"{path.name} belongs to {spec.source.package.name} and is not changed"
        raise SpecError([Problem(message, hint="use it in a spec of your own")])
    if path.resolve().is_relative_to(resource_folder("specs").resolve()):
        hint = "copy it to a file of your own"
        raise SpecError([Problem(f"{path} belongs to simspec's library and is not changed", hint=hint)])
    return path


def edited(before: str, wanted: Mapping[str, Mapping[str, Mapping[str, str]]]) -> str:
    """The text of a spec with features added under ``engines``; all else stays byte for byte. Raises SpecError where the file
    is not in YAML block style (JSON)."""
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    lines = before.splitlines(keepends=True)
    first, last = _block(lines)
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 1_000_000
    yaml.indent(mapping=2, sequence=4, offset=2)
    actual: Any = (yaml.load("".join(lines[first:last])) or {}).get("engines")
    engines = actual if isinstance(actual, CommentedMap) else CommentedMap()
    engines.fa.set_block_style()
    for name, keys in wanted.items():
        engine = engines.get(name)
        options = engine if isinstance(engine, CommentedMap) else CommentedMap()
        options.fa.set_block_style()
        for key, features in keys.items():
            listed = options.get(key)
            if not isinstance(listed, CommentedSeq):
                listed = CommentedSeq()
            listed.fa.set_block_style()
            for feature, why in features.items():
                listed.append(feature)
                listed.yaml_add_eol_comment(why, len(listed) - 1)
            options[key] = listed
        engines[name] = options
    out = io.StringIO()
    yaml.dump(CommentedMap({"engines": engines}), out)
    found = "".join([*lines[:first], out.getvalue(), *lines[last:]])
    if any(feature not in found for keys in wanted.values() for features in keys.values() for feature in features):
        raise AssertionError("a feature was not written")
    return found


def _block(lines: list[str]) -> tuple[int, int]:
    """The lines of the file's `engines`, or the empty place at its end for one."""
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    keys = [k for k, line in enumerate(lines) if _TOP.match(line)]
    if not any(lines[k].startswith("simspec:") for k in keys):
        hint = "add the entries by hand, or run simspec fmt first"
        raise SpecError([Problem("this file is not in YAML block style: its keys do not begin lines", hint=hint)])
    start = next((k for k in keys if _ENGINES.match(lines[k])), None)
    if start is None:
        return len(lines), len(lines)
    end = next((k for k in keys if k > start), len(lines))
    while end > start + 1 and (not lines[end - 1].strip() or lines[end - 1].startswith("#")):
        end -= 1  # blank lines and comments before the next key are its own
    return start, end


_TOP = re.compile(r"[\w\"']+\s*:")
_ENGINES = re.compile(r"[\"']?engines[\"']?\s*:")
