"""Fluids of MJCF files: the same passive forces as in the compiled original, and what acts by another law."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.imports.mjcf.comparison import deviations
from simspec.imports.mjcf.compiled import FEATURES
from simspec.language.foreign import ImportOptions, LossSeverity
from tests.imports.mjcf.models import read, written

pytestmark = pytest.mark.usefixtures("warm_readers")

SWIMMER = """<mujoco><option density="4000" viscosity="0.1" wind="0.1 0.2 0.3" timestep="0.01"/><worldbody><body name="torso">
<joint axis="1 0 0" type="slide"/><joint axis="0 1 0" type="slide"/><joint axis="0 0 1"/>
<geom name="head" fromto="1.5 0 0 0.5 0 0" size="0.1" type="capsule"/><body name="mid" pos="0.5 0 0"><joint axis="0 0 1"/>
<geom fromto="0 0 0 -1 0.3 0.1" size="0.1" type="capsule"/><geom type="box" size=".1 .2 .3" euler="10 20 30"/>
<body name="fin" pos="0.1 0 0"><geom type="box" size=".2 .01 .1"/></body></body></body></worldbody></mujoco>"""


def imported(folder, text):
    path = folder / "model.xml"
    path.write_text(text, encoding="utf-8")
    found, what = deviations(path, ImportOptions())
    return found, what, [entry.reason for entry in what.losses() if entry.severity is LossSeverity.PHYSICS]


def test_passive_forces_are_those_of_the_original(tmp_path):
    found, what, lost = imported(tmp_path, SWIMMER)
    assert found.worst < 1e-12
    assert lost == []
    assert what.data["physics"]["fluid"] == {"density": 4000, "viscosity": 0.1, "velocity": [0.1, 0.2, 0.3]}


def test_a_viscous_fluid_shortens_the_timestep(tmp_path):
    slow = SWIMMER.replace('viscosity="0.1"', 'viscosity="3000"')
    found, what, _ = imported(tmp_path, slow)
    assert found.worst < 1e-12
    assert what.data["physics"]["timestep"] < 0.01


def test_without_passive_forces_there_is_no_fluid(tmp_path):
    off = SWIMMER.replace('timestep="0.01"/>', '><flag spring="disable" damper="disable"/></option>')
    found, what, lost = imported(tmp_path, off)
    assert found.worst < 1e-12
    assert lost == []
    assert "fluid" not in what.data["physics"]


@pytest.mark.parametrize(
    ("old", "new", "feature"),
    [
        ('<geom name="head"', '<geom fluidshape="ellipsoid" name="head"', "geom.fluid"),
        ('<geom type="box" size=".2 .01 .1"/>', '<inertial pos="0 0 0" mass="9" diaginertia="0 0 0"/>', "option.fluid"),
    ],
)
def test_fluids_of_another_law_are_reported(tmp_path, old, new, feature):
    found, _, lost = imported(tmp_path, SWIMMER.replace(old, new))
    assert set(lost) == {FEATURES[feature].reason}
    assert found.passive > 1e-3


@pytest.mark.parametrize("viscosity", ["0", "0.1"])
def test_where_nothing_moves_a_fluid_says_nothing_of_the_timestep(tmp_path, viscosity):
    """A model without coordinates, whose mass matrix has no largest eigenvalue."""
    text = f'<mujoco><option viscosity="{viscosity}" timestep="0.01"/><worldbody>{{}}</worldbody></mujoco>'
    what = read(written(tmp_path, text.format('<body><geom type="box" size="1 1 1"/></body>')))
    assert what.data["physics"]["timestep"] == 0.01
    with pytest.raises(SpecError, match="this model has no bodies"):
        read(written(tmp_path, text.format("")))
