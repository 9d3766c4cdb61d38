"""kubectl for the demonstration and the end-to-end tests: the user's own tool, with deadlines."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from tests.cached import cache
from tests.waiting import wait_until

Result = TypeVar("Result")
Object = dict[str, Any]

_COMMAND_SECONDS = 120
EMBEDDED_KUBECONFIG = "/var/lib/bagpipe/kubeconfig"
TOOLBOX = "toolbox"
# The tests' namespace enforces the Pod Security level restricted, for their own pods too.
RESTRICTED: Object = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "runAsNonRoot": True,
    "runAsUser": 10001,
    "seccompProfile": {"type": "RuntimeDefault"},
}


class KubectlError(Exception):
    """kubectl ended with an error; the text is its output."""


def tool_environment() -> dict[str, str]:
    """The environment in which the project's own kubectl and helm are found, and the cluster."""
    environment = {"KUBECONFIG": EMBEDDED_KUBECONFIG, **os.environ}
    environment["PATH"] = f"{cache() / 'bin/tools'}:{environment['PATH']}"
    return environment


def kubectl(*arguments: str, given: str | None = None, seconds: float = _COMMAND_SECONDS) -> str:
    """What kubectl prints. Raises KubectlError."""
    done = subprocess.run(
        ["kubectl", *arguments],
        input=given,
        capture_output=True,
        text=True,
        timeout=seconds,
        env=tool_environment(),
        check=False,
    )
    if done.returncode:
        raise KubectlError(f"kubectl {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout


def get(namespace: str, *what: str) -> Object:
    """An object, or a list of them, as kubectl gets it."""
    loaded: Object = json.loads(kubectl("-n", namespace, "get", *what, "-o", "json"))
    return loaded


def items(namespace: str, *what: str) -> list[Object]:
    """The objects of a list."""
    found: list[Object] = get(namespace, *what)["items"]
    return found


def await_that(
    what: str, look: Callable[[], Result | None], seconds: float, every: float = 0.5
) -> Result:
    """Look until there is something true to see. Raises TimeoutError that says what was awaited."""
    return wait_until(look, seconds, f"waited for {what}", every)


def create_namespace(name: str) -> None:
    """A namespace that takes pods: their ServiceAccount is made a moment after it."""
    kubectl("create", "namespace", name)
    account = ("serviceaccount", "default", "--ignore-not-found", "-o", "name")
    await_that(
        f"the default ServiceAccount of {name}",
        lambda: kubectl("-n", name, "get", *account).strip(),
        120,
    )


def start_toolbox(namespace: str) -> None:
    """A pod of the ROS image with both claims: the way in and out for bags."""
    mounts = [{"name": claim, "mountPath": f"/{claim}"} for claim in ("recordings", "results")]
    volumes = [
        {"name": claim, "persistentVolumeClaim": {"claimName": claim}}
        for claim in ("recordings", "results")
    ]
    pod = {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": TOOLBOX, "namespace": namespace},
        "spec": {
            "terminationGracePeriodSeconds": 0,
            "enableServiceLinks": False,
            "automountServiceAccountToken": False,
            "securityContext": {"fsGroup": 10001},
            "volumes": volumes,
            "containers": [
                {
                    "name": TOOLBOX,
                    "image": "bagpipe.local/ros:0.2.0",
                    "imagePullPolicy": "IfNotPresent",
                    "command": ["sleep", "86400"],
                    "securityContext": RESTRICTED,
                    "volumeMounts": mounts,
                }
            ],
        },
    }
    kubectl("apply", "-f", "-", given=json.dumps(pod))
    ready = ("wait", "--for=condition=Ready", f"pod/{TOOLBOX}", "--timeout=300s")
    kubectl("-n", namespace, *ready, seconds=320)


def in_toolbox(namespace: str, *command: str) -> str:
    """What a command prints inside the toolbox."""
    return kubectl("-n", namespace, "exec", TOOLBOX, "--", *command)


def put(namespace: str, source: Path, target: str) -> None:
    """Copy a file into the claim `recordings`."""
    in_toolbox(namespace, "mkdir", "-p", str(Path("/recordings") / Path(target).parent))
    kubectl("cp", str(source), f"{namespace}/{TOOLBOX}:/recordings/{target}")


def results(namespace: str, uri: str) -> tuple[Object, list[Object]]:
    """The manifest and the rows below a results URI on the claim `results`."""
    folder = "/" + uri.removeprefix("pvc://")
    manifest: Object = json.loads(in_toolbox(namespace, "cat", f"{folder}/manifest.json"))
    lines = in_toolbox(namespace, "cat", f"{folder}/results.jsonl").splitlines()
    return manifest, [json.loads(line) for line in lines]


def on_claim(namespace: str, uri: str) -> str:
    """A URI on a claim of the toolbox as `kubectl cp` names it."""
    return f"{namespace}/{TOOLBOX}:/{uri.removeprefix('pvc://')}"


def take_results(namespace: str, uri: str, target: Path) -> None:
    """Copy a results folder out of the claim `results`, in place of what was there.

    Raises KubectlError (also where the copy lacks a file of every job), TimeoutExpired and OSError.
    """
    if target.exists():
        shutil.rmtree(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    kubectl("cp", on_claim(namespace, uri), str(target))
    # kubectl says nothing of a folder that it found empty, and ends well.
    missing = [name for name in ("manifest.json", "report.html") if not (target / name).is_file()]
    if missing:
        raise KubectlError(f"kubectl cp left no {' and no '.join(missing)} in {target}")
