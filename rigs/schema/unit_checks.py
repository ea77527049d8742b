"""Checks for values of a rig file that were written in metres or radians. Each raises ValueError with the remedy.

Unnoticed, a wrong unit shows only in its consequences: a target out of reach, or a table that fits no arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigs.schema.part import MM_PER_M, Vector

_LEAST_MM = 1.0
"""Least length of a tool, of a ball on it, and between two gauges. Chosen: the longest tools have 1 m, 1.0 in metres,
and the plunger of a gauge has 8 mm.
"""
_LEAST_MM_S = 0.5
"""Least speed on a circle. Chosen: a lap of 70 mm then takes a quarter of an hour."""
_LEAST_SHARE = 0.01
"""Least distance of a path from the base, as a share of the reach. Metres in place of millimetres give a thousandth."""
_WIDEST_LIMITS = 10.0
"""Largest joint limit that is read as radians, if no axis of the arm has a larger one. Chosen: ± 1.6 turns."""
SLOWEST_DEG_S = 10.0
"""Speed that no axis of an arm of the library falls below; radians per second are below it."""
_MOST_QUARTERS = 4
_ROUNDED_RAD, _EXACT_RAD = 0.002, 0.00025
"""Rounding of a quarter of a turn in radians: 1.57 and 3.14 if all angles are quarters, otherwise 1.571 and 1.5708."""


def _looks_like_metres(written: str, fact: str, in_mm: str) -> ValueError:
    return ValueError(f"{written} {fact}; it looks like metres: multiply it by {MM_PER_M} and write {in_mm}")


def _vector(place: Vector, factor: float = 1.0) -> str:
    return f"[{', '.join(f'{factor * value:g}' for value in place)}]"


def place_not_in_metres(place: Vector) -> Vector:
    """A place on the flange in mm unchanged. Raises ValueError if no coordinate reaches 1 mm."""
    if 0 < max(map(abs, place)) < _LEAST_MM:
        fact = f"has no coordinate of {_LEAST_MM:g} mm or more"
        raise _looks_like_metres(_vector(place), fact, _vector(place, MM_PER_M))
    return place


def not_in_metres(value: object) -> object:
    """A length in mm unchanged. Raises ValueError below 1 mm."""
    if isinstance(value, int | float) and 0 < abs(value) < _LEAST_MM:
        raise _looks_like_metres(f"{value:g} mm", "is too short", f"{MM_PER_M * value:g}")
    return value


def speed_not_in_metres(value: object) -> object:
    """A speed in mm/s unchanged. Raises ValueError below 0.5 mm/s, if it is a possible speed in m/s."""
    if isinstance(value, int | float) and _LEAST_MM_S <= MM_PER_M * value < MM_PER_M * _LEAST_MM_S:
        raise ValueError(
            f"{value:g} mm/s is too slow; it looks like metres per second: multiply it by {MM_PER_M} and write "
            f"{MM_PER_M * value:g}"
        )
    return value


def refuse_baseline_in_metres(baseline_mm: float, offsets_mm: Sequence[float]) -> None:
    if 0 < baseline_mm < _LEAST_MM:
        written = f"offset_mm {' and '.join(f'{value:g}' for value in offsets_mm)}"
        in_mm = " and ".join(f"{MM_PER_M * value:g}" for value in offsets_mm)
        raise _looks_like_metres(written, f"put g1 and g2 {baseline_mm:g} mm apart", in_mm)


def refuse_centre_in_metres(key: str, centre_mm: Vector, reach_mm: float) -> None:
    """Refuse a centre inside the base of an arm with a reach, in the frame of its base."""
    distance_mm = math.hypot(*centre_mm)
    is_placeholder = all(value.is_integer() for value in centre_mm)
    if 0 < distance_mm < _LEAST_SHARE * reach_mm and not is_placeholder:
        fact = f"is {distance_mm:.2g} mm from the origin, inside the base of the arm"
        raise _looks_like_metres(f"{key} {_vector(centre_mm)}", fact, _vector(centre_mm, MM_PER_M))


def refuse_angles_in_radians(key: str, angles_deg: Sequence[float]) -> None:
    """Refuse angles of which one is a quarter of a turn in radians to four digits, or several to three digits."""
    turned = [angle for angle in angles_deg if angle]
    quarters = [angle for angle in turned if _is_quarter(angle, _EXACT_RAD)]
    if len(turned) > 1 and all(_is_quarter(angle, _ROUNDED_RAD) for angle in turned):
        quarters = turned
    if quarters:
        in_deg = 90 * round(quarters[0] / (math.pi / 2))
        raise ValueError(
            f"{key} {quarters[0]:g} is {in_deg}° in radians; write it in degrees: multiply by {math.degrees(1):.4f}"
        )


def _is_quarter(angle: float, rounded_rad: float) -> bool:
    quarters = round(angle / (math.pi / 2))
    return 0 < abs(quarters) <= _MOST_QUARTERS and abs(angle - quarters * math.pi / 2) < rounded_rad


def refuse_limits_in_radians(limits_deg: Sequence[tuple[float, float]]) -> None:
    largest = max(max(map(abs, limits)) for limits in limits_deg)
    if largest <= _WIDEST_LIMITS:
        raise ValueError(
            f"limits_deg let no axis turn by more than {largest:g}°; they look like radians: multiply them by "
            f"{math.degrees(1):.4f}"
        )
