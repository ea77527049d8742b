"""What the installed package is called, and how a person adds a part to it, in whatever environment it runs.

The name `rig` belongs to another project on PyPI, so no message may send a person to `pip install rig`:
docs/decisions/0033-a-name-of-its-own.md.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

NAME = "rig-metrology"
"""The name of the distribution; the commands are `rig` and `rigd`."""


def version() -> str:
    """Return the version that is installed, `not installed` for sources that were only copied."""
    from importlib import metadata  # noqa: PLC0415 - slow to import, and reading a rig file needs no version

    with suppress(metadata.PackageNotFoundError):
        return metadata.version(NAME)
    return "not installed"


def to_install(*packages: str) -> str:
    """Return what a person types to add packages of PyPI to the environment in which rig runs.

    `pipx` and `uv tool` keep an environment for each program and leave a file in it by which it is known; any other
    environment, one without a pip of its own among them, is named by its Python.
    """
    prefix, names = Path(sys.prefix), " ".join(packages)
    if (prefix / "pipx_metadata.json").is_file():
        return f"add it: pipx inject {NAME} {names}"
    if (prefix / "uv-receipt.toml").is_file():
        with_each = " ".join(f"--with {package}" for package in packages)
        return f"add it: uv tool install {with_each} {NAME}"
    if sys.prefix == sys.base_prefix:
        return f"add it: python3 -m pip install {names}, or apt install the package of that name on Debian"
    as_root = "" if os.access(prefix, os.W_OK) else "sudo "
    return f"add it: {as_root}python3 -m pip --python {sys.executable} install {names}"
