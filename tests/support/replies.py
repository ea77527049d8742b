"""Requests and possible replies of each gauge according to its manual, with the expected values or faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import daq.gauges
from daq.protocol.conversation import FaultKind
from tests.support.drivers import gauge
from tests.support.simulated_conversation import Script

GARBLED, DEVICE_ERROR, MISSING = FaultKind.GARBLED, FaultKind.DEVICE_ERROR, FaultKind.MISSING


@dataclass(frozen=True)
class ExpectedFault:
    """An expected fault: its kind, and words in its message."""

    kind: FaultKind
    words: tuple[str, ...]


def error(*words: str) -> ExpectedFault:
    return ExpectedFault(DEVICE_ERROR, words)


def missing(*words: str) -> ExpectedFault:
    return ExpectedFault(MISSING, words)


def wrong_unit(shown: str, units: str = "mm") -> ExpectedFault:
    return ExpectedFault(
        DEVICE_ERROR, (f"reads in {shown}", f"file has {units};", "switch the gauge, or correct `units`")
    )


NONSENSE = ExpectedFault(GARBLED, ("is not a reading; check the line settings",))


@dataclass(frozen=True)
class GaugeReplies:
    """A gauge, its request, and each reply with the expected values in mm or the expected fault."""

    gauges: tuple[Any, ...]
    request: bytes
    replies: dict[bytes, tuple[float, ...] | float | ExpectedFault]
    before: tuple[bytes, bytes] | None = None
    """An earlier request and its reply."""

    def begun(self) -> Script:
        """Return the conversation just after the request has been sent."""
        script = Script(daq.gauges.host(self.gauges))
        script.wake()
        if self.before:
            request, reply = self.before
            assert script.sent == request
            script.sent = b""
            script.receive(reply)
        assert script.sent == self.request
        script.sent = b""
        assert script.taken() == []
        return script


def one(
    interface: str,
    request: bytes,
    replies: dict[bytes, Any],
    before: tuple[bytes, bytes] | None = None,
    **changes: object,
) -> GaugeReplies:
    return GaugeReplies((gauge(interface, **changes),), request, replies, before)


POLLED: dict[str, GaugeReplies] = {
    "tesa mm": one(
        "tesa_tt",
        b"?\r",
        {
            b"+0012.34\r\n": 12.34,
            b"-0000.01\r\n": -0.01,
            b"+1.2345\r\n": 1.2345,
            b"+123.456\r\n": wrong_unit("um"),
            b"ERR23\r\n": error("ERR23", "manual"),
            b"ERR1\r\n": error("ERR1"),
            b"0012.34\r\n": NONSENSE,
            b"+0012,34\r\n": NONSENSE,
            b"\r\n": NONSENSE,
        },
    ),
    "tesa um": one(
        "tesa_tt", b"?\r", {b"-123.456\r\n": -0.123456, b"-0123.45\r\n": wrong_unit("mm", "um")}, units="um"
    ),
    "c1202": one(
        "mahr_c1202",
        b"M1?\r",
        {
            b"1 +012.34 mm\r": 12.34,
            b"1 -000.01 mm >\r": -0.01,
            b"1 +000.01 mm = <\r": 0.01,
            b"1 +012.34 um\r": wrong_unit("um"),
            b"1 +012.34 inch\r": wrong_unit("inch"),
            b"1 +012.34 deg\r": wrong_unit("'deg'"),
            b"1 ERR6\r": error("feature 1 is deactivated", "`channel`"),
            b"ERR6\r": error("deactivated"),
            b"1 ERR1\r": error("ERR1"),
            b"2 +012.34 mm\r": missing("feature 1 is missing", "`channel`"),
            b"1 +012:34:56 dms\r": NONSENSE,
            b"1 012.34 mm\r": NONSENSE,
            b"1 +012.34\r": NONSENSE,
        },
    ),
    "c1202 feature 3 in inch": one("mahr_c1202", b"M3?\r", {b"3 +001.00 inch\r": 25.4}, channel=3, units="inch"),
    "c1202 two": GaugeReplies(
        (gauge("mahr_c1202", channel=1), gauge("mahr_c1202", channel=3)),
        b"?\r",
        {
            b"1 +012.34 mm;2 ERR6;3 -000.56 mm =\r": (12.34, -0.56),
            b"1 +012.34 mm;2 ERR6;3 -000.56\r": NONSENSE,
        },
    ),
    "c1208 optorsd": one(
        "mahr_c1208",
        b"?\r",
        {
            b"012.345mm\r\n": 12.345,
            b"-000.001mm\r\n": -0.001,
            b"012.345um\r\n": wrong_unit("um"),
            b"012.345in\r\n": wrong_unit("inch"),
            b"012.345\r\n": NONSENSE,
            b"M1, 012.345\r\n": NONSENSE,
        },
    ),
    "c1208 m1240": one(
        "mahr_c1208",
        b"M\r",
        {b"M1, 012.345\r": 12.345, b"M1, -012.345\r": -12.345, b"M2, 012.345\r": NONSENSE},
        protocol="m1240",
    ),
    "nd281b": one(
        "heidenhain_nd281b",
        b"\x02",
        {
            b"-      5.23  =A\r\n": -5.23,
            b"-      5.23   =A\r\n": NONSENSE,
            b"+    5.2345    \r\n": 5.2345,
            b"+    5.2345   ?A\r\n": NONSENSE,
            b"+    5.2345 ?  \r\n": error("reports a fault"),
            b'+   5.23456 "  \r\n': wrong_unit("inch"),
            b"+    5.2345   S\r\n": error("minimum", "ACTL"),
            b"+    5.2345   G\r\n": error("maximum", "ACTL"),
            b"+    5.2345  =D\r\n": error("difference", "ACTL"),
            b"     5.2345    \r\n": NONSENSE,
            b"+   5.2345    \r\n": NONSENSE,
        },
    ),
    "nd281b inch": one("heidenhain_nd281b", b"\x02", {b'+   1.00000 "  \r\n': 25.4}, units="inch"),
    "nd287": one(
        "heidenhain_nd287",
        b"\x1bA0100\r",
        {
            b"\x02-12345.6789\r\n": -12345.6789,
            b"\x02    12.3456\r\n": 12.3456,
            b"\x02+   12.3456\r\n": 12.3456,
            b"\x02FORMAT.ERR.  \r\n": error("FORMAT.ERR.", "close the dialog"),
            b"\x15": error("command rejected"),
            b"\x15\r\n": error("command rejected"),
            b"    12.3456\r\n": NONSENSE,
            b"\x02  12.345\r\n": NONSENSE,
        },
        before=(b"\x1bA0800\r", b"\x0200010012\r\n"),
    ),
    "magnescale lt": one(
        "magnescale_lt",
        b"R\r\n",
        {
            b"A+12.3456\r\n": 12.3456,
            b"A-00.0001\r\n": -0.0001,
            b"ANM+12.3456\r\n": 12.3456,
            b"ANMG-12.3456\r\n": -12.3456,
            b"A+12.3456 B-01.0000\r\n": 12.3456,
            b"A+12.3456 BE\r\n": 12.3456,
            b"APM+12.3456\r\n": error("peak-to-peak", "current value"),
            b"AIMG+12.3456\r\n": error("minimum"),
            b"AAM+12.3456\r\n": error("maximum"),
            b"ANI+12.3456\r\n": wrong_unit("inch"),
            b"A+F2.3456\r\n": error("overflow"),
            b"A-F2.3456 B+01.0000\r\n": error("overflow"),
            b"AEF\r\n": error("overflow"),
            b"ANME+F2.3456\r\n": error("overflow"),
            b"AE\r\n": error("alarm"),
            b"AEO\r\n": error("alarm"),
            b"AE BE\r\n": error("alarm"),
            b"ANME  Error \r\n": error("alarm"),
            b"B+12.3456\r\n": missing("channel A", "`channel`"),
            b"A+2.3456\r\n": NONSENSE,
            b"A12.3456\r\n": NONSENSE,
            b"+12.3456\r\n": NONSENSE,
        },
    ),
    "magnescale lt two": GaugeReplies(
        (gauge("magnescale_lt", channel=2), gauge("magnescale_lt", channel=1)),
        b"R\r\n",
        {
            b"A-12.3456 B+67.8910\r\n": (67.891, -12.3456),
            b"A-12.3456 B+67.891\r\n": NONSENSE,
            b"AE BE\r\n": error("alarm"),
            b"ANME  Error  BNME  Error \r\n": error("alarm"),
        },
    ),
    "magnescale mg80": one(
        "magnescale_mg80",
        b"D\r\n",
        {
            b"01NMG+12.3456\r\n": 12.3456,
            b"01NML-99.9999\r\n": -99.9999,
            b"01NME+F0.0000\r\n": error("overflow"),
            b"01NME-F0.0000\r\n": error("overflow"),
            b"01NME  Error \r\n": error("alarm"),
            b"01PMG+12.3456\r\n": error("peak-to-peak"),
            b"01NIG+12.3456\r\n": wrong_unit("inch"),
            b"02NMG+12.3456\r\n": missing("'02'", "`address`"),
            b"01NMG+2.3456\r\n": NONSENSE,
        },
    ),
    "mitutoyo usb": one(
        "mitutoyo_usb",
        b"1\r",
        {
            b"01A+0000.123\r": 0.123,
            b"01A-12.3455\r": -12.3455,
            b"911\r": error("911"),
            b"01A0000.123\r": NONSENSE,
            b"1A+0000.123\r": NONSENSE,
        },
    ),
    "qm-height": one(
        "mitutoyo_qm_height",
        b"1\r",
        {
            b"01A+0000.123\r": 0.123,
            b"01A-0000.125\r": -0.125,
            b"01A+00.12345\r": wrong_unit("inch"),
            b"01A+000.1234\r": wrong_unit("inch"),
            b"01A+000.123\r": NONSENSE,
            b"01A+00000.12\r": NONSENSE,
            b"911\r": error("911"),
        },
    ),
    "qm-height inch": one(
        "mitutoyo_qm_height",
        b"1\r",
        {b"01A+00.12345\r": 0.12345 * 25.4, b"01A+0000.123\r": wrong_unit("mm", "inch")},
        units="inch",
    ),
    "cdi": one(
        "cdi_iq",
        b"R\r",
        {
            b"+  2.1380, MM\r\n": 2.138,
            b"-000.0010, MM\r\n": -0.001,
            b"+  2.1380, IN\r\n": wrong_unit("inch"),
            b"NOT FOUND\r\n": error("NOT FOUND", "does not know"),
            b"NO ACCESS\r\n": error("NO ACCESS"),
            b"+ 2.1380, MM\r\n": NONSENSE,
            b"+        , MM\r\n": NONSENSE,
            b"+12345678, MM\r\n": NONSENSE,
        },
    ),
}
