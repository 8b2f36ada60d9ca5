"""Expressions of xacro files: an allow-list of syntax, and of attributes by the type of the object that has them.

An expression is parsed, its syntax tree is compared with the list, and each attribute access in it becomes a call of
:func:`_attribute`, which knows the object. What is not in the lists is refused by name; nothing is looked for that is bad.
"""

from __future__ import annotations

import ast
import functools
import string
from collections.abc import Callable, Mapping
from types import CodeType
from typing import Any, Final

import xacro

LONGEST: Final = 20_000
"""Characters of an expression."""


class Refused(Exception):
    """What the program requests and does not get."""


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
            raise Refused(f"a constant that is no number, text or truth value: {self._shown}")
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
