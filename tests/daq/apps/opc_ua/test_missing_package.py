"""Error message for a robot interface that needs a missing package."""

from __future__ import annotations

import sys

import pytest

from daq.acquisition.streams import robot_stream
from rigs.errors import CellError
from tests.support.drivers import opc_ua


def test_a_missing_package_is_named_before_anything_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("daq.apps.opc_ua")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with pytest.raises(CellError, match=r"opc_ua_robotics needs the Python package asyncua.*add it: .*asyncua"):
        robot_stream(opc_ua())
