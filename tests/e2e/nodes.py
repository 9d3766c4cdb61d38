"""Pods on chosen nodes of the embedded cluster, for tests of what happens between nodes."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

from tests.e2e import kubectl as k

IMAGE = "bagpipe.local/ros:0.2.0"
PORT = 8080
# A server that answers every connection with its pod's name; it also says so in its log.
SERVER = f"""
import http.server, os

class Answer(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.end_headers()
        self.wfile.write(os.environ["HOSTNAME"].encode())

print("serving as", os.environ["HOSTNAME"], flush=True)
http.server.ThreadingHTTPServer(("", {PORT}), Answer).serve_forever()
"""


def names() -> list[str]:
    """The cluster's nodes, sorted."""
    return sorted(each["metadata"]["name"] for each in k.items("default", "nodes"))


def ready(node: str) -> bool:
    """Whether the API server calls a node ready."""
    conditions = k.get("default", "node", node)["status"]["conditions"]
    return any(c["type"] == "Ready" and c["status"] == "True" for c in conditions)


def apply(objects: list[k.Object]) -> None:
    """kubectl apply objects that carry their namespace."""
    k.kubectl(
        "apply",
        "-f",
        "-",
        given=json.dumps({"apiVersion": "v1", "kind": "List"} | {"items": objects}),
    )


def pod(namespace: str, name: str, node: str, claims: tuple[str, ...] = ()) -> k.Object:
    """A pod that a node must run, serving its own name on PORT, with claims at /<claim>."""
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name, "namespace": namespace, "labels": {"app": "server"}},
        "spec": {
            "terminationGracePeriodSeconds": 0,
            "enableServiceLinks": False,
            # Not nodeName: the scheduler must see the pod, for a claim waits for its choice.
            "nodeSelector": {"kubernetes.io/hostname": node},
            "volumes": [{"name": c, "persistentVolumeClaim": {"claimName": c}} for c in claims],
            "containers": [
                {
                    "name": "server",
                    "image": IMAGE,
                    "imagePullPolicy": "IfNotPresent",
                    "command": ["python3", "-c", SERVER],
                    "securityContext": k.RESTRICTED,
                    "readinessProbe": {"httpGet": {"port": PORT}, "periodSeconds": 1},
                    "volumeMounts": [{"name": c, "mountPath": f"/{c}"} for c in claims],
                }
            ],
        },
    }


def service(namespace: str) -> k.Object:
    """The service `server` of all such pods."""
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": "server", "namespace": namespace},
        "spec": {"selector": {"app": "server"}, "ports": [{"port": 80, "targetPort": PORT}]},
    }


def claim(namespace: str, name: str, mode: str) -> k.Object:
    """A claim of the default class."""
    return {
        "apiVersion": "v1",
        "kind": "PersistentVolumeClaim",
        "metadata": {"name": name, "namespace": namespace},
        "spec": {"accessModes": [mode], "resources": {"requests": {"storage": "16Mi"}}},
    }


def run(namespace: str, name: str, *command: str, seconds: float = 30) -> str:
    """What a command prints in a pod."""
    return k.kubectl("-n", namespace, "exec", name, "--", *command, seconds=seconds)


def fetch(namespace: str, name: str, host: str, port: int = PORT) -> str:
    """What a server says to a pod. Raises KubectlError if it does not answer within 3 s."""
    url = f"http://{host}:{port}"
    program = f"import urllib.request as u; print(u.urlopen('{url}', timeout=3).read().decode())"
    return run(namespace, name, "python3", "-c", program).strip()


@contextmanager
def namespace(name: str) -> Iterator[str]:
    """A namespace that is gone with all in it when the block ends."""
    k.create_namespace(name)
    try:
        yield name
    finally:
        k.kubectl("delete", "namespace", name, "--wait=true", "--timeout=300s", seconds=320)
