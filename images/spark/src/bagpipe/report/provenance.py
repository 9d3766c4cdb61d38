"""A manifest's provenance as names and values: for JUnit's properties, the page and a terminal."""

from collections.abc import Mapping
from typing import Any


def facts_of(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What is known of where the results come from, in the order in which it is read."""
    given = manifest.get("provenance") or {}
    facts = [
        *((f"label {name}", value) for name, value in (given.get("labels") or {}).items()),
        *((name, value) for name, value in (given.get("annotations") or {}).items()),
        ("catalogue", _catalogue(given.get("catalogue") or {})),
        ("baseline", _baseline(given.get("baseline") or {})),
        ("began", given.get("began")),
        ("ended", given.get("ended")),
        ("seconds", given.get("seconds")),
        ("bagpipe", given.get("bagpipe")),
        ("agent", ", ".join(given.get("agents") or [])),
        *((f"image {image['container']}", _image(image)) for image in given.get("images") or []),
        *(("machine", _machine(machine)) for machine in given.get("machines") or []),
        ("seeds", ", ".join(str(seed) for seed in given.get("seeds") or [])),
        *((f"discarded {why}", n) for why, n in (given.get("discarded") or {}).items()),
    ]
    return [(str(name), str(value)) for name, value in facts if value not in (None, "")]


def _catalogue(found: Mapping[str, Any]) -> str:
    if not found:
        return ""
    return (
        f"{found['recordings']:,} recordings of {found['selected']:,} of {found['rows']:,} rows of"
        f" {found['catalogue']} (sha256 {found['sha256']}), where {found['where']}"
    )


def _baseline(found: Mapping[str, Any]) -> str:
    if not found.get("job"):
        return str(found.get("message") or "")
    return f"{found['job']}, the last of the schedule {found['schedule']} that passed"


def _image(image: Mapping[str, Any]) -> str:
    pods = "1 pod" if image["pods"] == 1 else f"{image['pods']} pods"
    return f"{image['image']} = {image['digest']} ({pods})"


def _machine(machine: Mapping[str, Any]) -> str:
    kind = f"{machine.get('cpu') or 'a processor without a name'}, {machine.get('cpus')} processors"
    where = ", ".join(machine.get("names") or [])
    return (
        f"{kind}, {machine.get('arch')}, Linux {machine.get('kernel')}:"
        f" {machine['cases']} cases on {where}"
    )
