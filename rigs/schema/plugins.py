"""Gauges, robot interfaces, effects and makers of other packages, provided as entry points.

The pyproject.toml of a package lists its classes by group, under the names used in a rig file:

    [project.entry-points."rig.gauges"]
    example_dial = "cell_dial.schema:ExampleDial"

A class that cannot be used is omitted, and the reason is reported if a rig file names it. Other cells are not affected.
"""

from __future__ import annotations

from functools import cache, reduce
from importlib.metadata import EntryPoint, entry_points
from operator import or_
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, Field

MAKERS = "rig.makers"
"""Group of makers. Here a package provides a package instead of a class, with a module per question."""
Group = Literal["rig.gauges", "rig.robots", "rig.effects"]
_KEY: dict[Group, str] = {"rig.gauges": "interface", "rig.robots": "interface", "rig.effects": "effect"}
"""Key of a rig file that contains the name of the class, by group."""
BROKEN: dict[str, str] = {}
"""Reasons for omitted classes, by name."""
C = TypeVar("C", bound=BaseModel)


@cache
def _offers() -> tuple[EntryPoint, ...]:
    """Return the entry points of all packages.

    Scanning an environment with a hundred packages once takes a few hundredths of a second.
    """
    of_packages = entry_points()
    return tuple(offer for group in (*_KEY, MAKERS) for offer in of_packages.select(group=group))


def offered(group: Group, base: type[C], taken: frozenset[str]) -> dict[str, type[C]]:
    """Return the classes provided for a group, by name.

    base: required base class. taken: names used by rig itself.
    """
    classes: dict[str, type[C]] = {}
    key = _KEY[group]
    for offer in sorted((offer for offer in _offers() if offer.group == group), key=lambda offer: offer.name):
        package = offer.dist.name if offer.dist else offer.value
        try:
            if offer.name in taken or offer.name in classes:
                raise ImportError("another has this name")
            cls = offer.load()
            if not (isinstance(cls, type) and issubclass(cls, base)):
                raise ImportError(f"{offer.value} is no {base.__name__}")
            if key not in cls.model_fields or get_args(cls.model_fields[key].annotation) != (offer.name,):
                raise ImportError(f"its key {key} is not {offer.name!r}")
            if group != "rig.effects" and not getattr(cls, "driver", ""):
                raise ImportError("it does not say in `driver` which module speaks to it")
            classes[offer.name] = cls
        except Exception as reason:  # noqa: BLE001 - whatever a foreign module raises as it is imported
            BROKEN[offer.name] = f"package {package} offers {offer.name}, which cannot be used: {reason}"
    return classes


def packages_of_makers() -> dict[str, str]:
    """Return the packages that provide makers, by the name of the maker."""
    return {offer.name: offer.value for offer in sorted(_offers()) if offer.group == MAKERS}


def extended(union: Any, group: Group, base: type[BaseModel]) -> Any:
    """Return a discriminated union, extended by the classes provided for a group."""
    classes = get_args(get_args(union)[0])
    names = frozenset(name for cls in classes for name in get_args(cls.model_fields[_KEY[group]].annotation))
    of_others = offered(group, base, names)
    if not of_others:
        return union
    return Annotated[reduce(or_, (*classes, *of_others.values())), Field(discriminator=_KEY[group])]


def driver_of(part: BaseModel, folder: str) -> str:
    """Return the driver module of a gauge or robot in a rig file.

    This is `driver` of the class, or the file in rig's folder.
    """
    return str(getattr(type(part), "driver", "") or f"{folder}.{part.interface}")  # type: ignore[attr-defined]
