"""Find the parts of a test. Each test is a package that an installed distribution offers as entry point `rig.tests`.

The package of a test contains a module for each layer of `analysis` that needs to know the test, with the class `PART`.
Reading a run therefore imports `format.py` only. Rig's own tests are offered in the same way as those of other
packages.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Literal, Protocol, TypeVar, get_args

from rigs.distribution import NAME
from rigs.errors import FileError
from rigs.schema.vocabulary import TEST_PACKAGES, TestName

Module = Literal["format", "predict", "evaluate", "checks", "observe"]
"""Names of the modules in the package of a test, each for one layer of `analysis`."""
TESTS: tuple[TestName, ...] = get_args(TestName)
"""All tests, in the order in which they are listed everywhere."""
_REMEDY = "install a different version of that package, or uninstall it"


class TestPart(Protocol):
    """Common base of the parts: the name of the test, because one package may offer several tests."""

    test: TestName

    def __init__(self, test: TestName) -> None:
        self.test = test


P = TypeVar("P")


def part_of(test: TestName, module: Module, usual: Callable[[TestName], P] | None = None) -> P:
    """Return a part of a test, or the usual part if its package does not contain the module. Raises FileError for an
    unusable package."""
    package = package_of(test).__name__
    if usual and find_spec(f"{package}.{module}") is None:
        return usual(test)
    part: P = _imported(test, f"{package}.{module}").PART(test)
    return part


@cache
def package_of(test: TestName) -> ModuleType:
    """Return the package of a test, which contains its records. Raises FileError for an unusable offer."""
    offer = TEST_PACKAGES.get(test)
    if offer is None:
        problem = f"the installed {NAME} does not offer it as rig.tests"
        raise FileError(f"test {test}", problem, "reinstall it; in a checkout: pip install --no-deps -e .")
    if offer.attr:
        problem = f"{offer.value}, which a package offers, has the form of version 1.1: a test is now a package"
        remedy = f"offer {offer.module.rpartition('.')[0] or offer.module}, with format.py and evaluate.py in it"
        raise FileError(f"test {test}", problem, f"{remedy} (docs/how-to/add-a-test-kind.md)")
    package: ModuleType = _imported(test, offer.module)
    return package


def _imported(test: TestName, module: str) -> Any:
    try:
        return import_module(module)
    except Exception as reason:
        problem = f"{module}, which a package offers, cannot be used: {reason}"
        raise FileError(f"test {test}", problem, _REMEDY) from reason
