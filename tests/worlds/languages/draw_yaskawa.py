"""Random INFORM jobs with pulses or coordinates, one or two per file, including everything that changes a frame,
shift or position.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array
from tests.worlds.languages.drawing import WORDS, Draft, Pen
from tests.worlds.languages.inform import SCALE, rconf


class _Job:
    """Headings, positions and lines of a job."""

    def __init__(self, name: str, kind: str, tool: int, user: int) -> None:
        self.name, self.kind, self.tool, self.user = name, kind, tool, user
        self.lines: list[str] = []
        self.positions: list[tuple[str, Array]] = []
        self.outer: list[float] = []
        self.station: list[float] = []
        self.variables: list[str] = []
        self.labels = self.depth = 0
        self.robot = "RB1"


def _coordinates(X: Array) -> str:
    """Position in mm and rotations in degrees of a frame (4, 4)."""
    turns = Rotation.from_matrix(X[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join([*(f"{value:.3f}" for value in X[:3, 3]), *(f"{value:.4f}" for value in turns)])


class Writer(Pen):
    """Generator of a job and the jobs it calls."""

    dialect = "yaskawa"

    def __init__(self, seed: int, *, plain: bool) -> None:
        super().__init__(seed, plain=plain)
        self.tools = {0: self.tool(), 1: self.tool()}
        self.frames = {1: self.user_frame(), 2: self.user_frame()}

    def draft(self) -> Draft:
        if self.plain:
            for name, on in (("GRIP_OPEN", "OFF"), ("GRIP_CLOSE", "ON")):
                job = self._job(name)
                job.lines = [f"DOUT OT#(3) {on}", "TIMER T=0.30"]
                self._finish(job)
        for _ in range(0 if self.plain else self.whole(0, 3)):
            self._routine()
        job = self._job("PICK")
        job.lines += self.move(job, self.near(), "MOVJ")
        for _ in range(self.whole(4, 9)):
            job.lines += self.line(job)
        main = self._text(job)
        files, together = {}, []
        for name, text in self.routines:
            if self.plain or self.maybe(0.5):
                files[f"{name}.JBI"] = self.coded(text, crlf=True)
            else:
                together.append(text)
        text = "".join([main, *together])
        files = {"PICK.JBI": self.coded(text, crlf=True), **files}
        tools, frames = self.stated(self.tools, 0.9), self.stated(self.frames, 0.9)
        return Draft(self.dialect, files, "PICK.JBI", ("PICK.JBI",), tools, frames, self.plain)

    def _job(self, name: str) -> _Job:
        kind = self.pick(["PULSE", "BASE", "ROBOT", "USER"])
        return _Job(name, kind, self.pick([0, 1]), self.pick([1, 2]))

    def _finish(self, job: _Job) -> None:
        self.routines.append((job.name, self._text(job)))

    def _numbers(self, job: _Job, q: Array) -> str:
        if job.kind == "PULSE":
            return ",".join(str(round(value)) for value in np.degrees(q) * np.array(SCALE))
        U = self.frames[job.user] if job.kind == "USER" else np.eye(4)
        return _coordinates(np.linalg.inv(U) @ self.flange(q) @ self.tools[job.tool])

    def _text(self, job: _Job) -> str:
        count = len(job.positions)
        outer = f"{len(job.outer)},{len(job.station)}"
        head = ["/JOB", f"//NAME {job.name}", "//POS", f"///NPOS {count},{outer},{len(job.variables)},0,0"]
        if job.kind == "USER":
            head += [f"///USER {job.user}"]
        head += [f"///TOOL {job.tool}", f"///POSTYPE {job.kind}", "///PULSE" if job.kind == "PULSE" else "///RECTAN"]
        last: tuple[int, ...] = ()
        for name, q in job.positions:
            if job.kind != "PULSE" and rconf(q) != last:
                last = rconf(q)
                head.append("///RCONF " + ",".join(map(str, last)) + ",0" * 18)
            head.append(f"{name}={self._numbers(job, q)}")
        if job.outer or job.station:
            head += ["///POSTYPE PULSE", "///PULSE"]
            head += [f"BC{k:05d}={value:.0f}" for k, value in enumerate(job.outer)]
            head += [f"EC{k:05d}={value:.0f}" for k, value in enumerate(job.station)]
        if job.variables:
            head += ["///POSTYPE BASE", "///RECTAN", "///RCONF 1,0,0,0,0,0" + ",0" * 18, *job.variables]
        attr = "SC,RW" if job.kind == "PULSE" else "SC,RW,RJ"
        middle = ["//INST", "///DATE 2023/05/04 10:11", f"///ATTR {attr}"]
        if job.kind != "PULSE":
            middle.append(f"///FRAME {job.kind}" + (f" {job.user}" if job.kind == "USER" else ""))
        groups = f"{',BS1' if job.outer else ''}{',ST1' if job.station else ''}"
        middle += [f"///GROUP1 {job.robot}{groups}", "NOP"]
        return "\n".join([*head, *middle, *job.lines, "END"]) + "\n"

    def _routine(self) -> None:
        job, what = self._job(self.name()), self.pick(["moves", "shift", "frame", "mixed", "off"])
        if what == "moves":
            job.robot = self.pick(["RB1", "RB1", "RB2"])
            job.lines = self.move(job, self.astray(), "MOVJ")
        elif what == "mixed":
            job.depth = 1
            job.lines = [one for _ in range(3) for one in self.line(job)]
        elif what == "off":
            job.lines = ["SFTOF"]
        else:
            job.lines = [f"SFTON {self._variable(job)}"] if what == "shift" else self.setting()
        self._finish(job)

    def line(self, job: _Job) -> list[str]:
        """Return one or more instructions."""
        plain = [
            (3.0, lambda job: self.move(job, self.near())),
            (0.4, self.arc),
            (1.0, lambda _: self.harmless()),
            (0.8, lambda job: [*self.call(), *self.move(job, self.near())]),
            (0.5, self.block),
        ]
        wild = [
            (0.7, self.shift),
            (0.6, lambda _: self.setting()),
            (0.5, self.variable),
            (0.4, self.again),
            (0.4, self.conveyor),
            (0.3, lambda _: self.unknown()),
            (0.4, self.external),
        ]
        return self.drawn(job, plain, wild)

    def move(self, job: _Job, q: Array, word: str = "") -> list[str]:
        """A move to a new position."""
        name = f"C{len(job.positions):05d}"
        job.positions.append((name, q))
        word = word or self.pick(["MOVJ", "MOVL", "MOVL"])
        speed = "VJ=25.00" if word == "MOVJ" else self.pick(["V=100.0", "V=250.0"])
        return [f"{word} {name} {speed}{self.pick(['', ' PL=0', ' PL=2'])}"]

    def arc(self, job: _Job) -> list[str]:
        return [self.move(job, self.near(), "MOVC")[0] for _ in range(3)]

    def again(self, job: _Job) -> list[str]:
        if not job.positions:
            return self.move(job, self.near())
        return [f"MOVL {self.pick(job.positions)[0]} V=100.0"]

    def harmless(self) -> list[str]:
        return [
            self.pick(["DOUT OT#(1) ON", "TIMER T=0.50", "WAIT IN#(2)=ON", f"'{self.pick(WORDS)[:30]}", "SET B000 1", "INC I001",
                      "'MOVL C00000 V=100.0", "PULSE OT#(4) T=0.30", "SPEED V=100.0", "SET D000 100"])
        ]  # fmt: skip

    def call(self) -> list[str]:
        if not self.routines:
            return self.harmless()
        name = self.pick(self.routines)[0]
        return [self.pick([f"CALL JOB:{name}", f"CALL JOB:{name} IF IN#(4)=ON"])]

    def block(self, job: _Job) -> list[str]:
        if job.depth > 1:
            return self.harmless()
        job.depth += 1
        body = [one for _ in range(self.whole(1, 3)) for one in self.line(job)]
        job.depth -= 1
        job.labels += 1
        label = f"*L{job.labels}"
        head, end = self.pick(
            [(["IFTHENEXP IN#(1)=ON"], ["ENDIF"]), (["IFTHENEXP B000=1"], ["ELSE", "DOUT OT#(1) OFF", "ENDIF"]), (["WHILEEXP I000<3"], ["ENDWHILE"]),
             ([f"JUMP {label} IF IN#(1)=OFF"], [label]), ([label], [f"JUMP {label} IF B001<>1"])]
        )  # fmt: skip
        return [*head, *body, *end]

    def _variable(self, job: _Job) -> str:
        k = len(job.variables) + 1
        x, y, z = self.small()
        job.variables.append(f"P{k:05d}={x:.3f},{y:.3f},{z:.3f},0.0000,0.0000,{self.rng.uniform(-9, 9):.4f}")
        return f"P{k:03d}"

    def shift(self, job: _Job) -> list[str]:
        name = self._variable(job) if self.maybe(0.6) else "P050"
        where = self.pick(["", " BF", " TF", " UF#(1)", " RF"])
        off = ["SFTOF"] if self.maybe(0.7) else []
        on = self.inside(0.2, "IFTHENEXP IN#(6)=ON", [f"SFTON {name}{where}"], "ENDIF", "")
        return [*on, *self.move(job, self.near()), *off, *self.move(job, self.near())]

    def setting(self) -> list[str]:
        """Return lines that change a tool or a user frame in the controller."""
        line = self.pick(["MFRAME UF#(1) C00000 C00001 C00002", "SETTOOL TL#(1) P010", "SETTOOL TL#(0) P010",
                         "MFRAME UF#(2) P001 P002 P003"])  # fmt: skip
        return self.inside(0.3, "IFTHENEXP IN#(7)=ON", [line], "ENDIF", "")

    def _place(self, job: _Job) -> str:
        """A position variable that contains a place of the work."""
        k, q = len(job.variables) + 1, self.near()
        numbers = _coordinates(self.flange(q) @ self.tools[job.tool])
        job.variables.append(f"///RCONF {','.join(map(str, rconf(q)))}{',0' * 18}\nP{k:05d}={numbers}")
        return f"P{k:03d}"

    def variable(self, job: _Job) -> list[str]:
        if self.maybe(0.5):
            name = self._place(job)
            again = self.pick([[], [], [f"SET P050 {name}"], [f"SETE {name} (3) 20000"], [f"MOVL {name} V=50.0"]])
            return [f"{self.pick(['MOVJ', 'MOVL'])} {name} V=100.0", *again, *self.move(job, self.near())]
        name = self._variable(job)
        return [*self.pick([[], [f"SETE {name} (3) 20000"], [f"ADD {name} P051"], [f"GETS PX{name[1:]} $PX000"]]),
                self.pick([f"IMOV {name} V=100.0 BF", f"IMOV {name} V=100.0 TF", f"SFTON {name}", f"MOVL {name} V=100.0"]), *self.move(job, self.near())]  # fmt: skip

    def conveyor(self, job: _Job) -> list[str]:
        first = self.move(job, self.near(), "MOVL")[0]
        return ["SYSTART CV#(1) STP=100.000", f"SY{first} CV#(1)", "SYEND CV#(1)", *self.move(job, self.near())]

    def external(self, job: _Job) -> list[str]:
        first = self.move(job, self.near(), "MOVL")[0]
        _, name, rest = first.split(" ", 2)
        if self.maybe(0.6):
            job.station.append(self.pick([0.0, 359.0]))
            axis = f"EC{len(job.station) - 1:05d}"
            together = [f"MOVL {name} {axis} {rest}", f"MOVL {name} {rest}  +MOVJ {axis} VJ=80.00",
                        f"SMOVL {name} {rest}  +MOVJ {axis} VJ=80.00", f"MOVJ {axis} VJ=10.00\nMOVL {name} {rest}"]  # fmt: skip
            return self.pick(together).split("\n")
        job.outer.append(self.pick([0.0, 12000.0]))
        return [f"MOVL {name} BC{len(job.outer) - 1:05d} {rest}"]

    def unknown(self) -> list[str]:
        return [self.pick([f"CALL JOB:{self.name()}", "MACRO1 MJ#(5)", f"CALL JOB:{self.name()} IF B002=1"])]
