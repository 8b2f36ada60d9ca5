"""Ratings of 0, which files of CAD programs have in every joint: no engine can tell one from none."""

import pytest

from simspec.language.foreign import Fate, LossSeverity
from tests.imports.urdf.robots import read, two_links


@pytest.mark.parametrize("name", ["velocity", "effort"])
def test_a_rating_of_zero_is_none_and_is_said_to_be(name, tmp_path):
    other = "effort" if name == "velocity" else "velocity"
    joint = f'<limit lower="-1" upper="1" {name}="0" {other}="3"/>'
    imported = read(two_links(f'<axis xyz="0 0 1"/>{joint}', kind="revolute"), tmp_path)
    body = next(body for body in imported.data["model"]["bodies"].values() if "parent" in body)
    assert body["joint"]["limits"] == {"position": [-1, 1], other: 3}
    (account,) = (account for account in imported.accounts if account.what.endswith(f"limit/@{name}"))
    assert (account.fate, account.severity) == (Fate.LOST, LossSeverity.INFORMATION)
