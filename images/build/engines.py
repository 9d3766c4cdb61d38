"""The two programs that can build images: Docker where an engine answers, else buildah."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import emulation
from archive import make_oci
from context import BASE, Image, cache
from cross import Target
from failure import BuildError

BUILD_SECONDS = 1800.0
# An emulated program takes ten times as long as one of this machine.
EMULATED_SECONDS = 4 * 3600.0
PULL_SECONDS = 90.0
LABEL = "io.bagpipe.content"
# Images without a name, of which the next build takes layers: six changes of all of them.
KEPT_IMAGES = 24
# Set by an interrupt, which only the main thread meets: then nothing more is begun.
interrupted = threading.Event()
# Before 23.0, as in Debian 12, Docker uses BuildKit only on request, and knows no secrets without.
BUILDKIT = {"DOCKER_BUILDKIT": "1", "BUILDKIT_PROGRESS": "plain"}


def run(command: Sequence[str | Path], *, log: Path, seconds: float = BUILD_SECONDS) -> None:
    """Run a command with its output in `log`; its end becomes the error's text."""
    log.parent.mkdir(parents=True, exist_ok=True)
    if interrupted.is_set():
        raise BuildError("It was interrupted.")
    with log.open("w") as file:
        try:
            done = subprocess.run(
                [*map(str, command)],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                timeout=seconds,
                env={**os.environ, "TMPDIR": str(temporary()), **BUILDKIT},
                check=False,
            )
            failed = f"status {done.returncode}" if done.returncode else ""
        except subprocess.TimeoutExpired:
            failed = f"no end after {seconds:.0f} s"
    if failed:
        last = "\n".join("  " + line for line in log.read_text(errors="replace").splitlines()[-20:])
        text = " ".join(map(str, command))[:300]
        raise BuildError(f"`{text}`: {failed}.\n{last}\nIts log: {log}")


def temporary() -> Path:
    """A folder for the engines' temporary files, and for buildah's cache mounts."""
    folder = cache() / "buildah" / "tmp"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def mounts_below(mountinfo: str, folder: Path) -> list[Path]:
    """Mount points at or below a folder, from the text of /proc/self/mountinfo."""
    points = [Path(line.split()[4].replace("\\040", " ")) for line in mountinfo.splitlines()]
    return [p for p in points if p == folder or folder in p.parents]


def remove_tree(folder: Path) -> None:
    """Remove a folder, but never while anything is mounted below it: a deletion would go on
    into the mounted file system, which may be the machine's own.
    """
    if not folder.exists():
        return
    mounted = mounts_below(Path("/proc/self/mountinfo").read_text(), folder.resolve())
    if mounted:
        listed = ", ".join(map(str, mounted))
        raise BuildError(f"{folder} is not removed: unmount {listed} first, then try again.")
    shutil.rmtree(folder)


def logs(name: str) -> Path:
    return cache() / "images" / "logs" / f"{name}.log"


def host_bundle() -> Path | None:
    """The machine's certificate authorities: behind some proxies only they will do."""
    named = os.environ.get("PIP_CERT") or os.environ.get("SSL_CERT_FILE")
    usual = "/etc/ssl/certs/ca-certificates.crt"
    return next((Path(p) for p in (named, usual) if p and Path(p).is_file()), None)


def secrets() -> list[str]:
    """--secret flags that lend pip the machine's settings for the time of the build.

    The one bundle goes to a path of its own: over /etc/ssl/certs it would break the packages
    that write there.
    """
    bundle = host_bundle()
    lines = ["[global]", "timeout = 180", "retries = 5"]
    for setting in ("index-url", "extra-index-url", "trusted-host"):
        value = os.environ.get("PIP_" + setting.upper().replace("-", "_"))
        if value:
            lines.append(f"{setting} = {value}")
    flags = []
    if bundle:
        lines.append("cert = /run/ca.crt")
        flags.append(f"--secret=id=ca,src={bundle}")
    path = temporary() / "pip.conf"
    # Whole at each moment: another image's build may be reading it.
    written = path.with_name(f"pip.conf.{threading.get_ident()}")
    written.write_text("\n".join(lines) + "\n")
    written.replace(path)
    return [*flags, f"--secret=id=pip-conf,src={path}"]


def platform(image: Image) -> list[str]:
    """The flag by which an image says that it is for other machines than this one."""
    return [f"--platform={image.target.platform}"] if image.target else []


@contextlib.contextmanager
def minimal_debian(target: Target | None = None) -> Iterator[Path]:
    """A tar of Debian's packages, in the place of a base image that could not be pulled.

    With a target it is of that architecture, whose programs have to run here.
    """
    # A name of its own: the orphan of a killed build may still be writing the last one.
    tar = temporary() / f"debian-{os.getpid()}.tar"
    # Its proc, sys and dev are mounted in a namespace that ends with it: a killed one would
    # else leave them below the cache, where a deletion of the cache would walk into them.
    make = ["unshare", "--mount", "mmdebstrap", "--variant=minbase"]
    # An interrupted layer is thrown away: dpkg need not wait for the disk, as in Debian's images.
    make += ["--dpkgopt=force-unsafe-io"]
    if target:
        # What mmdebstrap would look at, a program of another package, has been tried out.
        make += [f"--architectures={target.arch}", "--skip=check/qemu"]
    try:
        run(_where_they_run([*make, "bookworm", tar], target), log=logs("mmdebstrap"))
        yield tar
    finally:
        tar.unlink(missing_ok=True)


def _where_they_run(command: Sequence[str | Path], target: Target | None) -> Sequence[str | Path]:
    """A command that starts programs of a target, in a namespace in which they can run."""
    program = emulation.interpreter(target.machine) if target else None
    return emulation.words(program, target.machine, command) if target and program else command


def pulled(command: Sequence[str | Path]) -> bool:
    """Whether a pull of the base succeeds. Raises BuildError when it can't be made either."""
    try:
        run(command, log=logs("pull"), seconds=PULL_SECONDS)
    except BuildError:
        if interrupted.is_set() or os.geteuid() or not shutil.which("mmdebstrap"):
            raise
        print("  no registry answers: making the base image from Debian's packages", flush=True)
        return False
    return True


def remove_leftovers() -> None:
    """Remove what an interrupted making of a base left behind."""
    for folder in temporary().glob("mmdebstrap.*"):
        remove_tree(folder)
    for tar in temporary().glob("debian-*.tar"):
        tar.unlink()


class Docker:
    """A Docker engine, asked for BuildKit: only that lends a step its secrets."""

    name = "docker"

    def _inspect(self, reference: str, template: str) -> str:
        """What the engine knows of an image, or nothing if it has none of that name."""
        command = ["docker", "image", "inspect", reference, "--format", template]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    def base(self) -> str:
        """The base's identity; fetched, or made by mmdebstrap where no registry answers."""
        if not self._inspect(BASE, "{{.Id}}") and not pulled(["docker", "pull", BASE]):
            take = ["docker", "import", "--change", 'CMD ["/bin/bash"]']
            with minimal_debian() as tar:
                run([*take, tar, BASE], log=logs("base-import"))
        found = self._inspect(BASE, "{{.Id}}")
        if not found:
            raise BuildError(f"Docker does not find the image {BASE} that it was just given.")
        return found

    def release(self) -> None:
        """Docker looks after its own, but not after what makes a base for it."""
        remove_leftovers()

    def has(self, image: Image, content: str) -> bool:
        return self._inspect(image.reference, '{{index .Config.Labels "' + LABEL + '"}}') == content

    def build(self, image: Image, folder: Path, content: str) -> None:
        command = ["docker", "build", "--network=host", f"--label={LABEL}={content}"]
        command += [*platform(image), *secrets(), f"--tag={image.reference}"]
        run([*command, folder], log=logs(image.key))

    def save(self, image: Image, archive: Path) -> None:
        saved = archive.with_suffix(".saved")
        run(["docker", "save", "-o", saved, image.reference], log=logs(f"{image.key}-save"))
        make_oci(saved, archive, image.reference)
        saved.unlink(missing_ok=True)


class Buildah:
    """buildah with a storage of its own, so that `make clean` can remove all it made.

    With a target it builds images of another architecture, whose programs are emulated meanwhile
    (emulation.py); its storage is another one, as a base has the same name for each.
    """

    name = "buildah"

    def __init__(self, target: Target | None = None) -> None:
        self._target = target
        self._root = cache() / (f"buildah-{target.arch}" if target else "buildah")
        self._base = ""

    def _command(self, *arguments: str | Path) -> list[str]:
        """A command in a mount namespace of its own: buildah leaves mounts behind even when a
        build ends well, and these end with the process.
        """
        own = ["--root", self._root / "storage", "--runroot", self._root / "run"]
        buildah = ["buildah", *map(str, own), "--storage-driver", "overlay"]
        whole = ["unshare", "--mount", *buildah, *map(str, arguments)]
        return [*map(str, _where_they_run(whole, self._target))]

    def _ask(self, *arguments: str | Path) -> str | None:
        done = subprocess.run(
            self._command(*arguments), capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else None

    def release(self) -> None:
        """Remove the working containers and folders that an interrupted build left behind."""
        remove_leftovers()
        if (self._root / "storage").is_dir():
            self._ask("rm", "--all")
            self._forget()

    def _forget(self) -> None:
        """Remove what earlier builds left: each change of the code leaves some 4 GB behind."""
        listed = json.loads(self._ask("images", "--json") or "[]")
        nameless = [image for image in listed if not image.get("names")]
        nameless.sort(key=lambda image: image["created"], reverse=True)
        for image in nameless[KEPT_IMAGES:]:
            self._ask("rmi", image["id"])

    def base(self) -> str:
        """The base's identity; fetched, or made by mmdebstrap where no registry answers."""
        inspect = ("inspect", "--type", "image", "--format", "{{.FromImageID}}", BASE)
        if not self._base and self._ask(*inspect) is None:
            self._fetch_base()
        self._base = self._ask(*inspect) or ""
        if not self._base:
            raise BuildError(f"buildah does not find the image {BASE} that it was just given.")
        return self._base

    def _fetch_base(self) -> None:
        arch = [f"--arch={self._target.arch}"] if self._target else []
        if pulled(self._command("pull", *arch, BASE)):
            return
        with minimal_debian(self._target) as tar:
            container = self._ask("from", *arch, "scratch")
            if container is None:
                raise BuildError(f"buildah can't make a container below {self._root}.")
            run(self._command("add", container, tar, "/"), log=logs("base-add"))
        config = self._command("config", *arch, "--cmd", "/bin/bash", container)
        run(config, log=logs("base-config"))
        run(self._command("commit", "--rm", container, BASE), log=logs("base-commit"))

    def has(self, _image: Image, _content: str) -> bool:
        return False  # the archives' records know it without a start of buildah

    def build(self, image: Image, folder: Path, content: str) -> None:
        arguments = ["bud", "--isolation=chroot", "--network=host", "--pull-never", "--layers"]
        arguments += [f"--label={LABEL}={content}", *secrets(), f"--tag={image.reference}"]
        seconds = EMULATED_SECONDS if self._target else BUILD_SECONDS
        command = self._command(*arguments, *platform(image), folder)
        run(command, log=logs(image.key), seconds=seconds)

    def save(self, image: Image, archive: Path) -> None:
        target = f"oci-archive:{archive}:{image.reference}"
        run(self._command("push", image.reference, target), log=logs(f"{image.key}-save"))


def docker_answers() -> bool:
    if not shutil.which("docker"):
        return False
    try:
        done = subprocess.run(
            ["docker", "version", "--format", "{{.Server.Version}}"],
            capture_output=True,
            timeout=10,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def choose(name: str) -> Docker | Buildah:
    """The engine called `name`, or for `auto` the one that is there."""
    if name == "docker" or (name == "auto" and docker_answers()):
        return Docker()
    if not shutil.which("buildah"):
        raise BuildError("There is neither a Docker engine nor buildah; run `make preflight`.")
    return Buildah()
