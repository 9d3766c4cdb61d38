"""A fake kubelet, for want of a node: it writes into pods' statuses what a real one would.

Everything else around it is real: the API server, its admission and the garbage collector.
"""

from dataclasses import dataclass
from uuid import uuid4

from tests.integration.control_plane.client import STRATEGIC_PATCH, Client, Object, core
from tests.waiting import PATIENCE, wait_until

DRIVER = "driver"


@dataclass
class FakeKubelet:
    """Acts on pods by name; every method raises ApiError when the pod is not there."""

    admin: Client

    def run(self, namespace: str, pod: str, container: str = DRIVER, ip: str = "") -> None:
        """The container has started; `ip` is where a driver would serve its progress."""
        state = {"running": {"startedAt": "2026-11-20T04:00:00Z"}}
        self._report(namespace, pod, "Running", container, state, ready=True, ip=ip)

    def end(
        self, namespace: str, pod: str, code: int = 0, message: str = "",
        container: str = DRIVER, reason: str = "",
    ) -> None:  # fmt: skip
        """The container has ended; `message` is its termination message (a driver's account)."""
        state = {
            "terminated": {
                "exitCode": code,
                "reason": reason or ("Error" if code else "Completed"),
                "message": message,
                "startedAt": "2026-11-20T04:00:00Z",
                "finishedAt": "2026-11-20T04:00:01Z",
            }
        }
        self._report(namespace, pod, "Failed" if code else "Succeeded", container, state)

    def wait(
        self, namespace: str, pod: str, reason: str, message: str = "", container: str = DRIVER
    ) -> None:
        """The container waits: ImagePullBackOff, CreateContainerConfigError and the like."""
        state = {"waiting": {"reason": reason, "message": message}}
        self._report(namespace, pod, "Pending", container, state)

    def evict(self, namespace: str, pod: str, message: str) -> None:
        """The node has ended the pod as a whole."""
        self._patch(namespace, pod, {"phase": "Failed", "reason": "Evicted", "message": message})

    def bind(self, namespace: str, pod: str) -> str:
        """Gives the pod to a node that is not there: its deletion then waits for remove().

        Each to another one, whose name this returns. The API server's cache has it then: a pod
        that is deleted before that is still without a node there, and goes at once (132 of 1,500).
        """
        node = f"node-{uuid4().hex[:8]}"
        target = {"apiVersion": "v1", "kind": "Node", "name": node}
        binding = {"apiVersion": "v1", "kind": "Binding", "target": target}
        self.admin.create(
            core(namespace, "pods", pod) + "/binding", binding | {"metadata": {"name": pod}}
        )
        cached = f"{core(namespace, 'pods')}?resourceVersion=0&fieldSelector=spec.nodeName%3D{node}"
        wait_until(
            lambda: self.admin.get(cached)["items"],
            PATIENCE,
            f"the API server's cache does not show {pod}'s node",
        )
        return node

    def remove(self, namespace: str, pod: str) -> None:
        """The pod's processes have ended: a deleted pod goes for good."""
        self.admin.delete(core(namespace, "pods", pod), grace_seconds=0)

    def _report(
        self, namespace: str, pod: str, phase: str, container: str, state: Object,
        ready: bool = False, ip: str = "",
    ) -> None:  # fmt: skip
        shown = {
            "name": container,
            "image": "example/image:1",
            "imageID": "",
            "ready": ready,
            "restartCount": 0,
            "state": state,
        }
        status: Object = {"phase": phase, "containerStatuses": [shown]}
        if ip:
            status |= {"podIP": ip, "podIPs": [{"ip": ip}]}
        self._patch(namespace, pod, status)

    def _patch(self, namespace: str, pod: str, status: Object) -> None:
        path = core(namespace, "pods", pod) + "/status"
        self.admin.call("PATCH", path, {"status": status}, STRATEGIC_PATCH)
