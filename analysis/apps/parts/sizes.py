"""Dimensions of printed parts for commercial balls, magnets and screws.

A ball touches its cone of 90 degrees on a circle at 0.71 of its radius, and not the magnet below, so printing errors
elsewhere have no influence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.apps.parts.solid import Profile, Solid, bar, turned
from rigs.errors import UseError
from rigs.rig import Rig

Size = tuple[float, float]
_SCREWS: dict[str, Size] = {"M3": (3.4, 6.7), "M4": (4.5, 9.0), "M5": (5.5, 11.2)}
"""In mm: clearance hole (ISO 273, medium) and head of a countersunk screw (ISO 10642)."""
_TAPPED_MM, _TAPPED_DEEP_MM = 5.0, 14.0
"""An M6 screw cuts its thread into the plastic (core hole of ISO 965: 5.0 mm)."""
_GAP_MM = 0.5
"""Gap between ball and magnet: one or two layers of a printer."""
_CLEAR_MM = 0.15
"""Radial clearance of bores, usual for filament printers."""
_RIM_MM, _WALL_MM, _FLOOR_MM = 2.0, 3.0, 3.0
"""Cone outside the contact circle, wall, and floor below a screw head."""
_FOOT_MM, _FOOT_RADIUS_MM, _NECK_MM = 6.0, 15.0, 1.5
"""Holder's foot, and difference of radius between cup and neck."""
_SHELF_MM = 1.0
"""Shelf that stops a magnet in a bore with a conical ceiling; a printer can bridge it."""
_SHORTEST_HOLDER_MM, _LONGEST_HOLDER_MM = 35.0, 150.0
DISTANCE_MM = 100.0
BED_MM = 220.0
"""Longer parts are not written."""


@dataclass(frozen=True)
class Bought:
    ball_mm: float = 20.0
    magnet_mm: Size = (10.0, 5.0)
    """Diameter and height."""
    screw: str = "M4"


@dataclass(frozen=True)
class Seat:
    """Heights above the apex of the cone in mm; at 90 degrees the radius equals the height."""

    centre: float
    contact: float
    rim: float
    magnet_top: float
    bore: float

    @property
    def outside(self) -> float:
        return self.rim + _WALL_MM


@dataclass(frozen=True)
class PrintedPart:
    name: str
    count: int
    solid: Solid
    section: Profile
    """Corners (radius, height) in mm for the drawing."""
    about: str
    numbers: dict[str, float]


def seat_of(bought: Bought) -> Seat:
    """Raises UseError if the magnet is too wide for the ball."""
    radius = bought.ball_mm / 2
    centre, contact = radius * math.sqrt(2), radius / math.sqrt(2)
    bore = bought.magnet_mm[0] / 2 + _CLEAR_MM
    if bore > contact - 1:
        magnet_mm = bought.magnet_mm[0]
        what = f"with a magnet of {magnet_mm:g} mm, a ball of {bought.ball_mm:g} mm would not rest on the cone"
        raise UseError(
            "--magnet-mm",
            what,
            f"choose a magnet of at most {2 * (contact - 1 - _CLEAR_MM):.0f} mm",
            code="parts.impossible",
        )
    return Seat(centre, contact, contact + _RIM_MM, centre - radius - _GAP_MM, bore)


def parts_of(rig: Rig, bought: Bought) -> tuple[PrintedPart, ...]:
    """Raises UseError if a dimension is impossible."""
    touch, circle = rig.tests.touch, rig.tests.circle
    distance_mm = touch.distances[0].distance_mm if touch and touch.distances else DISTANCE_MM
    sockets = max(len(touch.sockets) - 2, 0) if touch else 1
    parts = [_holder(bought, abs(touch.ball_mm[2]) if touch else 0.0)]
    if sockets:
        parts.append(_socket(bought, sockets))
    if distance_mm + 2 * seat_of(bought).outside <= BED_MM:
        parts.append(_bar(bought, distance_mm))
    for name, length_mm in (("link", circle.radius_mm if circle else None), ("long-link", _long_mm(rig))):
        if length_mm is not None and length_mm <= BED_MM:
            parts.append(_link(bought, name, length_mm))
    return tuple(parts)


def remarks_of(rig: Rig, bought: Bought) -> list[str]:
    lengths = {"the long link": _long_mm(rig)}
    if rig.tests.touch and rig.tests.touch.distances:
        lengths["the bar of two sockets"] = rig.tests.touch.distances[0].distance_mm + 2 * seat_of(bought).outside
    remarks = [
        f"{name} is {length:g} mm long, but a typical print bed only {BED_MM:g} mm: screw two sockets to a "
        "flat bar of steel or aluminium, and measure over the balls"
        for name, length in lengths.items()
        if length is not None and length > BED_MM
    ]
    if rig.tests.touch and (aside_mm := math.hypot(*rig.tests.touch.ball_mm[:2])):
        remarks.append(f"in the rig file the ball is {aside_mm:.0f} mm off the tool's axis: mount the holder there")
    return remarks


def _long_mm(rig: Rig) -> float | None:
    return rig.tests.hemisphere.radius_mm if rig.tests.hemisphere else None


def _hole(bought: Bought) -> list[tuple[float, float]]:
    """From the rim downwards: cone, bore of the magnet, and countersunk screw, with heights above the bed."""
    seat = seat_of(bought)
    if bought.screw not in _SCREWS:
        raise UseError(
            "--screw", f"{bought.screw} is not one of {', '.join(_SCREWS)}", "give one of them", code="parts.unknown"
        )
    clearance, head = (diameter / 2 for diameter in _SCREWS[bought.screw])
    if head > seat.bore:
        what = f"the head of an {bought.screw} does not fit through the bore for a magnet of {bought.magnet_mm[0]:g} mm"
        raise UseError("--screw", what, "choose a smaller screw or a wider magnet", code="parts.impossible")
    floor = seat.magnet_top - bought.magnet_mm[1]
    bottom = floor - (head - clearance) - _FLOOR_MM
    inside = [(seat.rim, seat.rim), (seat.bore, seat.bore), (seat.bore, floor), (head, floor)]
    inside += [(clearance, floor - (head - clearance)), (clearance, bottom)]
    return [(radius, height - bottom) for radius, height in inside]


def _socket(bought: Bought, count: int) -> PrintedPart:
    seat, hole = seat_of(bought), _hole(bought)
    outside = [(seat.outside, 0.0), (seat.outside, hole[0][1])]
    section = [*reversed(outside), *reversed(hole)]
    about = f"screwed to the cell with an {bought.screw} from above, then the magnet is glued in; print upright"
    return PrintedPart("socket", count, turned(section), section, about, _socket_numbers(bought))


def _socket_numbers(bought: Bought) -> dict[str, float]:
    seat, hole = seat_of(bought), _hole(bought)
    top = hole[0][1]
    return {
        "ball": bought.ball_mm, "height": top, "ball's centre above the foot": top + seat.centre - seat.rim,
        "outside diameter": 2 * seat.outside, "bore of the magnet": 2 * seat.bore,
        "bore for the screw": 2 * hole[-1][0],
    }  # fmt: skip


def _bar(bought: Bought, distance_mm: float) -> PrintedPart:
    seat, hole = seat_of(bought), _hole(bought)
    top = hole[0][1]
    section = [(seat.outside, top), (seat.outside, 0.0), *reversed(hole)]
    numbers = {"distance of the sockets": distance_mm, "over both balls": distance_mm + bought.ball_mm}
    numbers |= {"length": distance_mm + 2 * seat.outside, "width": 2 * seat.outside} | _socket_numbers(bought)
    about = "two sockets in a single piece, also used to set the length of a link: measure over both balls"
    return PrintedPart("bar", 1, bar(hole, distance_mm, seat.outside), section, about, numbers)


def _holder(bought: Bought, asked_mm: float) -> PrintedPart:
    """Holder of the tool's ball, as high as the rig file states, within the printable range."""
    seat = seat_of(bought)
    height = min(max(asked_mm, _SHORTEST_HOLDER_MM), _LONGEST_HOLDER_MM)
    rim = height - (seat.centre - seat.contact)
    neck, tapped = seat.contact + _NECK_MM, _TAPPED_MM / 2
    foot = max(_FOOT_RADIUS_MM, neck)
    section = [
        (0.0, rim - seat.contact), (seat.contact, rim), (seat.contact + _RIM_MM, rim), (neck, rim - _WALL_MM),
        (neck, _FOOT_MM), (foot, _FOOT_MM), (foot, 0.0), (tapped, 0.0),
        (tapped, _TAPPED_DEEP_MM), (0.0, _TAPPED_DEEP_MM + tapped),
    ]  # fmt: skip
    numbers = {
        "ball": bought.ball_mm, "ball's centre above the foot": height, "hole for the M6": _TAPPED_MM,
        "neck": 2 * neck, "foot": 2 * foot,
    }  # fmt: skip
    about = "on the tool or in the gripper, with an M6 from below; the ball is glued into the cone with epoxy"
    return PrintedPart("holder", 1, turned(section), section, about, numbers)


def _link(bought: Bought, name: str, length_mm: float) -> PrintedPart:
    """Rod with a cone at each end, which keeps the balls at the radius of the test.

    The lower bore ends in a cone above a shelf, because a flat ceiling would require supports.
    """
    seat = seat_of(bought)
    top = length_mm / 2 - (seat.centre - seat.rim)
    depth = seat.rim - (seat.magnet_top - bought.magnet_mm[1])
    shelf = seat.bore - _SHELF_MM
    if 2 * (top - depth) - shelf < _FLOOR_MM:
        what = f"a link of {length_mm:g} mm has no space for two magnets of {bought.magnet_mm[1]:g} mm"
        raise UseError("--magnet-mm", what, "choose thinner magnets", code="parts.impossible")
    upper = [(0.0, top - depth), (seat.bore, top - depth), (seat.bore, top - (seat.rim - seat.bore)), (seat.rim, top)]
    upper.append((seat.outside, top))
    lower = [(radius, -height) for radius, height in reversed(upper[1:])]
    whole = [*upper, *lower, (shelf, depth - top), (0.0, depth - top + shelf)]
    section = [(radius, height + top) for radius, height in whole]
    numbers = {"ball": bought.ball_mm, "ball to ball": length_mm, "length": 2 * top, "diameter": 2 * seat.outside}
    about = "to lead the arm around the ball by hand (rig circle fit, rig ball fit); plastic is no length to measure by"
    return PrintedPart(name, 1, turned(section), section, about, numbers | {"bore of the magnet": 2 * seat.bore})
