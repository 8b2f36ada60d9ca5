"""Closed lists of words stand once, in the vocabulary."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from simspec.contact import Rules, combined
from simspec.language import vocabulary
from simspec.resolve.contact import RULES
from simspec.support.features import Feature
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Surface
from tests.modules import MODULES, PACKAGE, offences

LISTS = {name: frozenset(words) for name, words in vars(vocabulary).items() if isinstance(words, tuple)}
LEAST = 3
"""Words of a list that can be no coincidence: two are, as in ("hinge", "slide")."""
ELSEWHERE = ("dialects", "engines", "formats")
"""Words of an engine or of a file's language that happen to be the same."""
NEUTRAL = [
    path
    for path in MODULES
    if path.relative_to(PACKAGE).parts[0] not in ELSEWHERE and path != Path(vocabulary.__file__)
]


def repeated(tree: ast.AST) -> list[str]:
    """The lists of the vocabulary that a module writes again, as a tuple, list or set, in whatever order."""
    lists: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.Tuple, ast.List, ast.Set)):
            words = [word.value for word in node.elts if isinstance(word, ast.Constant) and isinstance(word.value, str)]
            if len(set(words)) == len(node.elts) >= LEAST:
                lists += [name for name, known in LISTS.items() if known == frozenset(words)]
    return lists


def test_no_list_stands_twice():
    assert not offences(repeated, NEUTRAL)


def test_a_second_list_is_seen():
    assert repeated(ast.parse('X = ["slide", "hinge", "fixed", "free", "ball"]')) == ["JOINT_KINDS"]
    assert repeated(ast.parse('def f(kind):\n    return kind in {"pd", "native", "computed-torque"}')) == [
        "CONTROL_LAWS"
    ]
    assert not repeated(ast.parse('X = ("hinge", "slide"), ("fixed", "hinge", "slide")'))


JOINT_LISTS = frozenset(frozenset(words) for name, words in vars(vocabulary).items() if name.endswith("_JOINTS"))


def joint_kind_queries(tree: ast.AST) -> list[int]:
    """Lines that ask for a joint's kind by a list of words that the vocabulary has."""
    lines: list[int] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for side in (node.left, *node.comparators):
                words = {word.value for word in ast.walk(side) if isinstance(word, ast.Constant)}
                if isinstance(side, (ast.Tuple, ast.List, ast.Set)) and any(known <= words for known in JOINT_LISTS):
                    lines.append(node.lineno)
    return lines


def test_code_queries_joint_properties_instead_of_kinds():
    assert not offences(joint_kind_queries)


def test_a_list_of_joint_kinds_is_seen():
    assert (
        len(
            joint_kind_queries(
                ast.parse("""
kind in ("hinge", "slide")
kind not in ["fixed", "slide", "hinge"]
kinds <= {"free", "ball"}
kind in SCALAR_JOINTS; kind in ("hinge", *QUATERNION_JOINTS); kind == "ball"; X = ("hinge", "slide")
""")
            )
        )
        == 3
    )


def test_kinds_of_joints_are_what_their_sizes_say():
    assert set(vocabulary.SCALAR_JOINTS) == {kind for kind, size in POSITION_SIZE.items() if size == 1}
    assert set(vocabulary.QUATERNION_JOINTS) == {
        kind for kind in POSITION_SIZE if POSITION_SIZE[kind] > VELOCITY_SIZE[kind]
    }
    assert set(vocabulary.TREE_JOINTS) == {
        kind for kind, size in VELOCITY_SIZE.items() if 0 < size < VELOCITY_SIZE["free"]
    }


def test_no_word_stands_twice_in_a_list():
    assert len(LISTS) >= 12
    assert all(len(words) == len(getattr(vocabulary, name)) for name, words in LISTS.items())


def test_tables_by_words_have_a_row_for_each():
    assert set(POSITION_SIZE) == set(VELOCITY_SIZE) == set(vocabulary.JOINT_KINDS)
    assert set(RULES) == set(vocabulary.COMBINATIONS)
    features = {feature.value for feature in Feature}
    for prefix, words in (
        ("joint", vocabulary.JOINT_KINDS),
        ("shape", vocabulary.SHAPE_KINDS),
        ("contact.cone", vocabulary.FRICTION_CONES),
        ("contact.hardness", vocabulary.HARDNESS_KINDS),
    ):
        assert {f"{prefix}.{word}" for word in words} <= features
    for rule in vocabulary.ENGINE_RULES:
        assert combined(Rules(rule, "none"), "friction", Surface(0.5), Surface(0.5)) >= 0.0


def test_an_engines_process_can_have_it():
    """Imported alone, it brings nothing but the package's own doors."""
    code = "import sys, simspec.language.vocabulary; print(sorted({'pydantic', 'numpy', 'scipy'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
