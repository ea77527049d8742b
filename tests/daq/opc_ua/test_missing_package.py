import sys

from daq.acquisition.streams import robot_stream
from tests.support.drivers import opc_ua
from tests.support.refusals import refused


def test_a_missing_package_is_named_before_anything_is_opened(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("daq.opc_ua")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with refused("package.missing"):
        robot_stream(opc_ua())
