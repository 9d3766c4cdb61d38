"""A real registry on loopback, which asks for a login, and a small release to push into it."""

from __future__ import annotations

import json
import os
import subprocess
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from embedded import builds, oci

from release import archives, charts, sums, version
from release.make import DIGESTS, RELEASED
from tests.integration.storage.servers import LOOPBACK, Host, Server, listens
from tests.ports import free_port
from tests.waiting import PATIENCE

USER, PASSWORD = "robot", "opensesame"
# bcrypt of the password, the one hash that the registry takes; of the least cost.
_HASH = "$2b$05$fPPN.XSqrHb5HsZtqJSBp.xnegonp/zu7CsLnjcIwCEG4seg5yprq"
_SECONDS = 60
# Of the small release: one of its images is for both.
PLATFORMS = {"agent": ("amd64", "arm64"), "operator": ("amd64",), "spark": ("amd64",)}


@dataclass(frozen=True)
class Running:
    """A running registry, and the folder of a client's logins."""

    port: int
    folder: Path
    address: str = "127.0.0.1"

    @property
    def name(self) -> str:
        return f"{self.address}:{self.port}/robots"

    def login(self, password: str) -> Path:
        """A folder for DOCKER_CONFIG, as `docker login` leaves it."""
        folder = self.folder / f"login-{password}"
        folder.mkdir(exist_ok=True)
        token = b64encode(f"{USER}:{password}".encode()).decode()
        config = {"auths": {f"{self.address}:{self.port}": {"auth": token}}}
        (folder / "config.json").write_text(json.dumps(config))
        return folder

    def ask(self, program: str, *words: str) -> str:
        """What crane or helm answers with the right login."""
        if program == "crane":
            program = str(builds.ensure(builds.PUSHER) / "crane")
        environment = {**os.environ, "DOCKER_CONFIG": str(self.login(PASSWORD))}
        done = subprocess.run(
            [program, *words], env=environment, capture_output=True, text=True, timeout=_SECONDS,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()


@contextmanager
def registry(
    folder: Path, host: Host = LOOPBACK, port: int | None = None, login: bool = True
) -> Iterator[Running]:
    """The registry over a folder, until the block ends; without a port on one that is free.

    In a network namespace it serves all addresses: nodes pull without TLS from loopback only.
    """
    found = Running(port or free_port(), folder, host.address)
    (folder / "htpasswd").write_text(f"{USER}:{_HASH}\n")
    config = {
        "version": "0.1",
        "storage": {"filesystem": {"rootdirectory": str(folder / "content")}},
        "http": {"addr": f"{'' if host.namespace else host.address}:{found.port}"},
    }
    if login:
        passwords = {"realm": "robots", "path": str(folder / "htpasswd")}
        config["auth"] = {"htpasswd": passwords}
    (folder / "config.yml").write_text(json.dumps(config))
    program = str(builds.ensure(builds.REGISTRY) / "registry")
    command = host.command(program, "serve", str(folder / "config.yml"))
    server = Server(command, folder / "registry.log")
    server.start()
    try:
        server.await_ready(lambda: listens(found.port, host.address), PATIENCE)
        yield found
    finally:
        server.kill()


def small_release(folder: Path) -> dict[str, str]:
    """A release of images that hold a few bytes each, with the charts; the images' digests."""
    number = version.version()
    (folder / "images").mkdir(parents=True)
    found = {}
    for name in RELEASED:
        program = folder.parent / f"{name}-program"
        program.write_bytes(name.encode() * 1000)
        reference, parts = f"bagpipe.local/{name}:{number}", []
        for arch in PLATFORMS[name]:
            parts.append(folder.parent / f"{name}-{arch}.tar")
            oci.write_single_binary(parts[-1], reference, program, "/program", arch)
        archive = folder / "images" / f"{name}-{number}.oci.tar"
        if len(parts) > 1:
            archives.join(parts, archive, reference)
        else:
            parts[0].replace(archive)
        found[name] = archives.inspect(archive)
    lines = [f"{name} {each.digest} {each.platforms}\n" for name, each in found.items()]
    (folder / DIGESTS).write_text("".join(lines))
    digests = {name: each.digest for name, each in found.items()}
    charts.pack("bagpipe", number, folder / "charts", digests=digests)
    charts.pack("bagpipe-namespace", number, folder / "charts")
    sums.write(folder)
    return digests
