"""Another reader of SDF, in a separate process: the models that Drake's parser makes of files, as JSON on standard output.

Arguments: a JSON file ``[{"file": ..., "positions": {joint: q}}]``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


def read(file: str, positions: dict[str, float]) -> dict[str, Any]:
    """Poses of centres of mass, and the mass matrix over the joints of one axis, by name."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import BodyIndex

    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.package_map().PopulateFromFolder(str(Path(file).parent))
    parser.AddModels(file)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    names = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            scope = plant.GetModelInstanceName(joint.model_instance())
            names[f"{scope}::{joint.name()}"] = joint.velocity_start()
            position = positions.get(f"{scope}::{joint.name()}", positions.get(joint.name()))
            if position is not None:
                q = plant.GetPositions(context)
                q[joint.position_start()] = position
                plant.SetPositions(context, q)
    bodies = {}
    for number in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(number))
        if body.name() == "world" or body.name().startswith("_"):
            continue
        scope = plant.GetModelInstanceName(body.model_instance())
        pose = plant.EvalBodyPoseInWorld(context, body)
        inertia = body.CalcSpatialInertiaInBodyFrame(context)
        centre = pose.multiply(inertia.get_com())
        matrix = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
        turn = pose.rotation().matrix()
        bodies[f"{scope}::{body.name()}"] = {
            "mass": inertia.get_mass(),
            "centre": list(centre),
            "inertia": (turn @ matrix @ turn.T).tolist(),
        }
    mass = plant.CalcMassMatrixViaInverseDynamics(context)
    order = sorted(names)
    rows = [names[name] for name in order]
    return {"bodies": bodies, "order": order, "mass": np.asarray(mass)[np.ix_(rows, rows)].tolist()}


def main() -> None:
    requests = json.loads(Path(sys.argv[1]).read_text())
    results = [read(**request) for request in requests]
    sys.stdout.write("\n" + json.dumps(results))


if __name__ == "__main__":
    main()
