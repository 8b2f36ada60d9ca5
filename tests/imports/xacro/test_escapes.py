"""Known ways out of Python expressions, held by the allow-list of xacro's expressions alone: no kernel wall, limit or audit
hook stands here. The walls of the kernel alone: ``tests/test_confinement.py``."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("xacro")

from simspec.imports.xacro import importer
from tests.imports.xacro.texts import MASS, imported, refused, robot

IN_A_FRAME = "[c.append((x.gi_frame.f_back.f_back for x in c)) or [one for one in c[0]][0] for c in [[]]][0]"
"""A generator that looks at the frame from which it is read."""
ESCAPES = {
    "the frame of a generator": "(x for x in [1]).gi_frame and 'out'",
    "the frames below it": f"{IN_A_FRAME} and 'out'",
    "the globals of those": f"{IN_A_FRAME}.f_globals and 'out'",
    "the code of a generator": "(x for x in [1]).gi_code.co_name and 'out'",
    "the wait of a generator": "(x for x in [1]).gi_yieldfrom is None and 'out'",
    "a generator that is sent to": "(x for x in [1]).send(None) and 'out'",
    "a generator by yield": "(lambda: (yield))().gi_frame and 'out'",
    "a yield from": "(lambda: (yield from [1]))().gi_code and 'out'",
    "the globals of a lambda": "(lambda: 0).__globals__ and 'out'",
    "the code of a lambda": "(lambda: 0).__code__ and 'out'",
    "the defaults of a lambda": "(lambda a=1: 0).__defaults__ and 'out'",
    "the globals of a function": "xacro.tokenize.__globals__ and 'out'",
    "the object of a method": "xacro.load_yaml.__self__ and 'out'",
    "the function of a method": "xacro['load_yaml'].__func__ and 'out'",
    "the closure of a function": "xacro.message.__closure__ and 'out'",
    "the module of a function": "len.__self__ and 'out'",
    "subclasses": "().__class__.__base__.__subclasses__() and 'out'",
    "classes above": "''.__class__.__mro__ and 'out'",
    "classes above by a method": "dict.mro() and 'out'",
    "subclasses of a class": "list.__subclasses__() and 'out'",
    "a class by type": "python.type(1) and 'out'",
    "a class by the name of type": "python['type'](1) and 'out'",
    "a new class": "python.type('A', (), dict()) and 'out'",
    "attributes by vars": "python.vars(python['type'](1)) and 'out'",
    "descriptors by vars": "python.vars(str)['join'] and 'out'",
    "a format of attributes": "'{0.__class__}'.format(1) and 'out'",
    "a format of harmless attributes": "'{x.real}'.format(x=1) and 'out'",
    "a format of items": "'{0[0]}'.format([1]) and 'out'",
    "a format within a format": "'{0:{1.real}}'.format(1, 2) and 'out'",
    "a format by a class": "str.format('{0.real}', 1) and 'out'",
    "a format by map": "list(map('{0.real}'.format, [1])) and 'out'",
    "a format by a table": "'{a}'.format_map({'a': 1}) and 'out'",
    "an attribute in an f-string": "f'{().__class__}' and 'out'",
    "an attribute in the format of an f-string": "f'{1:{().__len__()}}' and 'out'",
    "a walrus": "(a := 1) and 'out'",
    "a walrus in a comprehension": "[a := 1 for b in [1]] and 'out'",
    "the default of a lambda": "(lambda a=().__class__: 'out')()",
    "comprehensions within each other": "[[y.__class__ for y in [x]] for x in [1]] and 'out'",
    "a condition of a comprehension": "[x for x in [1] if x.__class__] and 'out'",
    "a comprehension that sets an item": "[0 for python['sum'] in [len]] and 'out'",
    "a comprehension that sets an attribute": "[0 for xacro.tokenize.a in [1]] and 'out'",
    "a name with underscores": "__builtins__ is not None and 'out'",
    "a parameter with underscores": "(lambda __a: 'out')(1)",
    "bytes": "b'a' and 'out'",
    "the ellipsis": "... and 'out'",
    "an encoded text": "'a'.encode('rot13' and 'utf-8') and 'out'",
    "a translated text": "'a'.translate({97: 98}) and 'out'",
    "numbers as bytes": "(1).to_bytes(1, 'big') and 'out'",
    "attributes of a range": "python.range(3).stop and 'out'",
    "the table above": "xacro.root is not None and 'out'",
    "a table of names as a table": "math.items() and 'out'",
    "a table of names that is changed": "python.setdefault('a', 1) and 'out'",
    "pickling": "[].__reduce_ex__(2) and 'out'",
    "a matrix product": "[] @ [] if 0 else 'out'",
}

PROGRAM = """
import json, mmap, sys
from simspec.imports.xacro import child
from simspec.imports.xacro import PLACE_NOW
if sys.argv[1] == "free":
    def evaluator(beyond):
        def evaluate(expression, names, local=None):
            names.update(__builtins__={})
            return eval(expression, names, local)
        return evaluate
    child.evaluator, child.TAKEN_OUT = evaluator, ()
answers = {}
for name, text in json.loads(sys.stdin.read()).items():
    now = mmap.mmap(-1, PLACE_NOW.size)
    program = child.XacroProgram(now, {"files": ["r.xacro"], "arguments": {}})
    try:
        answers[name] = program.run(text, None)
    except Exception as error:
        answers[name] = "refused: " + child._reason_of(error)
sys.stdout.write(json.dumps(answers))
"""


def expanded(texts, wall):
    """The expansion of files in a process without walls but the allow-list, or with none ("free")."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, wall], input=json.dumps(texts), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def texts():
    """A file for each attempt."""
    made = {}
    for name, expression in ESCAPES.items():
        written = expression.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
        made[name] = robot(f'<link name="${{{written}}}"/>')
    return made


@pytest.fixture(scope="module")
def outcomes():
    return {wall: expanded(texts(), wall) for wall in ("free", "listed")}


OF_BRACES = [name for name, expression in ESCAPES.items() if "}" in expression]
"""xacro ends an expression at its first brace: these are evaluated directly."""


@pytest.mark.parametrize("name", [name for name in ESCAPES if name not in OF_BRACES])
def test_the_allow_list_alone_holds_them(name, outcomes):
    assert 'name="out"' in outcomes["free"][name], "a way that leads nowhere proves nothing"
    assert outcomes["listed"][name].startswith("refused: "), outcomes["listed"][name]


@pytest.mark.parametrize("name", OF_BRACES)
def test_the_allow_list_alone_holds_those_with_braces(name):
    import xacro

    from simspec.imports.xacro.child import Refused, evaluator

    space = dict(xacro.create_global_symbols())
    assert eval(ESCAPES[name], {**space, "__builtins__": {}}) == "out"
    with pytest.raises(Refused):
        evaluator(None)(ESCAPES[name], space)


PLACES = {
    "an attribute": '<link name="{}"/>',
    "a text": "<link>{}</link>",
    "a property": '<xacro:property name="a" value="{}"/><link name="${{a}}"/>',
    "a property that is not lazy": '<xacro:property name="a" value="{}" lazy_eval="false"/>',
    "the name of a property": '<xacro:property name="{}" value="1"/>',
    "a condition": '<xacro:if value="{}"/>',
    "the default of an argument": '<xacro:arg name="a" default="{}"/>',
    "a parameter": '<xacro:macro name="m" params="a"/><xacro:m a="{}"/>',
    "the default of a parameter": '<xacro:macro name="m" params="a:={}"/><xacro:m/>',
    "the name of a macro": '<xacro:call macro="{}"/>',
    "the name of an element": '<xacro:element xacro:name="{}"/>',
    "the name of an attribute": '<link><xacro:attribute name="{}" value="1"/></link>',
    "an include": '<xacro:include filename="{}"/>',
    "a comment": "<!-- xacro:eval-comments:on --><!-- {} -->",
}


def test_every_place_of_an_expression_is_checked():
    way = "${().__class__}"
    answers = expanded({name: robot(text.format(way)) for name, text in PLACES.items()}, "listed")
    for name, answer in answers.items():
        assert answer == "refused: a name with two underscores: ().__class__", (name, answer)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: !!python/object/apply:os.getcwd []", "could not determine a constructor"),
        ("a: !!python/name:os.system", "could not determine a constructor"),
        ("a: !degrees ().__class__", "two underscores"),
        ("a: !meters (x for x in [1]).gi_frame", "'gi_frame' of generator is not in the list"),
    ],
)
def test_a_yaml_file_is_data(text, said, tmp_path):
    (tmp_path / "a.yaml").write_text(text)
    assert said in refused("<link name=\"${xacro.load_yaml('a.yaml')['a']}\"/>", tmp_path)


ALLOWED = {
    "'a b'.split()[1].upper()": "B",
    "', '.join(['a', 'b'])": "a, b",
    "'%s_%02d' % ('a', 3)": "a_03",
    "[x * 2 for x in python.range(3) if x]": "[2, 4]",
    "python.sum(x for x in [1, 2])": "3",
    "max(map(lambda a: a * 2, [1, 2]))": "4",
    "math.sin(pi / 2) + radians(0)": "1.0",
    "(0.5).is_integer()": "False",
    "dict(a=1).get('b', 2)": "2",
    "xacro.dotify(dict(a=dict(b=3))).a.b": "3",
    "list(map(str.strip, [' a ']))[0]": "a",
    "1 if 'a' in ['a'] else 2": "1",
    "python.len(python.set([1, 1]) | python.set([2]))": "2",
    "'abc'[::-1].replace('c', 'd').startswith('d')": "True",
    "python.sorted([3, 1], key=lambda x: -x, reverse=True)": "[1, 3]",
    "python.isinstance(1, int)": "True",
}


def test_syntax_that_robots_use_is_in_the_list():
    files = {name: robot(f'<link name="${{{name}}}"/>') for name in ALLOWED}
    for name, answer in expanded(files, "listed").items():
        assert f'name="{ALLOWED[name]}"' in answer, (name, answer)


def test_formats_of_names_and_numbers():
    from simspec.imports.xacro.child import evaluator

    evaluate = evaluator(None)
    assert evaluate("'{}_{:03d}|{a!r}'.format('x', 3, a='y')", {}) == "x_003|'y'"
    assert evaluate("'{0}{1:>{2}}'.format('x', 3, 4)", {}) == "x   3"
    assert evaluate("f'{1 + 1:>{4}}'", {}) == "   2"


# --- a system without walls -----------------------------------------------------------------------------------

ARITHMETIC = f"""<xacro:arg name="count" default="2"/><xacro:property name="size" value="0.5"/>
<xacro:if value="${{size * 2 == 1 and not False}}">
<link name="${{'a' + 'b' if count_ > 1 else 'c'}}">{MASS}</link>
</xacro:if>"""


@pytest.fixture
def no_walls(monkeypatch):
    from simspec.confinement import Walls

    monkeypatch.setattr(importer, "walls", lambda: Walls(why="this system offers no Landlock and no seccomp"))


@pytest.mark.usefixtures("no_walls")
def test_without_walls_arithmetic_is_evaluated(tmp_path):
    text = ARITHMETIC.replace("count_", "int(xacro.arg('count'))") + (
        '<link name="l${2 ** 3 % 5 + floor(math.pi) - python.abs(-1)}"/><joint name="j" type="fixed"><parent link="ab"/>'
        '<child link="l5"/><origin xyz="${-sin(radians(90))} 0 ${max(1, 2) / 4}"/></joint>'
    )
    bodies = imported(text, tmp_path).data["model"]["bodies"]
    assert bodies["l5"]["joint"]["origin"] == {"xyz": [-1, 0, 0.5]}


@pytest.mark.usefixtures("no_walls")
@pytest.mark.parametrize(
    "expression",
    [
        "[1][0]",
        "'a'.upper()",
        "[x for x in [1]]",
        "(lambda: 1)()",
        "load_yaml('a.yaml')",
        "xacro.load_yaml('a')",
        "dict(a=1)",
    ],
)
def test_without_walls_more_is_refused_and_the_reason_is_said(expression, tmp_path):
    text = refused(f'<link name="${{{expression}}}"/>', tmp_path)
    assert "only where the kernel confines it (this system offers no Landlock and no seccomp)" in text
    assert "r.xacro:3" in text


def test_a_process_that_is_not_confined_says_so_itself():
    """The starting process believes that there are walls, and the child finds none."""
    from simspec.imports.xacro import child

    assert child.close_doors.__defaults__ == (True,)
    source = "from simspec.imports.xacro import child; from simspec.confinement import Walls\n"
    source += "child.confine_calls = lambda profile: Walls(why='no seccomp'); child.confine_files = lambda: None\n"
    source += "import sys; sys.stdout.write(child.close_doors(5))"
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True)
    assert done.stdout == "no seccomp"
