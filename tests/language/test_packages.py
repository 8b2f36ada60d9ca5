"""Files of installed packages and robots of robot_descriptions by name: found without running code, read nowhere else."""

import hashlib
import json
import sys
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.errors import SpecError
from simspec.language import packages
from simspec.language.foreign import suffixes
from simspec.language.load import Spec, load
from simspec.language.packages import NotCachedError, is_robot, packaged
from simspec.world.canonical import sha256

ROBOT = """\
<robot name="crane">
  <link name="base"/>
  <link name="arm">
    <inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="{mesh}"/></geometry></collision>
  </link>
  <joint name="slew" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
</robot>
"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
EXPLODES = "raise RuntimeError('the code of a package was executed')\n"
USE = """\
simspec: 1
name: yard
physics: {{duration: 0.1}}
contact: {{materials: {{default: {{friction: 0.5}}}}}}
models:
  crane: {{use: {}, fixed: true}}
"""
COMMIT = "0123456789abcdef0123456789abcdef01234567"
MODULE = """\
from os import getenv as _getenv
from os import path as _path
from ._cache import clone_to_cache as _clone_to_cache
REPOSITORY_PATH: str = _clone_to_cache("yard-data", commit=_getenv("ROBOT_DESCRIPTION_COMMIT", None))
PACKAGE_PATH: str = _path.join(REPOSITORY_PATH, "robots", "crane")
SRDF_PATH: str = _path.join(PACKAGE_PATH, "crane.srdf")
{word}_PATH: str = _path.join(PACKAGE_PATH, "urdf", "{file}")
XACRO_ARGS = {{"length": "0.3"}}
raise RuntimeError("the code of robot_descriptions was executed")
"""
REPOSITORIES = f'''\
REPOSITORIES: Dict[str, Repository] = {{
    "yard-data": Repository(url="https://127.0.0.1/none.git", commit="{COMMIT}", cache_path="yard_data"),
    "out-data": Repository(url="https://127.0.0.1/none.git", commit="{COMMIT}", cache_path="../out"),
}}
raise RuntimeError("the code of robot_descriptions was executed")
'''


def put(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages, none of whose code can be executed, and a working folder next to it."""
    site = tmp_path / "site"
    arm = {"arm.urdf": ROBOT.format(mesh="package://yard_robots/meshes/arm.obj"), "meshes/arm.obj": TETRAHEDRON}
    put(site / "yard_robots", {"__init__.py": EXPLODES, **arm, "spec.yaml": USE.format("arm.urdf")})
    record = ["yard_robots/__init__.py", "yard_robots-1.2.dist-info/METADATA"]
    put(site / "yard_robots-1.2.dist-info", {"METADATA": "Metadata-Version: 2.1\nName: yard-robots\nVersion: 1.2\n"})
    put(site / "yard_robots-1.2.dist-info", {"RECORD": "".join(f"{name},,\n" for name in record)})
    put(site, {"alone.py": EXPLODES})
    with zipfile.ZipFile(tmp_path / "zipped.zip", "w") as archive:
        archive.writestr("zipped/__init__.py", "")
        archive.writestr("zipped/arm.urdf", arm["arm.urdf"])
    put(tmp_path / "other", {"spread/b.urdf": ROBOT.format(mesh="b.obj"), "spread/b.obj": TETRAHEDRON})
    put(site, {"spread/a.urdf": ROBOT.format(mesh="a.obj"), "spread/a.obj": TETRAHEDRON})
    monkeypatch.setattr(sys, "path", [str(site), str(tmp_path / "other"), str(tmp_path / "zipped.zip"), *sys.path])
    work = tmp_path / "work"
    put(work, {"pyproject.toml": "", "yard.yaml": USE.format("package://yard_robots/arm.urdf")})
    monkeypatch.chdir(work)
    return site


@pytest.fixture
def cached(site, tmp_path, monkeypatch):
    """robot_descriptions with two robots, whose repository is in its cache."""
    put(site / "robot_descriptions", {"__init__.py": EXPLODES, "_cache.py": EXPLODES, "_repositories.py": REPOSITORIES})
    put(site / "robot_descriptions", {"crane_description.py": MODULE.format(word="URDF", file="crane.urdf")})
    put(site / "robot_descriptions", {"hoist_description.py": MODULE.format(word="XACRO", file="hoist.urdf.xacro")})
    out = MODULE.format(word="URDF", file="crane.urdf").replace("yard-data", "out-data")
    put(site / "robot_descriptions", {"out_description.py": out})
    clone = tmp_path / "cache" / "yard_data"
    put(clone, {".git/HEAD": f"{COMMIT}\n", "robots/crane/meshes/arm.obj": TETRAHEDRON})
    put(clone, {"robots/crane/urdf/crane.urdf": ROBOT.format(mesh="package://crane/meshes/arm.obj")})
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ROBOT_DESCRIPTION_COMMIT", raising=False)
    return clone


def simspec(*words: str, code: int = 0):
    done = CliRunner().invoke(cli.app, list(words))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == code, done.output
    return done


def refused(text: str) -> str:
    with pytest.raises(SpecError) as error:
        Spec.from_data(
            {"name": "yard", "physics": {"duration": 0.1}, "models": {"crane": {"use": text, "fixed": True}}}
        )
    return str(error.value)


# --- installed packages ---


@pytest.mark.parametrize("command", ["check", "compile", "export"])
def test_a_file_of_a_package_needs_no_flag(site, command):
    more = {"compile": ("-e", "mujoco"), "export": ("--format", "urdf")}.get(command, ())
    simspec(command, "yard.yaml", *more)


def test_commands_take_its_name_in_place_of_a_file(site):
    assert "package://yard_robots/arm.urdf: ok" in simspec("check", "package://yard_robots/arm.urdf").stdout
    simspec("compile", "package://yard_robots/arm.urdf", "-e", "mujoco", "--out", "out")
    assert simspec("import", "package://yard_robots/arm.urdf", "-o", "arm.yaml").stdout
    text = Path("arm.yaml").read_text()
    assert 'mesh: {file: "package://yard_robots/meshes/arm.obj"}' in text, "no path of this machine"
    simspec("check", "arm.yaml")
    assert sha256(load("arm.yaml").resolve()) == sha256(load("package://yard_robots/arm.urdf").resolve())


def test_a_spec_of_a_package_uses_its_other_files(site):
    spec = load("package://yard_robots/spec.yaml")
    assert [body.name for body in spec.resolve().bodies] == ["crane/base", "crane/arm"]
    assert set(spec.packages()["package://yard_robots"]["files"]) == {"arm.urdf", "meshes/arm.obj", "spec.yaml"}
    assert "belongs to package://yard_robots" in simspec("accept", "package://yard_robots/spec.yaml", code=2).stderr


def test_version_and_digests_are_recorded_without_paths_of_the_machine(site):
    said = load("yard.yaml").packages()
    content = (site / "yard_robots" / "arm.urdf").read_bytes()
    assert said["package://yard_robots"]["version"] == "1.2"
    assert said["package://yard_robots"]["files"]["arm.urdf"] == hashlib.sha256(content).hexdigest()
    assert set(said["package://yard_robots"]["files"]) == {"arm.urdf", "meshes/arm.obj"}
    assert str(site) not in json.dumps(said)


def test_compile_check_notices_that_a_file_of_the_package_changed(site):
    simspec("compile", "yard.yaml", "-e", "mujoco", "--out", "out")
    assert str(site).encode() not in b"".join(file.read_bytes() for file in Path("out").rglob("*") if file.is_file())
    assert "world.json" not in simspec("compile", "yard.yaml", "-e", "mujoco", "--out", "out", "--check", code=1).stderr
    file = site / "yard_robots" / "meshes" / "arm.obj"
    file.write_text(TETRAHEDRON.replace("v 1 0 0", "v 1.5 0 0"))
    assert "world.json" in simspec("compile", "yard.yaml", "-e", "mujoco", "--out", "out", "--check", code=1).stderr


def test_defects_of_the_file_name_its_place_in_the_package(site):
    (site / "yard_robots" / "arm.urdf").write_text(
        ROBOT.format(mesh="x.obj").replace('mass value="2"', 'mass value="-2"')
    )
    stderr = simspec("check", "yard.yaml", code=2).stderr
    assert "package://yard_robots/arm.urdf:4:" in stderr
    assert str(site) not in stderr


def test_every_part_of_a_namespace_package_is_looked_into(site):
    for name in ("a", "b"):
        assert load(f"package://spread/{name}.urdf").resolve().bodies


def test_a_package_of_the_working_folder_does_not_count_as_installed(site, monkeypatch):
    put(Path.cwd() / "yard_robots", {"arm.urdf": "not this one"})
    monkeypatch.setattr(sys, "path", ["", str(Path.cwd()), *sys.path])
    assert packaged("package://yard_robots/arm.urdf", suffixes()).path.is_relative_to(site)
    put(Path.cwd() / "only_here", {"arm.urdf": "not this one"})
    assert "not installed" in refused("package://only_here/arm.urdf")


@pytest.mark.parametrize("share", ["yard-data.data/share/yard-data", "prefix/share/yard_data"])
def test_data_files_outside_the_package_are_found_by_the_list_of_the_distribution(site, share):
    put(site / share, {"robots/arm.urdf": ROBOT.format(mesh="arm.obj"), "robots/arm.obj": TETRAHEDRON})
    put(site / "yard_data-3.dist-info", {"METADATA": "Metadata-Version: 2.1\nName: yard-data\nVersion: 3\n"})
    lines = f"{share}/robots/arm.urdf,,\n../../../../../../etc/share/yard-data/passwd,,\n"
    put(site / "yard_data-3.dist-info", {"RECORD": lines})
    found = packaged("package://yard-data/robots/arm.urdf", suffixes())
    assert (found.package.version, found.package.root) == ("3", site / share)
    assert load("package://yard-data/robots/arm.urdf").resolve().bodies
    assert load("package://yard_data/robots/arm.urdf").resolve().bodies


def test_a_distribution_of_another_name_than_its_package(site):
    put(site / "ydata", {"__init__.py": EXPLODES, "arm.urdf": ROBOT.format(mesh="arm.obj"), "arm.obj": TETRAHEDRON})
    put(site / "yard_rtb-3.dist-info", {"METADATA": "Metadata-Version: 2.1\nName: yard-rtb\nVersion: 3\n"})
    put(site / "yard_rtb-3.dist-info", {"RECORD": "ydata/arm.urdf,,\nyard_rtb-3.dist-info/METADATA,,\n"})
    assert load("package://yard-rtb/arm.urdf").resolve().bodies
    assert load("package://ydata/arm.urdf").packages()["package://ydata"]["version"] in ("", "3")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("package://yard_robots/../alone.py", "not a path within a package"),
        ("package://yard_robots//etc/passwd", "not a path within a package"),
        ("package://yard_robots/meshes\\arm.obj", "not a path within a package"),
        ("package://yard_robots/", "names no file of the package"),
        ("package://yard_robots", "names no file of the package"),
        ("package:///etc/passwd", "not the name of a package"),
        ("package://../etc/passwd", "not the name of a package"),
        ("package://yard_robots.meshes/arm.obj", "not installed"),
        ("package://alone/x.urdf", "single module"),
        ("package://sys/x.urdf", "single module"),
        ("package://zipped/arm.urdf", "archive"),
        ("package://nothing_here/arm.urdf", "not installed"),
        ("package://yard_robots/arn.urdf", "did you mean package://yard_robots/arm.urdf?"),
        ("package://yard_robots/deeper/arm.obj", "did you mean package://yard_robots/meshes/arm.obj?"),
        ("package://yard_robots/" + "a/" * 450 + "arm.urdf", "no such file"),
        ("package://yard_robots/" + "a" * 900, "no such file"),
        ("robot_descriptions://../../etc_description", "not the name of a robot"),
        ("robot_descriptions://nobody_description", "robot_descriptions is not installed"),
        ("nobody_description", "robot_descriptions is not installed"),
    ],
)
def test_a_missing_file_of_a_package_is_a_located_error(site, text, words):
    given = refused(text)
    assert words in given
    assert "models.crane.use" in given


def test_a_package_is_looked_for_once_for_all_its_files(site, monkeypatch):
    names = [f"arm_{k}.urdf" for k in range(20)]
    put(site / "yard_robots", dict.fromkeys(names, "x"))
    looked_for = []
    find = packages.package_folders
    monkeypatch.setattr(packages, "package_folders", lambda name: looked_for.append(name) or find(name))
    assert len({packaged(f"package://yard_robots/{name}", suffixes()).path for name in names}) == 20
    assert looked_for == ["yard_robots"]


def test_links_out_of_the_package_are_not_followed(site, tmp_path):
    put(tmp_path, {"secret.urdf": ROBOT.format(mesh="x.obj"), "secret.obj": TETRAHEDRON})
    (site / "yard_robots" / "link.urdf").symlink_to(tmp_path / "secret.urdf")
    assert "leaves the package package://yard_robots" in refused("package://yard_robots/link.urdf")
    put(site / "yard_robots", {"out.urdf": ROBOT.format(mesh="../../secret.obj")})
    (site / "yard_robots" / "inner.obj").symlink_to(tmp_path / "secret.obj")
    put(site / "yard_robots", {"inner.urdf": ROBOT.format(mesh="inner.obj")})
    for name in ("out", "inner"):
        assert "leaves the project folder" in refused(f"package://yard_robots/{name}.urdf")


def test_a_file_of_a_package_may_not_read_the_project_that_uses_it(site):
    put(Path.cwd(), {"arm.obj": TETRAHEDRON})
    put(site / "yard_robots", {"in.urdf": ROBOT.format(mesh=str(Path.cwd() / "arm.obj"))})
    assert "leaves the project folder" in refused("package://yard_robots/in.urdf")


# --- robot_descriptions ---


def test_a_cached_robot_is_used_by_its_name(cached):
    Path("yard.yaml").write_text(USE.format("crane_description"))
    spec = load("yard.yaml")
    said = spec.packages()["robot_descriptions://crane_description"]
    assert said["version"] == COMMIT
    assert set(said["files"]) == {"robots/crane/meshes/arm.obj", "robots/crane/urdf/crane.urdf"}
    simspec("check", "yard.yaml")
    for name in ("crane_description", "robot_descriptions://crane_description"):
        simspec("check", name)
        simspec("compile", name, "-e", "mujoco", "--out", "out")
        simspec("import", name, "-o", "crane.yaml")
    text = Path("crane.yaml").read_text()
    assert "robot_descriptions://crane_description/robots/crane/meshes/arm.obj" in text
    simspec("check", "crane.yaml")


def test_a_file_of_that_name_comes_first(cached):
    put(Path.cwd(), {"crane_description": "simspec: 1\nname: mine\nmodel: {bodies: {base: {}}}\n"})
    Path("yard.yaml").write_text(USE.format("crane_description"))
    assert [body.name for body in load("yard.yaml").resolve().bodies] == ["crane/base"]


def test_the_arguments_that_robot_descriptions_gives_come_after_those_of_the_user(cached):
    pytest.importorskip("xacro")
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="hoist"><xacro:arg name="length" default="1"/>'
    body = ROBOT.split("\n", 1)[1].replace('mass value="2"', 'mass value="$(arg length)"')
    put(cached, {"robots/crane/urdf/hoist.urdf.xacro": head + body.format(mesh="package://crane/meshes/arm.obj")})
    world = load("robot_descriptions://hoist_description").resolve()
    assert max(body.inertial.mass for body in world.bodies if body.inertial) == 0.3
    simspec("check", "hoist_description", "--arg", "length=0.4")
    Path("yard.yaml").write_text(USE.format("hoist_description, import: {arguments: {length: '0.5'}}"))
    assert max(body.inertial.mass for body in load("yard.yaml").resolve().bodies if body.inertial) == 0.5


def test_a_robot_that_is_not_in_the_cache_is_not_fetched(cached, monkeypatch):
    monkeypatch.setattr("importlib.import_module", None)
    Path("yard.yaml").write_text(USE.format("crane_description"))
    (cached / ".git" / "HEAD").write_text("f" * 40 + "\n")
    stderr = simspec("check", "yard.yaml", code=2).stderr
    assert "in the cache at commit ffffffffffff" in stderr
    assert "simspec import crane_description fetches it" in stderr
    (cached / ".git" / "HEAD").unlink()
    for words in (
        ("check", "yard.yaml"),
        ("check", "crane_description"),
        ("audit", "crane_description", "-e", "mujoco"),
    ):
        stderr = simspec(*words, code=2).stderr
        assert "is not in the cache of robot_descriptions" in stderr
        assert "simspec import crane_description fetches it" in stderr
    with pytest.raises(NotCachedError):
        packaged("robot_descriptions://crane_description", suffixes())


def test_import_fetches_it(cached, monkeypatch):
    (cached / ".git" / "HEAD").unlink()
    requested = []

    def fetch(name):
        requested.append(name)
        (cached / ".git" / "HEAD").write_text(f"{COMMIT}\n")

    monkeypatch.setattr("importlib.import_module", fetch)
    simspec("import", "crane_description", "-o", "crane.yaml")
    simspec("import", "crane_description", "-o", "crane.yaml")
    assert requested == ["robot_descriptions.crane_description"]


def test_a_branch_that_is_checked_out_is_read_as_git_writes_it(cached):
    put(cached, {".git/HEAD": "ref: refs/heads/main\n", ".git/refs/heads/main": f"{COMMIT}\n"})
    assert packaged("robot_descriptions://crane_description", suffixes()).package.version == COMMIT
    put(cached, {".git/HEAD": "ref: ../../../../etc/passwd\n"})
    with pytest.raises(NotCachedError):
        packaged("robot_descriptions://crane_description", suffixes())


@pytest.mark.parametrize("name", ["out_description", "crane_descripton", "../crane_description", "a_description.b"])
def test_names_that_are_no_robots_and_repositories_outside_the_cache_are_refused(cached, name):
    with pytest.raises(SpecError):
        load(f"robot_descriptions://{name}")
    assert not is_robot(name) or name == "out_description"


def test_the_nearest_robot_is_suggested(cached):
    assert "did you mean 'crane_description'?" in refused("crain_description")


def test_another_commit_of_the_environment_is_another_clone(cached, monkeypatch):
    other = "a" * 40
    monkeypatch.setenv("ROBOT_DESCRIPTION_COMMIT", other)
    with pytest.raises(NotCachedError):
        load("robot_descriptions://crane_description")
    (cached / ".git" / "HEAD").write_text(other)
    (cached.parent / f"yard_data-{other}").mkdir()
    cached.rename(cached.parent / f"yard_data-{other}" / "yard_data")
    assert (
        load("robot_descriptions://crane_description").packages()["robot_descriptions://crane_description"]["version"]
        == other
    )
    monkeypatch.setenv("ROBOT_DESCRIPTION_COMMIT", "../../out")
    with pytest.raises(SpecError, match="not a commit"):
        load("robot_descriptions://crane_description")


def test_a_robot_in_no_language_that_is_imported_is_refused_with_its_files(cached, site):
    text = MODULE.format(word="SKETCH", file="crane.dae")
    put(site / "robot_descriptions", {"sketch_description.py": text})
    said = refused("sketch_description")
    assert "in no language that simspec imports" in said
    assert "robots/crane/urdf/crane.dae, robots/crane/crane.srdf" in said
    put(site / "robot_descriptions", {"bare_description.py": "".join(text.splitlines(True)[:5])})
    assert "no file" in refused("bare_description")
