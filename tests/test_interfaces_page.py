"""docs/interfaces.md is what the schemas and the peers say, and each peer is one of an interface that there is."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

from rigs.interfaces import known

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "interfaces.md"


def _wire_peers() -> Any:
    spec = importlib.util.spec_from_file_location("wire_peers", ROOT / "dev" / "wire_peers.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_schemas_and_the_peers_say() -> None:
    script = ROOT / "dev" / "interfaces_page.py"
    page = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, encoding="utf-8").stdout
    assert PAGE.read_text(encoding="utf-8") == page, "run: scripts/dev interfaces_page > docs/interfaces.md"


def test_every_interface_has_a_row_and_every_peer_an_interface() -> None:
    names = {one.name for one in known()}
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert {row.split("`")[1] for row in rows} >= names
    peers = _wire_peers().PEERS
    assert {name for peer in peers for name in peer.interfaces} <= names
    assert all(any(peer.name in row for row in rows) for peer in peers)


def test_a_peer_that_disagrees_or_is_absent_is_reported(capsys: Any, monkeypatch: Any) -> None:
    wire = _wire_peers()

    def disagrees() -> str:
        raise wire.Disagrees("1.0 where 2.0 was sent")

    def absent() -> str:
        raise ModuleNotFoundError("no such peer")

    peers = [wire.Peer(name, ("ur_rtde",), "host", check) for name, check in (("a", disagrees), ("b", absent))]
    monkeypatch.setattr(wire, "PEERS", peers)
    assert wire.main() == 1
    first, second = capsys.readouterr().out.splitlines()
    assert "DISAGREES: 1.0 where 2.0" in first and "skipped: no such peer" in second
    monkeypatch.setattr(wire, "PEERS", peers[1:])
    assert wire.main() == 0
