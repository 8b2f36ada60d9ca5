"""Small xacro files, and what becomes of them."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.foreign import ImportOptions, import_file

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
MASS = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def robot(content):
    return f'<?xml version="1.0"?>\n<robot name="r" {NAMESPACE}>\n{content}\n</robot>\n'


def imported(content, folder, **options):
    path = folder / "r.xacro"
    path.write_text(content if content.startswith("<?xml") else robot(content))
    options.setdefault("project", folder.resolve())
    return import_file(path, "r.xacro", ImportOptions(**options))


def refused(content, folder, **options):
    with pytest.raises(SpecError) as error:
        imported(content, folder, **options)
    return "\n".join(map(str, error.value.problems))
