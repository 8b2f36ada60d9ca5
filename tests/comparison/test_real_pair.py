"""Two runs of one engine, of worlds that differ a little: reported differences, above and below the noise of the engine."""

from __future__ import annotations

import json

import pytest

from simspec import cli
from simspec.comparison.floor import PERTURBATION, measure_floor, save_floor
from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, diff
from simspec.language.load import Spec
from simspec.runner.execution import run

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINE = "mujoco"


def sliding(friction: float):
    """A box thrown over a floor, whose contact shows the last bits of its state in micrometres."""
    return Spec.from_data(
        {
            "simspec": 1,
            "name": "slider",
            "physics": {"timestep": 0.001, "duration": 0.6},
            "contact": {"materials": {"wood": {"friction": friction}}},
            "bodies": {
                "floor": {"fixed": True, "shapes": [{"plane": {}}]},
                "box": {
                    "pose": {"xyz": [0, 0, 0.05]},
                    "velocity": {"linear": [1.2, 0.3, 0], "angular": [0, 0, 1]},
                    "shapes": [{"box": {"size": [0.1, 0.1, 0.1]}, "density": 500}],
                },
            },
            "record": {"every": 0.01, "channels": ["pose", "velocity"]},
            "engines": {ENGINE: {"accept": ["contact.friction.impact"]}},
        }
    ).resolve()


@pytest.fixture(scope="module")
def pair():
    """The two runs and their floors."""
    found = []
    for friction in (0.3, 0.3001):
        world = sliding(friction)
        entry = run(world, ENGINE)
        found.append((entry, measure_floor(entry, [run(world, ENGINE, perturb=PERTURBATION)])))
    return found


def test_a_small_change_of_friction_shows_above_bounded_noise(pair):
    (a, floor_a), (b, floor_b) = pair
    noise = max(floor_a.largest, floor_b.largest)
    position_largest = diff(a, b, floor=[floor_a, floor_b]).worst.position_largest
    # the box stops v²/(2 g) (1/0.3 − 1/0.3001) = 87 µm earlier
    assert position_largest == pytest.approx(8.7e-5, rel=0.05)
    assert 1e-9 < noise < 1e-5
    floors = [floor_a, floor_b]
    for tolerance in (3e-5, 1e-6, 1e-7):
        found = diff(a, b, tolerance=tolerance, floor=floors)
        assert (found.verdict, found.horizon) == (OUT, None), tolerance
    assert diff(a, b, tolerance=1e-3, floor=floors).verdict == WITHIN
    assert diff(a, a, tolerance=1e-9, floor=floors).verdict == INCONCLUSIVE


@pytest.mark.parametrize(
    ("others", "tolerance", "verdict", "code"),
    [(1, "1e-3", WITHIN, 0), (1, "1e-6", OUT, 1), (0, "1e-9", INCONCLUSIVE, 1)],
)
def test_the_command_reports_it_by_text_and_exit_code(pair, tmp_path, capsys, others, tolerance, verdict, code):
    folders = []
    for name, (entry, floor) in (("a", pair[0]), ("b", pair[others])):
        entry.save(tmp_path / name)
        save_floor(floor, tmp_path / name)
        folders.append(str(tmp_path / name))
    arguments = ["diff", *folders, "--tolerance", tolerance]
    assert cli.main([*arguments, "--json"]) == code
    assert json.loads(capsys.readouterr().out)["verdict"] == verdict
    assert cli.main(arguments) == code
    shown = capsys.readouterr()
    assert {WITHIN: "never", OUT: "(contacts not recorded)", INCONCLUSIVE: "inconclusive"}[verdict] in shown.out
    assert ("is inconclusive, because" in shown.err) == (verdict == INCONCLUSIVE)
