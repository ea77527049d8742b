"""Questions about the gauges: ports, identity of gauge 1, and facts known only to the user."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from pydantic import ValidationError

from analysis.apps.commission.init_answers import (
    Answers,
    Changes,
    Options,
    checked,
    key_error,
    read_number,
    with_keys,
)
from analysis.apps.report.texts import texts_of
from analysis.cli.dialogue import Dialogue
from daq.discovery.attempts import FoundGauge, PortReport, named_attempts
from daq.discovery.port_search import SearchOptions, ports_here, search
from daq.discovery.port_watch import PortWatch
from rigs.errors import CellError, FileError, UseError
from rigs.schema.gauges import Gauge
from rigs.schema.part import Part
from rigs.schema.probe import Counts
from rigs.yaml_text import read_yaml

_NAMES = ("g1", "g2")
_NEAREST_MM, _FURTHEST_MM = 10.0, 10_000.0
"""Limits for the distance of two gauges: adjacent stems are 8 mm apart, plus the clamp between them."""
_BODY_MM = 8.0
"""Diameter of the clamping stem of a dial gauge (DIN EN ISO 463)."""
_MOST_SHOWN = 5
"""Number of readings that fit into a line of 80 columns."""
_SIDES = {"g1": "+", "g2": "-"}


def ask_gauges(_: Answers, options: Options, dialogue: Dialogue) -> Changes:
    """Find the gauges, identify g1 and g2, and ask for the keys that only their owner knows."""
    gauges = []
    for name, found in zip(_NAMES, _identify_gauges(_find_gauges(options, dialogue), options, dialogue), strict=False):
        keys = dict(options.keys[name])
        for key in (key for key in found.lacks if key not in keys):
            question = f"{key} of {name} ({found.gauge.origin.instruments})"
            keys[key] = dialogue.ask(question, f"--key {name}.{key}", partial(_key, name, key, found.gauge))
        gauges.append(with_keys(Gauge, found.gauge, keys, name))
    return {"gauges": tuple(gauges)}


def describe_gauge(name: str, gauge: Gauge) -> str:
    place = f"{gauge.port}#{gauge.channel}" if gauge.shares else gauge.port
    which = f"{name} is {place} ({gauge.interface}), on the {_SIDES[name]} side"
    if "counts" in gauge.model_fields_set:
        return f"{which}, and counts {gauge.counts}"
    return f"{which}. Push {name} in. If the number goes up, restart with --key {name}.counts=towards"


_WITHOUT_GAUGES = "without gauges, --measured-by sockets needs only a ball and two sockets"


def ask_baseline(answers: Answers, _: Options, dialogue: Dialogue) -> Changes:
    if len(answers.gauges or ()) < 2:
        return {"baseline_mm": None}

    def read(text: str) -> float:
        remedy = f"type a number from {_NEAREST_MM:g} in mm, such as 50"
        positive = math.ulp(0.0)
        return check_baseline_mm(read_number(text, positive, _FURTHEST_MM, "a distance in mm", remedy), repr(text))

    return {"baseline_mm": dialogue.ask(texts_of("en")("ask_baseline"), "--baseline-mm", read, "50")}


def reports_of(ports: Sequence[str], options: Options, doing: Callable[[str], None]) -> list[PortReport]:
    named = {}
    for name, place in zip(_NAMES, options.places, strict=False):
        if "interface" in options.keys[name]:
            port = place.partition("#")[0]
            try:
                named[port] = named_attempts({**options.keys[name], "port": port})
            except ValidationError as error:
                raise key_error(error, name) from None
    return search(SearchOptions(tuple(ports), named, options.listen_s, options.modbus_units), doing)


def ports_of(options: Options) -> list[str]:
    return list(dict.fromkeys([*options.ports, *(place.partition("#")[0] for place in options.places)]))


def _selected_ports(ports: Sequence[str], typed: str) -> list[str]:
    if typed.lower() == "all":
        return list(ports)
    numbers = typed.replace(",", " ").split()
    if not numbers or not all(number.isdecimal() and 1 <= int(number) <= len(ports) for number in numbers):
        problem = f"is not a list of numbers from 1 to {len(ports)}"
        raise FileError(repr(typed), problem, "type numbers such as 1,2, or all", code="usage")
    return [ports[place] for place in dict.fromkeys(int(number) - 1 for number in numbers)]


def describe_port(report: PortReport, numbers: dict[str, int]) -> list[str]:
    """Lines about a port. numbers: number of each gauge in the list, by place."""
    if not report.gauges:
        described = f" ({report.description})" if report.description else ""
        return [f"  - {report.port}{described}: {report.problem}", f"      {report.remedy}"]
    lines = []
    for gauge in report.gauges:
        unit = "% of the range" if gauge.lacks else "mm"
        also = f"; {', '.join(gauge.also)} also match" if gauge.also else ""
        lines.append(f"  {numbers[gauge.place]} {gauge.place}")
        kind = f"{gauge.gauge.interface}, {gauge.gauge.line}, {gauge.rate_hz:.0f} readings a second"
        lines.append(f"      {kind}: {gauge.reading_mm:+z.4f} {unit}{also}")
    return lines


def _find_gauges(options: Options, dialogue: Dialogue) -> list[FoundGauge]:
    while True:
        ports, here = ports_of(options), ports_here()
        if not ports and (here or not dialogue.terminal):  # the user has to approve each port
            for number, (port, description) in enumerate(here.items(), 1):
                dialogue.say(f"  {number} {port}{f' ({description})' if description else ''}")
            if not dialogue.terminal:
                problem = "is missing, and rig cannot ask without a terminal"
                remedy = f"give --port; {_WITHOUT_GAUGES}"
                raise UseError("--port", problem, remedy, code="answer.missing")
            ports = dialogue.ask(texts_of("en")("ask_ports"), "--port", partial(_selected_ports, list(here)))
        with dialogue.busy("looking at the ports") as doing:
            reports = reports_of(ports, options, doing)
        gauges = [gauge for report in reports for gauge in report.gauges]
        numbers = {gauge.place: number for number, gauge in enumerate(gauges, 1)}
        for report in reports:
            for line in describe_port(report, numbers):
                dialogue.say(line)
        if len(gauges) > 1 or options.places or (gauges and not dialogue.terminal):
            return gauges
        problem = "one answers" if gauges else "none answers" if reports else "a serial port was not found"
        remedy = "connect and switch on the gauge, or name the port: --port PORT; " + _WITHOUT_GAUGES
        if not dialogue.terminal:
            raise CellError("gauges", problem, remedy, code="gauge.silent")
        dialogue.say(f"gauges: {problem}; {remedy}")
        prompt = "Enter repeats the search" + ("; type 1 to continue with this gauge only: " if gauges else ": ")
        if dialogue.line(prompt) == "1" and gauges:
            return gauges


def _identify_gauges(gauges: Sequence[FoundGauge], options: Options, dialogue: Dialogue) -> list[FoundGauge]:
    by_place = {gauge.place: gauge for gauge in gauges}
    if options.places:
        return [_gauge_at(place, by_place) for place in options.places]
    if not dialogue.terminal and len(gauges) == 1:
        return list(gauges)
    if not dialogue.terminal:
        problem = f"{len(gauges)} gauges answer ({', '.join(by_place)}), and their roles are unknown"
        raise FileError("gauges", problem, "name the gauges: --g1 PORT --g2 PORT", code="rig_file.invalid")
    with PortWatch(gauges) as watch:
        remaining = {str(number): gauge for number, gauge in enumerate(gauges, 1)}
        first = _wait_for_push("g1", remaining, watch, dialogue)
        is_typed = "counts" not in first.gauge.model_fields_set  # then the user pushes no gauge
        if not remaining or (len(remaining) == 1 and is_typed):
            return [first, *remaining.values()]
        return [first, _wait_for_push("g2", remaining, watch, dialogue)]


def _gauge_at(place: str, by_place: dict[str, FoundGauge]) -> FoundGauge:
    matching = [gauge for name, gauge in by_place.items() if place in (name, gauge.gauge.port)]
    if len(matching) == 1:
        return matching[0]
    if not matching:
        remedy = f"give a port with a gauge: {', '.join(by_place)}"
        raise CellError(place, "a gauge does not answer there", remedy, code="gauge.silent")
    remedy = f"add the channel: {', '.join(gauge.place for gauge in matching)}"
    raise FileError(place, f"has {len(matching)} gauges", remedy, code="rig_file.invalid")


def _wait_for_push(name: str, remaining: dict[str, FoundGauge], watch: PortWatch, dialogue: Dialogue) -> FoundGauge:
    """Gauge that is pushed or selected by number.

    A push shows the counting direction: the plunger goes in as the tool approaches the ball.
    """
    numbers = {gauge.place: number for number, gauge in remaining.items()}

    def prompt() -> str:
        now_mm = watch.readings_mm()
        shown = [f"{number} {now_mm[place]:+z.4f}" for place, number in numbers.items() if place in now_mm]
        return f"  {'   '.join(shown[:_MOST_SHOWN])}: "

    while True:
        watch.measure_rest()
        otherwise = "press Enter" if len(remaining) == 1 else "type the number"
        dialogue.say(f"Push gauge {name[1]} in, on the {_SIDES[name]} side of the baseline, or {otherwise}:")
        answer = dialogue.line_or(prompt, partial(watch.pushed_gauge, [*numbers]))
        number = numbers.get(answer, answer) or (next(iter(remaining)) if len(remaining) == 1 else "")
        if answer in numbers:
            counts: Counts = "towards" if watch.grows(answer) else "away"
            grew = "grows" if counts == "towards" else "falls"
            dialogue.say(f"{name}: {answer}; its reading {grew} when pushed in, so it counts {counts}")
            gauge = remaining.pop(number)
            return replace(gauge, gauge=gauge.gauge.model_copy(update={"counts": counts}))
        if number in remaining:
            dialogue.say(f"{name}: {remaining[number].place}, not pushed")
            return remaining.pop(number)
        known = ", ".join(remaining)
        dialogue.say(f"error: {answer!r}: is not a remaining gauge; type one of {known}, or push the gauge")


def _key(name: str, key: str, gauge: Part, typed: str) -> Any:
    value = read_yaml(typed, f"{name}.{key}")[1]
    checked(type(gauge), {**gauge.model_dump(mode="json", exclude_unset=True), key: value}, name)
    return value


def check_baseline_mm(value: float, where: str) -> float:
    """The distance between two gauges, unless it is impossibly small."""
    if value < _NEAREST_MM:
        problem = (
            f"is too small for two gauges with bodies of {_BODY_MM:g} mm, and at {value:g} mm an angle of 1 mrad would "
            f"change their difference by only {value * 1e-3:.2g} mm"
        )
        remedy = f"give the distance between the gauge axes in mm (not cm), at least {_NEAREST_MM:g}"
        raise FileError(where, problem, remedy, code="rig_file.invalid")
    return value
