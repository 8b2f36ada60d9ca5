"""Files of SDF for tests: a text around what a test is about, imported."""

from __future__ import annotations

from simspec.language.foreign import Fate, ImportOptions, import_file

INERTIAL = "<inertial><mass>2</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"


def sdf(content, version="1.9"):
    return f'<?xml version="1.0"?>\n<sdf version="{version}">\n{content}\n</sdf>\n'


def model(content, version="1.9", words=""):
    return sdf(f'<model name="robot"{words}>\n{content}\n</model>', version)


def link(name, content="", inertial=INERTIAL):
    return f'<link name="{name}">{inertial}{content}</link>'


def joint(kind, content="", name="elbow", parent="base", child="arm"):
    return f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>{content}</joint>'


def imported(text, folder, name="robot.sdf", **options):
    path = folder / name
    path.write_text(text)
    options.setdefault("project", folder.resolve())
    return import_file(path, name, ImportOptions(**options))


def lost(result):
    """The losses: path, severity and reason."""
    return {
        account.what: (account.severity.value, account.reason)
        for account in result.accounts
        if account.fate is Fate.LOST
    }
