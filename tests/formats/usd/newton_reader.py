"""The models of files of USD in the package newton: a program for an interpreter that has it. For paths as arguments, it
answers with JSON: a list, for each file bodies, joints and shapes by the paths of their prims."""

from __future__ import annotations

import json
import sys

import newton
import numpy as np
import warp


def plain(value):
    return np.array(value, dtype=float).tolist()


def read(path):
    builder = newton.ModelBuilder()
    builder.add_usd(path)
    bodies = {
        label: {"mass": mass, "com": plain(com), "inertia": plain(inertia), "place": plain(place)}
        for label, mass, com, inertia, place in zip(
            builder.body_label,
            plain(builder.body_mass),
            builder.body_com,
            builder.body_inertia,
            builder.body_q,
            strict=True,
        )
    }
    joints = {}
    starts = [*builder.joint_qd_start, len(builder.joint_axis)]
    for index, label in enumerate(builder.joint_label):
        axes = range(starts[index], starts[index + 1]) if builder.joint_type[index] != newton.JointType.FREE else ()
        joints[label] = {
            "type": newton.JointType(builder.joint_type[index]).name,
            "parent": builder.joint_parent[index],
            "child": builder.body_label[builder.joint_child[index]],
            "in_parent": plain(builder.joint_X_p[index]),
            "in_child": plain(builder.joint_X_c[index]),
            "axes": [plain(builder.joint_axis[k]) for k in axes],
            "lower": [float(builder.joint_limit_lower[k]) for k in axes],
            "upper": [float(builder.joint_limit_upper[k]) for k in axes],
            "stiffness": [float(builder.joint_target_ke[k]) for k in axes],
            "damping": [float(builder.joint_target_kd[k]) for k in axes],
        }
        parent = builder.joint_parent[index]
        joints[label]["parent"] = None if parent < 0 else builder.body_label[parent]
    shapes = {}
    for index, label in enumerate(builder.shape_label):
        source = builder.shape_source[index]
        shapes[label] = {
            "type": newton.GeoType(builder.shape_type[index]).name,
            "scale": plain(builder.shape_scale[index]),
            "points": 0 if source is None or not hasattr(source, "vertices") else len(source.vertices),
            "friction": float(builder.shape_material_mu[index]),
        }
    return {"bodies": bodies, "joints": joints, "shapes": shapes, "gravity": plain(builder.gravity)}


if __name__ == "__main__":
    warp.config.quiet = True
    sys.stdout.write("\n" + json.dumps([read(path) for path in sys.argv[1:]]))
