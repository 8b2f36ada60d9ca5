"""MJCF texts that the importer's tests share."""

from __future__ import annotations

from pathlib import Path

from simspec.imports.mjcf.importer import MjcfImporter
from simspec.language.foreign import Account, Fate, Imported, ImportOptions, LossSeverity

ARM = """<mujoco model="arm">
  <compiler angle="degree"/>
  <option gravity="0 0.5 -9.7" timestep="0.001"/>
  <default>
    <geom friction="0.7"/>
    <default class="visual"><geom contype="0" conaffinity="0"/></default>
  </default>
  <worldbody>
    <body name="base" pos="0 0 0.1">
      <geom type="box" size=".1 .1 .1"/>
      <frame pos="0 0 0.2" euler="10 20 30">
        <body name="upper">
          <joint name="swing" axis="0 1 0" pos="0 0 .05" range="-90 10" ref="5" damping="0.1" armature=".01" stiffness="3"
                 springref="9" frictionloss="0.2"/>
          <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02" contype="0"/>
          <geom class="visual" size=".01" rgba="1 0 0 1"/>
          <body name="slider" pos="0 0 .3">
            <joint name="push" type="slide" axis="1 1 0" pos="0 .1 0" range="-.1 .2"/>
            <geom type="cylinder" size=".03 .1" mass="0.4"/>
            <body name="ball" pos="0.1 0 .3">
              <joint type="ball" damping=".001" stiffness=".2"/>
              <geom type="ellipsoid" size=".1 .02 .03" pos=".1 .02 0" density="3000"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
</mujoco>
"""
SCENE = """<mujoco model="scene">
  <option cone="elliptic"/>
  <worldbody>
    <light pos="0 0 1"/>
    <geom name="floor" type="plane" size="1 1 1" friction="1 0.01 0.001" condim="4"/>
    <replicate count="3" offset="0.5 0 0">
      <body name="box" pos="0 0 1" euler="0.1 0.2 0.3">
        <freejoint/>
        <geom type="box" size=".1 .2 .3" pos=".1 .02 0" friction="0.5"/>
      </body>
    </replicate>
    <body name="stand" pos="2 0 0"><geom size="0.1"/></body>
  </worldbody>
  <contact><exclude body1="box0" body2="box1"/></contact>
</mujoco>
"""


def written(folder: Path, text: str, name: str = "model.xml") -> Path:
    """A file of that text."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def read(path: Path, options: ImportOptions | None = None) -> Imported:
    """A file as it is imported."""
    return MjcfImporter().read(path, path.name, options or ImportOptions())


def lost(imported: Imported, severity: LossSeverity = LossSeverity.PHYSICS) -> list[Account]:
    """Losses of a severity."""
    return [account for account in imported.accounts if account.fate is Fate.LOST and account.severity is severity]
