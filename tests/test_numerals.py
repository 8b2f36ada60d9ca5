"""One reader of numbers: the further numerals of Python are rejected in all languages, command lines and tables."""

from __future__ import annotations

import ast
import typing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec import cli, numerals
from simspec.commands.options import COMMANDS, NUMBERS
from simspec.errors import SpecError
from simspec.formats.kit.text import finite_numbers
from simspec.formats.wbt import reading as wbt
from simspec.language.document import scalar
from simspec.language.load import Spec, load
from simspec.language.quantities import UnitError, parse
from simspec.meshes.load import read_grid
from simspec.meshes.reading import MeshError, open_mesh
from simspec.numerals import NumeralError, number, numbers, rounded, whole
from simspec.resolve.tables import _number as table_number
from tests.modules import PACKAGE, offences

FOREIGN_NUMERALS = [
    "\u0661",
    "\uff11",
    "\u0967",
    "\U0001d7cf",
    "\u00a01",
    "1\u00a0",
    "1\u2007",
    "1\u2028",
    "1_0",
    "1_000.5",
]
"""Numerals that Python accepts: Arabic, full-width, Devanagari and mathematical digits, spaces, underscores."""
NOT_FINITE = ["inf", "-Infinity", "nan", "NaN"]


@pytest.mark.parametrize("text", FOREIGN_NUMERALS + NOT_FINITE)
def test_numerals_beyond_ascii_decimals_are_rejected(text):
    float(text)
    for read in (number, numbers, whole, lambda text: numbers(f"0 {text}"), finite_numbers):
        with pytest.raises(ValueError, match=r"number|finite|it has"):
            read(text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("\uff11", "digits other than 0 to 9"),
        ("1_000", "an underscore between digits"),
        ("1\u00a0", "a no-break space"),
        ("inf", "not finite"),
        ("1e999", "too large a number"),
        ("", "there are no digits"),
        ("0x10", "not a number"),
    ],
)
def test_the_refusal_says_why(text, why):
    with pytest.raises(NumeralError, match=why):
        number(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_written_double_is_read_back_exactly(value):
    assert number(repr(value)) == value
    assert numbers(f" {value!r}\t{value!r}\n", 2) == (value, value)
    assert finite_numbers(repr(value)) == (value,)


@given(st.text(max_size=8))
def test_numbers_are_read_as_in_python(text):
    """Nothing is read otherwise: this reader takes less, and the same."""
    try:
        value = number(text)
    except NumeralError:
        return
    assert text.isascii()
    assert float(text) == value


@given(st.text("0123456789+-.eE_ \t\u0661\u00a0infa", max_size=10))
def test_lists_take_what_single_numbers_do(text):
    try:
        expected = tuple(number(part) for part in numerals.parts_of(text))
    except NumeralError:
        with pytest.raises(NumeralError):
            numbers(text)
    else:
        assert numbers(text) == expected


def test_infinite_numbers_are_read_where_they_may_be():
    assert number("inf", infinite=True) == -number("-INFINITY", infinite=True) == float("inf")
    for text in ("nan", "\u0661", "1_0"):
        with pytest.raises(NumeralError):
            number(text, infinite=True)


# --- languages --------------------------------------------------------------------------------------------------------

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
URDF = '<robot name="r"><link name="base"><inertial><mass value="{}"/>' + INERTIA + "</inertial></link></robot>"
SDF = '<sdf version="1.9"><model name="m"><link name="l"><inertial><mass>{}</mass></inertial></link></model></sdf>'
XACRO = (
    '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:property name="m" value="{}"/><link name="base">'
    f'<inertial><mass value="${{{{m}}}}"/>{INERTIA}</inertial></link></robot>'
)
MJCF = '<mujoco><worldbody><body><freejoint/><geom type="sphere" size="0.1" mass="{}"/></body></worldbody></mujoco>'
USDA = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{{
    float physics:mass = {}
    float3 physics:diagonalInertia = (1, 1, 1)
}}
"""
YAML = """simspec: 1
name: a
physics: {{timestep: 1 ms, duration: 1 s}}
bodies:
  b: {{mass: {}, inertia: {{principal: [1, 1, 1]}}}}
"""
FILES = {"r.urdf": URDF, "r.sdf": SDF, "r.urdf.xacro": XACRO, "r.xml": MJCF, "r.usda": USDA, "r.yaml": YAML}


@pytest.mark.parametrize("text", ["\u0661", "\uff11", "1_0", "1\u00a0", "nan"])
@pytest.mark.parametrize("name", FILES)
def test_no_file_says_a_number_so(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(FILES[name].format("1"), encoding="utf-8")
    load(path)
    if name == "r.xml" and text == "nan":
        return  # in this language it is the number of what is not said
    path.write_text(FILES[name].format(text), encoding="utf-8")
    with pytest.raises(SpecError) as raised:
        load(path).resolve()
    assert any(problem.location is not None and problem.location.line >= 1 for problem in raised.value.problems)


def test_the_refusal_stands_at_the_number(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(f"<!-- -->\n{URDF.format(chr(0x661))}", encoding="utf-8")
    with pytest.raises(SpecError, match=r"r\.urdf:2.*digits other than 0 to 9"):
        load(path)


@pytest.mark.parametrize("version", ["\u0661.\u0668", "1.\uff18"])
def test_versions_are_numbers_too(tmp_path, version):
    path = tmp_path / "r.sdf"
    path.write_text(SDF.format("1").replace("1.9", version), encoding="utf-8")
    with pytest.raises(SpecError, match="this version of SDF is not read"):
        load(path)


MESHES = {
    "a.obj": "v {} 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "b.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf {} 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "a.stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex {} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n",
    "a.dae": '<COLLADA><float_array id="a_b" count="3">{} 0 0</float_array></COLLADA>',
    "a.ply": "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n{}\n",
    "a.csv": "{},1\n1,2\n",
}


@pytest.mark.parametrize("text", ["\u0661", "\uff11", "1_0", "\u00a01"])
@pytest.mark.parametrize("name", MESHES)
def test_nor_does_a_mesh_or_a_grid(tmp_path, name, text):
    read = read_grid if name.endswith(".csv") else open_mesh
    path = tmp_path / name
    path.write_text(MESHES[name].format("1"), encoding="utf-8")
    read(path)
    path.write_text(MESHES[name].format(text), encoding="utf-8")
    with pytest.raises(MeshError):
        read(path)


@pytest.mark.parametrize("text", [*FOREIGN_NUMERALS, *NOT_FINITE])
def test_nor_values_with_units_plain_scalars_and_tables(text):
    with pytest.raises(UnitError):
        parse(text, "mass")
    assert not isinstance(scalar(text), int | float)
    assert table_number(text) is None
    assert wbt.NUMBER.fullmatch(text) is None


def test_values_with_units_stay_what_they_were():
    for text, value in {" 1 kg ": 1.0, "2.5e-3kg": 2.5e-3, "1\tg": 1e-3, "3": 3.0, "1\u00a0kg": 1.0}.items():
        assert parse(text, "mass") == value
    with pytest.raises(UnitError):
        parse("1 kg\u00a0", "mass")


@pytest.mark.parametrize("text", ["\u0661", "1_0", "inf"])
def test_nor_an_override(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(YAML.format("1"))
    with pytest.raises(SpecError):
        load(path, sets=(f"bodies.b.mass={text}",))


@pytest.mark.parametrize("step", ["\u00b2", "\u0661"])
def test_an_index_is_a_number_too(step):
    data = {"simspec": 1, "name": "a", "bodies": {"b": {"shapes": [{"sphere": {"radius": 1}}]}}}
    with pytest.raises(SpecError):
        Spec.from_data(data).locate(f"bodies.b.shapes.{step}")


# --- the command line -------------------------------------------------------------------------------------------------


def test_every_option_that_takes_a_number_is_listed():
    found = {}
    for kind in COMMANDS.values():
        for name, hint in typing.get_type_hints(kind).items():
            kinds = {hint, *typing.get_args(hint)} & {int, float}
            if kinds and name in kind.TAKES:
                found[f"--{name.replace('_', '-')}"] = numerals.whole if int in kinds else numerals.number
    assert found == dict(NUMBERS)


@pytest.mark.parametrize("option", NUMBERS)
@pytest.mark.parametrize("text", ["\u0661", "1_0", "inf", "1\u00a0"])
def test_no_option_takes_it(option, text, capsys):
    for words in ([option, text], [f"{option}={text}"]):
        assert cli.main(["run", "nothing.yaml", *words]) == 2
        assert f"{option} should be a" in capsys.readouterr().err


# --- the house --------------------------------------------------------------------------------------------------------


TEXTUAL = {
    *("text", "attrib", "attributes", "get", "split", "strip", "partition", "rpartition", "group", "groups", "environ"),
    *("removesuffix", "removeprefix", "argv", "splitlines", "findall", "parts_of"),
}
NAMES = {
    "text",
    "word",
    "words",
    "part",
    "parts",
    "token",
    "line",
    "cell",
    "match",
    "value_text",
}
READERS = ("imports", "language", "formats", "meshes", "resolve", "commands")
"""The parts of simspec that read what others wrote."""
ALLOWED = {
    "formats/wbt/reading.py": "the tokenizer has matched it with NUMBER",
    "imports/writing.py": "rounding of a number by its text; or of ASCII digits, checked next to it",
    "imports/urdf/elements.py": "a match of NUMBER",
    "imports/mjcf/compiled.py": "of the compiler's version and message",
    "imports/usd/child.py": "of the library's message",
    "imports/xacro/child.py": "an argument that simspec gives",
    "imports/xacro/importer.py": "of ASCII digits, which the line before checks; or a line that the process gives",
    "imports/sdf/values.py": "of ASCII digits that a pattern matched",
    "language/document.py": "a match of _INT or _FLOAT",
    "language/quantities.py": "a match of _TERM or _QUANTITY",
    "language/locate.py": "of ASCII digits, checked next to it; or of an index that simspec made",
    "imports/mjcf/contact.py": "of arrays of the compiled model",
    "imports/sdf/shapes.py": "bits in any base of ASCII digits, checked next to it",
    "language/beginning.py": "of the text that simspec wrote, with a unit",
    "language/physics.py": "rounding of a number by its text",
    "language/parameters.py": "a match of _TERM",
    "experiments/cases.py": "the same",
    "language/sweep_values.py": "the same",
    "language/overrides.py": "of ASCII digits, checked next to it",
    "meshes/child.py": "a match of a pattern of bytes",
}
"""Modules that read a number of a text themselves, with the reason."""


def reads_text(tree: ast.AST) -> list[int]:
    """Lines that make a number of what looks like a text."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name) or not node.args:
            continue
        argument = node.args[0]
        if node.func.id == "map" and isinstance(argument, ast.Name) and argument.id in ("float", "int", "complex"):
            argument = node.args[1]
        elif node.func.id not in ("float", "int", "complex", "Fraction", "Decimal"):
            continue
        inside = list(ast.walk(argument))
        attributes = {node.attr for node in inside if isinstance(node, ast.Attribute)}
        names = {node.id for node in inside if isinstance(node, ast.Name)}
        if names & {"model", "data"}:
            continue  # arrays, and specs that were read
        if attributes & TEXTUAL or names & NAMES or isinstance(argument, ast.JoinedStr):
            found.append(node.lineno)
    return found


def test_numbers_in_texts_are_read_by_a_single_module():
    readers = [path for part in READERS for path in sorted((PACKAGE / part).rglob("*.py"))]
    assert not set(offences(reads_text, readers)) - set(ALLOWED), "use simspec.numerals"


@pytest.mark.parametrize("text", ["float(text)", "int(match[1])", "list(map(float, line.split()))", "int(e.text)"])
def test_another_reader_is_seen(text):
    assert reads_text(ast.parse(text))


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1842.3, 3, "1,840"),
        (332.0, 2, "330"),
        (9.96, 2, "10"),
        (0.523, 2, "0.52"),
        (5.9, 3, "5.9"),
        (0.0, 3, "0"),
        (-41.27, 3, "-41.3"),
        (1234567.0, 3, "1,230,000"),
        (0.00012345, 3, "0.000123"),
        (1.2345e-7, 3, "1.23e-07"),
        (1.5e16, 2, "1.5e+16"),
    ],
)
def test_numbers_for_reading_have_no_exponent_where_digits_suffice(value, digits, text):
    assert rounded(value, digits) == text
