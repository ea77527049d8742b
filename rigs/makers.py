"""Makers of robot controllers by name: entry points `rig.makers`, of rig as of any other package.

An entry point names the package of a maker, which is imported when the maker is used (`analysis.apps.makers` lists its
values). An entry point `rig.maker_names` gives another name that its arms have.
"""

from __future__ import annotations

from rigs.distribution import NAME
from rigs.schema.vocabulary import ENTRY_POINTS, MakerName


def _packages() -> dict[MakerName, str]:
    """Packages by maker. No other package can take over a maker of rig."""
    packages: dict[MakerName, str] = {}
    for offer in sorted(ENTRY_POINTS.select(group="rig.makers")):
        if offer.name not in packages or (offer.dist and offer.dist.name == NAME):
            packages[offer.name] = offer.value
    return packages


def _letters(word: str) -> str:
    return "".join(char for char in word.casefold() if char.isalnum())


PACKAGES = _packages()
MAKERS: tuple[MakerName, ...] = tuple(PACKAGES)
_NAMED = {_letters(offer.name): offer.value for offer in ENTRY_POINTS.select(group="rig.maker_names")}
_NAMED |= {_letters(maker): maker for maker in MAKERS}


def maker_named(word: str) -> MakerName | None:
    """Maker for a common spelling: UR, Universal Robots and UR10e are ur; None for other words."""
    names = [name for name in _NAMED if _letters(word).startswith(name)]
    return _NAMED[max(names, key=len)] if names else None


def maker_of(interface: str) -> MakerName | None:
    """Maker whose name begins the name of an interface; None for a general interface."""
    return next((maker for maker in MAKERS if f"{interface}_".startswith(f"{maker}_")), None)
