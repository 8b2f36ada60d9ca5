"""No file of the working folder of a command is imported: by simspec, its child processes, or the commands that it prints."""

from __future__ import annotations

import ast
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from simspec import processes
from simspec.engines.kit.registry import engines
from tests.modules import MODULES, name_of, parsed

FORMS = {"isolated", "with_search_path"}
STARTS = {
    *("Popen", "run", "call", "check_call", "check_output", "getoutput", "getstatusoutput", "system", "popen"),
    *("execv", "execve", "execvp", "execvpe", "execl", "execle", "execlp", "posix_spawn", "posix_spawnp", "spawnv"),
    *("spawnve", "create_subprocess_exec", "create_subprocess_shell"),
}
OWNERS = {"subprocess", "os", "asyncio"}
OTHERS = {
    "engines/kit/compiled.py": "a compiler, which imports nothing",
    "engines/kit/keeper.py": "an engine that is a program of its own",
    "engines/webots/program.py": "Webots, and its controller by `isolated`",
    "engines/kit/process.py": "a keeper, whose words are made a few lines above, in a folder of its own",
    "commands/installers.py": "commands of `environments.making` and `words`, which are made here and there by `isolated`",
}
"""Modules that start what is given to them, with the reason."""
EXECUTABLE = {"processes.py", "engines/kit/process.py"}
"""Modules that say `sys.executable`: the second hands it on to `with_search_path`."""
OPTIONS = {"-m", "-c", "-I", "-P", "-E", "-s"}


def starts(tree: ast.AST) -> list[ast.Call]:
    """Calls that start a program."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)]
    return [
        call
        for call in calls
        if isinstance(call.func, ast.Attribute)
        and call.func.attr in STARTS
        and isinstance(call.func.value, ast.Name)
        and call.func.value.id in OWNERS
        and (call.func.value.id, call.func.attr) != ("asyncio", "run")
    ]


def is_form(node: ast.expr | None, tree: ast.AST) -> bool:
    """Whether what is started is made by one of the two forms, there or where its name is given its value."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id in FORMS
    if not isinstance(node, ast.Name):
        return False
    values = [
        assignment.value
        for assignment in ast.walk(tree)
        if isinstance(assignment, ast.Assign)
        and any(isinstance(t, ast.Name) and t.id == node.id for t in assignment.targets)
    ]
    return bool(values) and all(is_form(value, tree) for value in values if not isinstance(value, ast.Name))


def first_words(node: ast.List | ast.Tuple) -> set[str]:
    """The first three constants of a list."""
    return set([str(element.value) for element in node.elts if isinstance(element, ast.Constant)][:3])


def wrong(path: str, tree: ast.Module) -> list[str]:
    """Lines of a module that start an interpreter in another way."""
    found = []
    for call in starts(tree):
        if path not in OTHERS and not is_form(call.args[0] if call.args else None, tree):
            found.append(f"{path}:{call.lineno}: started without isolation")
        if path not in ("engines/kit/compiled.py", "engines/kit/keeper.py") and "cwd" not in {
            key.arg for key in call.keywords
        }:
            found.append(f"{path}:{call.lineno}: started in the working folder")
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr == "executable" and path not in EXECUTABLE:
            found.append(f"{path}:{node.lineno}: sys.executable")
        has_options = isinstance(node, ast.List | ast.Tuple) and bool(OPTIONS & first_words(node))
        if has_options and path not in ("processes.py", "engines/kit/compiled.py"):
            found.append(f"{path}:{node.lineno}: words of an interpreter")
        if isinstance(node, ast.ImportFrom) and node.module in OWNERS and STARTS & {name.name for name in node.names}:
            found.append(f"{path}:{node.lineno}: started by a bare name")
    return found


def test_every_interpreter_is_started_in_either_isolated_form():
    assert not [line for path in MODULES for line in wrong(name_of(path), parsed(path))]


@pytest.mark.parametrize(
    "text",
    [
        "subprocess.run([sys.executable, '-c', code], cwd='/')",
        "subprocess.Popen([python, script], cwd='/')",
        "subprocess.run(isolated('-c', code))",
        "words = [python, '-m', 'pip']",
        "words = [python, script]\nsubprocess.run(words, cwd='/')",
        "os.execvp(python, [python, script])",
        "from subprocess import run",
    ],
)
def test_another_form_is_seen(text):
    assert wrong("some.py", ast.parse(text))


def test_the_forms_are_seen_as_such():
    text = "words = isolated('-m', 'pip')\nsubprocess.run(words, cwd='/')\nsubprocess.Popen(with_search_path(a), cwd=b)"
    assert not wrong("some.py", ast.parse(text))


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        (":/a", "/a"),
        ("/a:", "/a"),
        ("", None),
        (":", None),
        (".:/a:b:/c", "/a:/c"),
        (None, None),
    ],
)
def test_the_working_folder_is_not_on_the_search_path(given, kept):
    environment = {"HOME": "/h"} | ({} if given is None else {"PYTHONPATH": given})
    cleaned = processes.search_environment(environment)
    assert cleaned.get("PYTHONPATH") == kept
    assert (cleaned["HOME"], cleaned["PYTHONNOUSERSITE"]) == ("/h", "1")


# --- commands ---------------------------------------------------------------------------------------------------------

NAMES = (
    *(
        "json",
        "re",
        "os",
        "io",
        "struct",
        "ctypes",
        "socket",
        "tempfile",
        "subprocess",
        "importlib",
        "typing",
        "signal",
    ),
    *(
        "numpy",
        "pip",
        "venv",
        "ensurepip",
        "trimesh",
        "collada",
        "xacro",
        "yaml",
        "mujoco",
        "pxr",
        "pybullet",
        "simspec",
    ),
    *("sitecustomize", "usercustomize", "resource", "contextlib", "pathlib", "dataclasses"),
)
"""Names of planted modules: imports of simspec and of its child processes, and of every interpreter."""
PLANT = "open({mark!r}, 'a').write(__name__ + '\\n')\nraise SystemExit(77)\n"
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
FILES = {
    "robot.urdf": f"""<robot name="r"><link name="base"><inertial><mass value="1"/>{INERTIA}</inertial>
<collision><geometry><mesh filename="part.obj"/></geometry></collision></link></robot>""",
    "robot.urdf.xacro": f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="m" value="${{1 + 1}}"/>
<link name="base"><inertial><mass value="${{m}}"/>{INERTIA}</inertial></link></robot>""",
    "robot.xml": '<mujoco><worldbody><body><freejoint/><geom type="sphere" size="0.1"/></body></worldbody></mujoco>',
    "robot.usda": """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "ball" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
    float physics:mass = 1
    float3 physics:diagonalInertia = (1, 1, 1)
}
""",
    "part.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "fall.yaml": """simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 2 ms}
bodies:
  ball: {mass: 1 kg, inertia: {principal: [1, 1, 1]}}
sweep:
  over:
    physics.timestep: [1 ms, 2 ms]
""",
}
ENGINE = "mujoco"
VERSION = engines()[ENGINE].version() or ""
COMMANDS = [
    (0, "check", "robot.urdf"),
    (0, "check", "robot.urdf.xacro"),
    (0, "import", "robot.xml"),
    (0, "import", "robot.usda"),
    (0, "compile", "fall.yaml"),
    (0, "verify", "fall.yaml", "--engine", ENGINE),
    (0, "run", "fall.yaml", "--engine", ENGINE, "--engine", f"{ENGINE}@{VERSION}={sys.executable}"),
    (0, "run", "fall.yaml", "--engine", "dart", "--engine", "pybullet"),
    (0, "sweep", "fall.yaml", "--engine", ENGINE),
    (0, "explain", "fall.yaml", "--engine", ENGINE, "--engine", "dart"),
    (0, "engines", "doctor", ENGINE),
    (1, "audit", "robot.urdf", "--engine", ENGINE),  # MuJoCo fixes the free robot to the world
    (3, "bisect", "fall.yaml", "--engine", ENGINE, "--from", "3.4.0", "--to", "3.8.0", "--figure", "ball.z"),
    (3, "engines", "install", f"{ENGINE}@3.17", "--yes"),
]


@pytest.fixture
def hostile(tmp_path):
    """A folder with modules that leave a mark when they are imported, a home with some, and the environment of a command."""
    mark, folder, home = tmp_path / "mark", tmp_path / "folder", tmp_path / "home"
    user_packages = (
        home / ".local" / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    )
    for place in (folder, user_packages):
        place.mkdir(parents=True)
        for name in NAMES:
            (place / f"{name}.py").write_text(PLANT.format(mark=str(mark)))
    for name, text in FILES.items():
        (folder / name).write_text(text)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    # an index that has nothing: pip is started, and installs nothing
    environment |= {
        "HOME": str(home),
        "XDG_DATA_HOME": str(tmp_path / "data"),
        "PIP_INDEX_URL": (tmp_path / "i").as_uri(),
    }
    environment |= {
        "PYTHONNOUSERSITE": "1",
        "PIP_RETRIES": "0",
    }  # for simspec itself; its child processes must isolate themselves
    return folder, mark, environment


def simspec(folder: Path, environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-I", "-m", "simspec", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("code", "words"), [(code, words) for code, *words in COMMANDS], ids=lambda entry: str(entry)[:70]
)
def test_no_command_imports_from_the_working_folder(hostile, code, words):
    folder, mark, environment = hostile
    done = simspec(folder, environment, *words)
    assert not mark.exists(), mark.read_text()
    assert done.returncode == code, done.stdout + done.stderr


def test_nor_do_the_printed_words_that_install_engines(hostile, tmp_path):
    folder, mark, environment = hostile
    environment.pop("PYTHONNOUSERSITE")
    done = simspec(folder, environment, "engines", "install", f"{ENGINE}@3.17", "--json")
    rows = json.loads(done.stdout)["engines"][f"{ENGINE}@3.17"]["commands"]
    for row in rows:
        subprocess.run(shlex.split(row["words"]), cwd=folder, env=environment, capture_output=True, check=False)
    assert len(rows) == 2
    assert (tmp_path / "data" / "simspec" / "engines" / f"{ENGINE}@3.17" / "bin" / "python").exists()
    assert not mark.exists(), mark.read_text()


def test_a_planted_module_leaves_its_mark(hostile):
    folder, mark, environment = hostile
    subprocess.run(
        [sys.executable, "-m", "venv", "--help"], cwd=folder, env=environment, capture_output=True, check=False
    )
    assert mark.exists()
