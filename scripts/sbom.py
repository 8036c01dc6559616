#!/usr/bin/env python3
"""Writes the bill of materials of the program (or of the package that is named: quadrille-python), CycloneDX 1.5: every crate in it on any
system, its version, licence, checksum and what it depends on, by Cargo.lock and `cargo metadata`.

    scripts/sbom.py [PACKAGE] > quadrille.cdx.json
"""

import json
import sys
import tomllib
import uuid

from licences import ROOT, command, crates


def main(package: str) -> None:
    inside = crates(package)
    known = {p["id"]: f"pkg:cargo/{p['name']}@{p['version']}" for p in inside}
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    sums = {(p["name"], p["version"]): p.get("checksum") for p in locked}
    metadata = json.loads(command("metadata", "--locked", "--all-features", "--format-version", "1"))
    ours = {p["id"]: p for p in metadata["packages"] if p["id"] in metadata["workspace_members"]}
    (root,) = (p for p in ours.values() if p["name"] == package)
    ref = f"pkg:cargo/{package}@{root['version']}"
    nodes = {node["id"]: [dependency["pkg"] for dependency in node["deps"]] for node in metadata["resolve"]["nodes"]}
    # Our own crates are one thing: it depends on what any of them does.
    names = {p.split()[0] for p in command("tree", "--locked", "-p", package, "-e", "normal", "--prefix", "none").splitlines() if p}
    direct = {known[at] for id, p in ours.items() if p["name"] in names for at in nodes[id] if at in known}
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, ref + ' '.join(sorted(known.values())))}",
        "version": 1,
        "metadata": {"component": {
            "type": "application" if package == "quadrille" else "library", "bom-ref": ref, "name": package, "version": root["version"],
            "purl": ref, "licenses": [{"expression": root["license"]}],
        }},
        "components": [
            {
                "type": "library", "bom-ref": known[p["id"]], "name": p["name"], "version": p["version"], "purl": known[p["id"]],
                **({"licenses": [{"expression": p["license"].replace("/", " OR ")}]} if p["license"] else {}),
                "hashes": [{"alg": "SHA-256", "content": sums[p["name"], p["version"]]}],
            }
            for p in inside
        ],
        "dependencies": [{"ref": ref, "dependsOn": sorted(direct)}] + [
            {"ref": known[p["id"]], "dependsOn": sorted({known[at] for at in nodes[p["id"]] if at in known})} for p in inside
        ],
    }
    json.dump(bill, sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "quadrille")
