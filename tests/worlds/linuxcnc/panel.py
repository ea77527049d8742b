#!/usr/bin/python3
"""The operator's panel of LinuxCNC without a screen: [DISPLAY]DISPLAY of the INI file.

It switches the machine on, homes all joints and then obeys lines at a TCP port: `run FILE` starts a program, `continue`
resumes one that waits at M0, `state` reports, and `quit` ends LinuxCNC. It runs with Python and the module linuxcnc of
the operating system.
"""

import json
import socket
import sys
import threading
import time

import linuxcnc

command, stat, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()
shown = {"program": "", "state": "starts", "errors": []}
wanted = []


def home():
    for state in (linuxcnc.STATE_ESTOP_RESET, linuxcnc.STATE_ON):
        command.state(state)
        command.wait_complete()
    command.teleop_enable(0)
    command.wait_complete()
    command.home(-1)
    while True:
        time.sleep(0.1)
        stat.poll()
        if all(stat.homed[:6]):
            break
    command.teleop_enable(1)
    command.wait_complete()


def run(path):
    """Run a program to its end."""
    shown.update(program=path, state="runs", errors=[])
    for step in (
        lambda: command.mode(linuxcnc.MODE_AUTO),
        command.reset_interpreter,
        lambda: command.program_open(path),
    ):
        step()
        command.wait_complete()
    command.auto(linuxcnc.AUTO_RUN, 0)
    time.sleep(0.3)
    while True:
        time.sleep(0.05)
        stat.poll()
        while message := errors.poll():
            shown["errors"].append(message[1].strip())
        if stat.interp_state == linuxcnc.INTERP_PAUSED:
            shown["state"] = "waits"
            if "continue" in wanted:
                wanted.remove("continue")
                shown["state"] = "runs"
                command.auto(linuxcnc.AUTO_RESUME)
                time.sleep(0.3)
        elif stat.interp_state == linuxcnc.INTERP_IDLE and stat.inpos:
            break
    shown["state"] = "idle"


def listen(port):
    """Obey the lines of clients."""
    with socket.create_server(("127.0.0.1", port)) as server:
        while True:
            client, _ = server.accept()
            with client:
                line = client.makefile().readline().strip()
                if line != "state":
                    wanted.append(line)
                client.sendall((json.dumps(shown) + "\n").encode())


def main():
    """Home, and run what is wanted."""
    time.sleep(1)
    home()
    shown["state"] = "idle"
    threading.Thread(target=listen, args=(5490,), daemon=True).start()
    while "quit" not in wanted:
        if wanted and wanted[0].startswith("run "):
            run(wanted.pop(0)[4:])
        time.sleep(0.05)


main()
sys.exit(0)
