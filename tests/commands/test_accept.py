"""``simspec accept``: it writes the entries that engines need into the file, and changes nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from simspec import cli
from simspec.commands.check import edited
from simspec.compiler import compile_world
from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import engines, find_engine
from simspec.errors import SpecError
from simspec.language.load import load
from simspec.report import matrix
from simspec.report.matrix import support
from simspec.support.declarations import Level
from simspec.support.features import Feature

SCENE = """# my scene
simspec: 1
name: slider   # a name
physics: {timestep: 1 ms, duration: 1 s}
contact:
  materials: {a: {friction: 0.3}}   # wood
bodies:
  floor: {fixed: true, shapes: [{plane: {}}]}

  # the box
  box:
    pose: {xyz: [0.09063077870366499, 0, 0.05]}
    velocity: {linear: [1.2,0.3,0]}
    shapes:
      - {box: {size: [0.1, 0.1, 0.1]}, density: 500}
"""
TAIL = """
# what is recorded
record: {every: 10 ms}
"""
ENGINE = "pybullet"
NEEDED = "contact.cone.elliptic"


def call(path, *more) -> int:
    return cli.main(["accept", str(path), "--engine", ENGINE, *more])


@pytest.mark.parametrize(
    "engines_block",
    [
        "",
        "engines:\n  dart: {settings: {}}   # mine\n",
        f"engines: {{{ENGINE}: {{accept: [contact.friction.impact]}}}}\n",
        f"engines:\n  # why\n  {ENGINE}:\n    accept:\n      - contact.friction.impact  # measured by me\n",
    ],
    ids=["none", "another engine's", "flow", "block"],
)
def test_required_accept_entries_are_written_and_other_text_is_unchanged(tmp_path, capsys, engines_block):
    path = tmp_path / "slider.yaml"
    path.write_text(SCENE + engines_block + TAIL)
    assert call(path) == 0
    said = capsys.readouterr().out
    after = path.read_text()
    assert after.startswith(SCENE)
    if engines_block:
        assert after.endswith(TAIL)
    else:  # there was none: it comes at the end
        assert after.startswith(SCENE + TAIL)
    spec = load(path)
    world = spec.resolve()
    compile_world(world, [ENGINE], spec.locate)
    accepted = world.options(ENGINE).accept
    assert NEEDED in accepted
    assert ("contact.friction.impact" in accepted) == ("impact" in engines_block)
    line = next(line for line in after.splitlines() if NEEDED in line)
    assert "  # " in line
    assert len(line) < 140
    assert f"engines.{ENGINE}.accept: {NEEDED}" in said
    for comment in ("# mine", "# why", "# measured by me"):
        assert (comment in after) == (comment in engines_block)
    # a second time there is nothing to do, and not a byte changes
    assert call(path) == 0
    assert "no entries missing" in capsys.readouterr().out
    assert path.read_text() == after


def test_json_output_lists_the_added_entries(tmp_path, capsys):
    path = tmp_path / "slider.yaml"
    path.write_text(SCENE)
    assert call(path, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["written"] is True
    assert list(answer["added"]) == [ENGINE]
    assert NEEDED in answer["added"][ENGINE]["accept"]


def test_the_library_stays_as_it_is(capsys):
    assert call("box-on-ramp") == 2
    assert "belongs to simspec's library" in capsys.readouterr().err


def test_a_file_that_is_not_laid_out_in_blocks_is_left_alone(tmp_path, capsys):
    path = tmp_path / "slider.json"
    data = {"simspec": 1, "name": "x", "contact": {"materials": {"a": {"friction": 0.3}}}}
    box = {"shapes": [{"box": {"size": [1, 1, 1]}, "density": 1000}], "pose": {"xyz": [0, 0, 1]}}
    path.write_text(json.dumps({**data, "bodies": {"floor": {"fixed": True, "shapes": [{"plane": {}}]}, "b": box}}))
    before = path.read_text()
    assert call(path) == 2
    assert "not in YAML block style" in capsys.readouterr().err
    assert path.read_text() == before


def test_comments_before_the_next_key_stay_with_it():
    text = "simspec: 1\nengines:\n  a: {settings: {b: 1}}\n\n# next\nname: x\n"
    after = edited(text, {"a": {"accept": {"f.g": "short"}}})
    assert after == (
        "simspec: 1\nengines:\n  a:\n    settings: {b: 1}\n    accept:\n      - f.g  # short\n\n# next\nname: x\n"
    )
    with pytest.raises(SpecError):
        edited("{simspec: 1}", {"a": {"accept": {"f.g": "short"}}})


# --- short reasons ------------------------------------------------------------------------------------------------

DECLARED = list(
    dict.fromkeys(
        (owner.NAME, feature.value, said.short)
        for owner in (*dialects().values(), *engines().values())
        for feature, support in owner.SUPPORT.items()
        for said in (support, *support.cases)
        if said.level in (Level.APPROXIMATE, Level.OUTSIDE)
    )
)
"""Features of every format and engine that have to be accepted or requested by name, with their short reasons; once where an
engine and its dialect of the same name declare the same."""
PAGE = Path(__file__).resolve().parents[2] / matrix.MATRIX_FILE


def test_there_is_something_to_say():
    assert len(DECLARED) >= 20
    assert {"mujoco", "pybullet", "dart"} <= {name for name, _, _ in DECLARED}


def _dialect(name):
    return engines()[name].DIALECT if name in engines() else name


def test_short_reasons_fit_in_a_comment_on_a_single_line():
    assert DECLARED
    for _, _, short in DECLARED:
        assert 20 <= len(short) <= 100, short
        assert short == " ".join(short.split()), short
        assert not short.endswith((".", "…", ":", ";", ",")), short
        assert "#" not in short, short


def test_features_that_share_a_short_reason_share_the_whole_reason():
    users, reasons = {}, {}
    for owner in (*dialects().values(), *engines().values()):
        for feature, declaration in owner.SUPPORT.items():
            for reason in (declaration, *declaration.cases):
                if reason.level in (Level.APPROXIMATE, Level.OUTSIDE):
                    users.setdefault(reason.short, set()).add((_dialect(owner.NAME), feature))
                    reasons.setdefault(reason.short, set()).add(reason.how)
    assert not {short: found for short, found in users.items() if len(found) > 1 and len(reasons[short]) > 1}


def test_every_link_leads_to_the_whole_reason():
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    linked = [(name, feature) for name, feature, _ in DECLARED if name in engines()]
    assert linked
    for name, feature in linked:
        path, _, anchor = matrix.link(name, feature).partition("#")
        assert path == matrix.MATRIX_FILE
        (line,) = [line for line in lines if f'<a id="{anchor}"></a>' in line]
        users = line.rsplit(" (", 1)[1].rstrip(")").split("; ")
        (features,) = [user for user in users if user.startswith(f"{name}: ")]
        assert f"`{feature}`" in features


def test_anchors_of_the_page_are_unique():
    found = re.findall(r'<a id="([^"]*)"></a>', PAGE.read_text(encoding="utf-8"))
    assert len(found) == len(set(found)) > 50


def test_a_certificate_names_approximations_by_their_short_reasons():
    how = support(find_engine("mujoco"))[Feature.IMPACT_FRICTION]
    name = Feature.IMPACT_FRICTION.value
    assert matrix.short_reason("mujoco", name, f"approximate: {how.how}") == how.short
    assert matrix.short_reason("mujoco", name, "outside: by a loop") == how.cases[0].short
    assert matrix.short_reason("mujoco", "no.such.feature", "approximate: x") == "approximate: x"
    assert matrix.short_reason("another", name, "approximate: x") == "approximate: x"
    assert matrix.short_reason("mujoco", Feature.GRAVITY.value, "approximate: x") == "x", "nothing is declared"
    assert matrix.short_reason("mujoco", name, "no level") == "no level"


def test_comments_and_what_is_said_are_the_short_reasons(tmp_path, capsys):
    path = tmp_path / "slider.yaml"
    path.write_text(SCENE)
    assert call(path) == 0
    said, after = capsys.readouterr().out, path.read_text()
    short = support(find_engine(ENGINE))[Feature(NEEDED)].short
    assert f"- {NEEDED}  # {short}\n" in after
    assert f"{NEEDED}  # {short}\n    {matrix.link(ENGINE, NEEDED)}\n" in said
