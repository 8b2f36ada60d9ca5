"""Packages: found by the name in their `package.xml` or by their folder, the nearest first; a damaged or unclear one is an
error with its place, in bounded time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.audit.meaning import packages_of
from simspec.commands import files
from simspec.errors import UNSEEN_CHARACTERS, Location, SpecError
from simspec.imports import files as packages
from simspec.imports.elements import Element
from simspec.imports.files import ENVIRONMENT, Files, MissingFileError, Packages
from simspec.language.foreign import ImportOptions

pytestmark = pytest.mark.usefixtures("warm_readers")

ASKING = Element("mesh", {}, Location("r.urdf", 3, 1), "", None)


@pytest.fixture(autouse=True)
def no_environment(monkeypatch):
    for variable, _ in ENVIRONMENT:
        monkeypatch.delenv(variable, raising=False)


def package(folder: Path, name: str = "", text: str | None = None) -> Path:
    """A package in a folder; its ``package.xml`` says ``name``, that of the folder by default."""
    folder.mkdir(parents=True, exist_ok=True)
    said = f"<package><name>{name or folder.name}</name></package>" if text is None else text
    (folder / "package.xml").write_text(said)
    return folder


def finder(start: Path, project: Path | None = None, **options) -> Packages:
    start.mkdir(parents=True, exist_ok=True)
    return Packages(start.resolve(), ImportOptions(project=project, **options))


def refused(found: Packages, name: str) -> str:
    with pytest.raises(SpecError) as error:
        found.find(name, ASKING)
    return "\n".join(map(str, error.value.problems))


# --- where they are --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["robot-main/urdf", "robot-main", "arms/urdf/deep", "worlds"])
def test_a_package_above_or_next_to_the_file_is_known_by_the_name_that_it_says(tmp_path, start):
    robot = package(tmp_path / "robot-main", "robot_description")
    package(tmp_path / "arms")
    assert finder(tmp_path / start, tmp_path).find("robot_description", ASKING) == robot


def test_a_package_anywhere_in_the_workspace_is_found(tmp_path):
    hand = package(tmp_path / "src/hands/hand-ros", "hand_description")
    arm = package(tmp_path / "src/arm")
    assert finder(arm / "urdf", tmp_path).find("hand_description", ASKING) == hand
    without_project = finder(arm / "urdf", None)
    assert without_project.find("hand_description", ASKING) == hand


@pytest.mark.parametrize("way", ["option", *(variable for variable, _ in ENVIRONMENT)])
def test_the_path_of_the_user_and_of_the_environment(tmp_path, monkeypatch, way):
    prefix = tmp_path / "opt"
    share = prefix / dict(ENVIRONMENT).get(way, "")
    robot = package(share / "some-folder", "robot_description")
    model = share / "x500"
    model.mkdir()
    (model / "model.config").write_text("<model/>")
    options = {"package_path": (str(prefix),)} if way == "option" else {}
    if way != "option":
        monkeypatch.setenv(way, os.pathsep.join((str(tmp_path / "none"), "", str(prefix))))
    found = finder(tmp_path / "project", tmp_path / "project", **options)
    assert found.find("robot_description", ASKING) == robot
    assert found.find("x500", ASKING) == model
    assert isinstance(pytest.raises(SpecError, found.find, "y500", ASKING).value, MissingFileError)


@pytest.mark.parametrize("layout", ["share/{}", "{}/share/{}"])
def test_installed_packages_of_a_workspace(tmp_path, layout):
    """Merged, and each package into a folder of its name, with an entry in ament's index."""
    installed = package(tmp_path / "install" / layout.replace("{}", "robot_description"))
    index = installed.parents[0] / "ament_index/resource_index/packages/robot_description"
    index.parent.mkdir(parents=True)
    index.touch()
    assert (
        finder(tmp_path / "p", package_path=(str(tmp_path / "install"),)).find("robot_description", ASKING) == installed
    )
    assert finder(tmp_path / "p", package_path=(str(tmp_path),)).find("robot_description", ASKING) == installed
    if layout.startswith("{}"):
        prefix = str(tmp_path / "install/robot_description")
        named = finder(tmp_path / "p", packages={"robot_description": prefix})
        assert named.find("robot_description", ASKING) == installed


def test_the_sources_of_a_workspace_go_before_what_it_has_installed(tmp_path):
    source = package(tmp_path / "src/repository/robot")
    package(tmp_path / "install/share/robot")
    (tmp_path / "install/COLCON_IGNORE").touch()
    assert finder(tmp_path / "p", package_path=(str(tmp_path),)).find("robot", ASKING) == source


def test_a_folder_without_a_mark_is_a_package_by_its_name_where_it_is_a_sibling(tmp_path):
    (tmp_path / "robot").mkdir()
    assert finder(tmp_path / "urdf", tmp_path).find("robot", ASKING) == tmp_path / "robot"
    package(tmp_path / "other", "robot")
    assert finder(tmp_path / "urdf", tmp_path).find("robot", ASKING) == tmp_path / "other"


def test_packages_that_have_each_others_names(tmp_path):
    package(tmp_path / "left", "right")
    package(tmp_path / "right", "left")
    found = finder(tmp_path / "urdf", tmp_path)
    assert found.find("left", ASKING).name == "right"
    assert found.find("right", ASKING).name == "left"


def test_the_nearest_of_two_counts_and_two_as_near_are_an_error(tmp_path):
    near = package(tmp_path / "a/one", "robot")
    package(tmp_path / "two", "robot")
    assert finder(tmp_path / "a/urdf", tmp_path).find("robot", ASKING) == near
    package(tmp_path / "a/three", "robot")
    text = refused(finder(tmp_path / "a/urdf", tmp_path), "robot")
    assert text.startswith("r.urdf:3:1")
    assert f"{tmp_path}/a/one, {tmp_path}/a/three" in text
    assert "--package robot=FOLDER" in text
    named = finder(tmp_path / "a/urdf", tmp_path, packages={"robot": "two"}, base=tmp_path)
    assert named.find("robot", ASKING) == tmp_path / "two"


def test_models_within_the_package_that_the_file_is_in(tmp_path):
    package(tmp_path / "worlds-of-robots")
    model = tmp_path / "worlds-of-robots/models/indoor/house"
    model.mkdir(parents=True)
    (model / "model.config").touch()
    assert finder(tmp_path / "worlds-of-robots/worlds", tmp_path).find("house", ASKING) == model


def test_links_are_not_followed(tmp_path):
    outside = package(tmp_path / "outside/robot")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "other").symlink_to(outside)
    (inside / "loop").symlink_to(inside)
    assert "not found" in refused(finder(inside / "urdf", inside), "robot")
    manifest = package(inside / "linked") / "package.xml"
    manifest.unlink()
    manifest.symlink_to(outside / "package.xml")
    files = Files(inside / "r.urdf", "r.urdf", ImportOptions(project=inside))
    assert "not found" in refused(files.packages, "robot")


# --- what is not right -----------------------------------------------------------------------------------------------

DAMAGED = {
    "not XML": "<package><name>robot</name>",
    "another element": "<robot><name>robot</name></robot>",
    "no name": "<package><depend>robot</depend></package>",
    "two names": "<package><name>robot</name><name>robot</name></package>",
    "an empty name": "<package><name> </name><depend>robot</depend></package>",
    "a path": "<package><name>../robot</name></package>",
    "a path from the root": "<package><name>/robot</name></package>",
    "unseen characters": "<package><name>\u202erobot</name></package>",
    "a document type": '<!DOCTYPE a [<!ENTITY b "robot">]><package><name>&b;</name></package>',
    "huge": f"<package><name>robot</name>{' ' * packages.LARGEST_MANIFEST}</package>",
    "binary": "\0robot\ufffd",
    "empty": "",
}


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.parametrize("folder", ["robot", "any"])
def test_a_damaged_manifest_is_an_error_with_its_place(tmp_path, name, folder):
    package(tmp_path / folder, text=DAMAGED[name])
    text = refused(finder(tmp_path / "urdf", tmp_path), "robot")
    if folder == "robot":
        assert text.startswith(f"{tmp_path}/{folder}/package.xml:1:")
        assert "--package robot=FOLDER" in text
    else:
        assert "the package 'robot' is not found" in text
        assert f"{folder}/package.xml" in text
    other = package(tmp_path / "urdf/nearer", "robot")
    assert finder(tmp_path / "urdf", tmp_path).find("robot", ASKING) == other, "one that is not needed stands in no way"
    named = finder(tmp_path / "urdf", tmp_path, packages={"robot": folder}, base=tmp_path)
    assert named.find("robot", ASKING) == tmp_path / folder


@given(st.text(max_size=20))
def test_a_name_is_a_single_part_of_a_path(name):
    found = Packages(Path("/nowhere"), ImportOptions(project=Path("/nowhere"), packages={name: "here"}))
    is_part = "/" not in name and "\\" not in name and name.strip(".") != "" and not UNSEEN_CHARACTERS.search(name)
    if is_part:
        assert found.find(name, ASKING) == Path("here")
    elif name.strip(".") != "" or name in ("", ".", ".."):
        assert "not the name of a package" in refused(found, name)


def test_searching_has_an_end(tmp_path, monkeypatch):
    monkeypatch.setattr(packages, "MOST_FOLDERS", 50)
    for index in range(60):
        (tmp_path / f"f{index}/in").mkdir(parents=True)
    package(tmp_path / "zz/robot")
    seen: list[str] = []
    real = os.scandir
    monkeypatch.setattr(os, "scandir", lambda folder: seen.append(str(folder)) or real(folder))
    text = refused(finder(tmp_path / "f0", tmp_path), "robot")
    assert "in the first 50 folders" in text
    assert len(seen) <= 52


def test_manifests_are_read_up_to_a_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(packages, "MOST_MANIFESTS", 200)
    for index in range(20):
        package(tmp_path / f"p{index:02}", text=f"<package><name>p</name>{' ' * 40}</package>")
    package(tmp_path / "z", "robot")
    assert "more than 200 bytes" in refused(finder(tmp_path / "urdf", tmp_path), "robot")


def test_an_audit_finds_the_same_packages(tmp_path):
    robot = package(tmp_path / "robot-main", "robot_description")
    path = robot / "r.urdf"
    content = b'<mesh filename="package://robot_description/a.stl"/><mesh filename="package://none/a.stl"/>'
    found = packages_of(content, path, ImportOptions(project=tmp_path))
    assert found == {"robot_description": str(robot)}


# --- paths of files --------------------------------------------------------------------------------------------------


def found_file(folder: Path, text: str, **options) -> Path:
    return Files(folder / "r.urdf", "r.urdf", ImportOptions(project=folder, **options)).find(text, ASKING)


@pytest.mark.parametrize(
    "text",
    [
        "package://robot/a b.stl",
        "package://robot/a%20b.stl",
        "model://robot/a%20b.stl",
        "file://package://robot/a b.stl",
        "file://$(find robot)/a b.stl",
        "file:///$(find robot)/a%20b.stl",
        "file://{}/robot/a%20b.stl",
        "file://localhost{}/robot/a b.stl",
        "robot/a%20b.stl",
        "https://fuel.gazebosim.org/1.0/OpenRobotics/models/robot/3/files/a%20b.stl",
    ],
)
def test_ways_to_name_a_file(tmp_path, text):
    package(tmp_path / "robot")
    (tmp_path / "robot/a b.stl").touch()
    assert found_file(tmp_path, text.replace("{}", str(tmp_path))) == tmp_path / "robot/a b.stl"


def test_a_name_with_a_percent_sign_is_taken_as_it_is_where_there_is_such_a_file(tmp_path):
    (tmp_path / "a%20b.stl").touch()
    (tmp_path / "a b.stl").touch()
    assert found_file(tmp_path, "a%20b.stl").name == "a%20b.stl"
    (tmp_path.parent / "secret.stl").touch()
    with pytest.raises(SpecError, match="leaves the project folder"):
        found_file(tmp_path, "%2e%2e/secret.stl")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("C:\\robots\\a.stl", "a path of Windows"),
        ("c:/robots/a.stl", "a path of Windows"),
        ("file:///C:/robots/a.stl", "a path of Windows"),
        ("meshes\\a.stl", "a path of Windows"),
        ("package://robot\\meshes\\a.stl", "a path of Windows"),
        ("@PKG_DIR@/a.stl", "a placeholder"),
        ("package://@PROJECT_NAME@/a.stl", "a placeholder"),
        ("file://${MODELS}/a.stl", "a placeholder"),
        ("{{ folder }}/a.stl", "a placeholder"),
        ("$(env HOME)/a.stl", "a placeholder"),
        ("https://fuel.gazebosim.org/1.0/OpenRobotics/models/Husky/tip/files/a.stl", "--package 'Husky'=FOLDER"),
        ("https://example.org/a.stl", "nothing from the network"),
        ("ftp://example.org/a.stl", "nothing from the network"),
        ("gopher://example.org/a.stl", "gopher:// is not read"),
    ],
)
def test_paths_that_lead_nowhere_say_why(tmp_path, text, said):
    package(tmp_path / "robot")
    with pytest.raises(SpecError) as error:
        found_file(tmp_path, text)
    (problem,) = error.value.problems
    assert said in str(problem)
    assert problem.location == ASKING.location
    assert isinstance(error.value, MissingFileError) is ("gopher" not in text)


def test_a_robot_that_git_cannot_fetch_is_an_error_with_the_reason_of_git(monkeypatch):
    output = "Cmd('git') failed due to: exit code(128)\n  cmdline: git fetch\n  stderr: 'fatal: no such host'"

    def failing(name: str):
        raise RuntimeError(output)

    monkeypatch.setattr(files.importlib, "import_module", failing)
    with pytest.raises(SpecError) as caught:
        files._fetch("panda_description")
    (problem,) = caught.value.problems
    assert problem.message == "panda_description: robot_descriptions cannot fetch it: no such host"
