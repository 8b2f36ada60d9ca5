"""Models that an `<include>` names: by a folder, a bare name, `model://`, or known without files; old forms of SDF."""

from __future__ import annotations

import os

import pytest

from simspec.errors import SpecError
from simspec.imports.files import ENVIRONMENT
from simspec.imports.sdf.models import GROUND_FRICTION, SUN_NOTE
from simspec.language.load import load
from tests.imports.sdf.texts import imported, joint, link, lost, model, sdf

BOX = "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision>"
LIGHT = '<light name="sun" type="directional"/>'


@pytest.fixture(autouse=True)
def no_environment(monkeypatch):
    for variable, _ in ENVIRONMENT:
        monkeypatch.delenv(variable, raising=False)


def database(folder, name="x500", text=None, configuration="model.config"):
    """A model in a folder of models."""
    home = folder / name
    home.mkdir(parents=True)
    (home / configuration).write_text('<model><name>n</name><sdf version="1.9">model.sdf</sdf></model>')
    (home / "model.sdf").write_text(text or model(link("base", BOX)))
    return home


def world(*includes, more=""):
    return sdf(f"<world name='w'>{''.join(f'<include>{include}</include>' for include in includes)}{more}</world>")


def bodies(result):
    return {**result.data.get("bodies", {}), **result.data.get("models", {})}


def refused(text, folder, **options):
    with pytest.raises(SpecError) as error:
        imported(text, folder, **options)
    return "\n".join(map(str, error.value.problems))


# --- where models are ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("uri", ["x500", "x500/", "./x500", "model://x500", "model://x500/model.sdf", "x500/model.sdf"])
@pytest.mark.parametrize("place", ["beside", "above", "option", *(variable for variable, _ in ENVIRONMENT)])
def test_a_model_by_its_name(tmp_path, monkeypatch, uri, place):
    project = tmp_path / "project"
    (project / "worlds").mkdir(parents=True)
    homes = {"beside": project / "worlds", "above": project}
    database(homes.get(place, tmp_path / "models" / dict(ENVIRONMENT).get(place, "")))
    options = {"package_path": (str(tmp_path / "models"),)} if place == "option" else {}
    if place not in (*homes, "option"):
        monkeypatch.setenv(place, str(tmp_path / "models"))
    result = imported(world(f"<uri>{uri}</uri>"), project / "worlds", project=project, **options)
    assert bodies(result)["robot_base" if "robot_base" in bodies(result) else "robot"]
    assert not lost(result)


def test_a_model_within_models_is_found_as_the_first_is(tmp_path):
    """As drones are: each model includes one with more in it, by its bare name."""
    database(tmp_path / "models", "x500", model("<include merge='true'><uri>x500_base</uri></include>" + link("motor")))
    database(tmp_path / "models", "x500_base", model(link("base", BOX)))
    result = imported(world("<uri>x500</uri>"), tmp_path)
    assert {"robot_base", "robot_motor"} == result.data["bodies"].keys()


def test_a_file_that_is_an_include_alone(tmp_path):
    database(tmp_path, "inner", model(link("base", BOX)))
    database(tmp_path, "outer", sdf("<include><uri>inner</uri><name>renamed</name></include>"))
    alone = imported(sdf("<include><uri>outer</uri></include>"), tmp_path).data
    assert (alone["name"], alone["model"]["bodies"].keys()) == ("renamed", {"base"})
    placed = imported(world("<uri>outer</uri><pose>1 2 3 0 0 0</pose>"), tmp_path).data["models"]["renamed"]
    assert placed["bodies"]["base"]["pose"] == {"xyz": [1, 2, 3]}
    (tmp_path / "inner/model.sdf").write_text(sdf("<include><uri>outer</uri></include>"))
    assert "include each other" in refused(sdf("<include><uri>outer</uri></include>"), tmp_path)
    assert "has no model" in refused(sdf("<include><uri>model://sun</uri></include>"), tmp_path)


def test_old_names_of_configurations(tmp_path):
    database(tmp_path, "old", configuration="manifest.xml")
    assert bodies(imported(world("<uri>model://old</uri>"), tmp_path))


def test_the_configuration_chooses_the_newest_file_that_is_read(tmp_path):
    home = database(tmp_path)
    (home / "model.config").write_text(
        '<model><sdf version="1.4">a.sdf</sdf><sdf version="1.10">b.sdf</sdf><sdf version="9.9">c.sdf</sdf></model>'
    )
    (home / "b.sdf").write_text(model(link("right")))
    assert "robot" in bodies(imported(world("<uri>x500</uri>"), tmp_path))
    (home / "model.config").write_text('<model><sdf version="9.9">c.sdf</sdf></model>')
    assert "model.config:1:1: names no SDF file" in refused(world("<uri>x500</uri>"), tmp_path)


@pytest.mark.parametrize(
    ("uri", "said"),
    [
        ("https://fuel.gazebosim.org/1.0/OpenRobotics/models/Husky", "--package 'Husky'=FOLDER"),
        ("https://example.org/husky", "nothing from the network"),
        ("model://husky", "--package husky=FOLDER"),
        ("husky", "--package husky=FOLDER"),
        ("models/husky", "no such file"),
        ("husky.urdf", "use: husky.urdf in a scenario"),
        ("model://../husky", "not the name of a package"),
    ],
)
def test_a_model_that_is_not_there(tmp_path, uri, said):
    text = refused(world(f"<uri>{uri}</uri>"), tmp_path)
    assert said in text
    assert text.startswith("robot.sdf:3:1")


def test_a_downloaded_model_is_taken_in_the_place_of_its_address(tmp_path):
    database(tmp_path, "Husky Two")
    address = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Husky%20Two/3"
    assert bodies(imported(world(f"<uri>{address}</uri>"), tmp_path))


# --- models that are known, lights -----------------------------------------------------------------------------------

GROUNDS = ("model://ground_plane", "ground_plane", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane")


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_sun_and_the_ground_are_known_without_files(tmp_path, ground):
    text = world("<uri>model://sun</uri>", f"<uri>{ground}</uri><pose>0 0 -1 0 0 0</pose>", more=model_in("box"))
    result = imported(text, tmp_path)
    assert {severity for severity, _ in lost(result).values()} == {"appearance"}
    spec = load(tmp_path / "robot.sdf")
    resolved = spec.resolve()
    (plane,) = [body for body in resolved.bodies if body.name == "ground_plane"]
    assert [shape.kind for shape in plane.shapes] == ["plane"]
    assert plane.joint.origin.position == (0, 0, -1)
    assert plane.joint.kind == "fixed"
    materials = result.data["contact"]["materials"]
    assert materials[plane.shapes[0].material]["friction"] == GROUND_FRICTION
    (note,) = [account for account in result.accounts if "ground_plane is not among the files" in account.reason]
    assert note.location.line == 3
    assert result.comments["bodies.ground_plane"] == note.reason


def model_in(name):
    return f"<model name='{name}'>{link('link', BOX)}</model>"


def test_a_ground_of_the_database_counts(tmp_path):
    ground = "<static>true</static>" + link("link", BOX)
    database(tmp_path, "ground_plane", model(ground))
    database(tmp_path, "sun", sdf(LIGHT))
    result = imported(world("<uri>model://sun</uri>", "<uri>model://ground_plane</uri>", more=model_in("a")), tmp_path)
    assert "box" in bodies(result)["robot"]["shapes"][0]
    assert [reason for severity, reason in lost(result).values() if severity != "information"] == [SUN_NOTE] * 2


def test_a_world_of_lights_alone_has_no_models(tmp_path):
    assert "has no models" in refused(world("<uri>model://sun</uri>"), tmp_path)


def test_parameters_of_an_include_are_lost_and_change_physics(tmp_path):
    database(tmp_path)
    change = "<experimental:params><link element_id='base' action='remove'/></experimental:params>"
    found = lost(imported(world(f"<uri>x500</uri>{change}"), tmp_path))
    assert [severity for what, (severity, _) in found.items() if "experimental" in what] == ["physics"]


def test_an_include_says_name_pose_and_whether_the_model_is_static(tmp_path):
    database(tmp_path)
    say = "<uri>x500</uri><name>second</name><pose>1 2 3 0 0 0</pose><static>true</static>"
    say += "<placement_frame>base</placement_frame>"
    body = imported(world(say), tmp_path).data["models"]["second"]["bodies"]["base"]
    assert body["fixed"]
    assert body["pose"] == {"xyz": [1, 2, 3]}


# --- what is only drawn ----------------------------------------------------------------------------------------------

DRAWN = [
    "<geometry><plane><normal>0 0 1</normal><size>1 1</size></plane></geometry>",
    "<geometry><mesh><uri>none.dae</uri></mesh></geometry>",
    "<geometry><mesh><uri>https://example.org/a.dae</uri></mesh></geometry>",
    "<geometry><mesh/></geometry>",
    "<geometry><polyline><point>0 0</point></polyline></geometry>",
    "<geometry><heightmap/></geometry>",
    "<geometry><teapot/></geometry>",
    "<geometry><box><size>1 1</size></box></geometry>",
    "<geometry/>",
    "",
    "<pose relative_to='x'>0 0 0 0 0 0</pose><geometry><box/></geometry>",
    "<geometry><box/></geometry><material><diffuse>red</diffuse></material>",
]


@pytest.mark.parametrize("content", DRAWN)
def test_drawings_stand_in_no_way(tmp_path, content):
    result = imported(model(link("base", BOX + f"<visual name='v'>{content}</visual>")), tmp_path)
    assert len(result.data["model"]["bodies"]["base"]["shapes"]) == 1
    assert {severity for severity, _ in lost(result).values()} == {"appearance"}
    load(tmp_path / "robot.sdf").resolve()


def test_a_drawn_plane_of_a_fixed_link_stays(tmp_path):
    plane = f"<visual name='v'>{DRAWN[0]}</visual>"
    result = imported(model("<static>true</static>" + link("base", plane)), tmp_path)
    assert "plane" in result.data["model"]["bodies"]["base"]["shapes"][0]


# --- versions --------------------------------------------------------------------------------------------------------

FLAT = (
    link("base")
    + link("hand::palm")
    + link("hand::finger")
    + joint("fixed", name="hand::wrist", parent="base", child="hand::palm")
    + joint("revolute", "<axis><xyz>0 0 1</xyz></axis>", "hand::knuckle", "hand::palm", "hand::finger")
)


@pytest.mark.parametrize("version", ["1.3", "1.4", "1.5", "1.6", "1.7"])
def test_models_within_others_that_are_written_flat(tmp_path, version):
    frame = '<frame name="hand::__model__" attached_to="hand::palm"><pose relative_to="hand::palm"/></frame>'
    result = imported(model(FLAT + (frame if version == "1.7" else ""), version), tmp_path)
    assert result.data["model"]["bodies"].keys() == {"base", "hand_palm", "hand_finger"}
    finger = result.data["model"]["bodies"]["hand_finger"]
    assert (finger["parent"], finger["joint"]["name"]) == ("hand_palm", "hand_knuckle")


POSED = {
    "base": "<pose>0.1 0.2 0.3 0.4 0.5 0.6</pose>",
    "palm": "<pose>1 0 0 0 0.3 0</pose>",
    "finger": "<pose>1 0.5 0 0.2 0 0</pose>",
}
KNUCKLE = "<axis><xyz>0 0.6 0.8</xyz></axis>"


@pytest.mark.parametrize("version", ["1.5", "1.6", "1.7"])
def test_flat_and_nested_are_the_same_model(tmp_path, version):
    palm, finger = link("palm", POSED["palm"]), link("finger", POSED["finger"])
    inner = f"<model name='hand'>{palm}{finger}{joint('revolute', KNUCKLE, 'knuckle', 'palm', 'finger')}</model>"
    wrist = joint("revolute", KNUCKLE, "wrist", "base", "hand::palm")
    nested = model(link("base", POSED["base"]) + inner + wrist, version)
    flat = link("base", POSED["base"]) + link("hand::palm", POSED["palm"]) + link("hand::finger", POSED["finger"])
    flat += joint("revolute", KNUCKLE, "hand::knuckle", "hand::palm", "hand::finger") + wrist
    assert imported(model(flat, version), tmp_path).data == imported(nested, tmp_path).data


def test_since_names_are_reserved_flat_names_are_refused(tmp_path):
    assert "not a name of a <link>" in refused(model(FLAT, "1.8"), tmp_path)


def test_flat_names_and_models_within_models_together(tmp_path):
    database(tmp_path, "hand", model(link("palm") + link("inner::tip"), "1.6"))
    arm = "<include><name>hand</name><uri>hand</uri></include>" + link("base")
    joints = joint("fixed", parent="base", child="hand::palm") + joint(
        "fixed", name="j", parent="hand::palm", child="hand::inner::tip"
    )
    result = imported(model(arm + joints, "1.6"), tmp_path)
    assert result.data["model"]["bodies"].keys() == {"base", "hand_palm", "hand_inner_tip"}


def test_a_long_chain_of_flat_frames_is_read_without_recursion(tmp_path):
    frames = "".join(
        f'<frame name="a::f{i}" attached_to="a::f{i - 1}"><pose relative_to="a::f{i - 1}"/></frame>'
        for i in range(1, 3000)
    )
    text = model(link("base") + '<frame name="a::f0" attached_to="base"/>' + frames, "1.7")
    assert len(imported(text, tmp_path).data["model"]["frames"]) == 3000


OLD = """<gazebo version="1.0"><world name="default"><physics type="ode" update_rate="1000"><gravity xyz="0 0 -9.7"/>
<ode><solver type="quick" dt="0.002" iters="50" sor="1.3"/></ode></physics>
<model name="arm" static="false"><origin pose="0 0 1 0 0 0"/>
<link name="base" gravity="false" self_collide="true"><origin pose="0 0 0.5 0 0 0"/>
<inertial mass="2"><origin pose="0 0 0.1 0 0 0"/><inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/></inertial>
<collision name="c" laser_retro="0"><origin pose="0.1 0 0 0 0 0"/><geometry><box size="1 2 3"/></geometry>
<surface><friction><ode mu="0.5" mu2="0.5"/></friction></surface></collision>
<visual name="v" cast_shadows="true"><geometry><mesh filename="m.obj" scale="1 2 1"/></geometry>
<material script="Gazebo/Grey"><diffuse rgba="1 0 0 1"/></material></visual></link>
<link name="tip"><origin pose="0 0 1.5 0 0 0"/><inertial mass="1"><inertia ixx="1" iyy="1" izz="1"/></inertial>
<damping><linear>0</linear><angular>0</angular></damping></link>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 1 0"><dynamics damping="0.3"/>
<limit lower="-1" upper="2" effort="5" velocity="3"/></axis></joint></model></world></gazebo>"""
NEW = """<sdf version="1.4"><world name="default"><physics type="ode"><gravity>0 0 -9.7</gravity>
<max_step_size>0.002</max_step_size></physics>
<model name="arm"><pose>0 0 1 0 0 0</pose>
<link name="base"><gravity>false</gravity><self_collide>true</self_collide><pose>0 0 0.5 0 0 0</pose>
<inertial><mass>2</mass><pose>0 0 0.1 0 0 0</pose><inertia><ixx>1</ixx><iyy>2</iyy><izz>2.5</izz></inertia></inertial>
<collision name="c"><pose>0.1 0 0 0 0 0</pose><geometry><box><size>1 2 3</size></box></geometry>
<surface><friction><ode><mu>0.5</mu><mu2>0.5</mu2></ode></friction></surface></collision>
<visual name="v"><geometry><mesh><uri>m.obj</uri><scale>1 2 1</scale></mesh></geometry>
<material><diffuse>1 0 0 1</diffuse></material></visual></link>
<link name="tip"><pose>0 0 1.5 0 0 0</pose><inertial><mass>1</mass><inertia/></inertial></link>
<joint name="j" type="revolute"><parent>base</parent><child>tip</child><axis><xyz>0 1 0</xyz>
<dynamics><damping>0.3</damping></dynamics>
<limit><lower>-1</lower><upper>2</upper><effort>5</effort><velocity>3</velocity></limit></axis></joint></model></world></sdf>"""


def test_the_oldest_form_has_the_meaning_of_the_newer_form(tmp_path):
    old, new = imported(OLD, tmp_path, "old.world"), imported(NEW, tmp_path, "new.world")
    assert old.data == {**new.data, "name": old.data["name"]}
    assert old.data["physics"] == {"gravity": [0, 0, -9.7], "timestep": 0.002}
    assert not [what for what, (severity, _) in lost(old).items() if severity == "physics"]
    tree = next(iter(old.data["models"].values()))["bodies"]
    assert tree["tip"]["joint"]["limits"] == {"position": [-1, 2], "velocity": 3, "effort": 5}


@pytest.mark.parametrize(("outermost", "version"), [("gazebo", "1.2"), ("sdf", "1.2"), ("sdf", "1.3")])
def test_versions_between_have_the_step_of_the_solver(tmp_path, outermost, version):
    physics = "<physics type='bullet'><bullet><dt>0.004</dt></bullet></physics>"
    text = f"<{outermost} version='{version}'><world name='w'>{physics}{model_in('a')}</world></{outermost}>"
    assert imported(text, tmp_path).data["physics"]["timestep"] == 0.004


def test_versions_that_there_are_not(tmp_path):
    for version in ("0.9", "1.13", "2.0", "\u0661.\u0664", "one"):
        assert "this version of SDF is not read" in refused(model(link("a"), version), tmp_path)
    text = f"<gazebo version='1.3'>{model_in('a')}</gazebo>"
    assert "the outermost element is <gazebo>" in refused(text, tmp_path)


def test_a_world_under_the_name_of_plain_xml(tmp_path):
    assert "bodies" in imported(world(more=model_in("a")), tmp_path, "w.xml").data


def test_paths_of_the_environment_are_what_the_user_may_read(tmp_path, monkeypatch):
    database(tmp_path / "models")
    project = tmp_path / "project"
    project.mkdir()
    text = world(f"<uri>{os.path.relpath(tmp_path / 'models/x500', project)}</uri>")
    assert "leaves the project folder" in refused(text, project, project=project)
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(tmp_path / "models"))
    assert bodies(imported(text, project, project=project))


# --- extruded polygons -----------------------------------------------------------------------------------------------


def polyline(*points, height=2.0, tag="collision"):
    said = "".join(f"<point>{x} {y}</point>" for x, y in points)
    geometry = f"<geometry><polyline>{said}<height>{height}</height></polyline></geometry>"
    return f"<{tag} name='p'>{geometry}</{tag}>"


TRIANGLE = ((0, 0), (3, 0), (0, 6))


@pytest.mark.parametrize(
    "points", [TRIANGLE, TRIANGLE[::-1], (*TRIANGLE, (0, 0)), ((0, 0), (1, 0), (3, 0), (0, 6), (0, 3))]
)
def test_a_convex_polygon_is_its_solid(tmp_path, points):
    inertial = "<inertial auto='true'><density>10</density></inertial>"
    result = imported(model(link("base", polyline(*points), inertial), "1.11"), tmp_path)
    (body,) = load(tmp_path / "robot.sdf").resolve().bodies
    assert body.inertial.mass == pytest.approx(10 * 9 * 2)
    assert body.inertial.centre_of_mass == pytest.approx((1, 2, 1))
    assert result.made == result.files.keys()
    assert not lost(result)


NOT_CONVEX = {
    "a notch": ((0, 0), (4, 0), (1, 1), (0, 4)),
    "a star": ((0, 3), (2, -3), (-3, 1), (3, 1), (-2, -3)),
    "a bow": ((0, 0), (1, 1), (1, 0), (0, 1)),
    "a line": ((0, 0), (1, 1), (2, 2)),
    "a spike": ((0, 0), (2, 0), (1, 0), (1, 1)),
}


@pytest.mark.parametrize("name", NOT_CONVEX)
def test_other_polygons_are_refused_where_they_collide(tmp_path, name):
    assert "not convex" in refused(model(link("base", polyline(*NOT_CONVEX[name]))), tmp_path)
    drawn = imported(model(link("base", polyline(*NOT_CONVEX[name], tag="visual"))), tmp_path)
    assert {severity for severity, _ in lost(drawn).values()} == {"appearance"}


def test_polygons_without_volume_are_refused(tmp_path):
    for shape in (
        polyline(),
        polyline((0, 0), (1, 0)),
        polyline(*TRIANGLE, height=0),
        polyline(*TRIANGLE, height="nan"),
    ):
        assert "robot.sdf:4" in refused(model(link("base", shape)), tmp_path)
