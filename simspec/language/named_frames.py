"""Named frames on bodies: tool points, places of sensors, sites."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from simspec.language.shapes import Pose
from simspec.language.strict import ABSENT, Maybe, Strict
from simspec.language.words import Name


class Frame(Strict):
    """A frame that is fixed to a body. It has no mass, touches nothing and moves nothing: it is a name for a place."""

    body: Annotated[str, Name(path=True)] = Field(
        ...,
        description="The body that it is fixed to: by its name in the model, of a scenario's frame by its full name",
    )
    pose: Maybe[Pose] = Field(ABSENT, description="Its pose in the body's frame; default: the same frame")
