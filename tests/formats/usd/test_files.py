"""Single files of USD: text, binary and packages hold the same world; files of others are not replaced; packages of unknown
authors are unpacked within bounds."""

from __future__ import annotations

import dataclasses
import io
import warnings
import zipfile

import pytest

from simspec.cli import main
from simspec.commands.compile import SIDECAR_SUFFIX
from simspec.errors import SpecError
from simspec.files import find_spec
from simspec.formats.usd.format import WORLD, Usd
from simspec.language.load import load

pytest.importorskip("pxr")

pytestmark = pytest.mark.usefixtures("warm_readers")
SCENARIO = "coupled-gripper"
BODY = (
    b'#usda 1.0\n(defaultPrim = "a")\ndef Sphere "a" (apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"]) {}\n'
)


@pytest.fixture(scope="module")
def plain():
    return Usd().plain(load(find_spec(SCENARIO)).resolve())


@pytest.mark.parametrize("suffix", Usd.SINGLE)
def test_each_kind_of_file_reads_back_to_the_same_world(tmp_path, plain, suffix):
    content = Usd().single(plain, suffix)
    assert content == Usd().single(plain, suffix), "the same bytes each time"
    path = tmp_path / f"world{suffix}"
    path.write_bytes(content)
    back = load(path, allow_outside=True).resolve()
    world = load(find_spec(SCENARIO)).resolve()
    model = dataclasses.replace(
        world, controllers=(), trajectory=None
    )  # an import has no control: that is a scenario's
    assert Usd().plain(back).files[WORLD] == Usd().plain(model).files[WORLD]


def test_a_package_holds_its_meshes_and_names_nothing_else(tmp_path, plain):
    content = Usd().single(plain, ".usdz")
    with zipfile.ZipFile(io.BytesIO(content)) as package:
        (entry,) = package.infolist()
    assert entry.compress_type == zipfile.ZIP_STORED
    assert content.index(b"PXR-USDC") % 64 == 0
    assert b"890c736c" not in content, "no name of a mesh's file"


def test_only_files_that_simspec_wrote_are_replaced(tmp_path, capsys):
    path = tmp_path / "gripper.usdc"
    export = ["export", SCENARIO, "--format", "usd", "-o", str(path)]
    assert main(export) == 0
    assert "written" in capsys.readouterr().out
    first = path.read_bytes()
    assert main([*export, "--check"]) == 0
    assert main([*export, "--set", "physics.timestep=0.5 ms", "--check"]) == 1
    assert main([*export, "--set", "physics.timestep=0.5 ms"]) == 0
    assert path.read_bytes() != first
    path.write_bytes(b"of somebody")
    capsys.readouterr()
    assert main(export) == 2
    assert "simspec did not write it" in capsys.readouterr().err
    assert path.read_bytes() == b"of somebody"
    other = tmp_path / f"new.usda{SIDECAR_SUFFIX}"
    other.write_text("{}")
    assert main(["export", SCENARIO, "--format", "usd", "-o", str(tmp_path / "new.usda")]) == 2
    assert not (tmp_path / "new.usda").exists()


def test_several_specs_are_not_a_single_file(tmp_path, capsys):
    assert main(["export", SCENARIO, "ur10e", "--format", "usd", "-o", str(tmp_path / "both.usdz")]) == 2
    assert "is one file" in capsys.readouterr().err


def package_of(*entries, compression=zipfile.ZIP_STORED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as package, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, content in entries:
            package.writestr(name, content)
    return stream.getvalue()


def sharing():
    """A package of two entries that are the same bytes: the way of bombs that are not nested."""
    content = bytearray(package_of(("a.usda", BODY + b"#" * 5000), ("b.usda", b"")))
    at = content.rindex(b"PK\x01\x02")
    first = content.index(b"PK\x01\x02")
    content[at + 16 : at + 28] = content[first + 16 : first + 28]
    content[at + 42 : at + 46] = content[first + 42 : first + 46]
    return bytes(content)


REFERENCE = b'#usda 1.0\ndef "a" (references = @%s@) {}\n'
HOSTILE = {
    "a path out of it": (package_of(("a.usda", BODY), ("../b.usda", BODY)), "leads out of it"),
    "an absolute path": (package_of(("a.usda", BODY), ("/tmp/b.usda", BODY)), "leads out of it"),
    "a reference out of it": (package_of(("a.usda", REFERENCE % b"../../b.usda")), "leaves"),
    "a reference to a system file": (package_of(("a.usda", REFERENCE % b"/etc/passwd")), "leaves"),
    "compressed": (package_of(("a.usda", BODY), compression=zipfile.ZIP_DEFLATED), "neither compressed"),
    "files that share bytes": (sharing(), "larger than itself"),
    "no file of USD": (package_of(("a.txt", b"x"), ("b.usda", BODY)), "begins with a file of USD"),
    "nothing": (package_of(), "begins with a file of USD"),
    "twice the same": (package_of(("a.usda", BODY), ("a.usda", BODY)), "damaged"),
    "a package in a package": (
        package_of(("a.usda", REFERENCE % b"b.usdz"), ("b.usdz", package_of(("c.usda", BODY)))),
        "packages that other files name",
    ),
    "truncated": (package_of(("a.usda", BODY))[:-30], "damaged"),
    "no package": (b"PK\x03\x04 and no more", "damaged"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_packages_of_unknown_authors(tmp_path, name):
    content, message = HOSTILE[name]
    path = tmp_path / "world.usdz"
    path.write_bytes(content)
    with pytest.raises(SpecError) as raised:
        load(path, allow_outside=True)
    (problem,) = raised.value.problems
    assert message in problem.message
    assert problem.location is not None


def test_a_package_of_several_files(tmp_path):
    path = tmp_path / "world.usdz"
    path.write_bytes(package_of(("a.usda", REFERENCE % b"parts/b.usda"), ("parts/b.usda", BODY)))
    assert len(load(path, allow_outside=True).resolve().bodies) == 1
