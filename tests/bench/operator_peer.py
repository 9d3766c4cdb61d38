"""The peer of the operator's bench: kubeflow/spark-operator on the same cluster, same machine.

Its binary is built from its Go module and calls the spark-submit of the pyspark wheel, as it does
in its image; a JVM starts for every application. Its webhook and its UI services are off.
"""

import os
import time
from pathlib import Path

import pyspark
from embedded import builds

from tests.bench.operator_api import Client, Object, all_of
from tests.bench.operator_seen import until
from tests.bench.operator_world import (
    NAMESPACE,
    World,
    dying_with_us,
    fresh,
)
from tests.integration.storage.servers import Server
from tests.ports import free_port

VERSION = "v2.3.0"
APPLICATIONS = f"/apis/sparkoperator.k8s.io/v1beta2/namespaces/{NAMESPACE}/sparkapplications"
# One JVM after the other: measured elsewhere, 20 took 70 s on two processors.
LONGEST_SECONDS = 300.0


def application(name: str) -> Object:
    """The published example, with nothing to be pulled: KWOK's nodes run nothing anyway."""
    small = {"cores": 1, "memory": "512m"}
    return {
        "apiVersion": "sparkoperator.k8s.io/v1beta2",
        "kind": "SparkApplication",
        "metadata": {"name": name, "namespace": NAMESPACE},
        "spec": {
            "type": "Scala",
            "mode": "cluster",
            "image": "example/spark:4.0.0",
            "sparkVersion": "4.0.0",
            "mainClass": "org.apache.spark.examples.SparkPi",
            "mainApplicationFile": "local:///opt/spark/examples/jars/spark-examples.jar",
            "driver": {**small, "serviceAccount": "bagpipe-driver"},
            "executor": {**small, "instances": 1},
        },
    }


async def seconds_to_pods(count: int) -> tuple[float, float]:
    """Seconds until the first and the last driver pod of applications applied at once."""
    crds = builds.module_of(builds.SPARK_OPERATOR) / "config/crd/bases"  # as its module has them
    async with fresh(crds) as world:
        await _install(world.client)
        server = await _operator(world)
        try:
            server.start()
            return await _measure(world.client, server, count)
        finally:
            if server.alive:
                server.kill()


async def _measure(client: Client, server: Server, count: int) -> tuple[float, float]:
    created: dict[str, float] = {}

    def take(_kind: str, pod: Object) -> None:
        labels = pod["metadata"].get("labels") or {}
        if labels.get("spark-role") == "driver":
            created.setdefault(pod["metadata"]["name"], time.monotonic())

    log = server.log
    await until("the peer's start", lambda: "Starting workers" in log.read_text(), 60)
    async with client.watched(f"/api/v1/namespaces/{NAMESPACE}/pods", take):
        begun = time.monotonic()
        names = [f"peer-{number:03d}" for number in range(count)]
        await all_of(client.create(APPLICATIONS, application(name)) for name in names)
        try:
            await until(f"{count} driver pods", lambda: len(created) == count, LONGEST_SECONDS)
        except TimeoutError as error:
            raise TimeoutError(f"{error}; its last lines: {log.read_text()[-3000:]}") from error
    return min(created.values()) - begun, max(created.values()) - begun


async def _install(client: Client) -> None:
    """An account that may do anything."""
    account = {"kind": "ServiceAccount", "name": "peer", "namespace": NAMESPACE}
    await client.create(
        f"/api/v1/namespaces/{NAMESPACE}/serviceaccounts", {"metadata": {"name": "peer"}}
    )
    await client.create(
        "/apis/rbac.authorization.k8s.io/v1/clusterrolebindings",
        {
            "metadata": {"name": "peer"},
            "roleRef": {
                "apiGroup": "rbac.authorization.k8s.io", "kind": "ClusterRole",
                "name": "cluster-admin",
            },
            "subjects": [account],
        },
    )  # fmt: skip


async def _operator(world: World) -> Server:
    """Its controller, not started yet; spark-submit reads the same kubeconfig, with a token."""
    kubeconfig = world.folder / "peer.kubeconfig"
    world.plane.write_kubeconfig(kubeconfig, world.plane.token(NAMESPACE, "peer"))
    host, port = world.plane.admin.url.removeprefix("https://").split(":")
    program = builds.ensure(builds.SPARK_OPERATOR) / builds.SPARK_OPERATOR.folder
    flags = [
        f"--namespaces={NAMESPACE}", "--enable-ui-service=false", "--controller-threads=10",
        f"--health-probe-bind-address=127.0.0.1:{free_port()}", "--zap-log-level=info",
    ]  # fmt: skip
    environment = {
        "KUBECONFIG": str(kubeconfig),
        "KUBERNETES_SERVICE_HOST": host,
        "KUBERNETES_SERVICE_PORT": port,
        "SPARK_HOME": str(Path(pyspark.__file__).parent),
        "PATH": os.environ["PATH"],
    }
    command = [*dying_with_us(), str(program), "controller", "start", *flags]
    return Server(command, world.folder / "peer.log", environment)
