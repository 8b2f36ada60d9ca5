"""Attributes and elements of MuJoCo's schema that simspec does not write, with values that have an effect.

A test holds ``ATTRIBUTES`` and ``ELEMENTS`` against the schema that the installed MuJoCo prints: each attribute of an element
that simspec writes, and each element that it does not, stands here or in ``NOT_PLANTED``.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit.mutations import FileAddition

REFERENCE, IMPEDANCE = "0.05 1.5", "0.7 0.8 0.01 0.4 3"

ATTRIBUTES: Mapping[str, Mapping[str, str]] = {
    "compiler": {
        **dict.fromkeys(("assetdir", "meshdir", "texturedir"), "elsewhere"),
        "conflict": "merge",
        "coordinate": "local",
        "eulerseq": "zyx",
        "fitaabb": "true",
        "inertiagrouprange": "0 1",
        "passthrough": "true",
        "savecanonical": "true",
        "savecompiled": "true",
        "saveinertial": "true",
        "strippath": "true",
    },
    "option": {
        "actuatorgroupdisable": "0",
        "o_friction": "0.1 0.1 0 0 0",
        "o_margin": "0.02",
        "o_solimp": IMPEDANCE,
        "o_solref": REFERENCE,
        "sdf_initpoints": "3",
        "sdf_iterations": "3",
        "sleep_tolerance": "0.1",
    },
    "flag": dict.fromkeys(("diagexact", "ipc", "sleep", "speculative"), "enable"),
    "size": {
        **dict.fromkeys(("nconmax", "njmax", "nkey", "nuserdata"), "5"),
        **dict.fromkeys(("nuser_actuator", "nuser_body", "nuser_cam", "nuser_geom"), "1"),
        **dict.fromkeys(("nuser_sensor", "nuser_site", "nuser_tendon"), "1"),
        "memory": "20M",
        "nstack": "200000",
    },
    "default": {"class": "other"},
    "joint": {
        "active": "false",
        "actuatorfrclimited": "true",
        "actuatorfrcrange": "-1 1",
        "actuatorgravcomp": "true",
        "armature": "0.02",
        "axis": "0 1 0",
        "class": "visual",
        "damping": "0.3",
        "frictionloss": "0.2",
        "group": "1",
        "limited": "true",
        "margin": "0.01",
        "pos": "0.1 0 0",
        "range": "-1 1",
        "ref": "0.1",
        "solimpfriction": IMPEDANCE,
        "solimplimit": IMPEDANCE,
        "solreffriction": REFERENCE,
        "solreflimit": REFERENCE,
        "springdamper": "0.1 1",
        "springref": "0.2",
        "springyield": "0.5",
        "stiffness": "3",
        "type": "slide",
        "user": "1 2",
    },
    "geom": {
        "adhesion": "1",
        "axisangle": "1 0 0 0.3",
        "castshadow": "false",
        "conaffinity": "8",
        "condim": "4",
        "contype": "8",
        "density": "500",
        "euler": "0.3 0 0",
        "fitscale": "2",
        "fluidcoef": "1 1 1 1 1",
        "fluidshape": "ellipsoid",
        "friction": "0.3 0.01 0.01",
        "fromto": "0 0 0 0 0 1",
        "gap": "0.01",
        "group": "1",
        "hfield": "none",
        "margin": "0.01",
        "mass": "0.5",
        "material": "none",
        "mesh": "none",
        "name": "name",
        "pos": "0.1 0 0",
        "priority": "1",
        "quat": "0.8 0.6 0 0",
        "rgba": "1 0 0 1",
        "shellinertia": "true",
        "size": "0.07 0.07 0.07",
        "solimp": IMPEDANCE,
        "solmix": "3",
        "solref": REFERENCE,
        "surfacevel": "1 0 0 0 0 0",
        "type": "sphere",
        "user": "1",
        "xyaxes": "0 1 0 -1 0 0",
        "zaxis": "1 0 0",
        "class": "visual",
    },
    "hfield": {"content_type": "image/png", "file": "none.png"},
    "mesh": {
        "builtin": "sphere",
        "class": "main",
        "content_type": "model/stl",
        "face": "0 1 2",
        "material": "none",
        "maxhullvert": "4",
        "normal": "0 0 1",
        "params": "1",
        "refpos": "0.01 0 0",
        "refquat": "0.8 0.6 0 0",
        "scale": "1.01 1 1",
        "smoothnormal": "true",
        "texcoord": "0 0",
        "vertex": "0 0 0 1 0 0 0 1 0 0 0 1",
    },
    "pair": {
        "adhesion": "1",
        "class": "visual",
        "condim": "4",
        "friction": "0.3 0.3 0.01 0.01 0.01",
        "gap": "0.01",
        "margin": "0.01",
        "name": "pair",
        "solimp": IMPEDANCE,
        "solref": REFERENCE,
        "solreffriction": REFERENCE,
    },
    "body": {
        "axisangle": "1 0 0 0.3",
        "childclass": "visual",
        "euler": "0.3 0 0",
        "fuse": "true",
        "gravcomp": "1",
        "mocap": "true",
        "simple": "false",
        "sleep": "never",
        "user": "1",
        "xyaxes": "0 1 0 -1 0 0",
        "zaxis": "1 0 0",
    },
    "inertial": {
        "axisangle": "1 0 0 0.3",
        "euler": "0.3 0 0",
        "fullinertia": "0.1 0.1 0.1 0 0 0",
        "xyaxes": "0 1 0 -1 0 0",
        "zaxis": "1 0 0",
    },
    "exclude": {"name": "exclude"},
    "site": {
        "axisangle": "1 0 0 0.3",
        "class": "visual",
        "euler": "0.3 0 0",
        "fromto": "0 0 0 0 0 1",
        "group": "1",
        "material": "none",
        "mesh": "none",
        "rgba": "1 0 0 1",
        "size": "0.1",
        "type": "box",
        "user": "1",
        "xyaxes": "0 1 0 -1 0 0",
        "zaxis": "1 0 0",
    },
    "connect": {
        "active": "false",
        "anchor": "0.1 0 0",
        "body1": "{body[0]}",
        "body2": "{body[1]}",
        "class": "visual",
    },
    "weld": {
        "active": "false",
        "anchor": "0.1 0 0",
        "body1": "{body[0]}",
        "body2": "{body[1]}",
        "class": "visual",
        "relpose": "0.1 0 0 1 0 0 0",
        "torquescale": "2",
    },
    "fixed": {
        "actuatorfrclimited": "true",
        "actuatorfrcrange": "-1 1",
        "armature": "0.1",
        "class": "visual",
        "group": "2",
        "solimpfriction": IMPEDANCE,
        "solimplimit": IMPEDANCE,
        "solreffriction": REFERENCE,
        "solreflimit": REFERENCE,
        "springyield": "0.5",
        "user": "1",
    },
    "position": {
        "armature": "0.1",
        "class": "visual",
        "cranklength": "0.1",
        "cranksite": "none",
        "ctrllimited": "true",
        "ctrlrange": "-0.01 0.01",
        "damping": "0.5",
        "dampratio": "1",
        "delay": "0.01",
        "forcelimited": "true",
        "forcerange": "-0.1 0.1",
        "gear": "2 0 0 0 0 0",
        "group": "2",
        "inheritrange": "0.5",
        "interp": "linear",
        "jointinparent": "{joint[0]}",
        "kp": "3",
        "kv": "3",
        "lengthrange": "-1 1",
        "nsample": "3",
        "refsite": "none",
        "site": "none",
        "slidersite": "none",
        "tendon": "none",
        "timeconst": "0.1",
        "user": "1",
    },
    "key": {
        "act": "1",
        "ctrl": "0.5",
        "mpos": "1 0 0",
        "mquat": "0 1 0 0",
        "plastic": "1",
        "time": "1",
    },
}
"""Attributes of elements that simspec writes: each is added wherever such an element lacks it."""

NOT_OF_VELOCITY = ("kp", "dampratio", "inheritrange", "timeconst")
"""Attributes of a position actuator that a velocity actuator does not have."""
SITES = '<worldbody><site name="a"/><site name="b" pos="0 0 1"/></worldbody>'
ACTUATORS: Mapping[str, str] = {
    "general": 'gainprm="2"',
    "motor": 'gear="2"',
    "position": 'kp="3"',
    "velocity": 'kv="3"',
    "intvelocity": 'kp="3" actlimited="true" actrange="-1 1"',
    "pid": 'kp="3"',
    "damper": 'kv="3" ctrlrange="0 1"',
    "cylinder": 'area="1" timeconst="0.1"',
    "muscle": 'lengthrange="0 1"',
    "dcmotor": 'motorconst="0.05" resistance="1"',
}
SENSORS: Mapping[str, str] = {
    **dict.fromkeys(
        ("touch", "accelerometer", "velocimeter", "gyro", "force", "torque", "magnetometer", "rangefinder"), 'site="a"'
    ),
    **dict.fromkeys(("jointpos", "jointvel", "jointlimitpos", "jointlimitvel", "jointlimitfrc"), 'joint="{joint[0]}"'),
    **dict.fromkeys(("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis"), 'objtype="site" objname="a"'),
    **dict.fromkeys(("framelinvel", "frameangvel", "framelinacc", "frameangacc"), 'objtype="site" objname="a"'),
    **dict.fromkeys(("subtreecom", "subtreelinvel", "subtreeangmom"), 'body="{body[0]}"'),
    **dict.fromkeys(("e_potential", "e_kinetic", "clock"), ""),
    "jointactuatorfrc": 'joint="{joint[0]}"',
    "insidesite": 'site="a" objtype="site" objname="b"',
    **dict.fromkeys(("distance", "normal", "fromto"), 'geom1="{geom[0]}" geom2="{geom[1]}" cutoff="1"'),
    "contact": 'geom1="{geom[0]}" geom2="{geom[1]}"',
    "user": 'dim="1" datatype="real" needstage="pos"',
}
TENDON = f'{SITES}<tendon><spatial name="cord" stiffness="9"><site site="a"/><site site="b"/></spatial></tendon>'

ELEMENTS: tuple[FileAddition, ...] = (
    *(
        FileAddition("mujoco", f'<statistic {name}="{value}"/>')
        for name, value in (
            ("center", "1 2 3"),
            ("extent", "9"),
            ("meaninertia", "9"),
            ("meanmass", "9"),
            ("meansize", "9"),
        )
    ),
    FileAddition("mujoco", '<visual><global azimuth="9"/></visual>'),
    FileAddition("mujoco", '<visual><quality shadowsize="9"/></visual>'),
    FileAddition("mujoco", '<visual><headlight active="0"/></visual>'),
    FileAddition("mujoco", '<visual><map force="9" stiffness="9"/></visual>'),
    FileAddition("mujoco", '<visual><scale com="9"/></visual>'),
    FileAddition("mujoco", '<visual><rgba com="1 0 0 1"/></visual>'),
    FileAddition("compiler", '<lengthrange mode="all"/>'),
    # defaults for elements that the file does not have
    *(
        FileAddition("default", f"<{value}/>", once=True)
        for value in (
            *(
                'mesh inertia="exact"',
                'texture width="9"',
                'material shininess="0.9"',
                'site size="0.1"',
                'camera fovy="9"',
            ),
            *('light active="false"', 'equality active="false"', 'tendon damping="9"'),
            *(
                'general gear="9"',
                'motor gear="9"',
                'position kp="9"',
                'velocity kv="9"',
                'intvelocity kp="9"',
                'pid kp="9"',
            ),
            *(
                'damper kv="9"',
                'cylinder area="9"',
                'muscle force="9"',
                'adhesion gain="9"',
                'dcmotor motorconst="1" resistance="9"',
            ),
            *('orientation kp="9"', 'default class="fresh"'),
        )
    ),
    FileAddition("mujoco", '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'),
    FileAddition("mujoco", '<asset><mesh name="mesh" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'),
    FileAddition("mujoco", '<asset><hfield name="hill" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 0 1"/></asset>'),
    FileAddition("mujoco", '<asset><texture name="cloth" type="2d" builtin="flat" width="8" height="8"/></asset>'),
    FileAddition("mujoco", '<asset><material name="paint" rgba="1 0 0 1"/></asset>'),
    FileAddition(
        "mujoco",
        '<deformable><flex name="flex" dim="1" body="{body[0]} {body[1]}" vertex="0 0 0 0 0 0.1" element="0 1"/></deformable>',
    ),
    FileAddition(
        "mujoco",
        '<deformable><skin name="skin" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="{body[0]}" bindpos="0 0 0" '
        'bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>',
    ),
    FileAddition("contact", '<pair geom1="{geom[0]}" geom2="{geom[1]}" friction="0.1 0.1 0 0 0"/>'),
    FileAddition("contact", '<exclude body1="{body[0]}" body2="{body[1]}"/>'),
    FileAddition("mujoco", TENDON),
    FileAddition("mujoco", '<tendon><fixed stiffness="9"><joint joint="{joint[0]}" coef="1"/></fixed></tendon>'),
    FileAddition("mujoco", '<equality><connect body1="{body[0]}" body2="{body[1]}" anchor="0 0 0"/></equality>'),
    FileAddition("mujoco", '<equality><weld body1="{body[0]}" body2="{body[1]}"/></equality>'),
    FileAddition("mujoco", '<equality><joint joint1="{joint[0]}" polycoef="0.1 0 0 0 0"/></equality>'),
    FileAddition("mujoco", TENDON + '<equality><tendon tendon1="cord"/></equality>'),
    *(
        FileAddition("mujoco", f'<actuator><{tag} joint="{{joint[0]}}" {value}/></actuator>')
        for tag, value in ACTUATORS.items()
    ),
    FileAddition("mujoco", '<actuator><adhesion body="{body[0]}" ctrlrange="0 1" gain="9"/></actuator>'),
    *(FileAddition("mujoco", f"{SITES}<sensor><{tag} {value}/></sensor>") for tag, value in SENSORS.items()),
    FileAddition("mujoco", '<custom><numeric name="number" data="1"/></custom>'),
    FileAddition("mujoco", '<custom><text name="text" data="word"/></custom>'),
    FileAddition(
        "mujoco", '<custom><tuple name="tuple"><element objtype="body" objname="{body[0]}"/></tuple></custom>'
    ),
    FileAddition("keyframe", '<key name="second" time="1"/>'),
    *(
        FileAddition(where, value)
        for where in ("body", "worldbody")
        for value in (
            '<geom type="sphere" size="0.3"/>',
            '<site name="a"/>',
            '<camera name="eye"/>',
            '<light name="lamp"/>',
            '<body name="more"><geom type="sphere" size="0.3" mass="1"/></body>',
            '<frame pos="1 0 0"><geom type="sphere" size="0.3"/></frame>',
            '<replicate count="2" offset="1 0 0"><geom type="sphere" size="0.3"/></replicate>',
            '<flexcomp name="net" type="grid" count="2 2 1" spacing="1 1 1" radius="0.01" dim="2"/>',
            '<plugin plugin="mujoco.elasticity.cable"/>',
            '<include file="elsewhere.xml"/>',
        )
    ),
    *(
        FileAddition("body", value)
        for value in (
            '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>',
            '<joint name="more" type="slide"/>',
            "<freejoint/>",
        )
    ),
)
"""Elements that simspec does not write, or not in that place; of several, the first ones make the last one valid."""

NOT_PLANTED: Mapping[str, str] = {
    **dict.fromkeys(("layer", "instance", "config"), "details of elements that are planted"),
    **dict.fromkeys(("edge", "elasticity", "pin", "bone", "element", "pulley"), "details of elements that are planted"),
    **dict.fromkeys(("model", "attach"), "need a second file, which is not in the folder: refused as <include> is"),
    **dict.fromkeys(("flex", "flexstrain"), "equalities of a flex, which is planted itself"),
    **dict.fromkeys(("camprojection", "tactile"), "sensors of cameras and meshes, which are planted themselves"),
    **dict.fromkeys(
        ("tendonpos", "tendonvel", "tendonactuatorfrc", "tendonlimitpos", "tendonlimitvel", "tendonlimitfrc"),
        "sensors of tendons, which are planted themselves",
    ),
    **dict.fromkeys(
        ("actuatorpos", "actuatorvel", "actuatorfrc"), "sensors of actuators, which are planted themselves"
    ),
    **dict.fromkeys(("ballquat", "ballangvel"), "sensors as the other sensors of joints"),
    "orientation": "an actuator of ball joints alone; as the other actuators",
}
