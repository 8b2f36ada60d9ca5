"""The tables of docs/concepts/security.md are the code's own data."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simspec.audit import audit
from simspec.confinement import PROFILES, SYSTEM, confine_calls
from simspec.engines.kit import foreign
from simspec.imports import xacro as limits
from simspec.imports.files import Files
from simspec.imports.mjcf import compiled
from simspec.imports.usd import child as usd
from simspec.imports.usd import stage
from simspec.language.foreign import ImportOptions
from simspec.meshes import child as meshes

PAGE = Path(__file__).parents[1] / "docs/concepts/security.md"


def size(count):
    return f"{count / 2**30:g} GiB" if count >= 2**30 else f"{count / 2**20:g} MiB"


def processes():
    """The rows of the first table."""
    nothing, here = "nothing", "its own temporary folder"
    folders = "the file's folders, Python"
    stages = {end: stage.policy_of(Files(Path(f"a.{end}"), "a", ImportOptions())) for end in ("usda", "usdz")}
    assert [policy.writes for policy in stages.values()] == [False, True]
    usd_memory = f"{size(stage.MEMORY)} of addresses, {size(usd.LARGEST_DATA)} of data"
    xacro = f"{limits.CPU_SECONDS} s, {limits.SECONDS:g} s by the clock"
    return [
        ("xacro", "expressions", nothing, nothing, xacro, f"{size(limits.MEMORY)} of addresses"),
        ("meshes", "data", nothing, nothing, f"{meshes.CPU_SECONDS} s a file", f"{size(meshes.MEMORY)} of data"),
        (
            "MJCF",
            compiled.POLICY.profile,
            nothing,
            nothing,
            f"{compiled.SECONDS} s",
            f"{size(compiled.MEMORY)} of data",
        ),
        ("USD", stages["usda"].profile, folders, nothing, f"{stage.SECONDS} s", usd_memory),
        ("USD, a package (`.usdz`)", stages["usdz"].profile, folders, here, f"{stage.SECONDS} s", usd_memory),
        (
            "an engine that `audit` has load the file",
            "scratch",
            folders,
            f"{here}, `/dev/null`",
            f"{audit.DEADLINE:g} s by the clock, and what the engine compiles",
            f"{size(foreign.MEMORY)} of data; {size(foreign.REMAINING)} more than the engine holds before, if that exceeds "
            f"{size(foreign.MEMORY - foreign.REMAINING)}",
        ),
    ]


def tables():
    """The text of the tables as the code has them."""
    calls = [(name, " ".join(f"`{call}`" for call in sorted(profile.calls))) for name, profile in PROFILES.items()]
    return {
        "TABLE": "\n".join(f"| {' | '.join(row)} |" for row in processes()),
        "CALLS": "\n".join(f"| `{name}` | {text} |" for name, text in calls),
        "SYSTEM": " ".join(f"`{place}`" for place in SYSTEM),
    }


@pytest.mark.parametrize("name", ["TABLE", "CALLS", "SYSTEM"])
def test_the_page_has_the_codes_data(name):
    assert tables()[name] in PAGE.read_text(encoding="utf-8")


def test_profiles_are_used_where_the_page_says_so():
    """The two processes whose profile is no constant of theirs."""
    package = Path(confine_calls.__code__.co_filename).parent
    used = {
        "imports/xacro/child.py": "expressions",
        "meshes/child.py": "data",
        "engines/kit/foreign.py": "scratch",
    }
    found = {
        str(path.relative_to(package)): name
        for path in package.rglob("*.py")
        for name in re.findall(r'PROFILES\["(\w+)"\]', path.read_text(encoding="utf-8"))
    }
    assert found == used
