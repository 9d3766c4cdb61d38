"""Writes release.yaml beside this file: an earlier release of Bagpipe, as its chart rendered it.

    .venv/bin/python -m tests.e2e.previous.pack COMMIT

What is applied is that release's own: CRD, rights, Deployment, and the operator's sources, which
ride along in ConfigMaps and come before those of the image in Python's path. So the upgrade can be
tested from a shallow clone, without a registry and without building old images.
"""

import subprocess
import sys
import tarfile
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

import yaml

from tests.e2e import kubectl as k

HERE = Path(__file__).parent
RELEASE = HERE / "release.yaml"
NAMESPACE = "bagpipe-system"
_SECONDS = 60

Object = dict[str, Any]
# ConfigMap -> the package's folder, and what of it the operator imports.
_SOURCES = {
    "bagpipe-operator": ("operator/src/bagpipe_operator", "*.py"),
    "bagpipe": ("images/spark/src/bagpipe", "*.py"),
}


def checkout(commit: str, folder: Path) -> None:
    """The commit's chart and Python packages."""
    paths = ["charts/bagpipe", *(place for place, _ in _SOURCES.values())]
    packed = subprocess.run(
        ["git", "archive", commit, *paths], capture_output=True, timeout=_SECONDS, check=True
    ).stdout
    with tarfile.open(fileobj=BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")


def rendered(chart: Path) -> list[Object]:
    """The chart's objects, as `helm install bagpipe` makes them."""
    text = subprocess.run(
        ["helm", "template", "bagpipe", str(chart), "-n", NAMESPACE, "--kube-version", "1.34"],
        capture_output=True,
        text=True,
        timeout=_SECONDS,
        check=True,
        env=k.tool_environment(),
    ).stdout
    return [each for each in yaml.safe_load_all(text) if each]


def sources(folder: Path) -> list[Object]:
    """The packages as ConfigMaps, readable and not packed."""
    return [
        {
            "apiVersion": "v1",
            "kind": "ConfigMap",
            "metadata": {"name": f"previous-{name}", "namespace": NAMESPACE},
            "data": {path.name: path.read_text() for path in sorted((folder / place).glob(glob))},
        }
        for name, (place, glob) in _SOURCES.items()
    ]


def run_from_sources(deployment: Object) -> None:
    """Puts the ConfigMaps' modules before the image's."""
    pod = deployment["spec"]["template"]["spec"]
    container = pod["containers"][0]
    container["env"].append({"name": "PYTHONPATH", "value": "/previous"})
    mounts, volumes = container.setdefault("volumeMounts", []), pod.setdefault("volumes", [])
    for name in _SOURCES:
        folder = f"/previous/{name.replace('-', '_')}"
        mounts.append({"name": name, "mountPath": folder, "readOnly": True})
        volumes.append({"name": name, "configMap": {"name": f"previous-{name}"}})


def _string(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


class _Readable(yaml.SafeDumper):
    """Sources as blocks of lines."""


_Readable.add_representer(str, _string)


def main() -> None:
    """The module as a program."""
    (commit,) = sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkout(commit, folder)
        objects = rendered(folder / "charts/bagpipe")
        for each in objects:
            if each["kind"] == "Deployment":
                run_from_sources(each)
        objects += sources(folder)
    head = f"# Written by pack.py from commit {commit}; do not edit.\n"
    text = yaml.dump_all(objects, Dumper=_Readable, sort_keys=False, width=1000)
    RELEASE.write_text(head + text)
    print(f"wrote {RELEASE}: {RELEASE.stat().st_size} bytes, {len(objects)} objects")


if __name__ == "__main__":
    main()
