"""The charts as packages: bagpipe's with the release's images pinned by digest.

The same checkout and images give the same bytes, which `helm package` does not: it writes the time.
Annotations: https://artifacthub.io/docs/topics/annotations/helm/
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from plugin import archive

from release import ReleaseError
from release.changelog import changes
from release.schemas import KINDS
from release.version import ROOT

CHARTS = ("bagpipe", "bagpipe-namespace")
LOCAL = "bagpipe.local"
# Of a chart's folder: its own tests are no part of what is installed.
_LEFT_OUT = {"tests"}
_EXAMPLES = ("exec-highway/job.yaml", "schedule/schedule.yaml")
_HUB = "artifacthub.io"


def pack(
    name: str,
    version: str,
    folder: Path,
    registry: str = LOCAL,
    digests: Mapping[str, str] = {},
    platforms: Mapping[str, list[str]] = {},
) -> Path:
    """Write a chart's package into a folder; its path. Raises ReleaseError.

    `digests` has the digest of each image of the chart's values, by its name: that of its index
    where it is for several of `platforms`.
    """
    source = ROOT / "charts" / name
    files = {
        str(path.relative_to(source)): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file() and path.relative_to(source).parts[0] not in _LEFT_OUT
    }
    if digests:
        files["values.yaml"] = pinned(files["values.yaml"].decode(), registry, digests).encode()
    described = yaml.safe_load(files["Chart.yaml"])
    described["annotations"] = hub_annotations(described, version, registry, digests, platforms)
    files["Chart.yaml"] = yaml.safe_dump(described, sort_keys=False, width=100).encode()
    files["LICENSE"] = (ROOT / "LICENSE").read_bytes()
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{name}-{version}.tgz"
    target.write_bytes(archive([(f"{name}/{path}", data, 0o644) for path, data in files.items()]))
    return target


def pinned(values: str, registry: str, digests: Mapping[str, str]) -> str:
    """The text of values.yaml with another registry and digests, and its comments as they were.

    Raises ReleaseError where the values do not have the images of `digests`, all and no others.
    """
    images = yaml.safe_load(values)["images"]
    if set(images["digests"]) != set(digests):
        raise ReleaseError(
            f"The chart's images are {', '.join(sorted(images['digests']))}, and the release has"
            f" {', '.join(sorted(digests))}."
        )
    head, begin, rest = values.partition("  digests:\n")
    for name, digest in digests.items():
        rest = re.sub(rf'(?m)^    {name}: ""$', f"    {name}: {digest}", rest, count=1)
    head = re.sub(r"(?m)^  registry: .*$", f"  registry: {registry}", head, count=1)
    text = head + begin + rest
    read = yaml.safe_load(text)["images"]
    if (read["registry"], read["digests"]) != (registry, dict(digests)):
        raise ReleaseError("values.yaml has another form than release/charts.py can write into.")
    return text


def hub_annotations(
    described: Mapping[str, Any],
    version: str,
    registry: str,
    digests: Mapping[str, str],
    platforms: Mapping[str, list[str]] = {},
) -> dict[str, str]:
    """What Artifact Hub shows of the chart: those of its Chart.yaml, and the release's own."""
    found: dict[str, str] = dict(described.get("annotations") or {})
    found[f"{_HUB}/prerelease"] = "true" if "-" in version else "false"
    if digests:
        images = [
            {
                "name": name,
                "image": f"{registry}/{name}@{digest}",
                "platforms": list(platforms.get(name, ["linux/amd64"])),
            }
            for name, digest in sorted(digests.items())
        ]
        examples = [
            yaml.safe_load((ROOT / "docs/examples" / each).read_text()) for each in _EXAMPLES
        ]
        # Each change is a text there, and one that begins with a quote needs YAML's own quoting.
        lists: dict[str, object] = {
            "images": images,
            "crds": _crds(),
            "crdsExamples": examples,
            "changes": changes(version),
        }
        found |= {
            f"{_HUB}/{key}": yaml.safe_dump(value, sort_keys=False, width=100)
            for key, value in lists.items()
        }
    return found


def _crds() -> list[dict[str, str]]:
    crds = [yaml.safe_load((ROOT / "crds" / file).read_text()) for file in KINDS.values()]
    return [
        {
            "kind": crd["spec"]["names"]["kind"],
            "version": crd["spec"]["versions"][0]["name"],
            "name": crd["metadata"]["name"],
            "displayName": crd["spec"]["names"]["kind"],
            "description": _first_sentence(crd),
        }
        for crd in crds
    ]


def _first_sentence(crd: Mapping[str, Any]) -> str:
    text = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]["description"]
    return str(text).partition("\n")[0].partition(". ")[0]
