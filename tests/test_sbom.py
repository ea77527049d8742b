"""The bill of materials of a release names each pinned package with the hashes of the lock file."""

from scripts.tools.sbom import LOCK, names, pinned, with_hashes

TEXT = LOCK.read_text()


def test_each_pinned_package_has_version_and_hashes():
    packages = pinned(TEXT)
    assert {"numpy", "pydantic", "pyserial"} <= packages.keys()
    assert all(version and hashes for version, hashes in packages.values())
    assert len(packages) == sum("==" in line for line in TEXT.splitlines())
    assert sum(len(hashes) for _, hashes in packages.values()) == TEXT.count("--hash=sha256:")


def test_document_gets_hashes_and_loses_paths_of_the_computer():
    lock = "Py_YAML==6.0 \\\n    --hash=sha256:" + "a" * 64 + " \\\n    --hash=sha256:" + "b" * 64 + "\n"
    found = {"name": "py.yaml", "externalReferences": [{"type": "distribution", "url": "file:///home/anna/p.whl"}]}
    document = with_hashes({"components": [found, {"name": "other"}]}, lock)
    assert names(document) == {"py-yaml", "other"}
    (files,) = (one["externalReferences"] for one in document["components"] if one["name"] == "py.yaml")
    assert [one["content"] for one in files[0]["hashes"]] == ["a" * 64, "b" * 64]
    assert "anna" not in str(document)
