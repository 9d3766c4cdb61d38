"""The operator's settings, read once from the environment; the reason for each default is with it.

The chart sets the variables; docs name them as they stand here.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from bagpipe import storage_hosts
from bagpipe_operator.receivers import Receiver, read_receivers

# A fifth of it is the deadline of a renewal, and an API server under load needs most of a second.
SHORTEST_LEASE_SECONDS = 3


class SettingError(ValueError):
    """A variable holds what can't be used; the message names it and what to write."""


@dataclass(frozen=True)
class Settings:
    """What an administrator can set."""

    spark_image: str = "bagpipe.local/spark:0.2.0"
    """BAGPIPE_SPARK_IMAGE: driver and executors. The default is what `make images` builds."""

    agent_image: str = "bagpipe.local/agent:0.2.0"
    """BAGPIPE_AGENT_IMAGE: image whose one file is put beside the user's stack."""

    image_pull_policy: str = "IfNotPresent"
    """BAGPIPE_IMAGE_PULL_POLICY: for both; the images may exist on the nodes only."""

    architecture: str = "amd64"
    """BAGPIPE_ARCHITECTURE: kubernetes.io/arch of the nodes that jobs' pods go to, unless a job
    names one itself; set and empty means any. Spark's image is of amd64 alone, and a pod that is
    scheduled to another node fails there."""

    driver_service_account: str = "bagpipe-driver"
    """BAGPIPE_DRIVER_SERVICE_ACCOUNT: the chart makes it in every job namespace."""

    executor_service_account: str = "bagpipe-executor"
    """BAGPIPE_EXECUTOR_SERVICE_ACCOUNT: made there as well, without any right in the cluster."""

    watch_namespaces: tuple[str, ...] = ()
    """BAGPIPE_WATCH_NAMESPACES: comma-separated; none means all, which needs a ClusterRole."""

    stuck_seconds: float = 30.0
    """BAGPIPE_STUCK_SECONDS: how long a pod may show an error that only a person can mend, such as
    an image that can't be pulled, before its job fails. Long enough for a registry's hiccup."""

    missing_driver_seconds: float = 10.0
    """BAGPIPE_MISSING_DRIVER_SECONDS: how long the watch may lag before a live GET decides."""

    sweep_seconds: float = 2.0
    """BAGPIPE_SWEEP_SECONDS: how often running jobs are visited for progress and deadlines."""

    progress_wait_seconds: float = 30.0
    """BAGPIPE_PROGRESS_WAIT_SECONDS: for how long counts of a running job wait to be written when
    the API server is busy. A write costs it 10 ms of a processor: 1,000 jobs then take a third of
    one. Somebody who watches a job still sees it move."""

    request_seconds: float = 10.0
    """BAGPIPE_REQUEST_SECONDS: deadline of every call to the API server."""

    progress_seconds: float = 2.0
    """BAGPIPE_PROGRESS_SECONDS: deadline of one question to a driver; one slow driver must not
    hold a worker for long."""

    workers: int = 32
    """BAGPIPE_WORKERS: jobs that are reconciled at once. Each mostly waits: with 8 the operator was
    idle for two thirds of a burst, and 8 drivers that can't be reached would hold up all jobs."""

    lease_namespace: str = "default"
    """BAGPIPE_LEASE_NAMESPACE: where the Lease is by which one of several replicas leads. The chart
    gives its release's namespace."""

    lease_name: str = "bagpipe-operator"
    """BAGPIPE_LEASE_NAME: its name. Operators with the same Lease take turns, others do not know of
    each other and must watch different namespaces."""

    lease_seconds: int = 9
    """BAGPIPE_LEASE_SECONDS: how long a leader may be silent before another takes over. With one
    look of the other (a fifth of it) that is 11 s; shorter would cost more calls and
    tolerate less."""

    own_evaluators: bool = False
    """BAGPIPE_OWN_EVALUATORS: true or false; true lets jobs bring Python of their own into Spark's
    container, where it could use what the executor knows to speak to the driver, who may create
    pods."""

    storage_hosts: tuple[str, ...] = ()
    """BAGPIPE_STORAGE_HOSTS: comma-separated hosts that jobs' storage may be on, such as
    s3.example.com, *.example.com or namenode:8020; none means all. Drivers and executors get it
    too."""

    receivers: tuple[Receiver, ...] = ()
    """BAGPIPE_NOTIFICATIONS: a JSON list of receivers that jobs may name in spec.notify, each with
    name and url, and events, namespaces and always where they are not to be all, any and none."""

    notification_keys: str = "/etc/bagpipe/notifications"
    """BAGPIPE_NOTIFICATION_KEYS: where <receiver>/key is the key that signs what it gets."""

    kueue: bool = False
    """BAGPIPE_KUEUE: true or false; whether a job with a queueName gets a Workload of Kueue's, and
    its pods only when that is admitted. Needs Kueue in the cluster, and rights of its own."""

    pools: bool = False
    """BAGPIPE_POOLS: true or false; whether the driver and the executors of a job that names a pool
    wait for the next one."""

    pool_idle_seconds: float = 300.0
    """BAGPIPE_POOL_IDLE_SECONDS: for how long they wait. Somebody who tries one change after the
    other is back within minutes, and nobody else has the place meanwhile."""

    pools_per_namespace: int = 2
    """BAGPIPE_POOLS_PER_NAMESPACE: how many drivers, each with its executors, may wait in one
    namespace at the same time."""

    scrape_annotations: bool = True
    """BAGPIPE_SCRAPE_ANNOTATIONS: true or false; whether drivers and executors carry
    prometheus.io/scrape."""

    fixed_users: bool = True
    """BAGPIPE_FIXED_USERS: true or false; whether pods name their users and group. OpenShift gives
    each namespace users of its own, and refuses pods that name others."""

    listen_host: str = "0.0.0.0"  # noqa: S104 - the kubelet and Prometheus come from outside the pod
    """BAGPIPE_LISTEN_HOST: address of /metrics, /livez and /readyz."""

    listen_port: int = 8080
    """BAGPIPE_LISTEN_PORT: their port."""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str]) -> "Settings":
        """Settings from variables; raises SettingError naming the variable that is wrong."""
        texts = {
            "spark_image": "BAGPIPE_SPARK_IMAGE",
            "agent_image": "BAGPIPE_AGENT_IMAGE",
            "image_pull_policy": "BAGPIPE_IMAGE_PULL_POLICY",
            "driver_service_account": "BAGPIPE_DRIVER_SERVICE_ACCOUNT",
            "executor_service_account": "BAGPIPE_EXECUTOR_SERVICE_ACCOUNT",
            "lease_namespace": "BAGPIPE_LEASE_NAMESPACE",
            "lease_name": "BAGPIPE_LEASE_NAME",
            "listen_host": "BAGPIPE_LISTEN_HOST",
            "notification_keys": "BAGPIPE_NOTIFICATION_KEYS",
        }
        strings = {key: environment[name] for key, name in texts.items() if environment.get(name)}
        namespaces = environment.get("BAGPIPE_WATCH_NAMESPACES", "")
        return cls(
            watch_namespaces=tuple(n.strip() for n in namespaces.split(",") if n.strip()),
            stuck_seconds=_number(environment, "BAGPIPE_STUCK_SECONDS", cls.stuck_seconds),
            missing_driver_seconds=_number(
                environment, "BAGPIPE_MISSING_DRIVER_SECONDS", cls.missing_driver_seconds
            ),
            sweep_seconds=_number(environment, "BAGPIPE_SWEEP_SECONDS", cls.sweep_seconds),
            progress_wait_seconds=_number(
                environment, "BAGPIPE_PROGRESS_WAIT_SECONDS", cls.progress_wait_seconds
            ),
            request_seconds=_number(environment, "BAGPIPE_REQUEST_SECONDS", cls.request_seconds),
            progress_seconds=_number(environment, "BAGPIPE_PROGRESS_SECONDS", cls.progress_seconds),
            workers=int(_number(environment, "BAGPIPE_WORKERS", cls.workers)),
            lease_seconds=_lease_seconds(environment, cls.lease_seconds),
            architecture=environment.get("BAGPIPE_ARCHITECTURE", cls.architecture),
            own_evaluators=_truth(environment, "BAGPIPE_OWN_EVALUATORS", cls.own_evaluators),
            storage_hosts=_hosts(environment),
            receivers=_receivers(environment),
            kueue=_truth(environment, "BAGPIPE_KUEUE", cls.kueue),
            pools=_truth(environment, "BAGPIPE_POOLS", cls.pools),
            pool_idle_seconds=_number(
                environment, "BAGPIPE_POOL_IDLE_SECONDS", cls.pool_idle_seconds
            ),
            pools_per_namespace=int(
                _number(environment, "BAGPIPE_POOLS_PER_NAMESPACE", cls.pools_per_namespace)
            ),
            scrape_annotations=_truth(
                environment, "BAGPIPE_SCRAPE_ANNOTATIONS", cls.scrape_annotations
            ),
            fixed_users=_truth(environment, "BAGPIPE_FIXED_USERS", cls.fixed_users),
            listen_port=int(_number(environment, "BAGPIPE_LISTEN_PORT", cls.listen_port)),
            **strings,
        )


def _lease_seconds(environment: Mapping[str, str], default: int) -> int:
    value = _number(environment, "BAGPIPE_LEASE_SECONDS", default)
    if value < SHORTEST_LEASE_SECONDS or value != int(value):
        raise SettingError(
            f"BAGPIPE_LEASE_SECONDS is {value:g}: write a whole number of at least "
            f"{SHORTEST_LEASE_SECONDS}, for example {default}"
        )
    return int(value)


def _hosts(environment: Mapping[str, str]) -> tuple[str, ...]:
    try:
        return storage_hosts.read_hosts(environment.get(storage_hosts.VARIABLE, ""))
    except ValueError as error:
        raise SettingError(f"{storage_hosts.VARIABLE}: {error}") from None


def _receivers(environment: Mapping[str, str]) -> tuple[Receiver, ...]:
    try:
        return read_receivers(environment.get("BAGPIPE_NOTIFICATIONS", ""))
    except ValueError as error:
        raise SettingError(f"BAGPIPE_NOTIFICATIONS: {error}") from None


def _truth(environment: Mapping[str, str], name: str, default: bool) -> bool:
    text = environment.get(name, "")
    if text not in {"", "true", "false"}:
        raise SettingError(f"{name} is {text!r}: write true or false")
    return default if not text else text == "true"


def _number(environment: Mapping[str, str], name: str, default: float) -> float:
    text = environment.get(name, "")
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        raise SettingError(f"{name} is {text!r}: write a number, for example {default:g}") from None
    if value <= 0:
        raise SettingError(f"{name} is {text!r}: write a number above zero")
    return value
