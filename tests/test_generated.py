"""The committed output: when it is current, when not, and when a certificate still belongs to it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
from types import SimpleNamespace

import pytest

from simspec import generated
from simspec.compiler import Compiled, output_files
from simspec.dialects.kit.sidecar import SIDECAR_SCHEMA
from simspec.engines.kit.capabilities import DOUBLE
from simspec.errors import SpecError
from simspec.generated import CERTIFICATE_FILE, CompiledSpec, certificate_mismatch, check, read_certificate
from simspec.outputs.writing import Artifacts
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.proof.expected import expected, left_out
from simspec.proof.judge import demanded
from simspec.world.canonical import sha256
from tests import worlds


def spheres(count: int):
    """Bodies that cannot touch: a proof of them has no contact."""
    world = worlds.spheres(count)
    bodies = tuple(
        dataclasses.replace(body, shapes=tuple(dataclasses.replace(shape, collision=False) for shape in body.shapes))
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies)


WORLD = spheres(2)


def built(world=WORLD, engines=("first", "second"), text: str = "<model/>\n") -> CompiledSpec:
    """A compiled world of made-up engines, whose files are what the real ones' are: a model and a sidecar."""
    sidecar = json.dumps({"schema": SIDECAR_SCHEMA, "world": sha256(world)})
    artifacts = Artifacts({"model.xml": text, "sidecar.json": sidecar})
    compiled = {name: Compiled(name, "x", "xml", artifacts, ()) for name in engines}
    return CompiledSpec(world, compiled, output_files(world, compiled))


def whole(world) -> tuple[Check, ...]:
    """Checks of everything that a world without joints demands, each compared often enough."""
    parts = [part for part, why in expected(world).items() if not why and part[1]]
    parts += [
        (level, name) for level in ("L0", "L1") for name in ("bodies", "mass", "centre of mass", "inertia tensor")
    ]
    parts += [(level, name) for level in ("L0", "L2") for name in ("joint type", "parent")]
    parts += [("L2", "pose, orientation"), ("L2", "body velocity"), ("L4", "gravity")]
    demands = demanded(world, DOUBLE)
    counts = {part: demands[part].count if part in demands else 100 for part in parts}
    return tuple(Check(level, name, count, 1e-12, 0.0, "somewhere") for (level, name), count in counts.items())


def write_certificate(certificate: Certificate, folder, world=WORLD) -> bool:
    """Whether anything was written."""
    return generated.write_certificate(certificate, world, folder).changed


def proof(
    build: CompiledSpec, worst: float = 1e-15, seconds: float = 1.0, version: str = "1.0", checks=None
) -> Certificate:
    checks = whole(build.world) if checks is None else checks
    checks = tuple(
        dataclasses.replace(check, worst=worst, tolerance=1e-9)
        if (check.level, check.name) == ("L1", "mass")
        else check
        for check in checks
    )
    missing = left_out(build.world)
    engines = {
        name: EngineProof(version, part.sha256, checks, {}, {}, seconds, not_compared=missing)
        for name, part in build.compiled.items()
    }
    return Certificate(build.world.name, sha256(build.world), "pinocchio 4", engines)


def test_engine_versions_that_differ_from_installed_versions_are_named(tmp_path, monkeypatch):
    folder = tmp_path / "spheres"
    scenario = built(engines=("mujoco", "drake"))
    generated.write(scenario, folder)
    proofs = {name: EngineProof("1.0", part.sha256, whole(WORLD)) for name, part in scenario.compiled.items()}
    write_certificate(Certificate("spheres", sha256(WORLD), "oracle", proofs), folder)
    versions = {"mujoco": "2.0", "drake": "1.0"}
    here = {name: SimpleNamespace(version=lambda name=name: versions[name]) for name in versions}
    monkeypatch.setattr(generated, "engines", lambda: here)
    (line,) = generated.other_versions(folder)
    assert line.endswith("certificate.json: proven in mujoco 1.0, 2.0 is installed (simspec verify proves it there)")
    versions |= {"mujoco": None, "drake": None}  # not installed: there is nothing to differ from
    assert generated.other_versions(folder) == []


def test_a_folder_that_was_just_written_is_current(tmp_path):
    build, folder = built(), tmp_path / "spheres"
    assert len(check(build, folder)) == len(build.files) + 1
    assert generated.write(build, folder).changed
    assert [line.split(" (")[0] for line in check(build, folder)] == [f"missing: {folder / CERTIFICATE_FILE}"]
    assert write_certificate(proof(build), folder)
    assert check(build, folder) == []
    again = generated.write(build, folder)
    assert (again.changed, again.stored.dropped, list(again.stored.kept)) == (False, {}, ["first", "second"])
    assert check(build, folder) == []


@pytest.mark.parametrize(
    ("other", "stale", "kept", "dropped"),
    [
        (built(spheres(3)), "another world", [], dict.fromkeys(("first", "second"), "of another world")),
        (
            built(text="<other/>\n"),
            "other files of first",
            [],
            dict.fromkeys(("first", "second"), "its files are others than were verified"),
        ),
        (
            built(engines=("first",), text="<other/>\n"),
            "other files of first",
            ["second"],
            {"first": "its files are others than were verified"},
        ),
        (built(engines=("first", "second", "third")), "does not cover third", ["first", "second"], {}),
        (built(engines=("third",)), "does not cover third", ["first", "second"], {}),
    ],
)
def test_proofs_of_something_else_are_stale_and_go_and_the_others_stay(tmp_path, other, stale, kept, dropped):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    write_certificate(proof(built()), folder)
    (line,) = [line for line in check(other, folder) if CERTIFICATE_FILE in line]
    assert stale in line
    stored = generated.write(other, folder).stored
    assert (list(stored.kept), stored.dropped) == (kept, dropped)
    left = read_certificate(folder)
    assert (sorted(left.engines) if left else []) == kept
    assert (folder / CERTIFICATE_FILE).exists() == bool(kept)


# --- one engine after the other -------------------------------------------------------------------------------------------


def in_turn(folder, *verified: str, **words) -> list[generated.Certified]:
    """Writes of ``simspec verify --engine NAME`` to a folder, for one engine after the other."""
    certified = []
    for name in verified:
        build = built(engines=(name,))
        generated.write(build, folder)
        certified.append(generated.write_certificate(proof(build, **words), WORLD, folder))
    return certified


def together(folder, **words) -> bytes:
    generated.write(built(), folder)
    write_certificate(proof(built(), **words), folder)
    return (folder / CERTIFICATE_FILE).read_bytes()


@pytest.mark.parametrize("order", [("first", "second"), ("second", "first"), ("first", "second", "first")])
@pytest.mark.parametrize("worst", [1e-15, 1.0])
def test_engines_in_turn_give_the_same_file_as_together(tmp_path, order, worst):
    """Invalid proofs are kept too, and reported."""
    certified = in_turn(tmp_path / "one", *order, worst=worst)
    assert [list(written.stored.kept) for written in certified] == [[], *[[name] for name in order[:-1]]]
    assert [written.stored.dropped for written in certified] == [{}] * len(order)
    assert certified[-1].stored.lines() == [
        f"kept from before, not verified now: {order[-2]} 1.0 ({'valid' if worst < 1 else 'NOT VALID'})"
    ]
    assert (tmp_path / "one" / CERTIFICATE_FILE).read_bytes() == together(tmp_path / "both", worst=worst)
    assert bool(check(built(), tmp_path / "one")) == (worst == 1.0)


def test_the_seconds_of_a_proof_that_says_the_same_stay(tmp_path):
    before = together(tmp_path)
    (certified,) = in_turn(tmp_path, "second", seconds=9.0)
    assert not certified.changed
    assert (tmp_path / CERTIFICATE_FILE).read_bytes() == before
    (certified,) = in_turn(tmp_path, "second", seconds=9.0, worst=2e-15)
    assert certified.changed
    assert {name: engine.seconds for name, engine in read_certificate(tmp_path).engines.items()} == {
        "first": 1,
        "second": 9,
    }


def without_l3(plain):
    block = plain["engines"]["second"]
    block["checks"] = [row for row in block["checks"] if row["level"] != "L3"]


def quick_l3(plain):
    without_l3(plain)
    plain["engines"]["second"]["not_compared"]["L3"] = "not requested"


FILES = {
    "edited": (
        lambda second: (second / "model.xml").write_text("<other/>\n"),
        "its files are others than were verified",
    ),
    "one removed": (lambda second: (second / "model.xml").unlink(), "its files are others than were verified"),
    "removed": (shutil.rmtree, "its files are not there"),
}
TEXT = {
    "another world": (lambda plain: plain.update(world_sha256="0" * 64), "of another world"),
    "another simspec": (lambda plain: plain.update(simspec="0.0.0"), "made by simspec 0.0.0"),
    "another oracle": (lambda plain: plain.update(oracle="pinocchio 3"), "held against pinocchio 3"),
    "a level dropped": (without_l3, "not valid, as it claims to be: L3"),
    "a level not requested": (quick_l3, "made without L3, as by --quick"),
    "other files": (lambda plain: plain["engines"]["second"].update(artifacts_sha256="0" * 64), "its files are others"),
}


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("defect", [*FILES, *TEXT])
def test_a_proof_that_does_not_hold_any_more_is_not_kept(tmp_path, defect, compiled):
    """Whether compiling sees it, or the certificate is found so when the proof is done: another process may have changed it."""
    together(tmp_path)
    path = tmp_path / CERTIFICATE_FILE
    change, why = (FILES | TEXT)[defect]
    if defect in FILES:
        change(tmp_path / "second")
    else:
        path.write_text(edited(path.read_text(), change))
    build = built(engines=("first",))
    # these three are of the whole certificate, and compiling does not read them
    if defect not in ("another oracle", "another world", "another simspec"):
        assert any(f"second: {why}" in line for line in check(build, tmp_path, named=True))
    given = generated.write(build, tmp_path).stored if compiled else None
    stored = generated.write_certificate(proof(build), WORLD, tmp_path).stored
    stored = stored.after(given.without(["first"])) if given else stored
    assert (list(stored.dropped), stored.kept) == (["second"], {})
    assert stored.lines() == [f"dropped: second: {stored.dropped['second']}"]
    assert why in stored.dropped["second"]
    assert path.read_text() == proof(build).to_json()


def test_the_requested_engines_decide_the_verdict(tmp_path):
    """An engine that failed before, and says so, is none of another one's business."""
    in_turn(tmp_path, "first", worst=1.0)
    in_turn(tmp_path, "second")
    assert check(built(engines=("second",)), tmp_path, True) == []
    for entry, named in ((built(engines=("second",)), False), (built(engines=("first",)), True), (built(), False)):
        assert ["first: L1 mass" in line for line in check(entry, tmp_path, named)] == [True]


@pytest.mark.parametrize("text", ["", "{}", '{"schema": 1}', "[]", "\x00\xff"])
def test_a_file_of_simspecs_that_is_no_certificate_is_replaced_and_that_is_said(tmp_path, text):
    before = together(tmp_path)
    (tmp_path / CERTIFICATE_FILE).write_text(text)
    stored = generated.write_certificate(proof(built()), WORLD, tmp_path).stored
    assert stored.lines()[0].startswith("dropped: all that was there: ")
    assert (tmp_path / CERTIFICATE_FILE).read_bytes() == before
    (tmp_path / CERTIFICATE_FILE).write_text(text)
    assert generated.write(built(), tmp_path).stored.unread
    assert not (tmp_path / CERTIFICATE_FILE).exists()


def test_a_file_that_simspec_did_not_write_stays(tmp_path):
    generated.write(built(), tmp_path)
    path = tmp_path / CERTIFICATE_FILE
    path.write_text("mine")
    with pytest.raises(SpecError, match="was not written by simspec"):
        write_certificate(proof(built()), tmp_path)
    assert path.read_text() == "mine"


@pytest.mark.parametrize("text", ["", "{}", '{"schema": 1}', '{"schema": 99, "engines": {}}', "[]"])
def test_a_damaged_certificate_is_stale(tmp_path, text):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    (folder / CERTIFICATE_FILE).write_text(text)
    with pytest.raises(SpecError, match=CERTIFICATE_FILE):
        read_certificate(folder)
    assert certificate_mismatch(built(), folder)


def test_a_certificate_that_is_not_valid_does_not_count(tmp_path):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    write_certificate(proof(built(), worst=1.0), folder)
    assert any("it is not valid" in line for line in check(built(), folder))


def test_a_certificate_is_written_again_unless_equal_in_all_but_times(tmp_path):
    build, folder = built(), tmp_path / "spheres"
    generated.write(build, folder)
    write_certificate(proof(build), folder)
    first = (folder / CERTIFICATE_FILE).read_bytes()
    assert not write_certificate(proof(build, seconds=9.0), folder)
    assert (folder / CERTIFICATE_FILE).read_bytes() == first
    assert write_certificate(proof(build, worst=2e-15), folder)
    assert write_certificate(proof(build, version="1.1"), folder)
    assert write_certificate(proof(build, worst=1.0, version="1.1"), folder)
    assert (folder / CERTIFICATE_FILE).read_bytes() != first


def test_a_certificate_of_other_files_is_not_written(tmp_path):
    folder = tmp_path / "spheres"
    generated.write(built(text="<other/>\n"), folder)
    with pytest.raises(SpecError, match="not those that were verified"):
        write_certificate(proof(built()), folder)
    assert not (folder / CERTIFICATE_FILE).exists()


def edited(text: str, change) -> str:
    """An edited certificate, with the hash of its edited content."""
    plain = json.loads(text)
    change(plain)
    del plain["sha256"]
    body = json.dumps(plain, indent=2) + "\n"
    digest = hashlib.sha256(body.encode()).hexdigest()
    return body.replace("{\n", f'{{\n  "sha256": "{digest}",\n', 1)


def checks_of(plain: dict) -> list[dict]:
    return plain["engines"]["first"]["checks"]


def check_dropped(plain):
    plain["engines"]["first"]["checks"] = checks_of(plain)[:1]


def level_dropped(plain):
    plain["engines"]["first"]["checks"] = [row for row in checks_of(plain) if row["level"] != "L3"]


def excused(plain):
    level_dropped(plain)
    plain["engines"]["first"]["not_compared"]["L3"] = "not requested"


def change_of(of: str, name: str, **more):
    def change(plain):
        for row in checks_of(plain):
            if (row["level"], row["name"]) == (of, name):
                row.update(more)

    return change


def doubled(plain):
    checks_of(plain).append(checks_of(plain)[0] | {"count": 1})


EDITS = {
    "one check": (check_dropped, "first: L"),
    "worst beyond the tolerance": (change_of("L1", "mass", worst=1e9), "first: L1 mass"),
    "a wider tolerance": (change_of("L1", "mass", worst=1e9, tolerance=1e10), "a tolerance of 1e"),
    "worst in kind": (change_of("L1", "mass", worst=None), "first: L1 mass"),
    "compared nothing": (change_of("L2", "joint type", count=0, worst=None), "first: L2 joint type"),
    "compared less": (change_of("L1", "mass", count=1), "L1 mass: 1 comparisons, this world has 2"),
    "a level dropped": (level_dropped, "first: L3"),
    "a level excused": (excused, "does not apply to this world"),
    "a check twice": (doubled, "is duplicated"),
    "another level": (change_of("L3", "mass matrix", level="L9"), "first: "),
    "negative": (change_of("L1", "mass", worst=-1.0), "cannot be read"),
    "no engine": (lambda plain: plain.update(engines={}), "it does not cover first"),
    "another simspec": (lambda plain: plain.update(simspec="0.0.0"), "made by simspec 0.0.0"),
    "another form": (lambda plain: plain.update(schema=1), "schema 1"),
    "a count as text": (change_of("L1", "mass", count="many"), "cannot be read"),
    "an engine as text": (lambda plain: plain["engines"].update(first="x"), "engines.first"),
    "another world": (lambda plain: plain.update(world_sha256="0" * 64), "it belongs to another world"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_a_certificate_is_judged_from_its_figures(tmp_path, edit):
    build, folder = built(), tmp_path / "spheres"
    generated.write(build, folder)
    write_certificate(proof(build), folder)
    assert check(build, folder) == []
    path = folder / CERTIFICATE_FILE
    change, words = EDITS[edit]
    path.write_text(edited(path.read_text(), change))
    (stale,) = check(build, folder)
    assert words in stale
    # the certificate is written again without the edit
    assert write_certificate(proof(build), folder)
    assert check(build, folder) == []


@pytest.mark.parametrize("edit", ["valid", "worst", "seconds", "space"])
def test_an_edited_certificate_is_named_as_such(tmp_path, edit):
    build, folder = built(), tmp_path / "spheres"
    generated.write(build, folder)
    write_certificate(proof(build), folder)
    path = folder / CERTIFICATE_FILE
    text = path.read_text()
    changed = {
        "valid": text.replace('"valid": true', '"valid": false', 1),
        "worst": text.replace("1e-15", "2e-15", 1),
        "seconds": text.replace('"seconds": 1.0', '"seconds": 0.5'),
        "space": text + " ",
    }[edit]
    assert changed != text
    path.write_text(changed)
    (stale,) = check(build, folder)
    assert "was edited or is damaged" in stale
    assert write_certificate(proof(build), folder)


@pytest.mark.parametrize("kind", ["fifo", "link", "folder"])
@pytest.mark.parametrize("name", [CERTIFICATE_FILE, "world.json", "second/sidecar.json"])
def test_only_regular_files_are_read(tmp_path, kind, name):
    """A sidecar that is a link would have its target's content written into the repository."""
    secret = tmp_path / "secret"
    secret.write_text(json.dumps({"schema": SIDECAR_SCHEMA, "world": sha256(WORLD), "secret": 1}))
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    write_certificate(proof(built()), folder)
    path = folder / name
    path.unlink()
    {"fifo": os.mkfifo, "link": lambda place: place.symlink_to(secret), "folder": os.mkdir}[kind](path)
    with pytest.raises(SpecError, match=path.name):
        generated.write(built(engines=("first",)), folder)
    if kind != "folder":  # that is a file that is missing
        with pytest.raises(SpecError, match=path.name):
            check(built(engines=("first",)), folder)
    assert not [
        path for path in folder.rglob("*") if path.is_file() and not path.is_symlink() and "secret" in path.read_text()
    ]


@pytest.mark.parametrize("text", ["", "[]", "{", "null", '{"schema": 9}', "[" * 100_000])
def test_a_broken_sidecar_is_a_located_error(tmp_path, text):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    (folder / "second" / "sidecar.json").write_text(text)
    for work in (
        lambda: check(built(engines=("first",)), folder),
        lambda: generated.write(built(engines=("first",)), folder),
    ):
        with pytest.raises(SpecError, match=r"second/sidecar.json"):
            work()
    # compiling for that engine too writes it anew
    generated.write(built(), folder)
    assert (folder / "second" / "sidecar.json").read_text() != text


def test_engines_of_the_same_world_stay_and_others_go(tmp_path):
    folder = tmp_path / "spheres"
    generated.write(built(), folder)
    (folder / "notes").mkdir()
    (folder / "notes" / "mine.txt").write_text("not an engine")
    generated.write(built(engines=("first",), text="<new/>\n"), folder)
    assert (folder / "second" / "model.xml").read_text() == "<model/>\n"
    generated.write(built(spheres(3), engines=("first",)), folder)
    assert not (folder / "second").exists()
    assert (folder / "notes" / "mine.txt").read_text() == "not an engine"  # simspec did not write it


def test_a_changed_byte_is_seen(tmp_path):
    build, folder = built(), tmp_path / "spheres"
    generated.write(build, folder)
    write_certificate(proof(build), folder)
    (folder / "first" / "model.xml").write_bytes(b"<model/>\r\n")
    assert check(build, folder) == [f"stale: {folder}/first/model.xml"]
    assert generated.write(build, folder).changed
    assert check(build, folder) == []


def test_a_file_name_that_leaves_the_folder_is_refused(tmp_path):
    bad = dataclasses.replace(built(), files={"../escape.txt": "x"})
    with pytest.raises(SpecError, match="leaves the output folder"):
        generated.write(bad, tmp_path / "spheres")
    assert not (tmp_path / "escape.txt").exists()
