"""Models as their placements use them: parameters with values, mirrored, with a joint of the root. The result is a document as
a file would say it, whose marks are the file's, so that all that reads documents reads it, and errors name the place where a
value is written.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Unpack

from pydantic import ValidationError

from simspec.errors import Problem
from simspec.language import problems
from simspec.language.arrays import JointNames, NamePattern
from simspec.language.document import INVALID, Details, Document, Key, Mark, mapping
from simspec.language.joints import Joint
from simspec.language.mirroring import SAME, Flip, flip_of, mirrored, not_mirrored, together
from simspec.language.models import Model, Use
from simspec.language.parameters import MOST_PARAMETERS, ModelParameter, ModelParameters, ParameterName, is_reference
from simspec.language.quantities import DIMENSIONS, Reader
from simspec.language.strict import Faults, fault_problem, near
from simspec.language.vocabulary import TREE_JOINTS
from simspec.language.words import FileName, Name, Text, Word

_TEXTS = (FileName, Name, NamePattern, JointNames, Text, Word)
"""Readers of texts that are no quantities: no reference stands there."""


@dataclass(frozen=True)
class ModelPlacement:
    """A placement: the document that says it, its path there, and the values of parameters that it gives; ``flip``: the mirror
    of the model, by this placement and by those around it; ``joint``: of the model's root, with the document that says it and
    the path there."""

    document: Document
    path: tuple[Key, ...]
    values: Mapping[str, Any] = field(default_factory=dict)
    flip: Flip = SAME
    joint: tuple[Document, tuple[Key, ...]] | None = None

    def key(self) -> str:
        """The same for placements that make the same of a model."""
        joint = None if self.joint is None else [self.joint[0].file, *self.joint[1], self.joint[0].at(*self.joint[1])]
        return json.dumps([dict(self.values), self.flip, joint], sort_keys=True, default=str)


def placement_of(
    document: Document, path: tuple[Key, ...], placed: Mapping[str, Any], around: ModelPlacement | None
) -> ModelPlacement:
    """The placement at a path of ``document``, which is a file that ``around`` places, or is none itself."""
    flip, joint = flip_of(placed.get("mirror")), around.joint if around is not None else None
    if isinstance(placed.get("joint"), Mapping):
        joint = (document, (*path, "joint"))
    flip = together(flip, around.flip) if around is not None else flip
    return ModelPlacement(document, path, mapping(placed.get("with")), flip, joint)


def instance(document: Document, placement: ModelPlacement | None) -> tuple[Document, list[Problem]]:
    """A file as ``placement`` places it (None: it stands alone), and what is wrong with that."""
    data = document.data
    if not isinstance(data, Mapping):
        return document, []
    if "model" not in data:
        return _scenario(document)
    model = data["model"]
    if not isinstance(model, Mapping):
        return document, []
    made = _Maker(document)
    made.parameters(placement)
    if placement is not None and placement.flip != SAME:
        made.mirror(("model",), Model, placement.flip)
    if placement is not None and placement.joint is not None and "use" not in model:
        made.root_joint(("model", "bodies"), *placement.joint)
    return made.result(), made.problems


def _scenario(document: Document) -> tuple[Document, list[Problem]]:
    """A scenario: the models written in it mirrored, and with the joints that their placements give them."""
    made = _Maker(document)
    for name, placed in mapping(document.at("models")).items():
        path: tuple[Key, ...] = ("models", name)
        if not isinstance(placed, Mapping):
            continue
        flip = flip_of(placed.get("mirror"))
        if flip != SAME and "use" not in placed:
            made.mirror(path, Use, flip)
            made.remove(path, "mirror")
        joint = placed.get("joint")
        if not isinstance(joint, Mapping):
            continue
        if "origin" in joint and "pose" not in placed:
            made.put((*path, "pose"), joint["origin"], made.mark((*path, "joint", "origin")))
            made.remove((*path, "joint"), "origin")
        if "use" not in placed:
            made.root_joint((*path, "bodies"), document, (*path, "joint"))
    return made.result(), made.problems


class _Maker:
    """A document with changes; the other one stays as it is, and both share what is equal."""

    def __init__(self, document: Document):
        self._of = document
        self._document = Document(
            document.file, document.data, document.mark, document.problems, dict(document.references)
        )
        self.problems: list[Problem] = []

    def result(self) -> Document:
        """The document as it is now."""
        return self._document

    def mark(self, path: tuple[Key, ...]) -> Mark | None:
        """The mark of a value of the document as it was."""
        return _mark_at(self._of, path)

    def put(self, path: tuple[Key, ...], value: Any, mark: Mark | None) -> None:
        """Put a value, which is written at ``mark``, into the mapping around it, which is there."""
        holder, marks = self._opened(path[:-1])
        holder[path[-1]] = value
        if marks is not None and mark is not None and marks.items is not None and marks.keys is not None:
            marks.items[path[-1]] = mark
            marks.keys[str(path[-1])] = (mark.line, mark.column)

    def remove(self, path: tuple[Key, ...], key: str) -> None:
        """Take a key out of a mapping."""
        self._opened(path)[0].pop(key, None)

    def _opened(self, path: tuple[Key, ...]) -> tuple[dict[Any, Any], Mark | None]:
        """The mapping at a path and its mark, both copied with all that leads to them."""
        document = self._document
        data = document.data = dict(document.data)
        mark = document.mark = _copied(document.mark)
        for key in path:
            data[key] = dict(data[key])
            data = data[key]
            if mark is not None and mark.items is not None and key in mark.items:
                below = _copied(mark.items[key])
                mark.items[key], mark = below, below  # type: ignore[assignment]
            else:
                mark = None
        return data, mark

    def mirror(self, path: tuple[Key, ...], kind: Any, flip: Flip) -> None:
        """Mirror the model at a path."""
        for place in not_mirrored(self._document, (*path, "bodies")):
            message, hint = (
                "a height field cannot be mirrored exactly",
                "place it in another model, which is not mirrored",
            )
            self.problems.append(self._document.problem(place, message, hint=hint, code="S407"))
        model = mirrored(self._document.at(*path), kind, flip)
        holder, _ = self._opened(path[:-1])
        holder[path[-1]] = model

    def root_joint(self, path: tuple[Key, ...], user: Document, place: tuple[Key, ...]) -> None:
        """Give the root of the bodies at ``path`` the joint that ``user`` says at ``place``."""
        joint, bodies = user.at(*place), mapping(self._document.at(*path))
        roots = [name for name, body in bodies.items() if isinstance(body, Mapping) and "parent" not in body]
        try:
            Joint.model_validate(joint)
        except ValidationError:
            return  # reported where it is read
        if len(roots) != 1 or joint.items() <= (before := mapping(bodies[roots[0]].get("joint"))).items():
            return  # no tree; or the joint that it has
        root = (*path, roots[0])
        kind = "several joints" if "joints" in bodies[roots[0]] else f"a {before.get('type')} joint"
        if "joints" in bodies[roots[0]] or before.get("type") in TREE_JOINTS:
            message, hint = f"the root {roots[0]!r} has a joint of its own", "remove this one"
            self.problems.append(user.problem(place, message, key=True, found=kind, hint=hint, code="S404"))
            return
        named = {"name": before["name"]} if "name" in before else {}
        mark = _mark_at(user, place)
        if mark is not None:
            mark = Mark(mark.line, mark.column, mark.keys, mark.items, mark.file or user.file)
        self.put((*root, "joint"), {**named, **{key: value for key, value in joint.items() if key != "origin"}}, mark)
        self.remove(root, "fixed")
        if joint.get("type") != "free":
            self.remove(root, "velocity")

    def parameters(self, placement: ModelPlacement | None) -> None:
        """Put quantities in place of references to the parameters of the model."""
        model = self._document.data["model"]
        written, given = mapping(model.get("parameters")), placement.values if placement is not None else {}
        if len(written) > MOST_PARAMETERS:
            allowed = f"up to {MOST_PARAMETERS}"
            self._report(
                ("model", "parameters"), "too many parameters", found=f"{len(written)}", allowed=allowed, code="S109"
            )
            return
        declared = {name: parameter for name, parameter in written.items() if _is_declaration(name, parameter)}
        parameters = ModelParameters(declared, given, written.keys() - declared.keys())
        self._check(parameters, written, placement)
        if not written:
            return
        fields = problems.fields(Model)
        changed = {
            key: value if key == "parameters" else self._substituted(fields.get(key), value, ("model", key), parameters)
            for key, value in model.items()
        }
        self._document.data = {**self._document.data, "model": changed}
        for name in declared.keys() - parameters.referenced:
            hint = f"remove it, or write ${name} where it counts"
            message = f"no quantity of the model refers to the parameter {name!r}"
            self._report(("model", "parameters", name), message, key=True, hint=hint, code="S311")

    def _check(self, parameters: ModelParameters, written: Mapping[str, Any], placement: ModelPlacement | None) -> None:
        """Report values that are missing, unknown or wrong."""
        values = placement.values if placement is not None else {}
        for name in values:
            if name in written or placement is None:
                continue
            place, known = (*placement.path, "with", name), list(written)
            allowed = ", ".join(known) or "nothing: it has no parameters"
            message = f"the model has no parameter {name!r}"
            self.problems.append(
                placement.document.problem(
                    place, message, key=True, allowed=allowed, hint=near(name, known), code="S302"
                )
            )
        for name, parameter in parameters.declared.items():
            if name in values or "default" in parameter:
                continue
            unit = DIMENSIONS[parameters.dimensions[name]].unit
            example = f"{name}: 0.1{'' if unit == '1' else f' {unit}'}"
            message = f"the parameter {name!r} of the model has no value"
            if placement is None:
                hint = f"a default, or --set model.parameters.{name}.default=…"
                self._report(("model", "parameters", name), message, key=True, hint=hint, code="S102")
            else:
                place, hint = (*placement.path, "with"), f"with: {{{example}}}"
                self.problems.append(placement.document.problem(place, message, hint=hint, code="S102"))
        for name, of_placement, faults in parameters.wrong:
            for fault in faults:
                if of_placement and placement is not None:
                    place = (*placement.path, "with", name)
                    self.problems.append(fault_problem(placement.document, place, fault))
                else:
                    self.problems.append(fault_problem(self._document, ("model", "parameters", name, "default"), fault))

    def _report(self, path: tuple[Key, ...], message: str, **more: Unpack[Details]) -> None:
        self.problems.append(self._document.problem(path, message, **more))

    def _substituted(self, kind: Any, value: Any, path: tuple[Key, ...], parameters: ModelParameters) -> Any:
        """A value with quantities in place of references; ``kind``: its type in the language."""
        if isinstance(value, Mapping):
            return {
                key: self._substituted(_child(kind, key), item, (*path, key), parameters) for key, item in value.items()
            }
        if isinstance(value, (list, tuple)):
            return [
                self._substituted(_child(kind, index), item, (*path, index), parameters)
                for index, item in enumerate(value)
            ]
        if not is_reference(value) or kind is None or isinstance(kind, _TEXTS):
            return value
        try:
            quantity = parameters.quantity(value)
        except Faults as error:
            self.problems += [fault_problem(self._document, path, fault) for fault in error.faults]
            return INVALID
        if quantity is None:
            return INVALID
        self._document.references[path] = value
        return quantity


def _child(kind: Any, step: Key) -> Any:
    """The type below a type of the language; a reader reads all that is in its value."""
    return kind if isinstance(kind, Reader) else problems.child(kind, step)


def _is_declaration(name: Any, parameter: Any) -> bool:
    try:
        ParameterName().read(name)
        ModelParameter.model_validate(parameter)
    except (Faults, ValidationError):
        return False
    return isinstance(parameter, Mapping)


def _mark_at(document: Document, path: tuple[Key, ...]) -> Mark | None:
    mark = document.mark
    for key in path:
        if mark is None or mark.items is None:
            return None
        mark = mark.items.get(key)
    return mark


def _copied(mark: Mark | None) -> Mark | None:
    if mark is None:
        return None
    keys = None if mark.keys is None else dict(mark.keys)
    return Mark(mark.line, mark.column, keys, None if mark.items is None else dict(mark.items), mark.file)
