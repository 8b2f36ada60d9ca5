"""xacro is expanded by a process that can do nothing else; a request of a file to the system ends as an error with its
place."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from simspec.imports.xacro import importer
from simspec.language.foreign import Fate, ImportOptions, import_file
from simspec.language.load import load
from tests.imports.xacro.texts import MASS, NAMESPACE, imported, refused, robot
from tests.meshes.solids import box, stl

LEGS = f"""<xacro:arg name="count" default="2"/>
<xacro:include filename="parts/leg.xacro"/>
<xacro:property name="sizes" value="${{load_yaml('parts/sizes.yaml')}}"/>
<link name="base">{MASS}</link>
<xacro:leg side="left" length="${{sizes['leg'] * int('$(arg count)')}}"/>
<xacro:leg side="right" length="${{sizes.leg}}"/>"""
LEG = f"""<robot {NAMESPACE}><xacro:macro name="leg" params="side length">
<link name="${{side}}_leg">{MASS}</link>
<joint name="${{side}}_hip" type="revolute">
<parent link="base"/><child link="${{side}}_leg"/><origin xyz="0 0 ${{length}}"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></xacro:macro></robot>"""


@pytest.fixture
def legs(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/leg.xacro").write_text(LEG)
    (tmp_path / "parts/sizes.yaml").write_text("leg: 0.5")
    return tmp_path


def test_macros_includes_yaml_and_arguments(legs):
    result = imported(LEGS, legs)
    bodies = result.data["model"]["bodies"]
    assert bodies.keys() == {"base", "left_leg", "right_leg"}
    assert bodies["left_leg"]["joint"]["origin"] == {"xyz": [0, 0, 1]}
    assert {path.name for path in result.read} == {"r.xacro", "leg.xacro", "sizes.yaml"}
    assert imported(LEGS, legs, arguments={"count": "4"}).data["model"]["bodies"]["left_leg"]["joint"]["origin"] == {
        "xyz": [0, 0, 2]
    }
    assert len(load(legs / "r.xacro").resolve().bodies) == 3


def test_places_are_those_in_the_xacro_files(legs):
    result = imported(LEGS, legs)
    document = result.document("r.xacro")
    place = document.locate(("model", "bodies", "left_leg", "joint"))
    assert (place.file.rpartition("/")[2], place.line) == ("leg.xacro", 3)
    assert document.locate(("model", "bodies", "base", "mass")).line == 6
    assert not any("simspec-place" in account.what for account in result.accounts)


def test_defects_of_the_expansion_are_reported_at_the_macro(legs):
    (legs / "parts/leg.xacro").write_text(LEG.replace('link="base"', 'link="bas"'))
    assert "leg.xacro:3" in refused(LEGS, legs)


def test_packages(tmp_path):
    (tmp_path / "legs/urdf").mkdir(parents=True)
    (tmp_path / "legs/package.xml").write_text("<package><name>legs</name></package>")
    (tmp_path / "legs/urdf/leg.xacro").write_text(LEG)
    text = LEGS.replace("parts/leg.xacro", "$(find legs)/urdf/leg.xacro").replace(
        "load_yaml('parts/sizes.yaml')", "xacro.dotify(dict(leg=1))"
    )
    assert imported(text, tmp_path).data["model"]["bodies"].keys() == {"base", "left_leg", "right_leg"}
    assert "the package 'arms' is not found" in refused(text.replace("find legs", "find arms"), tmp_path)


def test_arguments_that_are_not_there(legs):
    assert "'xyz'" in refused(LEGS, legs, arguments={"xyz": "4"})
    assert "count" in refused(LEGS, legs, arguments={"xyz": "4"})
    text = refused(LEGS.replace('<xacro:arg name="count" default="2"/>', ""), legs)
    assert "the argument 'count' has no value" in text
    assert text.startswith("r.xacro:")


def test_libraries_are_refused_by_name(tmp_path):
    assert "is a library" in refused(LEG.replace("<robot", '<?xml version="1.0"?><robot'), tmp_path)
    assert "does not expand to URDF" in refused(f'<?xml version="1.0"?><sdf {NAMESPACE}/>', tmp_path)


def test_files_that_may_be_missing(tmp_path):
    text = f'<link name="a">{MASS}</link><xacro:include filename="none.xacro" optional="true"/>'
    assert imported(text, tmp_path).data["model"]["bodies"].keys() == {"a"}
    assert "none.xacro" in refused(text.replace(' optional="true"', ""), tmp_path)
    assert "leaves the project folder" in refused(text.replace("none.xacro", "../../etc/passwd"), tmp_path)


def test_warnings_of_xacro_are_reported(tmp_path):
    text = f'<link name="a">{MASS}</link><xacro:property name="pi" value="3"/>'
    result = imported(text, tmp_path)
    (given,) = [account for account in result.accounts if account.what == "xacro"]
    assert given.fate is Fate.UNUSED
    assert given.location.line == 3


HOSTILE = {
    "power": ('<link name="${9**9**9}"/>', "computing time"),
    "text": ("<link name=\"${'a'*10**10}\"/>", "memory"),
    "loop": ('<link name="${python.sum(python.range(10**12))}"/>', "computing time"),
    "passwd": ("<link name=\"${load_yaml('/etc/passwd')}\"/>", "leaves the project folder"),
    "passwd by a file URL": ("<link name=\"${load_yaml('file:///etc/passwd')}\"/>", "leaves the project folder"),
    "passwd by a package": ("<link name=\"${load_yaml('package://../../etc/passwd')}\"/>", "not the name of a package"),
    "include": ('<xacro:include filename="/etc/passwd"/>', "leaves the project folder"),
    "include above": ('<xacro:include filename="a/../../../../../../../etc/passwd"/>', "leaves the project folder"),
    "pattern": ('<xacro:include filename="/etc/*"/>', "no pattern"),
    "environment": ('<link name="$(env HOME)"/>', "the environment is not read"),
    "eval": ("<link name=\"$(eval open('/etc/passwd').read())\"/>", "is not evaluated"),
    "dirname": ('<link name="$(dirname)"/>', "is not evaluated"),
    "dunder": ('<link name="${().__class__}"/>', "two underscores"),
    "dunder within": ('<link name="${[x.__class__ for x in [1]]}"/>', "two underscores"),
    "import": ("<link name=\"${__import__('os')}\"/>", "two underscores"),
    "open": ("<link name=\"${open('/etc/passwd')}\"/>", "not defined"),
    "endless macro": (
        '<xacro:macro name="m" params="n"><xacro:m n="${n+1}"/></xacro:macro><xacro:m n="0"/>',
        "without an end",
    ),
    "circle": (
        '<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><link name="${a}"/>',
        "circular",
    ),
    "itself": ('<xacro:include filename="r.xacro"/>', "without an end"),
    "DOCTYPE": (
        f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "b">]><robot name="r" {NAMESPACE}><link name="&a;"/></robot>',
        "document type",
    ),
    "not XML": ('<?xml version="1.0"?><robot', "r.xacro:1"),
    "nothing": ('<?xml version="1.0"?>', "r.xacro:1"),
    "half a character": ("<link name=\"${'\\ud800'}\"/>", "half a character: '\\ud800'"),
    "half a character in a path": ("<xacro:include filename=\"${'\\ud800.xacro'}\"/>", "no such file"),
    "half a character in a message": ('<xacro:property name="a" value="${xacro.fatal(\'\\ud800\')}"/>${a}', "?"),
    "a table of names": ('<link name="${xacro}"/>', "a value that has no text"),
    "a function": ('<link name="a"><visual name="${sin} ${lambda: 1}"/></link>', "a value that has no text"),
    "unknown macro": ("<xacro:leg/>", "unknown macro"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_as_errors_with_their_places(name, tmp_path, monkeypatch):
    monkeypatch.setattr(importer, "CPU_SECONDS", 1)
    content, said = HOSTILE[name]
    read = []
    listening = [True]
    sys.addaudithook(lambda event, details: read.append(str(details[0])) if listening and event == "open" else None)
    text = refused(content, tmp_path)
    listening.clear()
    assert said in text
    assert "r.xacro:" in text
    assert text.encode()
    assert not [file for file in read if "passwd" in file]


def test_doubling_macros_end(tmp_path, monkeypatch):
    monkeypatch.setattr(importer, "CPU_SECONDS", 1)
    macros = '<xacro:macro name="m0" params=""><link name="a"/></xacro:macro>'
    for number in range(40):
        macros += f'<xacro:macro name="m{number + 1}" params=""><xacro:m{number}/><xacro:m{number}/></xacro:macro>'
    text = refused(macros + "<xacro:m40/>", tmp_path)
    assert "computing time" in text or "memory" in text


TRIES = """
import json, os, socket, subprocess, sys
from simspec.imports.xacro import child
child.close_doors(5, kernel=False)
def attempt(function):
    try:
        function()
    except BaseException as error:
        return type(error).__name__
    return "done"
tries = {
    "open": lambda: open("/etc/passwd"),
    "os.open": lambda: os.open("/etc/passwd", os.O_RDONLY),
    "socket": lambda: socket.socket(),
    "subprocess": lambda: subprocess.run(["/bin/cat", "/etc/passwd"], check=True),
    "listdir": lambda: os.listdir("/etc"),
    "system": lambda: os.system("true"),
    "remove": lambda: os.remove("/nothing"),
    "fork": lambda: os.fork(),
}
sys.stdout.write(json.dumps({name: attempt(function) for name, function in tries.items()}))
"""


def test_where_the_kernel_has_no_wall_an_audit_hook_is_left():
    """The kernel's, and the list of expressions: tests/test_confinement.py, test_escapes.py."""
    done = subprocess.run([sys.executable, "-c", TRIES], capture_output=True, text=True, check=True)
    answers = json.loads(done.stdout)
    assert len(answers) == 8
    assert set(answers.values()) == {"Refused"}


LIMITS = """
import sys
from simspec.imports.xacro import child
child.close_doors(1)
if sys.argv[1] == "time":
    while True:
        pass
if sys.argv[1] == "memory":
    try:
        bytearray(2 * child.MEMORY)
    except MemoryError:
        print("refused")
if sys.argv[1] == "call":
    sys.stdin.buffer.readline()
    print("answered")
"""


@pytest.mark.parametrize(
    ("what", "code", "said"), [("time", -24, b""), ("memory", 0, b"refused\n"), ("call", 0, b"answered\n")]
)
def test_time_and_memory_end(what, code, said):
    """Processor time by a signal (SIGXCPU), memory by an error; the purpose of the process goes on."""
    done = subprocess.run([sys.executable, "-c", LIMITS, what], input=b"\n", capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (code, said)


def test_an_answer_has_a_largest_size(tmp_path, monkeypatch):
    monkeypatch.setattr(importer, "LARGEST_ANSWER", 1000)
    assert "expands to too much" in refused(f"<link name=\"${{'a' * 2000}}\">{MASS}</link>", tmp_path)


def test_a_busy_machine_is_no_reason():
    """Processor time is the limit: a process that waits has all the time that it may need."""
    assert importer.SECONDS >= 20 * importer.CPU_SECONDS


def test_the_process_has_no_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMSPEC_SECRET", "hidden")
    result = imported(f'<link name="$(optenv SIMSPEC_SECRET shown)">{MASS}</link>', tmp_path)
    assert result.data["model"]["bodies"].keys() == {"shown"}


def test_a_part_is_refused_by_name_and_stands_by_itself_on_request(tmp_path):
    part = (
        f'<link name="finger">{MASS}</link>'
        '<joint name="bend" type="continuous"><parent link="palm"/><child link="finger"/></joint>'
    )
    text = refused(part, tmp_path)
    assert "r.xacro is a part: its joints lead from palm" in text
    assert "--repair undeclared-parents" in text
    result = imported(part, tmp_path, repair=("undeclared-parents",))
    assert result.data["model"]["bodies"]["palm"] == {"fixed": True}
    assert [repair.rule for repair in result.repairs] == ["undeclared-parents"]
    both = f'<link name="base">{MASS}</link>' + part
    assert "there is no link 'palm'" in refused(both, tmp_path)
    assert "have no parent" in refused(both, tmp_path, repair=("undeclared-parents",))


def test_meshes_next_to_the_expanded_text_are_found_above_the_program(tmp_path):
    shape = '<collision><geometry><mesh filename="./meshes/{}.stl"/></geometry></collision>'
    (tmp_path / "xacro").mkdir()
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/box.stl").write_bytes(stl(*box(0.1, 0.2, 0.3)))
    result = imported(f'<link name="base">{MASS}{shape.format("box")}</link>', tmp_path / "xacro", project=tmp_path)
    assert result.files == {"./meshes/box.stl": (tmp_path / "meshes/box.stl").resolve()}
    (given,) = [account for account in result.accounts if account.what.endswith("@filename")]
    assert (given.fate, "above the file" in given.reason) == (Fate.CARRIED, True)
    assert load(tmp_path / "xacro/r.xacro", allow_outside=True).resolve().bodies[0].shapes
    (tmp_path / "meshes/link.stl").symlink_to("/etc/passwd")
    for name in ("gone", "link", "../../../../../etc/hostname"):
        text = refused(
            f'<link name="base">{MASS}{shape.format(name)}</link>', tmp_path / "xacro", project=tmp_path.resolve()
        )
        assert "no such file" in text or "leaves the project folder" in text
    # not what the program is made of, nor above the project
    text = refused('<xacro:include filename="meshes/box.stl"/>', tmp_path / "xacro", project=tmp_path)
    assert "no such file" in text
    assert "no such file" in refused(
        f'<link name="base">{MASS}{shape.format("box")}</link>', tmp_path / "xacro", project=tmp_path / "xacro"
    )


# --- programs under other names, and what is said of arguments ------------------------------------------------------


def by_name(text, folder, name, **options):
    (folder / name).write_text(text)
    return import_file(folder / name, name, ImportOptions(project=folder.resolve(), **options))


@pytest.mark.parametrize("name", ["r.urdf", "r.xml", "r.URDF"])
def test_a_file_that_uses_xacro_is_expanded_independent_of_its_suffix(legs, name):
    assert by_name(robot(LEGS), legs, name).data == imported(LEGS, legs).data
    assert len(load(legs / name).resolve().bodies) == 3


@pytest.mark.parametrize(
    ("written", "length"),
    [("${2 * 0.25}", 0.5), ("$(optenv NOT_SET_HERE 0.5)", 0.5), ("$(arg z)", 0.5)],
)
def test_an_expression_in_an_attribute_of_plain_urdf_is_expanded(tmp_path, written, length):
    arg = '<xacro:arg name="z" default="0.5"/>' if "arg" in written else ""
    inertial = MASS.replace("<mass", f'<origin xyz="0 0 {written}"/><mass')
    text = robot(f'{arg}<link name="a">{inertial}</link>')
    text = text if arg else text.replace(NAMESPACE, "")
    assert by_name(text, tmp_path, "r.urdf").data["model"]["bodies"]["a"]["centre_of_mass"] == [0, 0, length]


def test_a_namespace_that_nothing_uses_is_no_program(tmp_path, monkeypatch):
    monkeypatch.setattr(importer, "_process", None)  # no process is started
    text = robot(f'<!-- <xacro:macro/> ${{x}} --><link name="a">{MASS}</link>')
    assert by_name(text, tmp_path, "r.urdf").data["model"]["bodies"].keys() == {"a"}


def test_a_missing_argument_says_how_it_is_given_and_which_there_are(legs):
    (legs / "parts/more.xacro").write_text(f'<robot {NAMESPACE}><xacro:arg name="side" default="left"/></robot>')
    more = '<xacro:include filename="parts/more.xacro"/><xacro:arg name="tall" default=""/>'
    text = refused(more + LEGS.replace('<xacro:arg name="count" default="2"/>', ""), legs)
    assert "the argument 'count' has no value" in text
    assert "--arg count=VALUE" in text
    assert "side=left" in text
    assert "tall=" in text


def test_an_argument_that_is_used_needs_no_declaration(tmp_path):
    text = robot(f'<link name="a">{MASS.replace("<mass", """<origin xyz="0 0 $(arg z)"/><mass""")}</link>')
    assert "--arg z=VALUE" in refused(text, tmp_path)
    assert imported(text, tmp_path, arguments={"z": "2"}).data["model"]["bodies"]["a"]["centre_of_mass"] == [0, 0, 2]
    assert "allowed: z" in " ".join(refused(text, tmp_path, arguments={"z": "2", "y": "1"}).split())


@pytest.mark.parametrize(
    "line",
    [
        b"[" * 100_000,
        b"1",
        b"{}",
        b'{"text": ""}',
        b'{"text": "", "warnings": [1], "declared": []}',
        b"\xff",
        b"no JSON",
    ],
)
def test_a_process_that_says_anything_is_refused(line):
    """A process that a file has taken over."""
    with pytest.raises(ValueError):  # noqa: PT011
        importer._message(line)
