import pkgutil

import pytest

import daq.gauge_drivers
import daq.robot_drivers
from rigs.interfaces import NO_DEFAULT, list_interfaces, models, name_of
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge


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
