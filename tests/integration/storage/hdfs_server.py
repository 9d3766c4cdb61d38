"""A real NameNode and a real DataNode, out of Hadoop's artefacts in Maven's registry."""

import hashlib
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.cached import cache
from tests.integration.storage.servers import LOOPBACK, Host, Server, listens
from tests.ports import free_port
from tests.waiting import PATIENCE, wait_until

_POM = Path(__file__).parent / "hadoop" / "pom.xml"
_SHA256 = {
    "hadoop-client-api-3.5.0.jar": (
        "cc59446ec9ebaceae56fdb8d8c21477766dc5d426325642151c796bec5c4e6b7"
    ),
    "hadoop-client-runtime-3.5.0.jar": (
        "b7db3e60c5df1cd37c2995b3e0142e57487260706834e5325bbe0a5e683eedf1"
    ),
    "hadoop-client-minicluster-3.5.0.jar": (
        "06772d24529e59939915979b3edba204d367750ef7dc5120411f35221dd4818c"
    ),
    "commons-logging-1.3.0.jar": (
        "66d3c980470b99b0c511dad3dfc0ae7b265ec1fb144e96bc0253a8a175fd34d9"
    ),
    "slf4j-api-1.7.36.jar": "d3ef575e3e4979678dc01bf1dcce51021493b4d11fb7f1be8ad982877c16a1c0",
    "slf4j-simple-1.7.36.jar": "2f39bed943d624dfa8f4102d0571283a10870b6aa36f197a8a506f147010c10f",
}
_FETCH_SECONDS = 600
_NAMENODE = "org.apache.hadoop.hdfs.server.namenode.NameNode"
_DATANODE = "org.apache.hadoop.hdfs.server.datanode.DataNode"
# Who starts the NameNode may do everything; tests are someone else.
_OWNER = {"HADOOP_USER_NAME": "root"}
_JAVA = ["java", "-Xmx192m", "-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1"]
# What Hadoop's own tests are given on a new Java.
_OPENS = [
    "--add-opens=java.base/java.lang=ALL-UNNAMED",
    "--add-opens=java.base/java.nio=ALL-UNNAMED",
]


def jars() -> list[Path]:
    """Hadoop's jars in Bagpipe's cache, fetched first where needed, each with its known hash."""
    folder = cache() / "hadoop" / "3.5.0"
    if not all((folder / name).exists() for name in _SHA256):
        _fetch(folder)
    for name, expected in _SHA256.items():
        with (folder / name).open("rb") as jar:
            found = hashlib.file_digest(jar, "sha256").hexdigest()
        assert found == expected, f"{folder / name} is not the file that the tests know: remove it"
    return [folder / name for name in _SHA256]


def _fetch(folder: Path) -> None:
    """By Maven, which knows the machine's registry."""
    folder.mkdir(parents=True, exist_ok=True)
    plugin = "org.apache.maven.plugins:maven-dependency-plugin:3.6.1:copy-dependencies"
    command = ["mvn", "--batch-mode", "--quiet", "--file", str(_POM), plugin]
    done = subprocess.run(
        [*command, f"-DoutputDirectory={folder}", "-DexcludeTransitive=true"],
        capture_output=True,
        text=True,
        timeout=_FETCH_SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


@dataclass
class Hdfs:
    """A NameNode and a DataNode; the folder /jobs is the user's."""

    namenode: Server
    datanode: Server
    port: int
    data_port: int
    host: Host = LOOPBACK

    @property
    def uri(self) -> str:
        return f"hdfs://{self.host.address}:{self.port}/jobs"

    def start(self) -> None:
        """Start both at once: most of it is Java's own start."""
        self.datanode.start()
        self.start_namenode()
        self._await_datanode(0)

    def start_namenode(self) -> None:
        self.namenode.start()
        self.namenode.await_ready(lambda: listens(self.port, self.host.address), PATIENCE)

    def start_datanode(self) -> None:
        """Start it and wait until the NameNode knows it, without which no block can be placed."""
        known = self._registrations()
        self.datanode.start()
        self._await_datanode(known)

    def _await_datanode(self, known: int) -> None:
        self.datanode.await_ready(lambda: listens(self.data_port, self.host.address), PATIENCE)
        wait_until(lambda: self._registrations() > known, PATIENCE, "the DataNode did not register")

    def stop(self) -> None:
        self.datanode.kill()
        self.namenode.kill()

    def _registrations(self) -> int:
        # With it a report's line ends that has been worked off; one says before that it begins.
        return self.namenode.log.read_text().count("hasStaleStorage: ")


def hdfs(folder: Path, host: Host = LOOPBACK, ports: tuple[int, int] | None = None) -> Hdfs:
    """HDFS over a folder, formatted, not yet started.

    `ports` are the NameNode's and the DataNode's; without them two of loopback that are free.
    """
    port, data_port = ports or (free_port(), free_port())
    (folder / "conf").mkdir()
    (folder / "tmp").mkdir()
    settings = {
        "dfs.namenode.name.dir": f"file://{folder}/name",
        "dfs.datanode.data.dir": f"file://{folder}/data",
        "dfs.replication": "1",
        "dfs.namenode.rpc-address": f"{host.address}:{port}",
        "dfs.namenode.http-address": "127.0.0.1:0",
        "dfs.datanode.address": f"{host.address}:{data_port}",
        # An address of the cluster's has no name that could be looked up.
        "dfs.namenode.datanode.registration.ip-hostname-check": "false",
        "dfs.datanode.http.address": "127.0.0.1:0",
        "dfs.datanode.ipc.address": "127.0.0.1:0",
        # The tests' files are small, and a machine's disk may be nearly full.
        "dfs.datanode.du.reserved": "0",
        "dfs.blocksize": "16777216",
        "dfs.namenode.fs-limits.min-block-size": "1048576",
        "dfs.namenode.safemode.extension": "0",
        "dfs.heartbeat.interval": "1",
        "dfs.client.use.datanode.hostname": "false",
    }
    _write_settings(folder / "conf/hdfs-site.xml", settings)
    _write_settings(
        folder / "conf/core-site.xml", {"fs.defaultFS": f"hdfs://{host.address}:{port}"}
    )
    # Its web servers unpack themselves there, and a killed one removes nothing.
    scratch = f"-Djava.io.tmpdir={folder}/tmp"
    java = [*_JAVA, scratch, *_OPENS, "-cp", ":".join(map(str, [folder / "conf", *jars()]))]
    done = subprocess.run(
        [*java, _NAMENODE, "-format", "-force"],
        cwd=folder,
        env={**os.environ, **_OWNER},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    namenode = Server(host.command(*java, _NAMENODE), folder / "namenode.log", _OWNER, folder)
    datanode = Server(host.command(*java, _DATANODE), folder / "datanode.log", _OWNER, folder)
    return Hdfs(namenode, datanode, port, data_port, host)


def _write_settings(path: Path, settings: dict[str, str]) -> None:
    entries = (
        f"<property><name>{name}</name><value>{value}</value></property>"
        for name, value in settings.items()
    )
    path.write_text(f"<configuration>{''.join(entries)}</configuration>\n")
