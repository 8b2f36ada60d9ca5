"""tools/restate_certificates.py replaces the reasons of a committed certificate, and nothing else."""

from __future__ import annotations

import dataclasses
import shutil
import sys
from pathlib import Path

import pytest

from simspec.generated import CERTIFICATE_FILE
from simspec.proof.certificate import Certificate
from simspec.proof.contact.run import contact_checks

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import restate_certificates  # noqa: E402 - a script outside the package

OLD = "the wording of an earlier release"


@pytest.fixture
def folder(tmp_path):
    """A copy of compiled files whose certificate has approximations, deviations and fields that are not readable back."""
    return Path(shutil.copytree(ROOT / "generated" / "coupled-gripper", tmp_path / "coupled-gripper"))


def _change(folder, change):
    """Write the certificate with MuJoCo's proof changed, and return both texts."""
    file = folder / CERTIFICATE_FILE
    before = file.read_text(encoding="utf-8")
    certificate = Certificate.from_json(before)
    engines = certificate.engines | {"mujoco": change(certificate.engines["mujoco"])}
    changed = dataclasses.replace(certificate, engines=engines).to_json()
    assert changed != before
    file.write_text(changed, encoding="utf-8")
    return before, changed


def _old_words(proof):
    contact = tuple(dataclasses.replace(figure, deviation=figure.deviation and OLD) for figure in proof.contact)
    details = {check.name: check for check in contact_checks(contact)}
    return dataclasses.replace(
        proof,
        contact=contact,
        checks=tuple(details[check.name] if check.level == "L5" else check for check in proof.checks),
        approximations=dict.fromkeys(proof.approximations, OLD),
        not_checked=dict.fromkeys(proof.not_checked, OLD),
    )


def test_an_unchanged_certificate_stays_byte_for_byte(folder, capsys):
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*") if path.is_file()}
    restate_certificates.main(folder)
    assert before == {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in before}
    assert capsys.readouterr().out == ""


def test_reasons_are_restored(folder):
    before, changed = _change(folder, _old_words)
    assert changed.count(OLD) > 20
    restate_certificates.main(folder)
    assert (folder / CERTIFICATE_FILE).read_text(encoding="utf-8") == before


def test_a_changed_number_is_not_restored(folder):
    def slower(proof):
        return dataclasses.replace(_old_words(proof), seconds=proof.seconds + 1.0)

    before, _ = _change(folder, slower)
    restate_certificates.main(folder)
    after = (folder / CERTIFICATE_FILE).read_text(encoding="utf-8")
    changed = [(old, new) for old, new in zip(before.splitlines(), after.splitlines(), strict=True) if old != new]
    assert [old.split(":")[0].strip() for old, _ in changed] == ['"sha256"', '"seconds"']


def test_a_figure_that_no_declaration_has_is_refused(folder):
    def wider(proof):
        contact = tuple(
            dataclasses.replace(figure, tolerance=figure.tolerance * (2.0 if figure.deviation else 1.0))
            for figure in proof.contact
        )
        return dataclasses.replace(proof, contact=contact)

    _, changed = _change(folder, wider)
    with pytest.raises(ValueError, match="should be"):
        restate_certificates.main(folder)
    assert (folder / CERTIFICATE_FILE).read_text(encoding="utf-8") == changed


def test_a_reason_without_a_declaration_is_refused(folder):
    _change(folder, lambda proof: dataclasses.replace(proof, approximations={"shape.torus": OLD}))
    with pytest.raises(ValueError, match=r"mujoco: no reason is declared today for shape\.torus"):
        restate_certificates.main(folder)
