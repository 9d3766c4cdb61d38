"""Make a release: charts, images, wheels, the plugin, schemas and lists, in one folder.

    .venv/bin/python -m release.make 0.2.0 [--folder dist] [--platforms P]
                                        [--registry REGISTRY] [--key SSH_KEY]

The folder appears under its name only when all of it is there. `make release` builds the images
first, and what this is done with.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import build
import plugin
import wheels
from context import IMAGES, Image, foreign, unemulated
from cross import Target, own, possible
from embedded.failure import ClusterError
from failure import BuildError
from lock import LockError

from release import ReleaseError, archives, changelog, charts, sbom, schemas, sums, version

# What a cluster needs; the examples' images stand for a user's own.
RELEASED = ("agent", "operator", "spark")
# What is pushed and pinned, with its platforms; and what each platform gets of it.
DIGESTS = "images/digests.txt"
MANIFESTS = "images/manifests.txt"


def asked_for(number: str) -> None:
    """Raises ReleaseError unless all of this checkout is of that version, and committed."""
    here = version.version()
    if number != here:
        raise ReleaseError(
            f"This checkout is of {here}, and {number} was asked for: run `make version"
            f" VERSION={number}`, write its section of CHANGELOG.md, and commit both."
        )
    others = [each for each in version.places() if each.number != here]
    if others:
        raise ReleaseError(f"VERSION says {here}, and {'; '.join(map(str, others))}.")
    changed = subprocess.run(
        ["git", "status", "--porcelain"], cwd=version.ROOT, capture_output=True, text=True,
        timeout=60, check=True,
    ).stdout  # fmt: skip
    if changed:
        raise ReleaseError(
            "A release is of a commit, and this checkout has changes:\n" + changed.rstrip()
        )


def images(number: str, folder: Path, targets: Sequence[Target]) -> dict[str, archives.Archive]:
    """Copy the archives of the images, checked, those of several platforms as one. Raises
    ReleaseError.
    """
    (folder / "images").mkdir(parents=True)
    found = {}
    for image in IMAGES:
        if image.name in RELEASED:
            others = [o for t in targets[1:] for o in foreign(t) if o.name == image.name]
            found[image.name] = _image([image, *others], number, folder)
    rows = sorted(found.items())
    pushed = [f"{name} {each.digest} {each.platforms}\n" for name, each in rows]
    (folder / DIGESTS).write_text("".join(pushed))
    pulled = [f"{n} {where} {digest}\n" for n, a in rows for where, digest in a.manifests.items()]
    (folder / MANIFESTS).write_text("".join(pulled))
    return found


def _image(parts: Sequence[Image], number: str, folder: Path) -> archives.Archive:
    """One image of a release, out of the archives of its platforms, and the list of each."""
    target = folder / "images" / f"{parts[0].name}-{number}.oci.tar"
    for part in parts:
        source = build.archive_of(part)
        if not build.recorded(part):
            raise ReleaseError(f"There is no whole {source}: run `make images`.")
        held = archives.inspect(source)
        wanted = part.target or own()
        if held.name != part.reference or held.platforms != wanted.platform:
            raise ReleaseError(
                f"{source} holds {held.name or 'no name'} of {held.platforms}: run `make images`."
            )
        sbom.of_image(source, part.name, number, wanted.arch, folder / "sbom")
    sources = [build.archive_of(part) for part in parts]
    if len(parts) == 1:
        shutil.copyfile(sources[0], target)
    else:
        archives.join(sources, target, parts[0].reference)
    return archives.inspect(target)


def fill(
    folder: Path, number: str, registry: str, downloads: str, targets: Sequence[Target]
) -> None:
    """Make all of a release in an empty folder. Raises ReleaseError, BuildError and others."""
    (folder / "NOTES.md").write_text(changelog.notes(number))
    schemas.write(folder / "schemas")
    (folder / "crds").mkdir()
    for name in schemas.KINDS.values():
        shutil.copy(version.ROOT / "crds" / name, folder / "crds")
    found = images(number, folder, targets)
    digests = {name: each.digest for name, each in found.items()}
    platforms = {name: list(each.manifests) for name, each in found.items()}
    charts.pack("bagpipe", number, folder / "charts", registry, digests, platforms)
    charts.pack("bagpipe-namespace", number, folder / "charts")
    sbom.of_crates(number, folder / "sbom")
    plugin.pack(folder / "plugin", downloads)
    with tempfile.TemporaryDirectory() as scratch:
        # The module's own wheel is inside of the first; the second is for all other machines.
        whole, pure, _module = wheels.build(Path(scratch))
        (folder / "wheels").mkdir()
        for wheel in (whole, pure):
            shutil.copy(wheel, folder / "wheels")
    for target in targets[1:]:
        wheels.build_for(target, folder / "wheels")
    why = {target.platform: unemulated(target) for target in targets[1:]}
    if partial := fewer(platforms, targets, why):
        print(partial)


def fewer(
    platforms: Mapping[str, Sequence[str]], targets: Sequence[Target], why: Mapping[str, str]
) -> str:
    """A sentence on the images that are not for all platforms of a release, and why, or nothing."""
    lines = []
    for target in targets:
        without = sorted(name for name, has in platforms.items() if target.platform not in has)
        if without:
            lines.append(
                f"No image of {' and '.join(without)} is for {target.platform}: building it runs"
                f" programs of that architecture, and {why[target.platform]}."
            )
    return "\n".join(lines)


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
    targets = possible(given.platforms)
    asked_for(given.version)
    changelog.notes(given.version)
    folder: Path = given.folder.resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=".release-", dir=folder.parent))
    try:
        fill(made, given.version, given.registry, given.downloads, targets)
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
    parser.add_argument(
        "--platforms", default=own().platform, help="such as 'linux/amd64 linux/arm64'"
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
