"""A sound arm in four languages, each of whose values a test can replace by a slip."""

from __future__ import annotations

from pathlib import Path

from simspec.language.load import load
from simspec.plausibility.examine import examine
from simspec.plausibility.findings import Plausibility, PlausibilityFinding

BOX = {"x": 0.06, "y": 0.06, "z": 0.4}


def moments(mass: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Of a homogeneous box."""
    return (mass * (y * y + z * z) / 12.0, mass * (x * x + z * z) / 12.0, mass * (x * x + y * y) / 12.0)


DEFAULTS = {
    "mass": "2",
    "centre": "0 0 0.2",
    "inertia": " ".join(f"{value:.8g}" for value in moments(2.0, 0.06, 0.06, 0.4)),
    "box": "0.06 0.06 0.4",
    "place": "0 0 0.2",
    "visual": "",
    "collision": "yes",
    "origin": "0 0 0.2",
    "type": "revolute",
    "axis": "0 1 0",
    "lower": "-1",
    "upper": "1",
    "effort": "50",
    "velocity": "3",
    "tip_origin": "0 0 0.405",
    "tip_lower": "-1",
    "tip_upper": "1",
    "tip_mass": "1",
    "tip_box": "0.05 0.05 0.3",
    "tip_place": "0 0 0.15",
    "tip_inertia": " ".join(f"{value:.8g}" for value in moments(1.0, 0.05, 0.05, 0.3)),
    "extra": "",
}
"""A base, an arm on a hinge, and a tip on a second hinge; their boxes end just before each other."""


def urdf(**slips: str) -> str:
    """As a URDF."""
    values = {**DEFAULTS, **slips}
    ix, iy, iz = values["inertia"].split()
    tx, ty, tz = values["tip_inertia"].split()
    box = f'<origin xyz="{values["place"]}"/><geometry><box size="{values["box"]}"/></geometry>'
    shapes = f"<collision>{box}</collision>" if values["collision"] else f"<visual>{box}</visual>"
    tip = f'<origin xyz="{values["tip_place"]}"/><geometry><box size="{values["tip_box"]}"/></geometry>'
    tip_shape = f"<collision>{tip}</collision>" if values["collision"] else f"<visual>{tip}</visual>"
    return f"""<robot name="arm">
  <link name="base">
    <inertial><mass value="5"/><inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.095"/><geometry><box size="0.2 0.2 0.19"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><origin xyz="{values["centre"]}"/><mass value="{values["mass"]}"/>
      <inertia ixx="{ix}" iyy="{iy}" izz="{iz}" ixy="0" ixz="0" iyz="0"/></inertial>
    {shapes}{values["visual"]}
  </link>
  <link name="tip">
    <inertial><origin xyz="{values["tip_place"]}"/><mass value="{values["tip_mass"]}"/>
      <inertia ixx="{tx}" iyy="{ty}" izz="{tz}" ixy="0" ixz="0" iyz="0"/></inertial>
    {tip_shape}
  </link>
  <joint name="shoulder" type="{values["type"]}"><parent link="base"/><child link="arm"/>
    <origin xyz="{values["origin"]}"/><axis xyz="{values["axis"]}"/>
    <limit lower="{values["lower"]}" upper="{values["upper"]}" effort="{values["effort"]}" velocity="{values["velocity"]}"/>
  </joint>
  <joint name="elbow" type="revolute"><parent link="arm"/><child link="tip"/>
    <origin xyz="{values["tip_origin"]}"/><axis xyz="0 1 0"/>
    <limit lower="{values["tip_lower"]}" upper="{values["tip_upper"]}" effort="50" velocity="3"/></joint>
  {values["extra"]}
</robot>
"""


def mjcf(**slips: str) -> str:
    """As an MJCF; its boxes have half edges."""
    values = {**DEFAULTS, **slips}
    half = " ".join(f"{0.5 * float(edge):.8g}" for edge in values["box"].split())
    tip_half = " ".join(f"{0.5 * float(edge):.8g}" for edge in values["tip_box"].split())
    touches = "" if values["collision"] else ' contype="0" conaffinity="0"'
    return f"""<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="base"><geom type="box" size="0.1 0.1 0.095" pos="0 0 0.095"/>
      <body name="arm" pos="{values["origin"]}">
        <joint name="shoulder" type="hinge" axis="{values["axis"]}" range="{values["lower"]} {values["upper"]}"/>
        <inertial pos="{values["centre"]}" mass="{values["mass"]}" diaginertia="{values["inertia"]}"/>
        <geom type="box" size="{half}" pos="{values["place"]}"{touches}/>
        <body name="tip" pos="{values["tip_origin"]}">
          <joint name="elbow" type="hinge" axis="0 1 0" range="{values["tip_lower"]} {values["tip_upper"]}"/>
          <inertial pos="{values["tip_place"]}" mass="{values["tip_mass"]}" diaginertia="{values["tip_inertia"]}"/>
          <geom type="box" size="{tip_half}" pos="{values["tip_place"]}"{touches}/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def _sdf_link(name: str, place: str, mass: str, centre: str, inertia: str, box: str, at: str, word: str) -> str:
    ix, iy, iz = inertia.split()
    return f"""<link name="{name}"><pose>{place} 0 0 0</pose>
      <inertial><pose>{centre} 0 0 0</pose><mass>{mass}</mass>
        <inertia><ixx>{ix}</ixx><iyy>{iy}</iyy><izz>{iz}</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>
      <{word} name="{name}_shape"><pose>{at} 0 0 0</pose><geometry><box><size>{box}</size></box></geometry></{word}>
    </link>"""


def _sdf_joint(name: str, parent: str, child: str, axis: str, lower: str, upper: str) -> str:
    return f"""<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>
      <axis><xyz>{axis}</xyz><limit><lower>{lower}</lower><upper>{upper}</upper>
        <effort>50</effort><velocity>3</velocity></limit></axis></joint>"""


def sdf(**slips: str) -> str:
    """As an SDF, whose links stand in the model's frame."""
    values = {**DEFAULTS, **slips}
    word = "collision" if values["collision"] else "visual"
    origin = [float(value) for value in values["origin"].split()]
    tip = " ".join(str(a + float(b)) for a, b in zip(origin, values["tip_origin"].split(), strict=True))
    arm = _sdf_link(
        "arm",
        values["origin"],
        values["mass"],
        values["centre"],
        values["inertia"],
        values["box"],
        values["place"],
        word,
    )
    end = _sdf_link(
        "tip",
        tip,
        values["tip_mass"],
        values["tip_place"],
        values["tip_inertia"],
        values["tip_box"],
        values["tip_place"],
        word,
    )
    base = _sdf_link("base", "0 0 0", "5", "0 0 0", "0.05 0.05 0.05", "0.2 0.2 0.19", "0 0 0.095", "collision")
    shoulder = _sdf_joint("shoulder", "base", "arm", values["axis"], values["lower"], values["upper"])
    elbow = _sdf_joint("elbow", "arm", "tip", "0 1 0", values["tip_lower"], values["tip_upper"])
    return f"""<sdf version="1.9"><model name="arm"><self_collide>true</self_collide>
    <joint name="stand" type="fixed"><parent>world</parent><child>base</child></joint>
    {base}{arm}{end}{shoulder}{elbow}
  </model></sdf>
"""


def yaml(**slips: str) -> str:
    """As a spec."""
    values = {**DEFAULTS, **slips}

    def row(name: str) -> str:
        return f"[{', '.join(values[name].split())}]"

    def tensor(name: str) -> str:
        return f"{{principal: [{', '.join(values[name].split())}]}}"

    return f"""simspec: 1
name: arm
physics: {{duration: 1 s}}
contact: {{materials: {{steel: {{friction: 0.5}}}}}}
bodies:
  base:
    fixed: true
    shapes: [{{box: {{size: [0.2, 0.2, 0.19]}}, pose: {{xyz: [0, 0, 0.095]}}}}]
  arm:
    parent: base
    mass: {values["mass"]}
    centre_of_mass: {row("centre")}
    inertia: {tensor("inertia")}
    joint:
      {{name: shoulder, type: hinge, axis: {row("axis")}, origin: {{xyz: {row("origin")}}},
       limits: {{position: [{values["lower"]} rad, {values["upper"]} rad]}}}}
    shapes: [{{box: {{size: {row("box")}}}, pose: {{xyz: {row("place")}}}}}]
  tip:
    parent: arm
    mass: {values["tip_mass"]}
    centre_of_mass: {row("tip_place")}
    inertia: {tensor("tip_inertia")}
    joint:
      {{name: elbow, type: hinge, axis: [0, 1, 0], origin: {{xyz: {row("tip_origin")}}},
       limits: {{position: [{values["tip_lower"]} rad, {values["tip_upper"]} rad]}}}}
    shapes: [{{box: {{size: {row("tip_box")}}}, pose: {{xyz: {row("tip_place")}}}}}]
"""


LANGUAGES = {"urdf": urdf, "xml": mjcf, "sdf": sdf, "yaml": yaml}
"""Writers by the end of a file's name."""


def examined(text: str, suffix: str, folder: Path) -> Plausibility:
    """The findings about a file of this content."""
    path = folder / f"model.{suffix}"
    path.write_text(text, encoding="utf-8")
    spec = load(path, allow_outside=True)
    return examine(spec, spec.resolve())


def of_rule(found: Plausibility, rule: str) -> list[PlausibilityFinding]:
    """The findings of one rule."""
    return [finding for finding in found.findings if finding.rule == rule]
