"""Commands as a person calls them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from analysis import cli


def ended(*words: str | Path) -> int:
    """What a command ends with, called as a person calls it."""
    before = sys.argv
    sys.argv = ["rig", *map(str, words)]
    try:
        with pytest.raises(SystemExit) as end:
            cli.main()
    finally:
        sys.argv = before
    return int(end.value.code or 0)
