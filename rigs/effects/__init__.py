"""Registry of effects (link side = reported + effect), one per file of this folder, named after the effect.

A file added here, or a class that another package offers under `rig.effects`, becomes an effect of rig files and a
candidate of every simulation, fit, plan, diagnosis and correction. `rigs/schema/effect.py` defines the interface.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache, reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from rigs.schema import plugins
from rigs.schema.effect import AT_AXIS, healthy, size_fields
from rigs.schema.effect import Effect as Effect
from rigs.schema.effect import EffectProvenance as EffectProvenance
from rigs.schema.effect import bounds as bounds
from rigs.schema.effect import healthy_size as healthy_size
from rigs.schema.effect import one_sided as one_sided
from rigs.schema.effect import size_field as size_field


def _class_in(name: str) -> type[Effect]:
    members: list[Any] = list(vars(importlib.import_module(f"{__name__}.{name}")).values())
    for member in members:
        is_effect = isinstance(member, type) and issubclass(member, Effect)
        if is_effect and member.model_fields["effect"].default == name:
            return _require_complete(f"rigs/effects/{name}.py", member)
    raise ImportError(f"rigs/effects/{name}.py: an Effect with the key effect {name!r} is missing")


def _require_complete(name: str, cls: type[Effect]) -> type[Effect]:
    missing = sorted(cls.__abstractmethods__) + ["STAGE"] * (not hasattr(cls, "STAGE"))
    missing += ["CORRECTION"] * (cls.compensation is Effect.compensation and not hasattr(cls, "CORRECTION"))
    missing += ["REMEDY"] * (cls.remedy is Effect.remedy and not hasattr(cls, "REMEDY"))
    has_seat = bool({"axis", "gauge"} & cls.model_fields.keys())
    missing += ["forms"] * (not has_seat and cls.forms.__func__ is Effect.forms.__func__)  # type: ignore[attr-defined]
    if missing := missing + ["its one size"] * (len(size_fields(cls)) != 1):
        raise ImportError(f"{name}: {cls.__name__} does not define {', '.join(missing)}")
    return cls


def _vocabulary() -> dict[str, type[Effect]]:
    found = {file.name: _class_in(file.name) for file in pkgutil.iter_modules(__path__)}
    for name, cls in plugins.offered("rig.effects", Effect, frozenset(found)).items():  # type: ignore[type-abstract]
        try:
            found[name] = _require_complete(name, cls)
        except ImportError as reason:
            plugins.BROKEN[name] = f"the effect {name} of an installed package cannot be used: {reason}"
    return dict(sorted(found.items()))


VOCABULARY = _vocabulary()

if TYPE_CHECKING:
    AnyEffect = Effect
else:
    AnyEffect = Annotated[reduce(or_, VOCABULARY.values()), Field(discriminator="effect")]
    """Any effect of the vocabulary, as a part of a rig file."""


def turned(axis: int, angle_deg: float) -> Effect:
    """Effect that turns a joint (1 … 6) by a constant, for scatter and derivatives."""
    return next(effect for cls in VOCABULARY.values() if (effect := cls.turning(axis, angle_deg)))


def changed(axis: int, key: str, delta: float) -> Effect:
    """Effect that changes a constant of an axis (1 … 6) by delta mm or degrees.

    key: name of the constant in the rig file.
    """
    return next(effect for cls in VOCABULARY.values() if (effect := cls.changing(axis, key, delta)))


def play_of_joint(axis: int, width_deg: float) -> Effect:
    cls = next(cls for cls in VOCABULARY.values() if cls.PLACE == AT_AXIS and cls.STRAIGHT == 0)
    return cls.model_validate({"effect": cls.model_fields["effect"].default, "axis": axis, "width_deg": width_deg})


def swing(frequency_hz: float, amplitude_mm: float) -> Effect:
    return next(effect for cls in VOCABULARY.values() if (effect := cls.swinging(frequency_hz, amplitude_mm)))


@cache
def late_stamps() -> tuple[Effect, ...]:
    names = [name for name, cls in VOCABULARY.items() if cls.STAGE == "time"]
    return tuple(healthy(VOCABULARY[name].model_validate({"effect": name})) for name in names)


def __getattr__(name: str) -> Any:
    for cls in VOCABULARY.values():
        if cls.__name__ == name:
            return cls
    raise AttributeError(name)
