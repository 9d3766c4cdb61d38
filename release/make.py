"""Make a release: charts, images, wheels, the plugin, schemas and lists, in one folder.

    .venv/bin/python -m release.make 0.2.0 [--folder dist] [--registry REGISTRY] [--key SSH_KEY]

The folder appears under its name only when all of it is there. `make release` builds the images
first, and what this is done with.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import build
import plugin
import wheels
from context import IMAGES, BuildError
from embedded.failure import ClusterError
from lock import LockError

from release import ReleaseError, archives, changelog, charts, sbom, schemas, sums, version

# What a cluster needs; the examples' images stand for a user's own.
RELEASED = ("agent", "operator", "spark")
DIGESTS = "images/digests.txt"


def asked_for(number: str) -> None:
    """Raises ReleaseError unless all of this checkout is of that version, and committed."""
    own = version.version()
    if number != own:
        raise ReleaseError(
            f"This checkout is of {own}, and {number} was asked for: run `make version"
            f" VERSION={number}`, write its section of CHANGELOG.md, and commit both."
        )
    others = [each for each in version.places() if each.number != own]
    if others:
        raise ReleaseError(f"VERSION says {own}, and {'; '.join(map(str, others))}.")
    changed = subprocess.run(
        ["git", "status", "--porcelain"], cwd=version.ROOT, capture_output=True, text=True,
        timeout=60, check=True,
    ).stdout  # fmt: skip
    if changed:
        raise ReleaseError(
            "A release is of a commit, and this checkout has changes:\n" + changed.rstrip()
        )


def images(number: str, folder: Path) -> dict[str, str]:
    """Copy the archives of the images, checked; the digest of each. Raises ReleaseError."""
    (folder / "images").mkdir(parents=True)
    digests, lines = {}, []
    for image in IMAGES:
        if image.name not in RELEASED:
            continue
        source = build.archive_of(image)
        if not build.recorded(image):
            raise ReleaseError(f"There is no whole {source}: run `make images`.")
        target = folder / "images" / f"{image.name}-{number}.oci.tar"
        shutil.copyfile(source, target)
        found = archives.inspect(target)
        if found.name != image.reference:
            raise ReleaseError(f"{source} holds {found.name or 'no name'}: run `make images`.")
        digests[image.name] = found.digest
        lines.append(f"{image.name} {found.digest} {found.platform}\n")
        sbom.of_image(target, image.name, number, folder / "sbom")
    (folder / DIGESTS).write_text("".join(lines))
    return digests


def fill(folder: Path, number: str, registry: str, downloads: str) -> None:
    """Make all of a release in an empty folder. Raises ReleaseError, BuildError and others."""
    (folder / "NOTES.md").write_text(changelog.notes(number))
    schemas.write(folder / "schemas")
    (folder / "crds").mkdir()
    for name in schemas.KINDS.values():
        shutil.copy(version.ROOT / "crds" / name, folder / "crds")
    digests = images(number, folder)
    charts.pack("bagpipe", number, folder / "charts", registry, digests)
    charts.pack("bagpipe-namespace", number, folder / "charts")
    sbom.of_crates(number, folder / "sbom")
    plugin.pack(folder / "plugin", downloads)
    with tempfile.TemporaryDirectory() as scratch:
        # The module's own wheel is inside of the first; the second is for all other machines.
        whole, pure, _module = wheels.build(Path(scratch))
        (folder / "wheels").mkdir()
        for wheel in (whole, pure):
            shutil.copy(wheel, folder / "wheels")


def replace(folder: Path, made: Path) -> None:
    """Put a release in the place of an earlier one. Raises ReleaseError for any other folder."""
    if folder.exists() and any(folder.iterdir()):
        if not (folder / sums.SUMS).is_file():
            raise ReleaseError(f"{folder} is there and no release: name another one.")
        shutil.rmtree(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    made.chmod(0o755)
    made.replace(folder)


def make(given: argparse.Namespace) -> None:
    """Make the release that was asked for. Raises ReleaseError, BuildError and others."""
    asked_for(given.version)
    changelog.notes(given.version)
    folder: Path = given.folder.resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=".release-", dir=folder.parent))
    try:
        fill(made, given.version, given.registry, given.downloads)
        sums.write(made)
        if given.key:
            sums.sign(made, given.key)
        replace(folder, made)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        print(f"{path.stat().st_size:>13,} {path.relative_to(folder)}")
    if not given.key:
        print(f"{sums.SUMS} is not signed: KEY= names the SSH key that signs it.")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("version", help="the number that VERSION has")
    parser.add_argument("--folder", type=Path, default=Path("dist"))
    parser.add_argument(
        "--registry", default=charts.LOCAL, help="where the chart takes its images from"
    )
    parser.add_argument(
        "--downloads", default=plugin.URI, help="the address of the plugin's archive, with {file}"
    )
    parser.add_argument("--key", type=Path, help="the SSH key that signs the checksums")
    try:
        make(parser.parse_args(arguments))
    except (ReleaseError, BuildError, ClusterError, LockError) as error:
        print(f"Making the release failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
