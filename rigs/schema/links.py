from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_serializer, model_validator

from rigs.schema.part import Part

_LINE = re.compile(r"(\d+) ([78])([NEO])([12])")
_NETWORK = re.compile(r"(tcp|udp)://(\[[0-9a-fA-F:]+\]|[^/:\s]+):(\d{1,5})")


class Line(Part):
    """Settings of a serial line, written `4800 7E2`: baud, data bits, parity, stop bits."""

    baud: int = Field(ge=50, le=4_000_000)
    bits: Literal[7, 8]
    parity: Literal["N", "E", "O"]
    stop: Literal[1, 2]

    @model_validator(mode="before")
    @classmethod
    def _parse(cls, value: object) -> object:
        if isinstance(value, dict | Line):
            return value
        match = _LINE.fullmatch(str(value))
        if not match or not 50 <= int(match[1]) <= 4_000_000:
            raise ValueError(f"{value!r} is not a line setting; write a setting such as '9600 8N1'")
        return {"baud": int(match[1]), "bits": int(match[2]), "parity": match[3], "stop": int(match[4])}

    @model_serializer
    def _write(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return f"{self.baud} {self.bits}{self.parity}{self.stop}"

    @property
    def character_ns(self) -> int:
        bits = 1 + self.bits + (self.parity != "N") + self.stop
        return round(bits * 1e9 / self.baud)


@dataclass(frozen=True)
class ModemLines:
    """Modem lines of a serial port, which power some cables."""

    dtr: bool
    rts: bool

    def __str__(self) -> str:
        return f"DTR {'on' if self.dtr else 'off'}, RTS {'on' if self.rts else 'off'}"


def tcp_address(port: str) -> tuple[str, int] | None:
    """Host and port number of `tcp://host:number`, or None for other text."""
    return _address("tcp", port)


def udp_address(port: str) -> tuple[str, int] | None:
    """Host and port number of `udp://host:number`, or None for other text."""
    return _address("udp", port)


def _address(scheme: str, port: str) -> tuple[str, int] | None:
    match = _NETWORK.fullmatch(port)
    return (match[2].strip("[]"), int(match[3])) if match and match[1] == scheme else None


def _port(kind: str, schemes: tuple[str, ...], remedy: str, *, serial: bool = False) -> AfterValidator:
    def check(port: str) -> str:
        match = _NETWORK.fullmatch(port)
        is_network = match is not None and match[1] in schemes and 0 < int(match[3]) < 65536
        if is_network or (serial and port.startswith("/") and len(port) > 1):
            return port
        meant = "UDP port" if "udp" in schemes and port.startswith("udp:") else kind
        raise ValueError(f"{port!r} is not a {meant}; write {remedy}")

    return AfterValidator(check)


def tcp_port(example: int) -> AfterValidator:
    """Require a TCP address; example: usual port number, for the message."""
    return _port("TCP port", ("tcp",), f"'tcp://host:{example}'")


_SERIAL = "'/dev/serial/by-id/…'"
Port = Annotated[str, _port("port", ("tcp",), f"{_SERIAL} or 'tcp://host:number'", serial=True)]
UDPPort = Annotated[str, _port("UDP port", ("udp",), "'udp://host:number'")]
AnyPort = Annotated[str, _port("port", ("tcp", "udp"), f"{_SERIAL}, 'tcp://…' or 'udp://host:number'", serial=True)]
