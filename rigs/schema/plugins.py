"""Gauges, robot interfaces, effects and makers of other packages, offered as entry points by the name for a rig file.

An unusable class is left out, and the reason is reported if a rig file names it.
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, Field

from rigs.schema.vocabulary import ENTRY_POINTS

Group = Literal["rig.gauges", "rig.robots", "rig.effects"]
_KEY: dict[Group, str] = {"rig.gauges": "interface", "rig.robots": "interface", "rig.effects": "effect"}
BROKEN: dict[str, str] = {}
C = TypeVar("C", bound=BaseModel)


def offered(group: Group, base: type[C], taken: frozenset[str]) -> dict[str, type[C]]:
    classes: dict[str, type[C]] = {}
    key = _KEY[group]
    for offer in sorted(ENTRY_POINTS.select(group=group), key=lambda offer: offer.name):
        package = offer.dist.name if offer.dist else offer.value
        try:
            if offer.name in taken or offer.name in classes:
                raise ImportError("another has this name")
            cls = offer.load()
            if not (isinstance(cls, type) and issubclass(cls, base)):
                raise ImportError(f"{offer.value} is not a {base.__name__}")
            if key not in cls.model_fields or get_args(cls.model_fields[key].annotation) != (offer.name,):
                raise ImportError(f"the key {key} differs from {offer.name!r}")
            if group != "rig.effects" and not getattr(cls, "driver", ""):
                raise ImportError("`driver` does not name the module for this interface")
            classes[offer.name] = cls
        except Exception as reason:  # noqa: BLE001 - whatever a foreign module raises as it is imported
            BROKEN[offer.name] = f"package {package} offers {offer.name}, which cannot be used: {reason}"
    return classes


def extended(union: Any, group: Group, base: type[BaseModel]) -> Any:
    classes = get_args(get_args(union)[0])
    names = frozenset(name for cls in classes for name in get_args(cls.model_fields[_KEY[group]].annotation))
    of_others = offered(group, base, names)
    if not of_others:
        return union
    return Annotated[reduce(or_, (*classes, *of_others.values())), Field(discriminator=_KEY[group])]


def driver_of(part: BaseModel, package: str) -> str:
    """Driver module of a gauge or robot: `driver` of the class, or the module in the package of rig."""
    return str(getattr(type(part), "driver", "") or f"{package}.{part.interface}")  # type: ignore[attr-defined]
