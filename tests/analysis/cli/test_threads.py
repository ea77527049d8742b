import os
import subprocess
import sys

import pytest

_PRINT = """
import sys
from analysis.cli import main
assert "numpy" not in sys.modules, "numpy reads its threads as it loads"
try:
    main()
except SystemExit:
    import os
    print("threads", os.environ["OPENBLAS_NUM_THREADS"])
"""


@pytest.mark.parametrize(("asked", "used"), [(None, "1"), ("2", "2")])
def test_one_thread_unless_asked(asked, used):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    if asked:
        environment["OPENBLAS_NUM_THREADS"] = asked
    done = subprocess.run(
        [sys.executable, "-c", _PRINT, "--help"], capture_output=True, text=True, check=True, env=environment
    )
    assert f"threads {used}" in done.stdout
