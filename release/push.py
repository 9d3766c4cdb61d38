"""Push a release's images and charts to a registry of one's own.

    .venv/bin/python -m release.push FOLDER REGISTRY [--charts-only] [--plain-http]

REGISTRY is a host and a path, such as registry.example/robots. Nothing is changed on the way: the
registry has the digests that the release names. Logins are Docker's (`docker login`, `crane auth
login`), in DOCKER_CONFIG.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from embedded import builds
from embedded.failure import ClusterError

from release import ReleaseError, archives, sums
from release.make import DIGESTS

# Of one image or chart; Spark's image has 0.9 GB.
PUSH_SECONDS = 3600.0
ASK_SECONDS = 120.0
_CHART = re.compile(r"bagpipe(?:-namespace)?-(\d.*)\.tgz")
# What registries and their clients say, and what it means for who pushes.
_REFUSALS = (
    (
        r"UNAUTHORIZED|\b401\b|basic credential not found",
        "refuses the login: log in (docker login, crane auth login) as somebody who may push there",
    ),
    (r"DENIED|\b403\b", "does not let this login push there"),
    (
        r"connection refused|no such host|i/o timeout|deadline exceeded",
        "does not answer: is its name right, and is it up?",
    ),
    (
        r"server gave HTTP response to HTTPS client",
        "speaks plain HTTP: PLAIN_HTTP=1 allows that for a registry of a closed network",
    ),
)
_ABSENT = re.compile(r"MANIFEST_UNKNOWN|NAME_UNKNOWN|\b404\b|not found", re.IGNORECASE)


@dataclass(frozen=True)
class Registry:
    """A registry and a path in it, and the programs that speak to it."""

    name: str
    plain_http: bool = False

    def image(self, layout: Path, name: str, tag: str) -> None:
        """Push an image that was laid out in a folder. Raises ReleaseError."""
        self._run([*self._crane("push"), str(layout), f"{self.name}/{name}:{tag}"], PUSH_SECONDS)

    def digest(self, reference: str) -> str:
        """The digest of an image or chart below the path; empty where there is none."""
        command = [*self._crane("digest"), f"{self.name}/{reference}"]
        try:
            return self._run(command, ASK_SECONDS).strip()
        except _AbsentError:
            return ""

    def chart(self, package: Path) -> str:
        """Push a chart; the digest under which the registry has it. Raises ReleaseError."""
        program = shutil.which("helm")
        if not program:
            raise ReleaseError("There is no helm on PATH: `make tools` builds it.")
        command = [program, "push", str(package), f"oci://{self.name}/charts"]
        answer = self._run(command + ["--plain-http"] * self.plain_http, PUSH_SECONDS)
        found = re.search(r"Digest: (sha256:[0-9a-f]{64})", answer)
        if not found:
            raise ReleaseError(f"helm did not print the digest of {package.name}: {answer.strip()}")
        return found[1]

    def _crane(self, verb: str) -> list[str]:
        program = str(builds.ensure(builds.PUSHER) / "crane")
        return [program, verb, *["--insecure"] * self.plain_http]

    def _run(self, command: list[str], seconds: float) -> str:
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=seconds, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise ReleaseError(f"{self.name} did not end in {seconds:.0f} s: {command}.") from error
        answer = done.stdout + done.stderr
        if not done.returncode:
            return answer
        for pattern, meaning in _REFUSALS:
            if re.search(pattern, answer):
                raise ReleaseError(f"The registry {self.name} {meaning}. It was: {_last(answer)}")
        kind = _AbsentError if _ABSENT.search(answer) else ReleaseError
        raise kind(f"{Path(command[0]).name} {command[1]} failed at {self.name}: {_last(answer)}")


class _AbsentError(ReleaseError):
    """The registry does not have what was asked for."""


def _last(answer: str) -> str:
    return (answer.strip().splitlines() or ["nothing"])[-1][:500]


def digests(folder: Path) -> dict[str, str]:
    """The digest of each image, as the release lists them."""
    lines = (folder / DIGESTS).read_text().splitlines()
    return {name: digest for name, digest, _platforms in (line.split() for line in lines)}


def pins(chart: Path) -> dict[str, str]:
    """The digest of each image, as the chart's values name them."""
    with tarfile.open(chart) as tar:
        file = tar.extractfile("bagpipe/values.yaml")
        values = yaml.safe_load(file.read() if file else b"")
    return dict(values["images"]["digests"])


def absent(registry: Registry, named: dict[str, str]) -> list[str]:
    """Which of the images, each by its digest, the registry does not have. Raises ReleaseError."""
    references = (f"{name}@{digest}" for name, digest in sorted(named.items()))
    return [each for each in references if registry.digest(each) != each.partition("@")[2]]


def push_images(folder: Path, version: str, registry: Registry) -> None:
    """Push all images, each with the version as its tag. Raises ReleaseError."""
    for name in digests(folder):
        with tempfile.TemporaryDirectory(prefix="bagpipe-push-") as scratch:
            archive = folder / "images" / f"{name}-{version}.oci.tar"
            registry.image(archives.unpack(archive, Path(scratch)), name, version)
        print(f"{registry.name}/{name}:{version} is pushed", flush=True)


def push(folder: Path, registry: Registry, charts_only: bool = False) -> dict[str, str]:
    """Push a release: images, then charts, whose images are there by then.

    Answers the digest of each chart. Raises ReleaseError.
    """
    sums.check(folder)
    packages = sorted((folder / "charts").glob("*.tgz"))
    (main,) = (each for each in packages if not each.name.startswith("bagpipe-namespace"))
    found = _CHART.fullmatch(main.name)
    if not found or pins(main) != digests(folder):
        raise ReleaseError(
            f"{main.name} names other images than {DIGESTS}: make the release again."
        )
    if not charts_only:
        push_images(folder, found[1], registry)
    lacking = absent(registry, pins(main))
    if lacking:
        raise ReleaseError(
            f"The registry {registry.name} does not have {', '.join(lacking)}, which the chart"
            " pins: push the images first. No chart was pushed."
        )
    pushed = {each.name: registry.chart(each) for each in packages}
    for name, digest in pushed.items():
        print(f"{registry.name}/charts/{name.removesuffix('.tgz')}: {digest}")
    print(
        f"Install it: helm install bagpipe oci://{registry.name}/charts/bagpipe --version"
        f" {found[1]} --set images.registry={registry.name} -n bagpipe-system --create-namespace"
        " --set 'jobNamespaces={default}'"
    )
    return pushed


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="the release's folder")
    parser.add_argument("registry", help="host and path, such as registry.example/robots")
    parser.add_argument("--charts-only", action="store_true", help="the images are there already")
    parser.add_argument("--plain-http", action="store_true", help="speak HTTP without TLS")
    given = parser.parse_args(arguments)
    try:
        push(given.folder, Registry(given.registry, given.plain_http), given.charts_only)
    except (ReleaseError, ClusterError) as error:
        print(f"Pushing the release failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
