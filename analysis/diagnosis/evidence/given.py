"""Effects requested by the user, as NAME:PLACE,NAME:PLACE, or by name only.

If the place is omitted, the name means all axes, or both gauges. Each effect defines the notation of its place.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product

from rigs.effects import VOCABULARY, Effect, one_sided
from rigs.errors import UseError
from rigs.schema.effect import healthy, is_wave, name_of, phases, scaled

_AXES = ("axis", "from_axis", "to_axis")


def parse_effects(words: str, axes: int = 6, option: str = "--fit") -> list[Effect]:
    """Parse a list of effects for an arm, each once, at zero or, if non-negative, half a healthy size. Raises
    UseError, which names the option.
    """
    effects: list[Effect] = []
    for word in filter(None, map(str.strip, words.split(","))):
        name, _, place = word.partition(":")
        if name not in VOCABULARY:
            raise UseError(f"{option} {word}", "is not a known effect", f"write one of {', '.join(VOCABULARY)}")
        written = VOCABULARY[name].PLACE
        match = re.fullmatch(written.pattern, place, re.ASCII)
        if not match:
            example = f"{name}:{written.example}" if written.example else name
            raise UseError(f"{option} {word}", f"{place!r} is not a place of {name}", f"write {example}")
        every = {**written.every, "axis": [str(axis) for axis in range(1, axes + 1)]}
        keys = {key: (value,) if value is not None else every[key] for key, value in match.groupdict().items()}
        if any(int(value) > axes for key, (value, *_) in keys.items() if key in _AXES):
            raise UseError(f"{option} {word}", f"the arm has {axes} axes", "name one of these axes")
        for values in product(*keys.values()):
            try:
                effect = VOCABULARY[name].model_validate(dict(zip(keys, values, strict=True)))
            except ValueError:
                raise UseError(
                    f"{option} {word}", f"is outside the range of {name}", "see docs/rig-file-reference.md"
                ) from None
            effects += phases(scaled(healthy(effect), 0.5 if one_sided(effect) else 0.0))
    if not effects:
        raise UseError(option, "does not name an effect", f"write some of {', '.join(VOCABULARY)}")
    return list(dict.fromkeys(effects))


def given_effects(words: str, axes: int = 6, option: str = "--fit") -> list[Effect]:
    """The distinct effects of a list; a wave has the initial phase of the fit. Raises UseError."""
    effects = parse_effects(words, axes, option)
    quarters = {quarter for effect in effects for quarter in phases(effect)[1:]}
    return [effect for effect in effects if effect not in quarters or not is_wave(effect)]


def without_fixed(given: Sequence[Effect], words: str, axes: int = 6) -> tuple[list[Effect], list[Effect]]:
    """Split the effects of --fit into those that remain to be fitted and those that --fix names in `words`. Raises
    UseError.
    """
    fixed = given_effects(words, axes, "--fix")
    if unused := [effect for effect in fixed if effect not in given]:
        problem = f"{name_of(unused[0])} is not fitted by --fit"
        raise UseError(f"--fix {words}", problem, "leave it out; --fix excludes effects that --fit names")
    kept = [effect for effect in given if effect not in fixed]
    if not kept:
        raise UseError(f"--fix {words}", "excludes every effect of --fit", "name fewer effects")
    return kept, fixed
