"""Named initial states of a model: where its joints, and a free root, begin."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from simspec.language.joint_names import NamePattern
from simspec.language.shapes import Pose, Velocity
from simspec.language.strict import ABSENT, Maybe, Strict


class State(Strict):
    """An initial state of a model. What it does not say is as the model's bodies say."""

    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the root in the model, instead of its own")
    velocity: Maybe[Velocity] = Field(
        ABSENT, description="Velocity of a free root in the model's axes, instead of its own"
    )
    positions: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint positions by the joint's name in the model; `*` matches any text"
    )
    velocities: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint velocities by the joint's name in the model; `*` matches any text"
    )
    commands: dict[Annotated[str, NamePattern("actuator")], Any] = Field(
        {},
        description="Commands by the actuator's name in the model, instead of the actuators' own; `*` matches any text",
    )
