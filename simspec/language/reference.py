"""The language as a JSON Schema (draft 07), for editors, and as the tables of docs/reference/language.md and
docs/guide/studies.md: every field's type, unit, default and meaning, from the models.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from simspec.language import problems
from simspec.language.arrays import NamePattern
from simspec.language.contact import Contact
from simspec.language.editor_hints import field_hints, snippets, with_word_meanings
from simspec.language.expectations import KINDS, Expectation
from simspec.language.joints import Joint
from simspec.language.models import File
from simspec.language.quantities import Reader
from simspec.language.shapes import Orientation
from simspec.language.strict import Strict
from simspec.language.sweep import FiguresFile, StudyFile
from simspec.language.sweep_values import Range
from simspec.language.vocabulary import COMBINATIONS, SCALAR_JOINTS
from simspec.language.words import Name

DIALECT = "http://json-schema.org/draft-07/schema#"
TITLE = "simspec: a scenario or a model for every physics engine"
LANGUAGES: Mapping[str, tuple[type[Strict], str]] = {
    "language": (File, TITLE),
    "study": (StudyFile, "simspec: a study, sweeps of several scenarios"),
    "figures": (FiguresFile, "simspec: figures from elsewhere that a study is held against"),
}
"""The model of each kind of file, and the title of its schema."""


def json_schema(of: str = "language") -> dict[str, Any]:
    """The schema of a spec, or of another kind of file (:data:`LANGUAGES`): units are allowed where numbers are, unknown keys
    nowhere."""
    root, title = LANGUAGES[of]
    models = {**problems.models(root), **(nested_models() if root is not FiguresFile else {})}
    definitions = {name: _model(model) for name, model in sorted(models.items())}
    return {"$schema": DIALECT, "title": title, **definitions.pop(root.__name__), "definitions": definitions}


def nested_models() -> dict[str, type[Strict]]:
    """Models that stand inside values that readers read, by name."""
    return {model.__name__: model for model in (Orientation, Range)}


def schema_text(of: str = "language") -> str:
    """The schema as the text of a file."""
    return json.dumps(json_schema(of), indent=2, ensure_ascii=False) + "\n"


def is_schema(content: bytes, of: str = "language") -> bool:
    """Whether a file is a schema of this kind of file, of whatever version: by its title, as JSON."""
    try:
        schema = json.loads(content)
    except (ValueError, RecursionError):
        return False
    return isinstance(schema, dict) and schema.get("title") == LANGUAGES[of][1] and schema.get("$schema") == DIALECT


def _model(model: type[Strict]) -> dict[str, Any]:
    properties = {}
    for name, kind in problems.fields(model).items():
        field = model.model_fields[name]
        described = {"description": field.description} if field.description else {}
        default = {} if field.is_required() else _default(problems.default(kind, field))
        # draft 07 ignores the keys next to a $ref
        what = {"allOf": [_kind(kind)]} if problems.is_model(kind) else _kind(kind)
        unit = kind.unit() if isinstance(kind, Reader) else ""
        properties[name] = with_word_meanings(
            {**described, **what, **default}, f"{model.__name__}.{name}", field.description or ""
        )
        properties[name] |= field_hints(properties[name], _what(kind), unit)
    if model is Contact:
        word = {"anyOf": [{"enum": list(COMBINATIONS)}, *properties["combine"].pop("allOf")]}
        properties["combine"].update(with_word_meanings(word, "Contact.combine", ""))
    schema: dict[str, Any] = {
        "description": " ".join((inspect.getdoc(model) or "").split()),
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
    }
    required = [name for name, field in model.model_fields.items() if field.is_required()]
    if required:
        schema["required"] = required
    if rules := _rules(model):
        schema["allOf"] = rules
    return schema | snippets(model.__name__)


def _kind(kind: Any) -> dict[str, Any]:
    if isinstance(kind, Reader):
        return kind.schema()
    if isinstance(kind, problems.Free):
        return {
            "type": "object",
            "propertyNames": {"pattern": kind.key.schema()["pattern"]},
            "additionalProperties": _kind(kind.item),
        }
    if isinstance(kind, list):
        return {"type": "array", "items": _kind(kind[0])}
    if problems.is_model(kind):
        return {"$ref": f"#/definitions/{kind.__name__}"}
    return {}


def _default(value: Any) -> dict[str, Any]:
    """The default, where one can be written: None stands for "not given", a model for its own defaults."""
    if value is None or isinstance(value, Strict):
        return {}
    return {"default": list(value) if isinstance(value, tuple) else value}


def _rules(model: type[Strict]) -> list[dict[str, Any]]:
    """The rules of a model between its fields."""
    rules: list[dict[str, Any]] = []
    if model.ALTERNATIVES:
        rules.append({"oneOf": [{"required": [name]} for name in model.ALTERNATIVES]})
    fields = problems.fields(model)
    if "rpy" in fields and "quat" in fields:
        rules.append({"not": {"required": ["rpy", "quat"]}})
    if model is Joint:
        with_axis = {"properties": {"type": {"enum": list(SCALAR_JOINTS)}}, "required": ["type"]}
        rules.append({"if": with_axis, "then": {"required": ["axis"]}, "else": {"not": {"required": ["axis"]}}})
    if model is File:
        rules.append({"anyOf": [{"required": ["bodies"]}, {"required": ["models"]}, {"required": ["model"]}]})
    return rules


BEGIN = "<!-- fields of {name}: generated by simspec.language.reference -->"
END = "<!-- end of fields of {name} -->"
EXPECTATIONS = "Expectation"


def tables() -> dict[str, str]:
    """A Markdown table for every model of the language, by the model's name; ``Expectation``: all kinds in one."""
    tables = {}
    for name, model in {**problems.models(File), **nested_models()}.items():
        if model is not Expectation and model.__module__ != Expectation.__module__:
            tables[name] = "\n".join(_table(model))
    tables[EXPECTATIONS] = "\n".join(_expectations())
    return tables


def study_tables() -> dict[str, str]:
    """The same for the models of studies and their figures, whose other models are those of specs."""
    known = {**problems.models(File), **nested_models()}
    models = {**problems.models(StudyFile), **problems.models(FiguresFile)}
    new = {name: "\n".join(_table(model)) for name, model in models.items() if name not in known}
    return {name: text.replace("(#sweep)", "(../reference/language.md#sweep)") for name, text in new.items()}


def update(text: str) -> str:
    """A page with the table between every pair of markers made anew. Raises KeyError for a marker of no model."""
    made = {**tables(), **study_tables()}

    def replaced(match: re.Match[str]) -> str:
        name = match["name"]
        return f"{BEGIN.format(name=name)}\n{made[name]}\n{END.format(name=name)}"

    pattern = BEGIN.format(name="(?P<name>[A-Za-z]+)") + ".*?" + END.format(name="(?P=name)")
    return re.sub(pattern, replaced, text, flags=re.DOTALL)


def missing(text: str, of: Mapping[str, str] | None = None) -> list[str]:
    """Models that a page has no marker for; ``of``: their tables (default: those of specs)."""
    return [name for name in (tables() if of is None else of) if BEGIN.format(name=name) not in text]


def _table(model: type[Strict]) -> Iterator[str]:
    yield "| field | what | unit | default | meaning |"
    yield "|---|---|---|---|---|"
    for name, kind in problems.fields(model).items():
        field = model.model_fields[name]
        default = "required" if field.is_required() else _default_cell(problems.default(kind, field))
        unit = kind.unit() if isinstance(kind, Reader) else ""
        yield f"| `{name}` | {_what(kind)} | {unit} | {default} | {_cell(field.description or '')} |"
    if model.ALTERNATIVES:
        yield ""
        yield f"Exactly one of {', '.join(f'`{name}`' for name in model.ALTERNATIVES)}."


def _expectations() -> Iterator[str]:
    yield "| kind | what must hold | parameter | what | unit | needed | meaning |"
    yield "|---|---|---|---|---|---|---|"
    for name, kind in KINDS.items():
        for index, (key, parameter) in enumerate(kind.parameters.items()):
            first = (f"`{name}`", _cell(kind.meaning)) if index == 0 else ("", "")
            needed = "yes" if parameter.required else ("one of them" if key in kind.alternatives else "no")
            reader = parameter.reader
            yield (
                "| "
                + " | ".join((*first, f"`{key}`", reader.describe(), reader.unit(), needed, _cell(parameter.meaning)))
                + " |"
            )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _what(kind: Any) -> str:
    if isinstance(kind, Reader):
        return kind.describe()
    if isinstance(kind, problems.Free):
        key = "name" if isinstance(kind.key, (Name, NamePattern)) else kind.key.describe()
        return f"{_what(kind.item)} by {key}" if kind.item is not Any else "by joint name"
    if isinstance(kind, list):
        return f"list of {_what(kind[0])}"
    return f"[{kind.__name__}](#{kind.__name__.lower()})"


def _default_cell(value: Any) -> str:
    if value is None or (isinstance(value, (dict, list, tuple)) and not value):
        return ""
    if isinstance(value, Strict):
        return "see there"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_default_cell(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


PAGES = ("docs/reference/language.md", "docs/guide/studies.md")


def main() -> None:
    """Write the tables of the pages anew."""
    from pathlib import Path

    from simspec.outputs.files import read_bytes
    from simspec.outputs.writing import write_file

    for path in map(Path, PAGES):
        before = read_bytes(path)
        write_file(path, update(before.decode()), before.__eq__)


if __name__ == "__main__":
    main()
