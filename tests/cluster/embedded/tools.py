"""kubectl and helm for the user and for make: the machine's if new enough, else ours."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

from . import builds
from .places import cache

# kubectl may be one minor version older than the API server; helm 3.14 reads our chart.
OLDEST = {"kubectl": (1, 33), "helm": (3, 14)}
NEWEST = {"kubectl": (1, 35), "helm": (3, 99)}


def folder() -> Path:
    """A folder for the front of PATH: it holds a link only for a tool the machine lacks."""
    return cache() / "bin" / "tools"


def parse_version(text: str) -> tuple[int, int] | None:
    """(major, minor) from what `kubectl version --client -o json` or `helm version` print."""
    with contextlib.suppress(ValueError, KeyError, TypeError):  # helm's is no JSON
        text = json.loads(text)["clientVersion"]["gitVersion"]
    found = re.search(r"v(\d+)\.(\d+)\.", text)
    return (int(found[1]), int(found[2])) if found else None


def machine_has(name: str) -> bool:
    """Whether the machine's own tool is of a version that fits the cluster."""
    path = os.pathsep.join(
        p for p in os.environ.get("PATH", "").split(os.pathsep) if Path(p) != folder()
    )
    program = shutil.which(name, path=path)
    if program is None:
        return False
    arguments = {
        "kubectl": ["version", "--client", "-o", "json"],
        "helm": ["version", "--template", "{{.Version}}"],
    }
    try:
        done = subprocess.run(
            [program, *arguments[name]], capture_output=True, text=True, timeout=30, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    version = parse_version(done.stdout)
    return version is not None and OLDEST[name] <= version <= NEWEST[name]


def link() -> Path:
    """Bring the folder up to date and return it."""
    folder().mkdir(parents=True, exist_ok=True)
    for name in OLDEST:
        place = folder() / name
        if machine_has(name):
            place.unlink(missing_ok=True)
            continue
        program = next(p for p in builds.PROGRAMS if name in p.names)
        temporary = folder() / f".{name}.{os.getpid()}"
        temporary.symlink_to(builds.ensure(program) / name)
        temporary.replace(place)
    return folder()
