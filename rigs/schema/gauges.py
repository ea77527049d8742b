"""Gauges of a rig: instrument, port, and position on the baseline. `interface` names a file in `gauge_drivers`.

Gauges with the same port share an instrument, with different `channel`, or a line on which each is polled separately.
Unconfirmed line settings have no default and must be given in the rig file.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from rigs.schema.links import Line, ModemLines
from rigs.schema.modbus import ModbusMap, SolartronOrbit
from rigs.schema.part import Origin, Part
from rigs.schema.plugins import extended
from rigs.schema.probe import Probe, Timing
from rigs.schema.unit_checks import refuse_baseline_in_metres
from rigs.schema.vocabulary import FURTHER


class SylvacOptoRS(Probe):
    """Sylvac simplex or duplex cable, and compatible cables."""

    ends_in_cr: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="Sylvac simplex and duplex cables (Opto-RS)",
        source="maker's manuals; modem lines: Sylvac Opto instruments, user manual p. 12-13",
        standing="confirmed",
        doubts="whether OUT0 and OUT1 are answered; for simplex cables the required DTR time between two "
        "requests, and the instant of the reading",
    )
    cables: ClassVar[dict[str, ModemLines]] = {
        "duplex": ModemLines(dtr=True, rts=False),
        "simplex": ModemLines(dtr=True, rts=True),
    }

    request_bytes = 2
    interface: Literal["sylvac_opto_rs"]
    line: Line = Line(baud=4800, bits=7, parity="E", stop=2)
    mode: Literal["polled", "continuous"] = "polled"
    cable: Literal["duplex", "simplex"] = "duplex"
    """Kind of cable.

    A simplex cable ignores commands, and is polled by DTR off for 120 ms: about four readings a second.
    """

    @property
    def modem(self) -> ModemLines:
        return self.cables[self.cable]

    @model_validator(mode="after")
    def _timed_as_it_sends(self) -> SylvacOptoRS:
        if self.mode == "continuous" and self.cable == "simplex":
            raise ValueError("a simplex cable cannot receive a command for continuous sending; write mode: polled")
        if self.mode == "continuous":
            self.timing.require_unasked()
        return self


class TesaTT(Probe):
    """TESA TT80, TT90."""

    origin: ClassVar[Origin] = Origin(
        instruments="TESA TT80, TT90",
        source="maker's manual p. 94",
        standing="confirmed",
        doubts="the unit is known only from the number of decimals (mm 2, µm 3); the meaning of ERR23",
    )

    request_bytes = 2
    interface: Literal["tesa_tt"]
    line: Line = Line(baud=4800, bits=7, parity="E", stop=2)
    units: Literal["mm", "um"] = "mm"


class MahrC1202(Probe):
    """Mahr Millimar C1202: up to three features, selected by `channel`. Two gauges may share it."""

    ends_in_cr: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="Mahr Millimar C1202", source="maker's manual p. 82", standing="confirmed"
    )
    shares: ClassVar[bool] = True

    request_bytes = 2
    interface: Literal["mahr_c1202"]
    line: Line = Line(baud=9600, bits=7, parity="E", stop=2)
    channel: int = Field(default=1, ge=1, le=3)


class MahrC1208(Probe):
    """Mahr Millimar C1208, C1216, C1240, in the protocol set in the menu."""

    origin: ClassVar[Origin] = Origin(
        instruments="Mahr Millimar C1208, C1216, C1240",
        source="maker's manual p. 67-70",
        standing="confirmed",
        doubts="line settings; M1240 does not send the unit: `units` must match the display",
    )

    request_bytes = 2
    interface: Literal["mahr_c1208"]
    line: Line
    protocol: Literal["optorsd", "m1240"] = "optorsd"
    """Protocol set in the menu. OPTORSD and OPTORSS use `?`, M1240 uses `M`."""


class HeidenhainND281B(Probe):
    """Heidenhain ND 281 B."""

    origin: ClassVar[Origin] = Origin(
        instruments="Heidenhain ND 281 B",
        source="maker's manual p. 39-42 (p. 47 of version 2)",
        standing="confirmed",
        doubts="9600 is the manual's example, any baud can be set; whether the sign is additional to the 10 characters",
    )

    timing_source = "maker's manual, version 1, p. 42: stored within 1 ms of the request, sent within 50 ms"
    interface: Literal["heidenhain_nd281b"]
    line: Line = Line(baud=9600, bits=7, parity="E", stop=2)
    units: Literal["mm", "inch"] = "mm"
    timing: Timing = Timing(latch="on_request", latched_within_ms=1.0)


class HeidenhainND287(Probe):
    """Heidenhain ND 287, read from the display."""

    origin: ClassVar[Origin] = Origin(
        instruments="Heidenhain ND 287",
        source="maker's manual p. 102-108; public driver (status bar)",
        standing="confirmed",
        doubts="baud; the unit is not sent with a reading but read from the status bar (`ESC A0800`), in the "
        "form used by a public driver; the form of a positive sign",
    )

    request_bytes = 7
    interface: Literal["heidenhain_nd287"]
    line: Line
    units: Literal["mm", "inch"] = "mm"


class KeyenceDLRS1A(Probe):
    """Keyence GT2 heads connected to a DL-RS1A: all heads in a single answer."""

    origin: ClassVar[Origin] = Origin(
        instruments="Keyence DL-RS1A with GT2 heads",
        source="seen on a wire; DL-RS1A/GT2 manual p. 14; public code",
        standing="confirmed",
        doubts="default baud (9600 and 38400 observed); errors 65-67, and the number for out of range, are from "
        "other amplifiers",
    )
    shares: ClassVar[bool] = True

    request_bytes = 4
    timing_source = (
        "DL-RS1A manuals: M0 reads a buffer that is filled periodically, within 7 ms for one amplifier and 9 ms for "
        "two (GT-70A edition p. 15; the figure for GT2 was not found)"
    )
    interface: Literal["keyence_dl_rs1a"]
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)
    channel: int = Field(default=1, ge=1, le=32)
    timing: Timing = Timing(latch="own_cycle", cycle_ms=9.0)


class MagnescaleLT(Probe):
    """Magnescale LT20A or LT30: channel 1 is A, channel 2 is B. Two gauges may share it."""

    origin: ClassVar[Origin] = Origin(
        instruments="Magnescale LT20A, LT30",
        source="replies: LT20A/LT30 manual p. 100-101; request: LT10A/LT11A manual p. 43",
        standing="weak",
        doubts="line settings; the request `R` and CR LF are from the sister series LT10A; the normal output "
        "does not include the unit: `units` must match the display",
    )
    shares: ClassVar[bool] = True

    interface: Literal["magnescale_lt"]
    line: Line
    channel: int = Field(default=1, ge=1, le=2)
    units: Literal["mm", "inch"] = "mm"


class MagnescaleMG80(Probe):
    """Magnescale MG80-SC."""

    origin: ClassVar[Origin] = Origin(
        instruments="Magnescale MG80-SC",
        source="replies: maker's manual p. 39",
        standing="unconfirmed",
        doubts="line settings and the request, which the rig file must give; CR LF; the mode letters are the LT20A's",
    )

    interface: Literal["magnescale_mg80"]
    line: Line
    units: Literal["mm", "inch"] = "mm"
    address: str = Field(pattern=r"^[0-9A-Za-z]{2}$")
    """Module and counter at the start of a reply."""
    request: str = Field(pattern=r"^[ -~]{1,40}$")
    """Request for the value of the counter, excluding CR LF."""


class MitutoyoUSB(Probe):
    """Mitutoyo gauges with a virtual COM port, USB id 0fe7:4001."""

    ends_in_cr: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="Mitutoyo USB virtual COM port (0fe7:4001)",
        source="public code",
        standing="confirmed",
        doubts="8N1; the meaning of the error numbers; the unit is not sent: `units` must match the display",
    )

    request_bytes = 2
    interface: Literal["mitutoyo_usb"]
    line: Line = Line(baud=115200, bits=8, parity="N", stop=1)
    units: Literal["mm", "inch"] = "mm"


class MitutoyoQMHeight(Probe):
    """Mitutoyo QM-Height on the USB port."""

    ends_in_cr: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="Mitutoyo QM-Height",
        source="reply: maker's manual p. 73 (p. 61 of the print)",
        standing="unconfirmed",
        doubts="whether the request `1` of the virtual COM port is understood; errors as for that port",
    )

    request_bytes = 2
    interface: Literal["mitutoyo_qm_height"]
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)
    units: Literal["mm", "inch"] = "mm"


class CDIIQ(Probe):
    """CDI and Starrett IQ indicators, over USB or RS-232."""

    origin: ClassVar[Origin] = Origin(
        instruments="CDI Logic, Starrett IQ",
        source="maker's pages (CDI, USB and RS232 protocol; Starrett IQ manual p. 17)",
        standing="confirmed",
    )

    request_bytes = 2
    interface: Literal["cdi_iq"]
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)
    units: Literal["mm", "inch"] = "mm"


class MicroEpsilonILD1420(Probe):
    """Micro-Epsilon optoNCDT 1420 on RS-422: streaming, with all readings in mm."""

    origin: ClassVar[Origin] = Origin(
        instruments="Micro-Epsilon optoNCDT 1420 (ILD1420)",
        source="maker's manual p. 65, 84, 108",
        standing="confirmed",
        doubts="error codes above 262075; whether a command ends in LF",
    )

    timing_source = (
        "maker's manual p. 57-59: the sensor averages up to 128 values, depending on its settings; state "
        "the resulting delay as filter_ms"
    )
    interface: Literal["micro_epsilon_ild1420"]
    line: Line = Line(baud=921600, bits=8, parity="N", stop=1)
    units: Literal["mm"] = "mm"
    range_mm: float = Field(gt=0, le=1000)  # type: ignore[assignment]  # its length says it all: it begins at 0
    """Measuring range: 10, 25, 50, 100, 200 or 500."""
    zero_mm: float = Field(default=0.0, ge=0, le=1000)
    """Distance from the start of the measuring range that reads as zero."""
    timing: Timing = Timing(latch="streamed")

    @property
    def limits_mm(self) -> None:
        """A transmitted number is within the range, or an error."""

    @model_validator(mode="after")
    def _timed_as_it_sends(self) -> MicroEpsilonILD1420:
        self.timing.require_unasked()
        return self


Gauge = Annotated[
    SylvacOptoRS
    | TesaTT
    | MahrC1202
    | MahrC1208
    | HeidenhainND281B
    | HeidenhainND287
    | KeyenceDLRS1A
    | MagnescaleLT
    | MagnescaleMG80
    | MitutoyoUSB
    | MitutoyoQMHeight
    | CDIIQ
    | MicroEpsilonILD1420
    | ModbusMap
    | SolartronOrbit,
    Field(discriminator="interface"),
]
if not TYPE_CHECKING:
    Gauge = extended(Gauge, "rig.gauges", Probe)


class Gauges(Part):
    """Gauge 1, and gauge 2 for angle tests. All other gauges are only recorded, exported and shown."""

    g1: Gauge
    g2: Gauge | None = None
    g3: Gauge | None = None
    g4: Gauge | None = None
    g5: Gauge | None = None
    g6: Gauge | None = None
    g7: Gauge | None = None
    g8: Gauge | None = None
    baseline_u_mm: float = Field(default=0.05, ge=0, le=100)
    """Standard uncertainty of the distance between the two gauges."""

    @model_validator(mode="after")
    def _check_baseline(self) -> Gauges:
        if self.g2 is None:
            return self
        if self.baseline_mm > 0:
            refuse_baseline_in_metres(self.baseline_mm, (self.g1.offset_mm, self.g2.offset_mm))
            return self
        places = f"g1 at {self.g1.offset_mm:g} mm and g2 at {self.g2.offset_mm:g} mm"
        if self.baseline_mm == 0:
            raise ValueError(f"{places} are at the same position, which cannot measure an angle; correct offset_mm")
        raise ValueError(
            f"{places} are exchanged: g1 must be on the positive side; swap the values of offset_mm, or the ports"
        )

    @model_validator(mode="after")
    def _sharing(self) -> Gauges:
        its_own = {"offset_mm", "channel", "counts", "accuracy_mm", "range_mm", "certificate", "calibrated"}
        for (first_name, first), (second_name, second) in combinations(self.recorded.items(), 2):
            if first.port != second.port:
                continue
            if first.interface == second.interface and not (first.shares or first.bus):
                problem = f"{first.interface} supports a single gauge per port, not two"
                raise ValueError(f"{problem}; give {second_name} a separate port")
            both = f"{first_name} and {second_name}"
            common = {"interface", "line", "framing"} if first.bus else type(first).model_fields.keys() - its_own
            for key in sorted(common):
                settings = [getattr(gauge, key, "none") for gauge in (first, second)]
                if settings[0] != settings[1]:
                    problem = f"{both} share {first.port}, but not `{key}`"
                    raise ValueError(f"{problem} ({settings[0]} and {settings[1]}); make them equal")
            if first.place == second.place:
                raise ValueError(f"{both} share {first.port} and {first.place}; use different values")
        return self

    def __iter__(self) -> Iterator[tuple[str, Gauge]]:  # type: ignore[override]
        for name in ("g1", "g2"):
            if (gauge := getattr(self, name)) is not None:
                yield name, gauge

    @property
    def recorded(self) -> dict[str, Gauge]:
        further = {name: gauge for name in FURTHER if (gauge := getattr(self, name)) is not None}
        return dict(self) | further

    @property
    def baseline_mm(self) -> float:
        """Distance between the gauges: offset of g1 minus offset of g2. Positive for two gauges, otherwise 0."""
        return sum(sign * gauge.offset_mm for sign, (_, gauge) in zip((1, -1), self, strict=False))


NO_GAUGES = Gauges.model_construct(g1=None)  # type: ignore[arg-type]  # which no rig file can write
"""Gauges of a cell measured only by a tracker: none."""
