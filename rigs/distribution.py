"""What the installed package is called, and how a person adds a part to it, in whatever environment it runs.

The name `rig` belongs to another project on PyPI, so no message may send a person to `pip install rig`:
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
"""The name of the distribution; the commands are `rig` and `rigd`."""
_OF_UVX = ("archive-v", "environments-v")
"""Folders of uv's cache in which `uvx` keeps environments (uv 0.13); nothing is to be added in a cache."""


def version() -> str:
    """Return the version that is installed, `not installed` for sources that were only copied."""
    from importlib import metadata  # noqa: PLC0415 - a tenth of the start of a command that needs none

    with suppress(metadata.PackageNotFoundError):
        return metadata.version(NAME)
    return "not installed"


def to_install(*packages: str) -> str:
    """Return what a person types to add packages of PyPI, in the versions that rig asks for, to where rig runs.

    `pipx` and `uv tool` keep an environment for each program and leave a file in it by which it is known, and `uvx`
    keeps its own in a cache. Any other environment is named by its Python, also one without a pip.
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
    beneath = shlex.quote(getattr(sys, "_base_executable", "python3"))  # `python3` may be this environment's own
    pip = f"{python} -m pip" if find_spec("pip") else f"{beneath} -m pip --python {python}"
    return f"add it: {as_root}{pip} install {names}"


def _required(package: str) -> str:
    """A package with the versions of it that rig asks for; as it is where rig does not ask for it."""
    from importlib import metadata  # noqa: PLC0415 - as above

    with suppress(metadata.PackageNotFoundError):
        for line in metadata.requires(NAME) or ():
            requirement = line.partition(";")[0].strip()
            if re.fullmatch(rf"{re.escape(package)}([<>=!~,.\d ]*)", requirement):
                return requirement
    return package


def _of_uv(receipt: Path) -> list[str]:
    """What `uv tool` was given: rig by its name or place, then what was added, which uv removes unless named again; of
    a receipt that is damaged, which uv passes by as well, the name alone."""
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
