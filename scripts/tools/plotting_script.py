"""Extract the plotting script of the report from the package plotly: compressed, with version and licence.

scripts/dev plotting_script     # writes analysis/templates/plotly.min.js.gz and plotly.txt

The package has 39 MB in addition to the 5 MB of this file, so only developers install it.
"""

from __future__ import annotations

import gzip
import re
from importlib import metadata
from pathlib import Path

TEMPLATES = Path(__file__).parents[2] / "analysis" / "templates"


def made() -> dict[str, bytes]:
    """Return the contents of the two files by name."""
    from plotly.offline import get_plotlyjs  # noqa: PLC0415 - slow to import

    script = get_plotlyjs()
    found = re.search(r"plotly\.js v([\d.]+)", script[:300])
    if found is None:
        raise SystemExit("error: the script of plotly does not say its version at its head; look at it")
    files = metadata.files("plotly") or ()
    (licence,) = (file for file in files if file.name == "LICENSE.txt")
    head = f"plotly.js {found[1]}, from plotly {metadata.version('plotly')} of PyPI, unchanged. Its licence:\n\n"
    return {
        "plotly.min.js.gz": gzip.compress(script.encode(), 9, mtime=0),
        "plotly.txt": (head + licence.read_text(encoding="utf-8").strip() + "\n").encode(),
    }


if __name__ == "__main__":
    for name, content in made().items():
        (TEMPLATES / name).write_bytes(content)
        print(f"{TEMPLATES / name}: {len(content) / 1e6:.1f} MB")
