import signal
import subprocess
import sys
import threading
from queue import SimpleQueue

import pytest

from rigs.signals import end_from

AT_THE_END = """
import atexit, os, signal, sys
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.argv = {words}
from {module} import main
main()
"""


@pytest.mark.parametrize(
    ("module", "words", "code"),
    [
        ("analysis.cli", ["rig", "--version"], 0),
        ("analysis.cli", ["rig", "check", "no-such-file"], 3),
        ("daq.service.rigd", ["rigd", "no-such-file"], 3),
    ],
)
def test_ctrl_c_at_the_last_instant_changes_nothing(module, words, code):
    program = AT_THE_END.format(module=module, words=words)
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == code and "Traceback" not in done.stderr, done.stderr


def test_an_end_is_heard_though_another_thread_gets_the_signal():
    """As the system may deliver it: the main thread sleeps on, and runs the handler once it wakes."""
    ends: SimpleQueue[int] = SimpleQueue()
    before = signal.signal(signal.SIGINT, lambda number, _: ends.put(number))
    sender = threading.Timer(0.1, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT))
    try:
        sender.start()
        assert end_from(ends) == signal.SIGINT
    finally:
        sender.join()
        signal.signal(signal.SIGINT, before)
