"""Entry points of the commands `rig` and `rigd`. They check that the packages `rigs`, `daq` and `analysis` belong to
rig.

After installation this file is the module `rig_metrology`, a unique name. Other software may have packages of the same
names, and ROS puts its folders first on PYTHONPATH. Unchecked, the commands would end there with a traceback. Nothing
of rig is imported before the check.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

PACKAGE_OF_API = "analysis"
MARKS = {"rigs": "distribution.py", "daq": "service/rigd.py", "analysis": "cli/commands.py"}
"""Characteristic file of each package, absent in foreign packages of the same name."""
_WRONG_ENVIRONMENT = 4
"""Exit code for an unusable environment (rigs.errors.CellError)."""


def rig() -> None:
    _require_packages("rig", "rigs", "daq", "analysis")
    import_module("analysis.cli").main()


def rigd() -> None:
    _require_packages("rigd", "rigs", "daq")
    import_module("daq.service.rigd").main()


def _require_packages(program: str, *packages: str) -> None:
    """Exit with a single-line error if a package is missing or hidden by a foreign package."""
    for package in packages:
        spec = find_spec(package)
        if spec is None:
            problem, remedy = f"its package {package} is missing", "install rig again"
        elif not (Path(str(spec.origin)).parent / MARKS[package]).is_file():
            problem = (
                f"a different package {package}, in {str(Path(str(spec.origin)).parent)!a}, hides the package of rig"
            )
            remedy = f"run env -u PYTHONPATH {program}, or remove that folder from PYTHONPATH"
        else:
            continue
        print(f"error: {program}: {problem}; {remedy}", file=sys.stderr)
        sys.exit(_WRONG_ENVIRONMENT)


def __getattr__(name: str) -> Any:
    """Return a name of the public API, which is the API of `analysis`. `import rig_metrology` needs no other name."""
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    _require_packages("import rig_metrology", "rigs", "daq", PACKAGE_OF_API)
    return getattr(import_module(PACKAGE_OF_API), name)


def __dir__() -> list[str]:
    _require_packages("import rig_metrology", "rigs", "daq", PACKAGE_OF_API)
    return [*globals(), *import_module(PACKAGE_OF_API).__all__]
