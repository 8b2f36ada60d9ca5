"""The processes that read files of unknown origin, with an escape planted in each where the reader of the file would be."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from simspec.audit.audit import loaded, readable
from simspec.audit.meaning import Meaning
from simspec.confinement import walls
from simspec.errors import SpecError
from simspec.imports.elements import parse
from simspec.imports.files import Files
from simspec.imports.mjcf import compiled
from simspec.imports.mjcf.assembly import MjcfAssembly
from simspec.imports.usd import stage
from simspec.language.foreign import ImportOptions
from simspec.meshes.reading import _request, open_mesh
from tests import attempts
from tests.attempts import DONE
from tests.meshes.solids import box, stl

pytestmark = pytest.mark.skipif(not (walls().calls and walls().landlock), reason=f"this kernel: {walls().why}")

PLANTED = f"""
import importlib.util, json, os, sys
spec = importlib.util.spec_from_file_location("attempts", {attempts.__file__!r})
attempts = importlib.util.module_from_spec(spec)
spec.loader.exec_module(attempts)
def done(read, write, held):
    tried = attempts.all_tried(read, write, held)
    return sorted(name for some in tried.values() for name, came in some.items() if came == "done")
def problem_of(*places):
    return " ".join(name.replace(" ", "_") for name in done(*places, os.getppid()))
def prepare():
    global HERE
    HERE = os.getcwd()
def main():
    sys.stdin.buffer.read()
    sys.stdout.write(json.dumps({{"error": problem_of(READ, HERE), "found": "", "missing": False}}))
"""
SEEN = DONE["files"] - {"mapped file"}
"""Attempts that a reader of files may do; its standard input is a pipe."""


def words(names):
    return {name.replace(" ", "_") for name in names}


@pytest.fixture
def project(tmp_path):
    """A folder of a project with a file that may be read, and a program with an escape in it."""
    folder = tmp_path.resolve() / "project"
    folder.mkdir()
    (folder / "known").write_text("known")
    (folder / "program.py").write_text(f"READ = {str(folder)!r}\n{PLANTED}")
    return folder


def test_the_process_that_expands_xacro(project):
    """The kernel's wall in it, with the expansion replaced and the audit hook taken away."""
    program = f"""{PLANTED}
import xacro
from simspec.imports.xacro import child
child.sys = type("Without", (), {{"addaudithook": lambda hook: None, "stdin": sys.stdin, "stdout": sys.stdout,
    "argv": sys.argv, "setrecursionlimit": lambda most: None}})
child.XacroProgram.run = lambda self, text, beyond: problem_of({str(project)!r}, {str(project)!r}) + f";{{beyond}}"
with open("now", "w+b") as now:
    now.write(bytes(16))
    now.flush()
    sys.argv[1:] = [str(now.fileno())]
    child.main()
"""
    request = {"files": ["a.xacro"], "text": "", "arguments": {}, "seconds": 5, "walls": None}
    requested = json.dumps(request).encode() + b"\n"
    words = [sys.executable, "-c", program]
    answer = subprocess.run(words, input=requested, capture_output=True, check=False, cwd=project)
    assert json.loads(answer.stdout)["text"] == ";None", answer.stderr.decode()


def test_the_reader_of_meshes(project):
    mesh = project / "a.stl"
    mesh.write_bytes(stl(*box(1, 1, 1)))
    program = f"""{PLANTED}
from simspec.meshes import child
def read(content, buffers):
    raise child.RefusedMeshError(problem_of({str(project)!r}, {str(project)!r}))
child.READERS[".stl"] = read
sys.argv[1:] = []
child.main()
"""
    request = _request(open_mesh(mesh))
    answer = subprocess.run([sys.executable, "-c", program], input=request, capture_output=True, check=False)
    assert set(json.loads(answer.stdout)["error"].split()) == DONE["data"], answer.stderr.decode()


def test_the_compiler_of_models(project, monkeypatch):
    planted = type("Planted", (), {"PROGRAM": project / "program.py"})
    monkeypatch.setattr(compiled, "_compiler", lambda root: planted)
    monkeypatch.setattr(compiled, "_refused", lambda error, assembly: pytest.fail(error))
    root = parse(b"<mujoco/>", "a.xml")
    assembly = MjcfAssembly.__new__(MjcfAssembly)
    assembly.root, assembly.texts = root, {}
    with pytest.raises(pytest.fail.Exception) as failed:
        compiled.compile_model(assembly)
    assert set(str(failed.value).split()) == words(DONE["data"])


@pytest.mark.parametrize("suffix", ["usda", "usdz"])
def test_the_reader_of_stages(suffix, project, monkeypatch):
    monkeypatch.setattr(stage, "PROGRAM", project / "program.py")
    path = project / f"a.{suffix}"
    path.write_text("#usda 1.0")
    with pytest.raises(SpecError) as error:
        stage.read_stage(Files(path, path.name, ImportOptions(project=project)), False)
    made = {"create", "create without a name", "folder"} if suffix == "usdz" else set()
    assert set(error.value.problems[0].message.split()) == words(SEEN | made)


def test_a_stage_outside_of_a_project_may_read_what_the_user_may(project, monkeypatch):
    monkeypatch.setattr(stage, "PROGRAM", project / "program.py")
    path = project / "a.usda"
    path.write_text("#usda 1.0")
    with pytest.raises(SpecError) as error:
        stage.read_stage(Files(path, path.name, ImportOptions()), False)
    more = {"open a file of the system", "listdir", "environment", "own environment"}
    assert set(error.value.problems[0].message.split()) - words(more) == words(SEEN)


def test_the_process_in_which_an_engine_loads_a_file(project, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own/old").touch()
    program = f"""{PLANTED}
from pathlib import Path
from simspec.engines.kit.foreign import ForeignSession
from simspec.engines.kit.worker import _confine_files
class Engine:
    FOREIGN_MEMORY = 0
    def prepare_foreign(self):
        pass
    def load_foreign(self, file, language, packages, log):
        return done({str(project)!r}, os.getcwd(), os.getppid())
_confine_files(Path.cwd(), {{"operations": [{{"op": "foreign", "roots": [{str(project)!r}]}}]}})
print(json.dumps(ForeignSession(Engine).load_foreign(None, "", {{}})))
"""
    answer = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        check=False,
        cwd=tmp_path / "own",
        stdin=subprocess.PIPE,
        env={"PYTHONPATH": str(Path(__file__).parents[1])},
    )
    assert set(json.loads(answer.stdout)) == DONE["scratch"] - {"mapped file"}, answer.stderr.decode()


ROBOT = """<mujoco><asset><mesh name="m" file="{}"/></asset>
<worldbody><body><freejoint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""


def test_an_engine_reads_the_projects_files_and_no_others(project, tmp_path):
    """By MuJoCo's own loader, which opens any path that a file names."""
    pytest.importorskip("mujoco")
    mesh = stl(*box(1, 1, 1))
    (tmp_path / "outside.stl").write_bytes(mesh)
    (project / "inside.stl").write_bytes(mesh)
    (project / "simspec.toml").touch()
    robot = project / "robot.xml"

    def load(name, allow_outside=False):
        robot.write_text(ROBOT.format(name))
        meaning = Meaning(robot, "mjcf")
        return loaded("mujoco", meaning, None, 60.0, roots=readable(meaning, ImportOptions(), allow_outside))

    assert load("inside.stl").read_back is not None
    outside = str(tmp_path.resolve() / "outside.stl")
    refused = load(outside)
    assert refused.read_back is None
    assert "outside.stl" in str(refused.error)
    assert load(outside, allow_outside=True).read_back is not None


def test_a_locale_breaks_no_engine(project, monkeypatch):
    """Drake's sources are not ASCII: where texts are, it cannot be imported."""
    pytest.importorskip("pydrake")
    for name, value in {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}.items():
        monkeypatch.setenv(name, value)
    robot = project / "robot.xml"
    robot.write_text(
        '<mujoco model="r"><worldbody><body name="a"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    )
    loading = loaded("drake", Meaning(robot, "mjcf"), None, 60.0)
    assert loading.read_back is not None, loading.error
