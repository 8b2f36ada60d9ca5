"""Whether an engine can be installed on this Python, as simspec's own package metadata says."""

from __future__ import annotations

import platform

from simspec.distribution import requirements as own_requirements
from simspec.engines.kit.compiled import Needs
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines


def how_to_install(engine: type[Engine]) -> str:
    """The words that install an engine: of pip, of Debian's apt-get, what no package brings, or several of these."""
    words = (pip_words(engine), apt_words(engine.NEEDS), engine.NEEDS.elsewhere)
    return " and ".join(command for command in words if command)


def not_installed(engine: type[Engine]) -> str:
    """That an engine is not installed, what is missing where that is known, and how to install it."""
    lacking = engine.NEEDS.lacking()
    why = f" ({str(lacking[0]).splitlines()[0].removeprefix(f'{engine.NAME}: ')})" if lacking else ""
    how = how_to_install(engine)
    return f"not installed{why}" + (f": {how}" if how else "")


def pip_words(engine: type[Engine]) -> str:
    """The command that installs its packages of Python, here or in an environment of its own; empty where there are none."""
    if engine.APART:
        return f"simspec engines install {engine.NAME} --yes"
    return f"pip install 'simspec-physics[{engine.EXTRA}]'" if engine.EXTRA else ""


def apt_words(needs: Needs) -> str:
    """The command that installs its packages of Debian; empty where there are none."""
    return f"apt-get install {' '.join(needs.packages)}" if needs.debian else ""


def why_not(engine: type[Engine], environment: dict[str, str] | None = None) -> str | None:
    """Why ``engine`` cannot be installed here: the requirement of its extra whose marker rules this Python out. None when it
    can be, or when simspec's metadata say nothing of it (an engine of a third party). ``environment`` overrides markers."""
    found = None
    if not engine.EXTRA:
        return None
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    for line in own_requirements():
        requirement = Requirement(line)
        marker = requirement.marker
        if canonicalize_name(requirement.name) != canonicalize_name(engine.DISTRIBUTION) or marker is None:
            continue
        if f'"{engine.EXTRA}"' not in str(marker):
            continue
        if marker.evaluate({**(environment or {}), "extra": engine.EXTRA}):
            return None
        version = (environment or {}).get("python_version") or platform.python_version()
        rule = str(marker).replace(f' and extra == "{engine.EXTRA}"', "")
        found = f"cannot be installed on Python {version}: {requirement.name} has no wheels but for {rule}"
    return found


def left_out(environment: dict[str, str] | None = None) -> dict[str, str]:
    """The known engines that are not installed and cannot be on this Python, each with the reason."""
    return {
        name: why
        for name, engine in engines().items()
        if engine.version() is None and (why := why_not(engine, environment)) is not None
    }
