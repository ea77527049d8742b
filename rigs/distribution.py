"""Name and version of the installed package, and the remedy for a missing one.

The name `rig` belongs to a different project on PyPI (docs/decisions/0033-a-name-of-its-own.md).
"""

from __future__ import annotations

import shlex
import sys
from contextlib import suppress

NAME = "rig-metrology"


def version() -> str:
    from importlib import metadata  # noqa: PLC0415 - a tenth of the start of a command that needs none

    with suppress(metadata.PackageNotFoundError):
        return metadata.version(NAME)
    return "not installed"


def to_install(*packages: str) -> str:
    return f"add it to the environment of rig: {shlex.quote(sys.executable)} -m pip install {' '.join(packages)}"
