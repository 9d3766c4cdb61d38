"""`bagpipe doctor`: what this machine, the cluster and the namespace lack for jobs."""

from pathlib import Path
from typing import Any
from urllib.parse import quote

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bagpipe.cli.cluster.faults import ClusterError, refusals
from bagpipe.cli.cluster.place import Place, place_options
from bagpipe.cli.cluster.watching import Seconds
from bagpipe.cli.health import cluster as deciders
from bagpipe.cli.health.finding import Finding, status_of
from bagpipe.cli.health.machine import of_machine, seen
from bagpipe.cli.health.needs import Needs, needs_of
from bagpipe.cli.health.nodes import of_nodes
from bagpipe.cli.health.replies import Answer, Question
from bagpipe.cli.manifest import ManifestError, read_job, read_object
from bagpipe.cli.places import RefusedError, output_option, print_as
from bagpipe.cli.terminal import plain
from bagpipe.spec import SimulationJobSpec

_API = "/apis/sim.bagpipe.io/v1alpha1"
_HOME = "bagpipe-system"
_COLOURS = {"done": "green", "missing": "red", "unknown": "yellow"}
# As many names of a job as are looked for; a job that has more is no first one.
_MOST_OBJECTS = 50
_NODES, _MOST_NODES = "nodes", 300


@click.command("doctor")
@click.argument("manifest", required=False, type=click.Path(path_type=Path))
@place_options
@click.option(
    "--for",
    "wanted",
    type=click.Choice(["submit", "run", "spark"]),
    default="submit",
    show_default=True,
    help="What it is to be fit for: jobs in the cluster, `run` here, or `run --spark`. The cluster"
    " is asked for `submit` alone.",
)
@click.option(
    "--operator-namespace",
    default=_HOME,
    show_default=True,
    metavar="NAMESPACE",
    help="Where the chart is installed.",
)
@click.option("--agent", default="bagpipe-agent", help="The program bagpipe-agent.")
@click.option(
    "--timeout", type=Seconds(), default="5s", show_default=True, help="For each question."
)
@output_option
def doctor_command(manifest: Path | None, place: Place, output: str, **given: Any) -> None:
    """Show what this machine, the cluster and the namespace lack, all at once.

    With MANIFEST also what that job needs: its claims, Secrets, ConfigMaps and priority classes,
    room in the quota, a node that is large enough, and whether the API server would take it.
    Nothing is changed, and no value of a Secret is read. What you may not see is unknown, and no
    fault.

    The exit status is 0 if nothing is missing that is needed, 1 if something is, and 2 if the
    cluster does not answer.

    \b
    bagpipe doctor
    bagpipe doctor job.yaml -n robots
    bagpipe doctor job.yaml --for run
    """
    try:
        job = None if manifest is None else _Job(manifest)
    except ManifestError as error:
        raise RefusedError(str(error)) from error
    spec = job.spec if job else None
    findings = list(of_machine(seen(given["agent"]), spec, given["wanted"]))
    reached = True
    if given["wanted"] == "submit":
        if job is not None and place.namespace is None:
            place = Place(place.context, job.namespace)
        asked = _Asked(place, given["timeout"], given["operator_namespace"], job)
        more, reached = asked.findings()
        findings += more
    if output == "table":
        _show(findings, Console(emoji=False))
    else:
        print_as([each.as_json() for each in findings], output)
    raise SystemExit(status_of(findings, reached))


class _Job:
    """A manifest. Raises ManifestError."""

    def __init__(self, path: Path) -> None:
        _, self.spec = read_job(path)
        self.written, _ = read_object(path)
        self.namespace: str | None = self.written["metadata"].get("namespace")
        self.needs: Needs = needs_of(self.spec)


class _Asked:
    """A look at the cluster, by questions that do not wait for each other."""

    def __init__(self, place: Place, seconds: float, home: str, job: _Job | None) -> None:
        self._place, self._seconds, self._home, self._job = place, seconds, home, job

    def findings(self) -> tuple[list[Finding], bool]:
        """All of them, and whether the cluster answered."""
        try:
            cluster = self._place.cluster(self._seconds)
        except ClusterError as error:
            remedy = "or ask about this machine alone: --for run"
            return [Finding("cluster", "kubeconfig", "missing", error.message, remedy)], True
        # It needs the client's library, which only verbs about a cluster load.
        from bagpipe.cli.health.asking import ask  # noqa: PLC0415

        first = ask(cluster, {"version": Question("/version")}, self._seconds)["version"]
        found = [deciders.of_version(first, cluster.context)]
        if first.status == 0 or deciders.is_something_else(first):
            return found, False
        answers = ask(cluster, self._questions(cluster.namespace), self._seconds)
        found += self._of_cluster(answers)
        found += self._of_namespace(answers, cluster.namespace)
        if answers["namespace"].status == 404:
            return found, True
        pulled = deciders.pull_secrets_of(
            {name: answers[name] for name in ("bagpipe-driver", "bagpipe-executor")}
        )
        secrets = sorted({*pulled, *(self._job.needs.secrets if self._job else [])})
        more = ask(cluster, self._objects(cluster.namespace, secrets), self._seconds)
        found += self._of_job(more, secrets)
        return found, True

    def _questions(self, namespace: str) -> dict[str, Question]:
        inside = in_namespace("/api/v1", namespace)
        review = {"verb": "create", "namespace": namespace, "resource": "simulationjobs"}
        review["group"] = "sim.bagpipe.io"
        return {
            "kinds": Question(_API),
            "schema": Question(f"/openapi/v3{_API}"),
            "namespace": Question(inside),
            "right": Question(
                "/apis/authorization.k8s.io/v1/selfsubjectaccessreviews",
                {
                    "apiVersion": "authorization.k8s.io/v1",
                    "kind": "SelfSubjectAccessReview",
                    "spec": {"resourceAttributes": review},
                },
            ),
            "operator": Question(
                f"{in_namespace('/apis/apps/v1', self._home)}/deployments"
                "?labelSelector=app.kubernetes.io%2Fname%3Dbagpipe-operator&limit=10"
            ),
            "jobs": Question(f"{in_namespace(_API, namespace)}/simulationjobs?limit=20"),
            "bagpipe-driver": Question(f"{inside}/serviceaccounts/bagpipe-driver"),
            "bagpipe-executor": Question(f"{inside}/serviceaccounts/bagpipe-executor"),
            "quota": Question(f"{inside}/resourcequotas?limit=100"),
            "policies": Question(
                f"{in_namespace('/apis/networking.k8s.io/v1', namespace)}/networkpolicies?limit=200"
            ),
        }

    def _objects(self, namespace: str, secrets: list[str]) -> dict[str, Question]:
        inside = in_namespace("/api/v1", namespace)
        asked = {
            f"Secret {name}": Question(f"{inside}/secrets/{_quoted(name)}", metadata=True)
            for name in secrets
        }
        if self._job is None:
            return asked
        needs = self._job.needs
        for name in needs.config_maps:
            path = f"{inside}/configmaps/{_quoted(name)}"
            asked[f"ConfigMap {name}"] = Question(path, metadata=True)
        for name in needs.priorities:
            path = f"/apis/scheduling.k8s.io/v1/priorityclasses/{_quoted(name)}"
            asked[f"priority class {name}"] = Question(path, metadata=True)
        for name in needs.claims:
            path = f"{inside}/persistentvolumeclaims/{_quoted(name)}"
            asked[f"claim {name}"] = Question(path)
        asked = dict(list(asked.items())[:_MOST_OBJECTS])
        asked[_NODES] = Question(f"/api/v1/nodes?limit={_MOST_NODES}")
        job = self._job.written | {
            "metadata": self._job.written["metadata"] | {"namespace": namespace}
        }
        path = f"{in_namespace(_API, namespace)}/simulationjobs?dryRun=All&fieldValidation=Strict"
        return asked | {"job": Question(path, job)}

    def _of_cluster(self, answers: dict[str, Answer]) -> list[Finding]:
        kinds = deciders.of_kinds(answers["kinds"])
        found = [kinds]
        if kinds.state == "done":
            own = (field.alias or name for name, field in SimulationJobSpec.model_fields.items())
            found.append(deciders.of_schema(answers["schema"], own))
        found.append(deciders.of_operator(answers["operator"], answers["jobs"], self._home))
        return found

    def _of_namespace(self, answers: dict[str, Answer], namespace: str) -> list[Finding]:
        needs = self._job.needs if self._job else None
        found = deciders.of_namespace(answers["namespace"], namespace, needs)
        if answers["namespace"].status == 404:
            return found
        found.append(deciders.of_right(answers["right"], "create", namespace))
        found += deciders.of_accounts(answers, namespace)
        found += deciders.of_quota(answers["quota"], needs)
        return [*found, deciders.of_policies(answers["policies"])]

    def _of_job(self, answers: dict[str, Answer], secrets: list[str]) -> list[Finding]:
        found = []
        part = "job" if self._job else "namespace"
        if self._job is not None:
            found += of_nodes(answers[_NODES], self._job.needs.pods)
        for what, answer in answers.items():
            kind, _, name = what.rpartition(" ")
            if kind == "claim":
                found.append(deciders.of_claim(name, answer))
            elif kind:
                found.append(deciders.of_object(part, kind, name, answer))
        if self._job is None:
            return found
        if len(secrets) + len(self._job.needs.claims) > _MOST_OBJECTS:
            text = f"only the first {_MOST_OBJECTS} of its objects were looked for"
            found.append(Finding("job", "more objects", "unknown", text))
        judged = answers["job"]
        return [*found, deciders.of_dry_run(judged, refusals(judged.body, judged.why))]


def in_namespace(api: str, namespace: str) -> str:
    """A namespace's path. A name that is none changes no other part of it."""
    return f"{api}/namespaces/{_quoted(namespace)}"


def _quoted(name: str) -> str:
    # The server would resolve these two as it resolves them in any path.
    return "%2E" * len(name) if name in (".", "..") else quote(name, safe="")


def _show(findings: list[Finding], console: Console) -> None:
    table = Table(box=None, header_style="bold")
    for column in ("Of", "What", "State"):
        table.add_column(column, no_wrap=True)
    table.add_column("Found, and what to do", overflow="fold")
    for each in findings:
        state = (
            f"{each.state} (optional)" if each.state == "missing" and each.optional else each.state
        )
        colour = "dim" if each.optional and each.state != "done" else _COLOURS[each.state]
        text = (
            each.found
            if each.state == "done" or not each.remedy
            else f"{each.found}: {each.remedy}"
        )
        table.add_row(
            escape(each.part),
            escape(plain(each.what)),
            f"[{colour}]{state}[/]",
            escape(plain(text)),
        )
    console.print(table)
