"""The words of SDF in the spec, and the reports of words that are lost."""

from __future__ import annotations

import math

import pytest

from simspec.errors import SpecError
from simspec.language.foreign import Fate, ImportOptions, LossSeverity
from simspec.language.load import load
from simspec.language.moments import principal_moments
from simspec.world.kinematics import trees
from tests.imports.sdf.texts import imported, joint, link, lost, model, sdf

PAIR = link("base") + link("arm")
SLIPPERY = (
    "<collision name='c'><geometry><sphere/></geometry><surface><friction><ode><mu>inf</mu></ode></friction></surface>"
)
SLIPPERY += "</collision>"
MESH = "<collision name='c'><geometry><mesh>{}</mesh></geometry></collision>"
PLANE = "<collision name='c'><geometry><plane><normal>1e308 0 1</normal></plane></geometry></collision>"
BALL = "<collision name='c'><geometry><sphere/></geometry></collision>"
CIRCLE = "<frame name='f'><pose relative_to='g'/></frame><frame name='g'><pose relative_to='f'/></frame>"


def bodies(text, folder, **options):
    return imported(text, folder, **options).data["model"]["bodies"]


def refused(text, folder, **options):
    with pytest.raises(SpecError) as error:
        imported(text, folder, **options)
    return "\n".join(map(str, error.value.problems))


@pytest.mark.parametrize(
    ("kind", "word"),
    [("revolute", "hinge"), ("continuous", "hinge"), ("prismatic", "slide"), ("ball", "ball"), ("fixed", "fixed")],
)
def test_joints_that_the_language_has(kind, word, tmp_path):
    joined = bodies(model(PAIR + joint(kind)), tmp_path)["arm"]["joint"]
    assert joined["type"] == word
    assert joined["name"] == "elbow"
    assert joined.get("axis") == ([0.0, 0.0, 1.0] if word in ("hinge", "slide") else None)
    load(tmp_path / "robot.sdf").resolve()


@pytest.mark.parametrize("kind", ["screw", "planar", "hinge"])
def test_joints_that_it_does_not_have_are_refused_by_name_and_line(kind, tmp_path):
    said = refused(model(PAIR + "\n" + joint(kind)), tmp_path)
    assert said.startswith("robot.sdf:5:")
    assert kind in said


def test_limits_and_efforts(tmp_path):
    content = (
        "<axis><xyz>0 2 0</xyz><limit><lower>-1</lower><upper>2</upper><effort>30</effort><velocity>-1</velocity></limit>"
        "<dynamics><damping>0.5</damping><friction>0.1</friction><spring_stiffness>3</spring_stiffness>"
        "<spring_reference>0.2</spring_reference></dynamics></axis>"
    )
    data = bodies(model(PAIR + joint("revolute", content)), tmp_path)["arm"]["joint"]
    assert data["limits"] == {"position": [-1.0, 2.0], "effort": 30.0}
    assert (data["damping"], data["dry_friction"], data["spring"]) == (0.5, 0.1, {"stiffness": 3.0, "rest": 0.2})


@pytest.mark.parametrize(
    "bounds", ["<lower>-1e16</lower><upper>1e16</upper>", "<lower>-inf</lower><upper>inf</upper>", ""]
)
def test_limits_that_are_none(bounds, tmp_path):
    data = bodies(model(PAIR + joint("revolute", f"<axis><limit>{bounds}</limit></axis>")), tmp_path)
    assert "limits" not in data["arm"]["joint"]


def test_a_limit_on_a_single_side_is_refused(tmp_path):
    text = model(PAIR + joint("revolute", "<axis><limit><lower>0</lower></limit></axis>"))
    assert "one limit" in refused(text, tmp_path)


def test_the_armature_is_the_rotor_behind_its_gear(tmp_path):
    space = 'xmlns:x="http://drake.mit.edu"'
    rotor = f"<x:rotor_inertia {space}>0.5</x:rotor_inertia><x:gear_ratio {space}>3</x:gear_ratio><axis/>"
    assert bodies(model(PAIR + joint("revolute", rotor)), tmp_path)["arm"]["joint"]["armature"] == 4.5


def test_a_missing_inertial_is_a_kilogram_and_says_so(tmp_path):
    result = imported(model(link("base", inertial="")), tmp_path)
    assert result.data["model"]["bodies"]["base"]["mass"] == 1.0
    assert result.data["model"]["bodies"]["base"]["inertia"] == {"principal": [1.0, 1.0, 1.0]}
    assert "SDF then means 1 kg" in result.comments["model.bodies.base.mass"]


def test_a_missing_inertial_is_at_the_links_origin_where_the_body_is_elsewhere(tmp_path):
    text = model(link("base") + link("arm", inertial="") + joint("revolute", "<pose>0 0 1 0 0 0</pose>"))
    assert bodies(text, tmp_path)["arm"]["centre_of_mass"] == [0.0, 0.0, -1.0]


def test_an_inertia_that_is_computed_is_that_of_the_densities(tmp_path):
    shape = "<collision name='c'><density>500</density><geometry><box><size>1 2 3</size></box></geometry></collision>"
    shape += "<collision name='d'><pose>5 0 0 0 0 0</pose><geometry><sphere/></geometry></collision>"
    data = bodies(model(link("base", shape, '<inertial auto="true"/>'), "1.11"), tmp_path)["base"]
    assert [shape["density"] for shape in data["shapes"]] == [500.0, 1000.0]
    world = load(tmp_path / "robot.sdf").resolve()
    assert world.bodies[0].inertial.mass == pytest.approx(3000.0 + 4000.0 / 3.0 * math.pi)


def test_links_of_a_model_do_not_touch_unless_they_say_so(tmp_path):
    ball = "<collision name='c'><geometry><sphere/></geometry></collision>"
    three = link("a", ball) + link("b", ball) + link("c", ball)
    three += joint("revolute", name="j", parent="a", child="b") + joint("revolute", name="k", parent="b", child="c")
    assert imported(model(three), tmp_path).data["contact"]["exclude"] == [["a", "c"]]
    assert "exclude" not in imported(model(three + "<self_collide>1</self_collide>"), tmp_path).data["contact"]
    local = three.replace('<link name="c">', '<link name="c"><self_collide>true</self_collide>')
    assert "exclude" not in imported(model(local), tmp_path).data["contact"]


def test_in_a_world_links_of_a_model_are_a_group(tmp_path):
    ball = "<collision name='c'><geometry><sphere/></geometry></collision>"
    three = link("a", ball) + link("b", ball) + link("c", ball)
    three += joint("fixed", name="j", parent="a", child="b") + joint("revolute", name="k", parent="b", child="c")
    text = sdf(f"<world name='w'><model name='m'>{three}</model><model name='n'>{three}</model></world>")
    data = imported(text, tmp_path).data
    assert data["contact"]["groups"] == {"m": {"ignores": ["m"]}, "n": {"ignores": ["n"]}}
    assert data["models"]["m"]["bodies"]["c"]["collision_group"] == "m"
    load(tmp_path / "robot.sdf").resolve()


def test_a_collision_and_a_visual_of_the_same_place_are_the_same_shape(tmp_path):
    geometry = "<pose>1 0 0 0 0 0</pose><geometry><box><size>1 2 3</size></box></geometry>"
    colour = "<material><diffuse>1 0 0 1</diffuse><ambient>1 1 1 1</ambient></material>"
    other = "<visual name='w'><geometry><sphere><radius>2</radius></sphere></geometry></visual>"
    text = model(
        link("base", f"<visual name='v'>{geometry}{colour}</visual>{other}<collision name='c'>{geometry}</collision>")
    )
    first, second = bodies(text, tmp_path)["base"]["shapes"]
    assert first == {
        "box": {"size": [1.0, 2.0, 3.0]},
        "pose": {"xyz": [1.0, 0.0, 0.0]},
        "colour": [1.0, 0.0, 0.0, 1.0],
        "name": "c",
    }
    assert second["collision"] is False
    assert "ambient" in str(lost(imported(text, tmp_path)))


@pytest.mark.parametrize(
    ("normal", "up"), [("0 0 1", (0, 0, 1)), ("0 0 -2", (0, 0, -1)), ("1 0 0", (1, 0, 0)), ("1 2 -3", (1, 2, -3))]
)
def test_a_plane_looks_along_its_normal(normal, up, tmp_path):
    from simspec.world import frames

    shape = f"<collision name='c'><geometry><plane><normal>{normal}</normal></plane></geometry></collision>"
    imported(model(link("base", shape) + "<static>1</static>"), tmp_path)
    pose = load(tmp_path / "robot.sdf").resolve().bodies[0].shapes[0].pose
    length = math.hypot(*up)
    assert frames.rotate(pose.quaternion, (0.0, 0.0, 1.0)) == pytest.approx([value / length for value in up], abs=1e-15)


def test_surfaces_are_materials(tmp_path):
    def ball(surface):
        return f"<collision name='c'><geometry><sphere/></geometry><surface>{surface}</surface></collision>"

    entry = "<friction><ode><mu>0.5</mu><mu2>0.5</mu2></ode></friction>"
    two = "<bounce><restitution_coefficient>0.4</restitution_coefficient><threshold>0.1</threshold></bounce>"
    text = model(link("a", ball(entry)) + link("b", ball(two)) + joint("fixed", parent="a", child="b"))
    assert imported(text, tmp_path).data["contact"]["materials"] == {
        "surface-1": {"friction": 0.5},
        "surface-2": {"friction": 1.0, "restitution": 0.4, "restitution_threshold": 0.1},
    }
    uneven = "<friction><ode><mu>0.5</mu><mu2>0.7</mu2></ode></friction><contact><ode><kp>1</kp></ode></contact>"
    losses = lost(imported(model(link("a", ball(uneven))), tmp_path))
    assert {name.rpartition("/")[2]: severity for name, (severity, _) in losses.items()} == {
        "mu2": "physics",
        "ode": "information",
    }


def test_how_hard_contact_is_is_each_solvers_and_who_touches_whom_is_physics(tmp_path):
    def contact(words):
        ball = f"<collision name='c'><geometry><sphere/></geometry><surface><contact>{words}</contact></surface></collision>"
        return {severity for severity, _ in lost(imported(model(link("a", ball)), tmp_path)).values()}

    assert contact("<ode><kp>1e5</kp><max_vel>0.1</max_vel></ode><collide_bitmask>0x01</collide_bitmask>") == {
        "information"
    }
    assert contact("<collide_bitmask>6</collide_bitmask>") == {"physics"}
    assert contact("<collide_without_contact>1</collide_without_contact>") == {"physics"}
    assert contact("<invented>1</invented>") == {"physics"}
    soft = "<axis><limit><lower>0</lower><upper>1</upper><stiffness>1e5</stiffness></limit></axis>"
    soft += "<physics><ode>{}</ode></physics>"
    for words, severity in (("<cfm_damping>1</cfm_damping>", "information"), ("<max_force>3</max_force>", "physics")):
        losses = lost(imported(model(PAIR + joint("revolute", soft.format(words))), tmp_path))
        assert severity in {given for given, _ in losses.values()}
        assert ("physics" in {given for given, _ in losses.values()}) == (severity == "physics")


def test_friction_of_a_link_is_that_of_its_collisions_that_say_none(tmp_path):
    text = "<surface><friction><ode><mu>0.5</mu><mu2>0.5</mu2></ode></friction></surface>"
    ball = "<collision name='{}'><geometry><sphere/></geometry>{}</collision>"
    balls = ball.format("c", "") + ball.format("d", text)
    words = "<contact><lateral_friction value='0.8'/><rolling_friction>0.04</rolling_friction></contact>"
    result = imported(model(link("a", words + balls)), tmp_path)
    assert not lost(result)
    assert result.data["contact"]["materials"] == {
        "surface-1": {"friction": 0.8, "rolling_friction": 0.04},
        "surface-2": {"friction": 0.5},
    }


def test_words_without_effect_are_no_loss(tmp_path):
    plain = "<gravity>true</gravity><enable_wind>0</enable_wind><kinematic>0</kinematic>"
    plain += "<velocity_decay><linear>0.00</linear><angular>0</angular></velocity_decay>"
    contact = "<surface><contact><collide_bitmask>65535</collide_bitmask></contact></surface>"
    plain += f"<collision name='c'><geometry><sphere/></geometry>{contact}</collision>"
    assert not lost(imported(model(link("base", plain)), tmp_path))
    text = "<velocity_decay><linear>0.1</linear></velocity_decay><invented/>"
    losses = lost(imported(model(link("base", text)), tmp_path))
    assert {name.rpartition("/")[2] for name in losses} == {"velocity_decay", "invented"}


def test_a_link_without_gravity_has_no_weight(tmp_path):
    result = imported(model(link("base", "<gravity>0</gravity>")), tmp_path)
    assert not lost(result)
    assert result.data["model"]["bodies"]["base"]["gravity_scale"] == 0.0


def test_everything_of_a_file_is_accounted_for(tmp_path):
    text = model(
        link("base", '<sensor name="s" type="camera"><camera/></sensor><light name="l" type="spot"/>')
        + '<plugin name="p" filename="q"/>'
    )
    losses = lost(imported(text, tmp_path))
    assert losses["model[robot]/plugin[p]"][0] == "physics"
    assert losses["model[robot]/link[base]/sensor[s]"][0] == "information"
    assert losses["model[robot]/link[base]/light[l]"][0] == "appearance"


def test_a_world_is_a_scenario(tmp_path):
    ball = "<collision name='c'><geometry><sphere/></geometry></collision>"
    plane = ball.replace("sphere", "plane")
    text = sdf(
        f"""<world name="yard"><gravity>0 0 -1.6</gravity>
        <physics type="ode"><max_step_size>0.002</max_step_size><real_time_factor>1</real_time_factor></physics>
        <light name="sun" type="directional"/>
        <model name="ground"><static>true</static>{link("link", plane)}</model>
        <model name="ball"><pose>0 0 3 0 0 0</pose>{link("link", ball)}</model>
        <model name="arm"><pose>1 0 0 0 0 1</pose>{PAIR}{joint("revolute")}{joint("fixed", "", "hold", "world", "base")}</model>
        <model name="two">{link("a")}{link("b")}</model>
        </world>"""
    )
    data = imported(text, tmp_path).data
    assert data["physics"] == {"gravity": [0.0, 0.0, -1.6], "timestep": 0.002}
    assert data["bodies"]["ground"]["fixed"] is True
    assert data["bodies"]["ball"]["pose"] == {"xyz": [0.0, 0.0, 3.0]}
    assert data["models"]["arm"]["bodies"]["base"]["joint"]["type"] == "fixed"
    assert data["models"]["arm"]["bodies"]["base"]["joint"]["origin"] == {
        "xyz": [1.0, 0.0, 0.0],
        "rpy": [0.0, 0.0, 1.0],
    }
    assert {"two_a", "two_b"} <= data["bodies"].keys()
    world = load(tmp_path / "robot.sdf").resolve()
    assert trees(world).keys() == {"arm/base", "ground", "ball", "two_a", "two_b"}


def test_the_default_gravity_of_a_world_is_that_of_sdf(tmp_path):
    data = imported(sdf(f"<world name='w'><model name='m'>{link('a')}</model></world>"), tmp_path).data
    assert data["physics"] == {"gravity": [0.0, 0.0, -9.8], "timestep": 0.001}


def test_links_of_a_static_model_are_rigid_together(tmp_path):
    text = model(link("a") + link("b") + joint("revolute", parent="a", child="b") + "<static>true</static>")
    data = bodies(text, tmp_path)
    assert data["a"]["fixed"] is True
    assert data["b"]["joint"]["type"] == "fixed"


def test_a_root_without_mass_is_a_defect_with_a_rule(tmp_path):
    text = model(
        link(
            "base",
            inertial="<inertial><mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>",
        )
    )
    assert "--repair massless" in refused(text, tmp_path)
    result = imported(text, tmp_path, repair=("massless",))
    assert result.data["model"]["bodies"]["base"]["fixed"] is True
    (repair,) = result.repairs
    assert (repair.rule, repair.path) == ("massless", "model.bodies.base.fixed")
    assert "no rule of repair" in refused(text, tmp_path, repair=("other",))


FLAT = "<inertial>{}<mass>2</mass><inertia><ixx>1</ixx><iyy>2</iyy><izz>4</izz><ixy>{}</ixy></inertia></inertial>"


@pytest.mark.parametrize(("turn", "product"), [("", 0), ("<pose>0 0 0 0.3 0.5 0.7</pose>", 0), ("", 0.25)])
def test_a_tensor_that_no_body_has_is_a_defect_with_a_rule(turn, product, tmp_path):
    text = model(link("base", inertial=FLAT.format(turn, product)))
    assert "triangle inequality" in refused(text, tmp_path)
    assert "--repair triangle-inequality" in refused(text, tmp_path)
    result = imported(text, tmp_path, repair=("triangle-inequality",))
    (repair,) = result.repairs
    assert (repair.rule, repair.path) == ("triangle-inequality", "model.bodies.base.inertia")
    assert repair.location.line == 4
    (body,) = load(tmp_path / "robot.sdf", options=ImportOptions(repair=("triangle-inequality",))).resolve().bodies
    low, middle, high = sorted(principal_moments(body.inertial.inertia))
    assert high == pytest.approx(low + middle)
    # the same axes and the same sum but for what all share: 4 > 1 + 2 by 1
    assert (low + middle + high) == pytest.approx(7 + 1 / 3)
    alright = text.replace("<izz>4</izz>", "<izz>2.5</izz>")
    assert not imported(alright, tmp_path, repair=("triangle-inequality",)).repairs


def test_an_empty_link_called_world_is_the_world_in_old_files(tmp_path):
    text = link("base") + joint("prismatic", name="lift", parent="world", child="base")
    old = bodies(model('<link name="world"></link>' + text, "1.6"), tmp_path)
    assert old.keys() == {"base"}
    assert old["base"]["joint"]["type"] == "slide"
    local = bodies(model(link("world") + text, "1.6"), tmp_path)
    assert local.keys() == {"world_2", "base"}
    assert local["base"]["parent"] == "world_2"
    assert "not a name" in refused(model(link("world") + text, "1.7"), tmp_path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            PAIR
            + joint("revolute")
            + joint("revolute", name="k", parent="world")
            + joint("ball", name="l", parent="world"),
            "a joint to the world",
        ),
        (PAIR + joint("prismatic") + joint("prismatic", name="k"), "closed by a joint of the type prismatic"),
        (PAIR + joint("fixed", child="world"), "the child of a joint is a link"),
        (PAIR + joint("fixed", child="leg"), "nothing is called 'leg'"),
        (PAIR + joint("fixed", parent="robot::base"), "no model is called 'robot'"),
        (PAIR + link("arm"), "the name of two things"),
        (PAIR + "<frame name='f' attached_to='g'/><frame name='g' attached_to='f'/>", "attached to each other"),
        (
            "<frame name='f'><pose relative_to='g'/></frame><frame name='g'><pose relative_to='f'/></frame>" + PAIR,
            "relative to each other",
        ),
        (PAIR + joint("revolute", "<axis><xyz>0 0 0</xyz></axis>"), "no length"),
        (PAIR + joint("revolute", "<axis><xyz>0 0 nan</xyz></axis>"), "3 finite numbers"),
        (PAIR + joint("revolute", "<axis><limit><lower>inf</lower><upper>1</upper></limit></axis>"), "nothing reaches"),
        (
            PAIR + joint("revolute", "<axis><limit><lower>0</lower><upper>-inf</upper></limit></axis>"),
            "nothing reaches",
        ),
        (link("a", SLIPPERY), "<mu> should be finite"),
        (PAIR + joint("revolute", "<axis><mimic joint='x'/></axis>"), "nothing is called 'x'"),
        (PAIR + joint("revolute", "<axis><mimic joint='arm'/></axis>"), "not a joint"),
        (PAIR + joint("revolute", "<axis><mimic joint='elbow' axis='z'/></axis>"), "not an axis"),
        (link("a", "<pose>1 2 3</pose>"), "6 finite numbers"),
        (link("a", PLANE), "beyond the largest double"),  # found by fuzzing
        (
            link("a", f"<pose>1e308 1e308 0 0 0 0</pose>{BALL}")
            + link("b", "<pose relative_to='a'>1e308 1e308 0 0 0 1</pose>"),
            "beyond",
        ),
        (link("a", "<pose rotation_format='quat_xyzw'>0 0 0 1 1 1 1</pose>"), "not a unit quaternion"),
        (link("a", "<pose degrees='maybe'>0 0 0 0 0 0</pose>"), "not a flag"),
        (link("a", "<collision name='c'><geometry><torus/></geometry></collision>"), "not a shape of SDF"),
        (link("a", "<collision name='c'><geometry><cone/></geometry></collision>"), "no cones"),
        (link("a", "<collision name='c'/>"), "no <geometry>"),
        ("<link name='a::b'/>", "not a name"),
        ("<include><uri>https://x/y</uri></include>", "nothing from the network"),
        ("<include><uri>../../etc/model.sdf</uri></include>", "leaves the project folder"),
        ("<include merge='true'><uri>x.sdf</uri></include>", "no such file"),
        (link("a", "<collision name='c'><geometry><mesh/></geometry></collision>"), "no <uri>"),
        (link("a", MESH.format("<uri>x.stl</uri>")), "no such file"),
        (link("a", MESH.format("<uri>../x.stl</uri>")), "leaves the project folder"),
        (link("a", MESH.format("<uri>x.step</uri>")), "not a file of triangles"),
        (link("a", MESH.format("<uri>x.stl</uri><submesh><name>s</name></submesh>")), "a part of a file"),
    ],
)
def test_obstacles_are_reported_by_line(content, said, tmp_path):
    text = refused(model(content), tmp_path)
    assert said in text
    assert text.startswith("robot.sdf:")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot/>", "the outermost element"),
        ("<sdf/>", "no attribute 'version'"),
        ('<sdf version="1.13"><model name="a"/></sdf>', "version of SDF is not read"),
        ('<sdf version="9.9"><model name="a"/></sdf>', "version of SDF is not read"),
        ('<sdf version="1.9"/>', "no model and no world"),
        ('<sdf version="1.9"><model name="a"/></sdf>', "no link"),
        ('<sdf version="1.9"><world name="a"/></sdf>', "no models"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><sdf version="1.9"><model name="a"/></sdf>', "DOCTYPE"),
        ('<sdf version="1.9"><model', "not XML"),
    ],
)
def test_files_that_are_no_model(text, said, tmp_path):
    assert said in refused(text, tmp_path)


def test_includes_are_copies_that_have_poses_and_names(tmp_path):
    folder = tmp_path / "wheel"
    folder.mkdir()
    (folder / "model.config").write_text(
        "<model><sdf version='1.5'>old.sdf</sdf><sdf version='1.7'>new.sdf</sdf><sdf version='9.0'>later.sdf</sdf></model>"
    )
    (folder / "new.sdf").write_text(model(link("rim"), "1.7").replace('"robot"', '"wheel"'))
    include = "<include><uri>model://wheel</uri><name>{0}</name><pose>{1} 0 0 0 0 0</pose></include>"
    joints = "".join(
        joint("revolute", name=f"j{side}", parent="base", child=f"{side}::rim") for side in ("left", "right")
    )
    text = model(link("base") + include.format("left", 1) + include.format("right", -1) + joints)
    data = bodies(text, tmp_path)
    assert data.keys() == {"base", "left_rim", "right_rim"}
    assert data["left_rim"]["joint"]["origin"] == {"xyz": [1.0, 0.0, 0.0]}
    result = imported(text, tmp_path)
    assert {path.name for path in result.read} == {"robot.sdf", "model.config", "new.sdf"}
    names = {account.location.file.rpartition("/")[2] for account in result.accounts}
    assert names == {"robot.sdf", "new.sdf"}


def test_includes_that_never_end_are_refused(tmp_path):
    again = "<include><uri>robot.sdf</uri></include>"
    assert "include each other" in refused(model(link("a") + again), tmp_path)
    for number in range(12):
        inner = f"<include><uri>m{number + 1}.sdf</uri><name>{{}}</name></include>"
        twice = inner.format("x") + inner.format("y")
        (tmp_path / f"m{number}.sdf").write_text(model(twice))
    (tmp_path / "m12.sdf").write_text(model(link("a")))
    assert "more than 1,000 includes" in refused(model("<include><uri>m0.sdf</uri></include>"), tmp_path)


def test_places_are_those_of_the_file(tmp_path):
    result = imported(model(link("base") + "\n" + link("arm") + "\n" + joint("revolute")), tmp_path)
    document = result.document("robot.sdf")
    assert document.locate(("model", "bodies", "arm", "mass")).line == 5
    assert document.locate(("model", "bodies", "arm", "joint", "axis")).line == 6


def test_names_that_the_language_does_not_allow_are_changed_and_reported(tmp_path):
    result = imported(model(link("1 a") + link("b.c") + joint("fixed", parent="1 a", child="b.c")), tmp_path)
    assert result.data["model"]["bodies"].keys() == {"_1_a", "b_c"}
    accounts = [account for account in result.accounts if account.what.endswith("link[1 a]/@name")]
    assert [(account.fate, account.severity) for account in accounts] == [(Fate.CARRIED, LossSeverity.INFORMATION)]
    assert "_1_a" in accounts[0].reason
