"""Build all images of Bagpipe, or the named ones, and keep each as an archive for loading.

    python3 images/build/build.py [--engine docker|buildah] [--no-archives] [--platforms P]
                                  [NAME...]

An image whose content did not change is not built again: a second run takes seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from pathlib import Path

import engines
from context import IMAGES, Image, cache, content, foreign, stage
from cross import Target, own, possible
from failure import BuildError
from lock import LockError, locked

Engine = engines.Docker | engines.Buildah


def archive_of(image: Image) -> Path:
    folder = cache() / "images"
    # A cluster loads all of the first ones, and its nodes could not run these.
    return (folder / image.target.arch if image.target else folder) / f"{image.name}.oci.tar"


def recorded(image: Image) -> str:
    """The content hash of the image's archive, or nothing if there is no complete one."""
    path = archive_of(image)
    try:
        record = json.loads(path.with_suffix(".json").read_text())
        return str(record["content"]) if path.stat().st_size == record["size"] else ""
    except (FileNotFoundError, ValueError, KeyError):
        return ""


def keep(engine: Engine, image: Image, hashed: str) -> None:
    """Write the archive beside its final place, move it there, then record what it holds."""
    path = archive_of(image)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}")
    temporary.unlink(missing_ok=True)
    path.with_suffix(".json").unlink(missing_ok=True)
    engine.save(image, temporary)
    temporary.replace(path)
    record = {"image": image.reference, "content": hashed, "size": path.stat().st_size}
    path.with_suffix(".json").write_text(json.dumps(record))


def ensure(engine: Engine, image: Image, archives: bool, base: Future[str]) -> None:
    """Build an image unless what it would hold is there already."""
    began = time.monotonic()
    folder = stage(image)
    hashed = content(image, folder, "scratch" if image.base == "scratch" else base.result())
    built = engine.has(image, hashed)
    archived = recorded(image) == hashed
    if archived and (built or isinstance(engine, engines.Buildah)):
        print(f"  {image.reference}: unchanged", flush=True)
        return
    if not built:
        engine.build(image, folder, hashed)
    if archives:
        keep(engine, image, hashed)
    print(f"  {image.reference}: built in {time.monotonic() - began:.1f} s", flush=True)


def ensure_all(engine: Engine, images: Sequence[Image], archives: bool) -> None:
    """Build images beside each other: one compiles while another waits for a mirror.

    After a failure none begins, and those that have begun end. Raises the first one's BuildError.
    """
    with ThreadPoolExecutor((os.cpu_count() or 1) + 2) as pool:
        base = pool.submit(engine.base if any(i.base != "scratch" for i in images) else str)
        builds = [pool.submit(ensure, engine, image, archives, base) for image in images]
        try:
            wait(builds, return_when=FIRST_EXCEPTION)
        except BaseException:
            engines.interrupted.set()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
    for each in builds:
        if not each.cancelled():
            each.result()


def build_all(
    engine: Engine, names: Sequence[str], others: Sequence[Target], archives: bool
) -> None:
    """Build the named images, or all of them, for this machine and for others. Raises BuildError.

    What is emulated comes last, as it takes longest.
    """

    def named(images: Sequence[Image]) -> list[Image]:
        return [image for image in images if image.name in (names or [image.name])]

    for_others = {target: named(foreign(target)) for target in others}
    compiled = [i for images in for_others.values() for i in images if i.base == "scratch"]
    ensure_all(engine, [*named(IMAGES), *compiled], archives)
    for target, images in for_others.items():
        if emulated := [image for image in images if image.base != "scratch"]:
            print(f"  emulating {target.platform}, which takes ten times as long", flush=True)
            emulating = engines.Buildah(target)
            emulating.release()
            ensure_all(emulating, emulated, archives)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(i.name for i in IMAGES))
    parser.add_argument(
        "--platforms", default=own().platform, help="such as 'linux/amd64 linux/arm64'"
    )
    parser.add_argument("--engine", choices=["auto", "docker", "buildah"], default="auto")
    parser.add_argument(
        "--no-archives", action="store_true", help="for kind, which loads from Docker's engine"
    )
    parser.add_argument(
        "--release", action="store_true", help="build nothing; end what was interrupted"
    )
    parser.add_argument("--clean", action="store_true", help="remove the whole cache, and no mount")
    given = parser.parse_args()
    try:
        if given.clean:
            engines.remove_tree(cache())
            return 0
        targets = possible(given.platforms)
        engine = engines.choose(given.engine)
        # All share storage and contexts.
        with locked(cache() / "images" / "lock"):
            engine.release()
            if not given.release:
                build_all(engine, given.names, targets[1:], not given.no_archives)
    except (BuildError, LockError) as error:
        print(f"Building the images failed. {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("Building the images was interrupted; it can be run again.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
