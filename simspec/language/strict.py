"""The base of every model of the language, and what it reports.

A fault is a wrong value or a wrong combination of values. Every model reports all its faults at once: those of its fields,
and those that :meth:`Strict.faults` finds between fields, whatever else is wrong.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from simspec.errors import Problem
from simspec.language.document import INVALID, Document, Key

LONGEST_WORD = 200
"""Characters of an unknown word that are looked at for a suggestion."""
MOST_COMPARED = 50_000
"""Words that are compared for suggestions while one spec is read: half a second's worth."""
Given = TypeVar("Given")
_left: ContextVar[list[int] | None] = ContextVar("_left", default=None)
"""How many are left, in a list of one; None: no bound."""

FAULT = "simspec"
"""pydantic error type of our own faults."""
REPORTED = "simspec_reported"
"""The same of values that have been reported already (``INVALID``)."""


class Fault(NamedTuple):
    """A fault, at ``loc`` below the model (or value) that reports it."""

    loc: tuple[str | int, ...]
    message: str
    found: str | None = None
    allowed: str | None = None
    hint: str | None = None
    reported: bool = False
    code: str = ""


class Faults(ValueError):
    """Raised by readers of single values."""

    def __init__(self, faults: Sequence[Fault]):
        super().__init__(faults[0].message)
        self.faults = tuple(faults)


def fault(
    message: str, found: str | None = None, allowed: str | None = None, hint: str | None = None, *, code: str
) -> Faults:
    """One fault at the value itself."""
    return Faults([Fault((), message, found, allowed, hint, code=code)])


def show(value: Any) -> str:
    """A value as a message shows it: short."""
    if isinstance(value, Mapping):
        keys = list(value)
        return "{" + ", ".join(str(key) for key in keys[:6]) + (", ..." if len(keys) > 6 else "") + "}"
    text = {None: "nothing", True: "true", False: "false"}.get(value) if value is None or value is True else None
    text = text or ("false" if value is False else repr(value))
    return text if len(text) <= 80 else text[:77] + "..."


@contextlib.contextmanager
def bounded_suggestions() -> Iterator[None]:
    """Within it, :func:`near` compares at most :data:`MOST_COMPARED` words in all: a thousand wrong names among a thousand
    right ones would take minutes. All problems are reported; the later ones only lack a suggestion."""
    token = _left.set([MOST_COMPARED])
    try:
        yield
    finally:
        _left.reset(token)


def near(word: str, words: Iterable[str]) -> str | None:
    """A hint naming the nearest of ``words``."""
    left = _left.get()
    if left is not None and left[0] <= 0:
        return None
    known = sorted(map(str, words))[:3000]  # sorted: the same suggestion every time
    if left is not None:
        left[0] -= len(known)
    similar = difflib.get_close_matches(str(word)[:LONGEST_WORD], known, 1, 0.5)
    return f"did you mean {similar[0]!r}?" if similar else None


def _details(fault: Fault, value: Any) -> InitErrorDetails:
    context = {"code": fault.code, "found": fault.found, "allowed": fault.allowed, "hint": fault.hint}
    kind = REPORTED if fault.reported else FAULT
    # a message goes in whole: pydantic would take braces in a template for its own
    error = PydanticCustomError(kind, "{message}", {"message": fault.message, **context})
    return InitErrorDetails(type=error, loc=fault.loc, input=value)


def raised(faults: Sequence[Fault], value: Any, others: ValidationError | None = None) -> ValidationError:
    """The faults as the error that pydantic understands, with pydantic's own ``others``."""
    details = [_details(item, value) for item in faults]
    for error in others.errors(include_url=False) if others is not None else ():
        kind: Any = error["type"]
        if kind in (FAULT, REPORTED):
            kind = PydanticCustomError(kind, "{message}", error["ctx"])
        elif kind == "value_error":
            kind = PydanticCustomError(FAULT, "{message}", {"code": "S104", "message": error["msg"]})
        details.append(InitErrorDetails(type=kind, loc=error["loc"], input=error["input"], ctx=error.get("ctx", {})))
    return ValidationError.from_exception_data("spec", details)


def as_faults(error: ValidationError, fields: Iterable[str]) -> Faults:
    """A model's error as faults; ``fields`` are the model's, for suggestions."""
    faults = []
    for item in error.errors(include_url=False):
        if item["type"] in (FAULT, REPORTED):
            context = item["ctx"]
            more = (context["message"], context["found"], context["allowed"], context["hint"], item["type"] == REPORTED)
            faults.append(Fault(item["loc"], *more, code=context["code"]))
        elif item["type"] == "missing":
            faults.append(Fault(item["loc"][:-1], f"{item['loc'][-1]} is missing", code="S102"))
        else:
            word = str(item["loc"][-1]) if item["loc"] else ""
            faults.append(
                Fault(item["loc"], f"unknown key {word!r}", None, ", ".join(fields), near(word, fields), code="S101")
            )
    return Faults(faults)


def replace_loc(faults: Iterable[Fault], prefix: tuple[str | int, ...]) -> list[Fault]:
    """The faults, seen from above."""
    return [item._replace(loc=(*prefix, *item.loc)) for item in faults]


def unreported(value: Any) -> Any:
    """The value. Raises Faults for one that has been reported already."""
    if value is INVALID:
        raise Faults([Fault((), "", reported=True)])
    return value


def read_each(items: Iterable[tuple[str | int, Any]], read: Callable[[Any], Given]) -> list[Given]:
    """Every item of (key, value), read. Raises Faults with those of all items, each at its key."""
    found, faults = list[Given](), list[Fault]()
    for key, item in items:
        try:
            found.append(read(unreported(item)))
        except Faults as error:
            faults += replace_loc(error.faults, (key,))
    if faults:
        raise Faults(faults)
    return found


def read_entries(
    data: Mapping[Any, Any], read_name: Callable[[Any], str], read: Callable[[Any], Given]
) -> dict[str, Given]:
    """Every entry of a mapping, its name and its value read. Raises Faults with those of all entries, each at its name."""
    entries = ((str(name), (name, item)) for name, item in data.items())
    return dict(read_each(entries, lambda entry: (read_name(entry[0]), read(unreported(entry[1])))))


def fault_problem(document: Document, path: Sequence[Key], fault: Fault) -> Problem:
    """A fault of the value at ``path`` as a problem."""
    return document.problem(
        (*path, *fault.loc),
        fault.message,
        found=fault.found,
        allowed=fault.allowed,
        hint=fault.hint,
        code=fault.code,
    )


ABSENT: Final = None
"""Default of a field that need not be given."""

if TYPE_CHECKING:
    Maybe: TypeAlias = Given | None
else:

    class Maybe:
        """The type of a field that need not be given: its readers have to expect None, which a spec cannot say."""

        def __class_getitem__(cls, given: Any) -> Any:
            return given


def required(value: Given | None) -> Given:
    """A field that need not be given, where the model's checks have seen that it is. Raises ValueError where they have not."""
    if value is None:
        raise ValueError("a field is not given, and the checks of its model let that pass")
    return value


class Strict(BaseModel):
    """Base of every model: unknown keys are errors, instances are frozen, None means "not given" and is no value."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=(), defer_build=True)

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ()
    """Fields of which exactly one must be given."""

    @classmethod
    def prepare(cls, data: dict[str, Any]) -> tuple[dict[str, Any], list[Fault]]:
        """The data as the fields want them (a copy where it differs), and faults of what could not be prepared."""
        return data, []

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        """The faults between fields. The data are as written: any value may have any type."""
        return ()

    @model_validator(mode="wrap")
    @classmethod
    def _all_at_once(cls, data: Any, handler: Any) -> Any:
        if data is INVALID:
            raise raised([Fault((), "", reported=True)], None)
        if not isinstance(data, dict):
            if isinstance(data, cls):
                return handler(data)
            empty = not any(field.is_required() for field in cls.model_fields.values()) and not cls.ALTERNATIVES
            hint = "write {}" if data is None and empty else None
            words = ", ".join(cls.model_fields)
            allowed = f"the keys {words}" if words else "{}"
            raise raised([Fault((), "expected a mapping (key: value)", show(data), allowed, hint, code="S104")], None)
        faults = list(cls.faults(data))
        if cls.ALTERNATIVES:
            faults += _exclusive(cls.ALTERNATIVES, data, cls.model_fields)
        prepared, more = cls.prepare(data)
        faults += more
        try:
            model = handler(prepared)
        except ValidationError as error:
            raise raised(faults, None, error) from None
        if faults:
            raise raised(faults, None)
        return model


def _exclusive(names: Sequence[str], data: Mapping[str, Any], fields: Iterable[str]) -> Iterable[Fault]:
    present = [name for name in names if name in data]
    allowed = "exactly one of " + ", ".join(names)
    if len(present) > 1:
        yield Fault((present[1],), f"{' and '.join(present)} exclude each other", None, allowed, code="S103")
    elif not present and not any(misspelt(name, data, fields) for name in names):
        yield Fault((), f"expected one of {', '.join(names)}", show(data), allowed, code="S102")


def fields_of(data: Any) -> Mapping[str, Any]:
    """The fields of a model, or of the plain data that one is made from; empty for anything else."""
    return data if isinstance(data, Mapping) else getattr(data, "__dict__", {})


def too_long(data: Mapping[str, Any], key: str, most: int) -> Iterator[Fault]:
    """The fault of a field whose list or mapping is too long."""
    value = data.get(key)
    if isinstance(value, (list, Mapping)) and len(value) > most:
        yield Fault((key,), f"too many {key}", str(len(value)), f"up to {most}", code="S109")


def misspelt(name: str, data: Mapping[str, Any], fields: Iterable[str]) -> bool:
    """Whether a field that is missing seems to be there under a wrong name, which is reported as an unknown key."""
    known = set(fields)
    return any(key not in known and near(key, known) == near(name, [name]) for key in data)
