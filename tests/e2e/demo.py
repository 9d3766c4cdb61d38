"""The demonstration: the example's job on a running cluster, followed to its verdict.

`make demo` calls it when the cluster is up and the chart is installed.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.live import Live
from rich.table import Table

from tests.cached import cache
from tests.e2e import first_verdict
from tests.e2e import kubectl as k
from tests.recording import RecordingError, fetch

NAMESPACE = "default"
JOB = "robot-state-publisher"
EXAMPLE = Path(__file__).parents[2] / "docs/examples" / JOB
_JOB_SECONDS = 300

# A log has no width: the table needs about this much to say its words whole.
console = Console(width=None if sys.stdout.isatty() else 140)


def main() -> int:
    """0 when the job is Complete and Passed, 1 when it is not, 2 when it could not be run."""
    try:
        return _demonstrate()
    except (k.KubectlError, RecordingError, TimeoutError, subprocess.TimeoutExpired) as error:
        console.print(f"[red]The demonstration stopped:[/] {error}", highlight=False)
        console.print(f"Look at: kubectl -n {NAMESPACE} get simjob,pods; make demo tries again.")
        return 2


def _demonstrate() -> int:
    with _step("Fetching the PR2 recording from Debian's source package"):
        recording = fetch()
    with _step("Making the volumes and copying the recording to the claim recordings"):
        k.kubectl("-n", NAMESPACE, "apply", "-f", str(EXAMPLE / "volumes.yaml"))
        k.start_toolbox(NAMESPACE)
        k.put(NAMESPACE, recording, "pr2/joint_states.bag")
    with _step(f"Applying {EXAMPLE.name}/job.yaml"):
        manifest = str(EXAMPLE / "job.yaml")
        k.kubectl("-n", NAMESPACE, "delete", "-f", manifest, "--ignore-not-found", "--wait=true")
        k.kubectl("-n", NAMESPACE, "apply", "-f", manifest)
    with _step("Running the job"):
        job = _follow()
    return _show(job)


@contextmanager
def _step(what: str) -> Iterator[None]:
    console.print(f"[bold]--> {what}[/]", highlight=False)
    begun = time.monotonic()
    yield
    console.print(f"[green]<-- {time.monotonic() - begun:.1f} s[/]", highlight=False)


def _follow() -> k.Object:
    """Show the job's phase and counts until it has ended."""
    begun = time.monotonic()
    last = ""
    with Live(console=console, refresh_per_second=4, transient=True) as live:

        def look() -> k.Object | None:
            nonlocal last
            job = k.get(NAMESPACE, "simjob", JOB)
            line = _progress_line(job)
            live.update(f"    {time.monotonic() - begun:5.1f} s  {line}")
            if line != last and not console.is_terminal:
                console.print(f"    {time.monotonic() - begun:5.1f} s  {line}", highlight=False)
            last = line
            return job if job.get("status", {}).get("phase") in ("Complete", "Failed") else None

        return k.await_that("the job to end", look, _JOB_SECONDS)


def _progress_line(job: k.Object) -> str:
    status = job.get("status", {})
    cases = status.get("cases", {})
    done = sum(cases.get(outcome, 0) for outcome in ("passed", "failed", "invalid", "errored"))
    counts = f"{done} of {cases.get('planned', 0)} cases, {cases.get('running', 0)} running"
    return f"{status.get('phase', 'Pending'):9} {counts}"


def _show(job: k.Object) -> int:
    status = job["status"]
    if "results" not in status or status["phase"] != "Complete":
        console.print(k.kubectl("-n", NAMESPACE, "describe", "simjob", JOB), markup=False)
        return 1
    _, rows = k.results(NAMESPACE, status["results"])
    console.print(_table(rows))
    ledger = status["ledger"]
    console.print(
        f"Ledger: {ledger['sent']} sent, {ledger['received']} received, {ledger['dropped']} dropped"
    )
    console.print(f"Phase: {status['phase']}   Verdict: [bold]{status.get('verdict', 'none')}[/]")
    folder = "/" + status["results"].removeprefix("pvc://")
    console.print(f"Recorded bags: {status['results']}/cases", soft_wrap=True)
    first = next(row["recorded"] for row in rows if row["recorded"])
    command = ["rosbag", "info", f"{folder}/{first}"]
    console.print(f"\n$ kubectl exec {k.TOOLBOX} -- {' '.join(command)}", soft_wrap=True)
    info = k.in_toolbox(NAMESPACE, *command)
    console.print(info, markup=False, highlight=False, soft_wrap=True)
    take_out(status["results"])
    _show_real_time()
    console.print(
        "The cluster stays up: export KUBECONFIG="
        f"{k.tool_environment()['KUBECONFIG']}; kubectl get simjob,pods -A. make down removes it.",
        soft_wrap=True,
    )
    return 0 if status.get("verdict") == "Passed" else 1


def _show_real_time() -> None:
    """The other mode, on this machine. Whether the node keeps up is luck, so it is no verdict."""
    _say("Lock-step waits for each answer. In real time a node with a queue of one may lose some:")
    try:
        results = cache() / "demo/laptop/realtime"
        first_verdict.run(f"docs/examples/{JOB}/realtime.yaml", results, "--cases", "1")
    except (RecordingError, subprocess.TimeoutExpired, OSError) as error:
        _say(f"There is no play in real time to show: {error}")
    _say("")


def take_out(uri: str) -> None:
    """Copy the results to this machine, and say how to look at them; or why there is no copy."""
    folder = cache() / "demo" / JOB
    try:
        k.take_results(NAMESPACE, uri, folder)
    except (k.KubectlError, subprocess.TimeoutExpired, OSError) as error:
        # The job's verdict stands: only a copy is missing, which is reported.
        _say(f"The results could not be copied to {folder}: {error}")
        _say(f"They are in the cluster. Try: kubectl cp {k.on_claim(NAMESPACE, uri)} {folder}")
        return
    _say(f"A copy of the results is in {folder}. Look at it with")
    _say(f"$ .venv/bin/bagpipe results {folder}")
    _say(f"and at its page in a browser: {folder / 'report.html'}\n")


def _say(text: str) -> None:
    """A line that can be copied as it is."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def _table(rows: list[k.Object]) -> Table:
    table = Table(title=f"Cases of {JOB}")
    for heading in ("Case", "Window s", "Sent", "Lead-in", "Received", "Dropped"):
        table.add_column(heading, justify="left" if heading == "Case" else "right")
    for heading in ("Recorded", "Attempts", "Took s", "Outcome"):
        table.add_column(heading, justify="right")
    for row in rows:
        result = row["result"]
        if result is None:
            table.add_row(row["case"], *[""] * 6, str(row["attempts"]), "", row["reason"])
            continue
        ledger = result["ledger"]
        counts = [str(ledger[key]) for key in ("sent", "lead_in", "received", "dropped")]
        recorded = ", ".join(f"{t['messages']} {t['topic']}" for t in result["recorded"]["topics"])
        window = f"{(row['window'][2] - row['window'][1]) / 1e9:.2f}"
        took, tries = f"{row['seconds']:.1f}", str(row["attempts"])
        table.add_row(row["case"], window, *counts, recorded, tries, took, row["outcome"])
    return table


if __name__ == "__main__":
    sys.exit(main())
