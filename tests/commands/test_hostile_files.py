"""Every command that takes robot files rejects hostile files: exit code 2, a place in the file, and nothing written."""

from __future__ import annotations

import struct

import pytest

from simspec import cli

MASS = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
MESH = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
LINK = '<robot name="r">\n<link name="a">{}</link></robot>'
XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n{}</robot>'
SDF = '<sdf version="1.9"><model name="m">\n{}</model></sdf>'
BODY = '<body pos="{} 0 0"><freejoint/><geom size="1"/></body>'
FILES = {
    "bomb.urdf": '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>\n<robot name="&b;"/>',
    "outside.urdf": LINK.format(MASS + MESH.format("../outside/secret.stl")),
    "lies.urdf": LINK.format(MASS + MESH.format("lies.stl")),
    "command.urdf": LINK.format(MASS + MESH.format("$(touch pwned).stl; touch pwned")),
    "secret.xacro": XACRO.format("<link name=\"${load_yaml('../outside/secret.yaml')}\"/>"),
    "environment.xacro": XACRO.format('<link name="$(env HOME)"/>'),
    "nan.xml": f"<mujoco>\n<worldbody>{BODY.format('nan')}</worldbody></mujoco>",
    "copies.xml": f"<mujoco>\n<worldbody>{'<replicate count=%s100%s>' * 4 % ((chr(34),) * 8)}{BODY.format(0)}"
    f"{'</replicate>' * 4}</worldbody></mujoco>",
    "circle.sdf": SDF.format(
        '<link name="a"><pose relative_to="b"/></link><link name="b"><pose relative_to="a"/></link>'
    ),
    "itself.sdf": SDF.format("<include><uri>itself.sdf</uri></include>"),
    "outside.usda": '#usda 1.0\ndef Xform "a" (\n    references = @../outside/secret.usda@\n)\n{\n}\n',
    "damaged.usdc": "PXR-USDC" + "\0" * 100,
}
CHEAP = ("bomb.urdf", "outside.urdf", "circle.sdf")
"""Files that are read without a separate process; each command is tested with these, and one command with all."""
COMMANDS = {
    "check": ["check", "{}"],
    "import": ["import", "{}", "-o", "written.yaml"],
    "export": ["export", "{}", "--format", "mjcf", "-o", "out"],
    "compile": ["compile", "{}", "--engine", "mujoco", "--accept", "all"],
    "verify": ["verify", "{}", "--engine", "mujoco"],
    "run": ["run", "{}", "--engine", "mujoco", "--accept", "all"],
    "diff": ["diff", "{}", "{}"],
    "explain": ["explain", "{}", "--engine", "mujoco", "--with", "physics.timestep=2ms", "--accept", "all"],
    "accept": ["accept", "{}", "--engine", "mujoco"],
    "sweep": ["sweep", "{}", "--engine", "mujoco"],
}


@pytest.fixture
def project(tmp_path, monkeypatch):
    folder, outside = tmp_path / "project", tmp_path / "outside"
    (folder / ".git").mkdir(parents=True)
    outside.mkdir()
    for end in (".stl", ".yaml", ".usda", ".xacro"):
        (outside / f"secret{end}").write_text("hidden: word")
    (folder / "lies.stl").write_bytes(bytes(80) + struct.pack("<I", 10_000_000) + bytes(150))
    for name, text in FILES.items():
        (folder / name).write_text(text)
    monkeypatch.chdir(folder)
    return folder


def everything(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("check", name) for name in FILES),
        *((command, name) for command in COMMANDS if command != "check" for name in CHEAP),
    ],
)
def test_it_is_refused_with_its_place_and_nothing_is_written(command, name, project, capsys):
    before = everything(project)
    assert cli.main([word.format(name) for word in COMMANDS[command]]) == 2
    captured = capsys.readouterr()
    assert f"{name}:" in captured.err, captured.err
    assert "hidden" not in captured.err + captured.out
    assert not captured.out
    assert everything(project) == before


@pytest.mark.parametrize(
    ("said", "message"), [("repair: [unheard-of]", "no rule of repair"), ("arguments: {a: b}", "no argument is called")]
)
def test_wrong_import_options_in_a_scenario_are_located(said, message, project, capsys):
    link = f'<link name="a">{MASS}</link>'
    (project / "good.xacro").write_text(XACRO.format(link))
    text = f"simspec: 1\nname: cell\nmodels:\n  r:\n    use: good.xacro\n    import: {{{said}}}\n"
    (project / "cell.yaml").write_text(text)
    assert cli.main(["check", "cell.yaml"]) == 2
    error = capsys.readouterr().err
    assert "cell.yaml:6:" in error
    assert message in error
