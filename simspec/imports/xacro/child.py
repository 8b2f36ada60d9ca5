"""The process that expands xacro: it has no file, no network and no environment.

A xacro file is a program. It runs here behind two walls, each of which holds alone: the kernel lets the process use memory and
the descriptors that it has, and nothing else (:mod:`simspec.confinement`), and expressions consist of listed syntax and listed
attributes (:mod:`simspec.imports.xacro.child`). Where the kernel has no such wall, expressions are arithmetic. Texts of
files come from simspec, which reads only what the user allows.

Lines of JSON on standard input and output. From simspec first ``{"files", "text", "arguments", "seconds", "walls"}`` (the last:
why the kernel has none, or null), then an answer to each question. From here ``{"ask": path, "place": [file, line]}``, at last
``{"text": ...}`` or ``{"failed": ...}``.
"""

from __future__ import annotations

import ast
import encodings.idna  # noqa: F401  (imported now: later this process can open no file)
import functools
import json
import mmap
import os
import re
import resource
import string
import sys
import unicodedata  # noqa: F401  (the same)
import xml.dom.expatbuilder
import xml.dom.minidom
from collections.abc import Callable, Mapping
from types import CodeType
from typing import Any, Final

import xacro
import yaml  # type: ignore[import-untyped]  # its stubs are a package of their own

from simspec.confinement import PROFILES, confine_calls, confine_files
from simspec.imports.xacro import DEEPEST, LARGEST_TEXT, MEMORY, MOST_FILES, PLACE, PLACE_NOW

# Expressions: allowed syntax, and allowed attributes by the type of the object.
# The syntax tree is compared with the list, and each attribute access is a call of _attribute, which knows the object. What is
# not listed is refused by name.

LONGEST: Final = 20_000
"""Characters of an expression."""


class Refused(Exception):
    """The program requests something that it does not get."""


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


ARITHMETIC: Final = _words(
    "Expression Constant Name Load BinOp UnaryOp BoolOp Compare IfExp Call Attribute Add Sub Mult Div FloorDiv "
    "Mod Pow UAdd USub Not And Or Eq NotEq Lt LtE Gt GtE Is IsNot"
)
"""Nodes of the syntax tree (``ast``) of an expression of numbers, texts and names."""
SYNTAX: Final = ARITHMETIC | _words(
    "BitAnd BitOr BitXor LShift RShift Invert In NotIn Subscript Slice List Tuple Dict Set Starred keyword "
    "ListComp SetComp DictComp GeneratorExp comprehension Store JoinedStr FormattedValue Lambda arguments arg"
)
"""Those of any expression."""
CONSTANTS: Final = (str, int, float, complex, bool, type(None))
FUNCTIONS: Final = _words(
    "abs acos acosh asin asinh atan atan2 atanh bool ceil copysign cos cosh degrees exp fabs float floor fmod "
    "hypot int isfinite isnan len log log10 log2 max min pow radians round sin sinh sqrt str tan tanh trunc"
)
"""Functions of an arithmetic expression, by themselves or in ``math`` and ``python``; also ``xacro.arg``."""
NUMBERS: Final = frozenset({"pi", "e", "tau", "inf"})
NAMESPACES: Final = ("math", "python")

METHODS: Final[Mapping[type, frozenset[str]]] = {
    str: _words(
        "capitalize casefold center count endswith find format index isalnum isalpha isascii isdecimal isdigit "
        "isidentifier islower isnumeric isspace istitle isupper join ljust lower lstrip partition removeprefix "
        "removesuffix replace rfind rindex rjust rpartition rsplit rstrip split splitlines startswith strip swapcase "
        "title upper zfill"
    ),
    list: _words("append clear copy count extend index insert pop remove reverse sort"),
    tuple: frozenset({"count", "index"}),
    dict: _words("clear copy get items keys pop popitem setdefault update values"),
    set: _words("add copy difference discard intersection issubset issuperset pop remove symmetric_difference union"),
    float: frozenset({"is_integer"}),
    int: frozenset({"bit_length"}),
    complex: frozenset({"conjugate", "imag", "real"}),
}
"""Attributes of objects, by type. Keys of YAML files and of namespaces are attributes too."""
UNBOUND: Final = METHODS[str] - {"format"}
"""Methods of text that may be named without a text (``map(str.strip, words)``)."""
TAKEN_OUT: Final = ("type", "vars")
"""Functions of xacro's namespace ``python`` that lead to attributes by other ways."""


class _Formatter(string.Formatter):
    """``str.format`` without attributes and items of what is formatted."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if not field_name.isalnum() and not field_name.replace("_", "").isalnum():
            raise Refused(f"a format with more than a name or a number in braces: {field_name[:80]}")
        return super().get_field(field_name, args, kwargs)


def _attribute(value: Any, name: str) -> Any:
    """The attribute of an object, where the lists have it. Raises Refused, and what the object raises."""
    if isinstance(value, xacro.NameSpace):
        return getattr(value, name) if name not in _OF_TABLES else _refuse(value, name)
    if isinstance(value, dict) and not isinstance(value, xacro.Table) and name not in _OF_DICTS:
        return getattr(value, name)  # a key of a YAML file, or no such key
    if value is str and name in UNBOUND:
        return getattr(str, name)
    for kind, names in METHODS.items():
        if isinstance(value, kind) and not isinstance(value, xacro.Table) and name in names:
            if name == "format":
                return functools.partial(_Formatter().format, value)
            return getattr(value, name)
    return _refuse(value, name)


_OF_DICTS: Final = frozenset(dir(dict))
_OF_TABLES: Final = frozenset(dir(xacro.NameSpace())) | {"parent", "root", "depth", "unevaluated", "recursive"}


def _refuse(value: Any, name: str) -> Any:
    kind = value.__name__ if isinstance(value, type) else type(value).__name__
    raise Refused(f"the attribute {name[:80]!r} of {kind} is not in the list of those that expressions may use")


GUARD: Final = "<attribute>"
"""The name of :func:`_attribute` in evaluated code: no file can write it."""


class _Checked(ast.NodeTransformer):
    """The tree of an expression whose syntax is in the list, with attributes by way of the guard. Raises Refused."""

    def __init__(self, allowed: frozenset[str], shown: str):
        self._allowed, self._shown = allowed, shown[:80]

    def visit(self, node: ast.AST) -> Any:
        name = type(node).__name__
        if name not in self._allowed:
            raise Refused(f"{name} is not in the list of what expressions may use: {self._shown}")
        return super().visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        if not isinstance(node.value, CONSTANTS):
            raise Refused(f"a constant that is not a number, text or truth value: {self._shown}")
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        self._demand_name(node.id)
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        self._demand_name(node.arg)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self._demand_reading(node.ctx)
        return self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self._demand_reading(node.ctx)
        self._demand_name(node.attr)
        guard = ast.Name(GUARD, ast.Load())
        return ast.copy_location(ast.Call(guard, [self.visit(node.value), ast.Constant(node.attr)], []), node)

    def _demand_reading(self, context: ast.expr_context) -> None:
        if not isinstance(context, ast.Load):
            raise Refused(f"an expression that changes an object: {self._shown}")

    def _demand_name(self, name: str) -> None:
        if name.startswith("__"):
            raise Refused(f"a name with two underscores: {self._shown}")


def _demand_arithmetic(tree: ast.Expression, shown: str, why: str) -> None:
    """Raise Refused for expressions beyond arithmetic."""
    functions = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        known = type(node).__name__ in ARITHMETIC
        if isinstance(node, ast.Call):
            known = isinstance(node.func, ast.Name | ast.Attribute) and not node.keywords
            known = known and (not isinstance(node.func, ast.Name) or node.func.id in FUNCTIONS)
        elif isinstance(node, ast.Attribute):
            space = node.value.id if isinstance(node.value, ast.Name) else ""
            if id(node) in functions:
                known = (space in NAMESPACES and node.attr in FUNCTIONS) or (space, node.attr) == ("xacro", "arg")
            else:
                known = space == "math" and node.attr in NUMBERS
        if not known:
            raise Refused(f"more than arithmetic is evaluated only where the kernel confines it ({why}): {shown[:80]}")


@functools.lru_cache(maxsize=4096)
def _compiled(expression: str, beyond: str | None) -> CodeType:
    if len(expression) > LONGEST:
        raise Refused(f"an expression of more than {LONGEST:,} characters")
    tree = ast.parse(expression.strip(), "<expression>", "eval")
    if beyond is not None:
        _demand_arithmetic(tree, expression, beyond)
    checked = ast.fix_missing_locations(_Checked(SYNTAX, expression).visit(tree))
    return compile(checked, "<expression>", "eval")


def evaluator(beyond: str | None) -> Callable[..., Any]:
    """The function that replaces ``xacro.safe_eval``. ``beyond``: why expressions beyond arithmetic are refused; None: they are
    not."""

    def evaluate(expression: str, names: dict[str, Any], local: Any = None) -> Any:
        code = _compiled(expression, beyond)
        names.update(__builtins__={GUARD: _attribute})
        return eval(code, names, local)

    return evaluate


HARMLESS = frozenset({"compile", "exec", "object.__getattr__", "builtins.id", "sys._getframe"})
"""Audited operations of an evaluation that reach nothing outside it."""


ADDRESS = re.compile(r" at 0x[0-9a-f]{6,}>")
"""How Python shows what has no text of its own."""


class _PlacedBuilder(xml.dom.expatbuilder.ExpatBuilderNS):
    """The document of a file, whose elements know their places."""

    def __init__(self, number: int):
        super().__init__()
        self._number = number

    def install(self, parser: Any) -> None:
        super().install(parser)
        parser.StartDoctypeDeclHandler = self._doctype

    def _doctype(self, *_: object) -> None:
        raise Refused("a document type is not read")

    def start_element_handler(self, name: str, attributes: Any) -> None:
        super().start_element_handler(name, attributes)
        element: Any = self.curNode
        element.setAttribute(PLACE, f"{self._number}:{self.getParser().CurrentLineNumber}")


class XacroProgram:
    """One file that is expanded: xacro, with its requests to the system answered here."""

    def __init__(self, now: mmap.mmap, request: dict[str, Any]):
        self._now = now
        self._texts = 1
        self._names = request["files"]
        self.place = (0, 1)
        self.warnings: list[tuple[tuple[int, int], str]] = []
        self.arguments: dict[str, str] = dict(request["arguments"])
        self.declared: list[str] = []

    def run(self, text: str, beyond: str | None = None) -> str:
        """The expanded text. ``beyond``: why expressions beyond arithmetic are refused; None: they are not."""
        self._install(beyond)
        xacro.init_stacks(self._names[0])
        document = self._parsed(text, 0)
        xacro.process_doc(document, mappings=self.arguments, verbosity=0)
        self._demand_texts(document)
        output = _Output()
        document.writexml(output, addindent="  ", newl="\n")
        return "".join(output.parts)

    def _demand_texts(self, document: Any) -> None:
        """Raise Refused where the value of an expression was a function or a table of names: its text has an address in memory,
        which is another in each run."""
        for element in document.getElementsByTagName("*"):
            texts = [child.data for child in element.childNodes if child.nodeType == child.TEXT_NODE]
            for text in (*dict(element.attributes.items()).values(), *texts):
                if ADDRESS.search(text):
                    self._note(element)
                    raise Refused(f"an expression with a value that has no text: {ADDRESS.sub('>', text)[:80]}")

    def _install(self, beyond: str | None) -> None:
        """Put our functions in the place of those that would read files or the environment, and of those that see elements."""
        for name in ("eval_all", "handle_macro_call", "check_attrs"):
            setattr(xacro, name, self._noting(getattr(xacro, name), keep=name == "eval_all"))
        xacro.warning = self._warn
        xacro.print_location = lambda: None
        xacro.parse = self._parse
        xacro.abs_filename_spec = _absolute
        xacro.get_include_files = self._included
        xacro.eval_extension = self._extension
        xacro.load_yaml = self._yaml
        xacro.safe_eval = evaluator(beyond)
        space = xacro._global_symbols
        for table in (space["xacro"], space):
            dict.__setitem__(table, "load_yaml", self._yaml)
            dict.__setitem__(table, "abs_filename", _absolute)
        for name in TAKEN_OUT:
            space["python"].pop(name, None)
        for unit in xacro.ConstructUnits:
            yaml.SafeLoader.add_constructor(unit.value.tag, unit.constructor)

    def _noting(self, function: Callable[..., Any], *, keep: bool) -> Callable[..., Any]:
        """The same function, which notes the place of its first argument, an element."""

        def noting(node: Any, *arguments: Any) -> Any:
            self._note(node)
            if not keep and node.tagName.startswith("xacro:") and node.hasAttribute(PLACE):
                node.removeAttribute(PLACE)
            if function.__name__ == "check_attrs" and node.tagName == "xacro:arg":
                self.declared.append(node.getAttribute("name"))
            return function(node, *arguments)

        return noting

    def _note(self, node: Any) -> None:
        if node.hasAttribute(PLACE):
            number, _, line = node.getAttribute(PLACE).partition(":")
            if number.isdigit() and line.isdigit():
                self.place = (int(number), int(line))
                PLACE_NOW.pack_into(self._now, 0, *self.place)

    def _warn(self, *words: object, **_: object) -> None:
        if len(self.warnings) < 100:
            self.warnings.append((self.place, " ".join(map(str, words))[:300]))

    def _parse(self, _: object, filename: str) -> Any:
        try:
            text = self._ask(filename)
        except FileNotFoundError as error:
            xacro.filestack.pop()
            raise xacro.XacroException(exc=error) from None
        return self._parsed(text, self._texts - 1)

    def _parsed(self, text: str, number: int) -> Any:
        return _PlacedBuilder(number).parseString(text)

    def _included(self, spec: str, symbols: Any) -> list[str]:
        name = _absolute(str(xacro.eval_text(spec, symbols)))
        if re.search(r"[*?\[]", name):
            raise Refused(f"an include names one file, no pattern: {name[:200]}")
        return [name]

    def _yaml(self, filename: str) -> Any:
        name = _absolute(str(filename))
        return xacro.YamlListWrapper.wrap(yaml.safe_load(self._ask(name)))

    def _extension(self, text: str) -> str:
        words = text[2:-1].split()
        match words:
            case ["find", package]:
                return f"package://{package}"
            case ["arg", name]:
                if name not in self.arguments:
                    raise Refused(f"the argument {name[:80]!r} has no value")
                return self.arguments[name]
            case ["optenv", _, *default]:
                return " ".join(default)  # no variable is set
            case ["env", *_]:
                raise Refused(f"{text[:80]}: the environment is not read")
        raise Refused(f"{text[:80]} is not evaluated; find, arg and optenv are")

    def _ask(self, name: str) -> str:
        if self._texts >= MOST_FILES:
            raise Refused(f"more than {MOST_FILES} files are included")
        _say({"ask": name, "place": self.place})
        answer = json.loads(sys.stdin.buffer.readline())
        if answer.get("missing"):
            raise FileNotFoundError(answer["missing"])
        if "text" not in answer:
            raise Refused("")  # simspec knows why
        self._texts += 1
        return str(answer["text"])


class _Output:
    """Text up to the largest."""

    def __init__(self) -> None:
        self.parts: list[str] = []
        self._left = LARGEST_TEXT

    def write(self, text: str) -> None:
        self._left -= len(text)
        if self._left < 0:
            raise Refused(f"expands to more than {LARGEST_TEXT:,} characters")
        self.parts.append(text)


def _absolute(spec: str) -> str:
    """A path as seen from the first file's folder, or one that says itself where it starts."""
    spec = str(spec)
    if "://" in spec or spec.startswith("/"):
        return spec
    return os.path.join(os.path.dirname(xacro.filestack[-1] or ""), spec)


def close_doors(seconds: int, kernel: bool = True) -> str:
    """From here on this process opens nothing, and ends after so many seconds of processor time. Returns the
    reason where the kernel does not confine it ("": it does); then limits and an audit hook are all that there is. ``kernel``:
    whether the kernel is requested to."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    os.environ.clear()
    os.closerange(3, 256)
    if kernel:
        confine_files()  # where there is one; the calls are enough
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
    walls = confine_calls(PROFILES["expressions"]) if kernel else None
    sys.addaudithook(_refuse_child)
    return "" if walls is None or walls.calls else walls.why


def _refuse_child(event: str, _: object) -> None:
    if event not in HARMLESS:
        raise Refused(f"{event} is not allowed")


def _say(message: dict[str, Any]) -> None:
    sys.stdout.buffer.write(json.dumps(message).encode() + b"\n")
    sys.stdout.buffer.flush()


def main() -> None:
    """Expand the file that standard input names. The one argument is the descriptor of the memory that holds the place."""
    now = mmap.mmap(int(sys.argv[1]), PLACE_NOW.size)
    request = json.loads(sys.stdin.buffer.readline())
    sys.setrecursionlimit(DEEPEST)
    program = XacroProgram(now, request)
    text = request["text"]
    missing = close_doors(request["seconds"], kernel=request["walls"] is None) or request["walls"]
    try:
        expanded = program.run(text, missing)
    except Exception as error:  # a program may raise anything: it is reported with its place
        _say({"failed": _reason_of(error), "place": program.place})
    else:
        _say({"text": expanded, "warnings": program.warnings, "declared": program.declared})


def _reason_of(error: BaseException) -> str:
    """The cause of an error, in one line: of an error that xacro has wrapped, the inmost."""
    while isinstance(error, xacro.XacroException) and isinstance(error.exc, BaseException):
        if isinstance(error.exc, (Refused, MemoryError, RecursionError, xacro.XacroException)):
            error = error.exc
        else:
            break
    if isinstance(error, MemoryError):
        return "needs more computing time or memory than a robot takes"
    if isinstance(error, RecursionError):
        return "macros or expressions within each other without an end"
    text = " ".join(str(error).split()) or type(error).__name__
    return f"{type(error).__name__}: {text}"[:400] if isinstance(error, (KeyError, TypeError)) else text[:400]


if __name__ == "__main__":
    main()
