import json
import pkgutil
from typing import Annotated, ClassVar, Literal

import pytest
from pydantic import Field

import daq.gauge_drivers
import daq.robot_drivers
from rigs.interfaces import NO_DEFAULT, list_interfaces, models, name_of
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.part import Origin
from rigs.schema.probe import Probe
from tests.support.command_line import ran


def test_every_driver_is_listed_once():
    drivers = [
        f"{package.__name__}.{module.name}"
        for package in (daq.gauge_drivers, daq.robot_drivers)
        for module in pkgutil.iter_modules(package.__path__)
    ]
    named = [
        getattr(model, "driver", f"{package.__name__}.{name_of(model)}")
        for package, part in ((daq.gauge_drivers, Gauge), (daq.robot_drivers, Feedback))
        for model in models(part)
    ]
    assert sorted(named) == sorted([*drivers, "daq.opc_ua.robotics"])


@pytest.mark.parametrize("interface", list_interfaces(), ids=lambda one: one.name)
def test_every_interface_names_its_source(interface):
    origin = interface.origin
    assert origin.instruments and origin.source
    assert origin.standing == "confirmed" or origin.doubts  # what is not confirmed says what of it
    assert interface.line != NO_DEFAULT or "line settings" in origin.doubts or "baud" in origin.doubts


@pytest.mark.parametrize(
    "interface", [one for one in list_interfaces() if one.kind == "gauge"], ids=lambda one: one.name
)
def test_every_gauge_states_its_latch(interface):
    assert interface.timing and interface.timing_source
    assert interface.timing == "unknown" or "manual" in interface.timing_source


def test_a_class_added_to_a_union_appears_by_itself():
    class Abacus(Probe):
        origin: ClassVar[Origin] = Origin("abacus", "seen", "weak", "all")
        interface: Literal["abacus"]
        beads: int = 10

    class Slate(Probe):
        interface: Literal["slate"]

    assert models(Annotated[Abacus | Slate, Field(discriminator="interface")]) == (Abacus, Slate)


def test_the_command_as_json_and_as_a_table():
    done = ran("interfaces", "--json")
    listed = json.loads(done.stdout)["interfaces"]
    by_name = {one["name"]: one for one in listed}
    assert len(listed) == len(list_interfaces())
    assert by_name["magnescale_lt"]["origin"]["standing"] == "weak"
    assert by_name["heidenhain_nd281b"]["timing"].endswith("within 1 ms")
    assert by_name["tesa_tt"]["line"] == "4800 7E2" and by_name["ur_rtde"]["kind"] == "robot"
    table = ran("interfaces", COLUMNS="160").stdout
    assert all(one.name in table for one in list_interfaces()) and f"{len(listed)} interfaces" in table
