"""Where a verb looks for jobs: the options -n and --context, and names as they are written."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from bagpipe.cli.cluster.faults import ClusterError

if TYPE_CHECKING:
    from bagpipe.cli.cluster.api import Cluster

# Whoever presses Tab waits for it.
_COMPLETION_SECONDS = 2.0
JOB_PREFIX = "job/"


@dataclass(frozen=True)
class Place:
    """A context and a namespace, None for the kubeconfig's own."""

    context: str | None
    namespace: str | None

    def cluster(self, seconds: float | None = None) -> "Cluster":
        """Its API server. Raises ClusterError."""
        try:
            from bagpipe.cli.cluster.api import connect  # noqa: PLC0415  see there
        except ModuleNotFoundError as error:
            if error.name is None or error.name.partition(".")[0] != "kubernetes":
                raise
            raise ClusterError(
                "the package kubernetes is not installed: in a checkout of Bagpipe write"
                " pip install './images/spark[cli]'"
            ) from error
        if seconds is None:
            return connect(self.context, self.namespace)
        return connect(self.context, self.namespace, seconds)

    def job_in(self, where: str) -> str | None:
        """The name of the job that is meant by `job/NAME`, or by NAME if a namespace was given.

        None for a URI or a folder.
        """
        if where.startswith(JOB_PREFIX):
            return where.removeprefix(JOB_PREFIX)
        if self.namespace and "/" not in where and where not in (".", ".."):
            return where
        return None


def place_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """-n and --context; the command gets both as `place`."""

    @functools.wraps(command)
    def placed(*, namespace: str | None, context: str | None, **given: Any) -> Any:
        return command(place=Place(context, namespace), **given)

    placed = click.option(
        "--context", metavar="CONTEXT", help="A context of the kubeconfig.  [default: its current]"
    )(placed)
    return click.option(
        "-n", "--namespace", metavar="NAMESPACE",
        help="The job's namespace.  [default: the context's]",
    )(placed)  # fmt: skip


def job_names(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Jobs whose names begin so; none where the cluster does not answer at once."""
    return [CompletionItem(name) for name in _names(ctx) if name.startswith(incomplete)]


def results_places(
    ctx: click.Context, _param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """`job/NAME` of the cluster, and folders of this machine."""
    if incomplete.startswith(JOB_PREFIX):
        names = [f"{JOB_PREFIX}{name}" for name in _names(ctx)]
        return [CompletionItem(name) for name in names if name.startswith(incomplete)]
    if ctx.params.get("namespace"):
        return job_names(ctx, _param, incomplete)
    begun = JOB_PREFIX.startswith(incomplete)
    folders = [CompletionItem(incomplete, type="dir")]
    return ([CompletionItem(JOB_PREFIX)] if begun else []) + folders


results_option = click.option(
    "--results",
    "where",
    required=True,
    metavar="RESULTS",
    shell_complete=results_places,
    help="job/NAME for a job in the cluster, the URI in the job's status.results, or a folder.",
)


def _names(ctx: click.Context) -> list[str]:
    place = Place(ctx.params.get("context"), ctx.params.get("namespace"))
    try:
        return place.cluster(_COMPLETION_SECONDS).names()
    except ClusterError:
        return []
