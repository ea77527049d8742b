"""Name of the installed package, and the command for adding packages in any kind of environment.

The name `rig` belongs to a different project on PyPI, so messages must never suggest `pip install rig`:
docs/decisions/0033-a-name-of-its-own.md.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

NAME = "rig-metrology"
"""Name of the distribution; the commands are `rig` and `rigd`."""
_OF_UVX = ("archive-v", "environments-v")
"""Folders in the cache of uv with environments of `uvx` (uv 0.13). Such an environment must not be modified."""


def version() -> str:
    """Return the installed version, or `not installed` for a copy of the sources."""
    from importlib import metadata  # noqa: PLC0415 - a tenth of the start of a command that needs none

    with suppress(metadata.PackageNotFoundError):
        return metadata.version(NAME)
    return "not installed"


def to_install(*packages: str) -> str:
    """Return the command that adds PyPI packages, in the required versions, to the environment of rig.

    `pipx` and `uv tool` use an environment per program, recognised by a file in it, and `uvx` uses a cache. Other
    environments are identified by the Python interpreter, even if they lack pip.
    """
    prefix, python = Path(sys.prefix), shlex.quote(sys.executable)
    asked = [shlex.quote(_required(package)) for package in packages]
    names = " ".join(asked)
    if (prefix / "pipx_metadata.json").is_file():
        return f"add it: pipx inject {NAME} {names}"
    if (receipt := prefix / "uv-receipt.toml").is_file():
        rig, *before = _of_uv(receipt)
        with_each = " ".join(f"--with {package}" for package in (*before, *asked))
        return f"add it: uv tool install {with_each} {rig}"
    if prefix.parent.name.startswith(_OF_UVX):
        return f"add it: uvx {' '.join(f'--with {package}' for package in asked)} --from {NAME} rig"
    as_root = "" if os.access(prefix, os.W_OK) else "sudo "
    beneath = shlex.quote(getattr(sys, "_base_executable", "python3"))  # `python3` may belong to this environment
    pip = f"{python} -m pip" if find_spec("pip") else f"{beneath} -m pip --python {python}"
    return f"add it: {as_root}{pip} install {names}"


def _required(package: str) -> str:
    """Return a package with the version range required by rig, if any."""
    from importlib import metadata  # noqa: PLC0415 - as above

    with suppress(metadata.PackageNotFoundError):
        for line in metadata.requires(NAME) or ():
            requirement = line.partition(";")[0].strip()
            if re.fullmatch(rf"{re.escape(package)}([<>=!~,.\d ]*)", requirement):
                return requirement
    return package


def _of_uv(receipt: Path) -> list[str]:
    """Return the arguments of `uv tool`: rig by name or path, and the added packages, which uv would otherwise remove.

    For a damaged receipt, which uv also ignores, only the name is returned.
    """
    import tomllib  # noqa: PLC0415 - as above

    places = ("path", "directory", "editable")
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
        requirements = tomllib.loads(receipt.read_text(encoding="utf-8"))["tool"]["requirements"]
        names = [
            next((part[key] for key in places if key in part), part["name"] + part.get("specifier", ""))
            for part in requirements
        ]
        return [shlex.quote(name) for name in names] or [NAME]
    return [NAME]
