"""Make the archive of Spark's classes that this image's JVMs map in place of reading 280 jars.

    python3 class_archive.py class-path    leave one jar in SPARK_HOME/jars, which names all others
    python3 class_archive.py archive FILE  run a job, and archive what its JVMs load

Part of the image's build, before Bagpipe's own package, so that a change there makes no new one.
The job has four tasks: a driver in client mode, for which this program is Kubernetes, and one
executor of the image's entrypoint (class data sharing: `java -Xshare:dump`).
"""

import base64
import hashlib
import hmac
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

Json = dict[str, Any]

ENTRYPOINT = "/opt/bagpipe/entrypoint.sh"
# The job takes 15 s of an idle machine, and so does the archive; a build may share its machine.
SECONDS = 900
# Since 1970, for the jars: a layer keeps whole seconds, and the JVM compares them.
WRITTEN = 1_700_000_000
NAME = "training"
# A job's own (bagpipe.driver.spark_context), where they decide which classes are loaded.
SETTINGS = {
    "spark.app.name": NAME,
    "spark.kubernetes.namespace": NAME,
    "spark.kubernetes.container.image": "spark",
    "spark.kubernetes.driver.pod.name": NAME,
    "spark.kubernetes.executor.disableConfigMap": "true",
    "spark.driver.bindAddress": "127.0.0.1",
    "spark.driver.host": "127.0.0.1",
    "spark.authenticate": "true",
    "spark.network.crypto.enabled": "true",
    "spark.ui.enabled": "false",
    "spark.ui.showConsoleProgress": "false",
    "spark.kubernetes.driver.service.deleteOnTermination": "false",
    "spark.kubernetes.driver.ownPersistentVolumeClaim": "false",
    "spark.kubernetes.driver.reusePersistentVolumeClaim": "false",
    "spark.executor.instances": "1",
    "spark.scheduler.minRegisteredResourcesRatio": "0.0",
    "spark.kubernetes.resource.type": "python",
    "spark.kubernetes.executor.enablePollingWithResourceVersion": "true",
    "spark.task.reaper.enabled": "true",
    "spark.python.unix.domain.socket.enabled": "true",
    "spark.speculation": "true",
}


class TrainingError(Exception):
    """The job did not do what it should; the message says what."""


def manifest(jars: list[str]) -> str:
    """Of a jar that names others, as the JAR specification has it: at most 72 bytes a line."""
    line = "Class-Path: " + " ".join(jars)
    folded = "\r\n ".join(line[at : at + 70] for at in range(0, len(line), 70))
    return f"Manifest-Version: 1.0\r\n{folded}\r\n\r\n"


def one_class_path(home: Path) -> None:
    """Move Spark's jars, and leave one in their place, which names them in their order.

    Spark's class path is `jars/*`, in the order in which a file system lists it: with all of them
    there an archive would fit on the machine where it was made, and perhaps on no other.
    """
    others = home / "all-jars"
    # A layer's folder can't be renamed in another one.
    shutil.move(home / "jars", others)
    # Spark's launcher puts slf4j's before all others.
    jars = sorted(
        others.glob("*.jar"), key=lambda jar: (not jar.name.startswith("slf4j-api-"), jar)
    )
    (home / "jars").mkdir()
    path = home / "jars" / "class-path.jar"
    with zipfile.ZipFile(path, "w") as jar:
        names = [f"../{others.name}/{each.name}" for each in jars]
        jar.writestr(zipfile.ZipInfo("META-INF/MANIFEST.MF"), manifest(names))
    for each in (path, *jars):
        os.utime(each, (WRITTEN, WRITTEN))


class Kubernetes(ThreadingHTTPServer):
    """As much of an API server as Spark needs, and a kubelet that runs executors as processes."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Request)
        self.pods: dict[str, Json] = {NAME: pod(NAME, {})}
        self.executors: dict[str, subprocess.Popen[bytes]] = {}
        self.done = threading.Event()
        self.address = f"http://127.0.0.1:{self.server_port}"
        # A build may have the machine's network, where anybody could ask for a process.
        self.token = secrets.token_urlsafe()

    def run(self, name: str, container: Json) -> None:
        """Start an executor. What Kubernetes would fill in is an address, but for its name."""
        given = {each["name"]: each.get("value", "127.0.0.1") for each in container["env"]}
        own = {"SPARK_EXECUTOR_POD_NAME": name, "SPARK_LOCAL_DIRS": tempfile.gettempdir()}
        self.executors[name] = subprocess.Popen(
            [ENTRYPOINT, "executor"], env=os.environ | given | own
        )

    def settings(self, token: Path) -> dict[str, str]:
        """What leads Spark here. The token is in a file: settings are words of a process."""
        token.touch(0o600)
        token.write_text(self.token)
        return {
            "spark.kubernetes.authenticate.oauthTokenFile": str(token),
            "spark.master": f"k8s://{self.address}",
        }

    def look(self) -> None:
        """Say of executors that have ended that they failed: then Spark gives up after a few."""
        # A request of another thread may add one meanwhile.
        for name, process in list(self.executors.items()):
            if process.poll() is not None:
                self.pods[name]["status"] = {"phase": "Failed"}


class Request(BaseHTTPRequestHandler):
    """What Spark's scheduler of executors asks for."""

    server: Kubernetes
    protocol_version = "HTTP/1.1"

    def parse_request(self) -> bool:
        """Whether it is a request, and Spark's."""
        if not super().parse_request():
            return False
        given = self.headers.get("Authorization", "")
        if hmac.compare_digest(given.encode(), f"Bearer {self.server.token}".encode()):
            return True
        self.send_error(401)
        return False

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        name = path.partition("/pods")[2].strip("/")
        if "watch=true" in query:
            self.watch()
        elif name:
            self.answer(json.dumps(self.server.pods[name]).encode())
        else:
            self.server.look()
            # The driver looks for itself by its name, and for its executors by their labels.
            own = "labelSelector" not in query
            items = [each for name, each in list(self.server.pods.items()) if (name == NAME) == own]
            kind = {"apiVersion": "v1", "kind": "PodList", "metadata": {"resourceVersion": "1"}}
            self.answer(json.dumps(kind | {"items": items}).encode())

    def do_POST(self) -> None:
        made = json.loads(self.body())
        name = made["metadata"]["name"]
        self.server.pods[name] = pod(name, made["metadata"]) | {"spec": made["spec"]}
        (container,) = made["spec"]["containers"]
        self.server.run(name, container)
        self.answer(json.dumps(self.server.pods[name]).encode())

    def do_PATCH(self) -> None:
        self.body()
        self.answer(json.dumps(self.server.pods[self.path.rpartition("/")[2]]).encode())

    def do_DELETE(self) -> None:
        self.body()
        self.answer(b'{"apiVersion": "v1", "kind": "Status", "status": "Success"}')

    def body(self) -> bytes:
        return self.rfile.read(int(self.headers.get("Content-Length", 0)))

    def answer(self, text: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def watch(self) -> None:
        """A WebSocket (RFC 6455) on which nothing happens: Spark asks for lists besides."""
        key = self.headers["Sec-WebSocket-Key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
        accepted = base64.b64encode(hashlib.sha1(key.encode(), usedforsecurity=False).digest())
        self.send_response(101)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        self.send_header("Sec-WebSocket-Accept", accepted.decode())
        self.end_headers()
        self.server.done.wait(SECONDS)
        self.close_connection = True

    def log_message(self, *_: object) -> None:
        """Nothing: the build's output is about the build."""


def pod(name: str, metadata: Json) -> Json:
    """One that runs, with what else its metadata says."""
    own = {"name": name, "namespace": NAME, "uid": name, "resourceVersion": "1"}
    begun = {"creationTimestamp": "2026-01-01T00:00:00Z"}
    ready = {"phase": "Running", "conditions": [{"type": "Ready", "status": "True"}]}
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": own | begun | metadata,
        "spec": {"containers": []},
        "status": ready,
    }


@contextmanager
def kubernetes() -> Iterator[Kubernetes]:
    """At its end all executors have ended. Raises subprocess.TimeoutExpired."""
    with Kubernetes() as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield server
            for executor in server.executors.values():
                executor.wait(SECONDS)
        finally:
            for executor in server.executors.values():
                executor.kill()
            server.done.set()
            server.shutdown()


@contextmanager
def deadline() -> Iterator[None]:
    """Raises TrainingError in the main thread, wherever it waits."""

    def over(*_: object) -> None:
        raise TrainingError(f"the job was not done after {SECONDS} s: see what Spark says above")

    before = signal.signal(signal.SIGALRM, over)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def on_this_machine() -> None:
    """Leave out of the environment what would lead Spark elsewhere."""
    for name in [name for name in os.environ if name.lower().endswith("_proxy")]:
        del os.environ[name]
    # In a build's container the machine's own name may be nobody's.
    os.environ |= {"SPARK_LOCAL_IP": "127.0.0.1", "SPARK_LOCAL_HOSTNAME": "localhost"}


@contextmanager
def job(settings: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """The JVM of a driver whose four tasks are done; after the block it has ended.

    Raises TrainingError, and subprocess.TimeoutExpired.
    """
    from pyspark import SparkConf, SparkContext  # noqa: PLC0415  its jars may have to be moved yet
    from pyspark.java_gateway import launch_gateway  # noqa: PLC0415

    conf = SparkConf().setAll(list(settings.items()))
    gateway: Any = launch_gateway(conf)  # type: ignore[no-untyped-call]
    try:
        spark = SparkContext(conf=conf, gateway=gateway)
        total = spark.parallelize(range(4), 4).map(lambda number: number + 1).sum()
        if total != 10:
            raise TrainingError(f"the tasks' sum is {total}")
        yield gateway.proc
        spark.stop()
        gateway.shutdown()
        gateway.proc.stdin.close()
        gateway.proc.wait(SECONDS)
    finally:
        gateway.proc.kill()


def loaded(folder: Path) -> list[str]:
    """What the JVMs of a job load, in the words of a class list. Raises TrainingError."""
    on_this_machine()
    lists = {side: folder / side for side in ("driver", "executor")}
    options = {
        f"spark.{side}.extraJavaOptions": f"-XX:DumpLoadedClassList={path}"
        for side, path in lists.items()
    }
    with (
        deadline(),
        kubernetes() as server,
        job(SETTINGS | options | server.settings(folder / "token")),
    ):
        pass  # A JVM writes its list as it ends.
    return sorted({line for path in lists.values() for line in path.read_text().splitlines()})


def archive(home: Path, made: Path) -> None:
    """Raises TrainingError, and subprocess' CalledProcessError and TimeoutExpired."""
    with tempfile.TemporaryDirectory() as folder:
        lines = loaded(Path(folder))
        classes = Path(folder) / "classes"
        classes.write_text("\n".join(lines) + "\n")
        subprocess.run(
            [
                "java", "-Xshare:dump", "-Xlog:cds=error", f"-XX:SharedClassListFile={classes}",
                f"-XX:SharedArchiveFile={made}", "-cp", f"{home}/conf:{home}/jars/*",
            ],
            check=True, timeout=SECONDS,
        )  # fmt: skip
    print(f"{len(lines)} classes in {made.stat().st_size >> 20} MiB")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["class-path"]:
            one_class_path(Path(os.environ["SPARK_HOME"]))
        case ["archive", name]:
            archive(Path(os.environ["SPARK_HOME"]), Path(name))
        case _:
            sys.exit(__doc__)
