"""Prints the software bill of materials of a package in CycloneDX 1.6 (JSON): python3 .ci/sbom.py PACKAGE

Its components are the crates that are part of the package on any system, with licence, checksum and dependencies. Crates that only
compile or test it are left out. The same commit gives the same bytes.
"""

import json
import subprocess
import sys
import tomllib
from pathlib import Path


def metadata() -> dict:
    """What cargo knows of the packages in the lock file."""
    text = subprocess.run(["cargo", "metadata", "--format-version", "1", "--locked"], check=True, capture_output=True).stdout
    return json.loads(text)


def reference(package: dict) -> str:
    """The package URL of a crate."""
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package: dict, checksums: dict) -> dict:
    """A crate as a component."""
    url = reference(package)
    entry = {"type": "library", "bom-ref": url, "name": package["name"], "version": package["version"], "purl": url}
    if package["license"]:
        entry["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if checksum := checksums.get((package["name"], package["version"])):
        entry["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return entry


def bill(name: str) -> dict:
    """The bill of the package `name` of this workspace."""
    known = metadata()
    packages = {p["id"]: p for p in known["packages"]}
    needs = {
        node["id"]: sorted(d["pkg"] for d in node["deps"] if any(k["kind"] is None for k in d["dep_kinds"]))
        for node in known["resolve"]["nodes"]
    }
    macros = {p["id"] for p in known["packages"] if any("proc-macro" in t["kind"] for t in p["targets"])}
    (root,) = (p["id"] for p in known["packages"] if p["name"] == name and p["source"] is None)
    found, waiting = set(), [root]
    while waiting:
        if (one := waiting.pop()) not in found:
            found.add(one)
            waiting += [d for d in needs[one] if d not in macros]
    lock = tomllib.loads((Path(__file__).parent.parent / "Cargo.lock").read_text())
    checksums = {(p["name"], p["version"]): p.get("checksum") for p in lock["package"]}
    order = sorted(found, key=lambda one: (packages[one]["name"], packages[one]["version"]))
    main = component(packages[root], checksums)
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {**main, "type": "application"}},
        "components": [component(packages[one], checksums) for one in order if one != root],
        "dependencies": [
            {"ref": reference(packages[one]), "dependsOn": [reference(packages[d]) for d in needs[one] if d in found]}
            for one in order
        ],
    }


if len(sys.argv) != 2:
    sys.exit(__doc__)
print(json.dumps(bill(sys.argv[1]), indent=1, sort_keys=True))
