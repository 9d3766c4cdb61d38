"""A stack that hangs is ended at its deadline with all that it started; the next case runs well."""

import pytest

from tests import hanging
from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

CASE_SECONDS = 20


def make_job() -> k.Object:
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "hanging"},
        "spec": {
            "source": {"files": ["pvc://recordings/hanging/*.bin"]},
            "stack": {
                "engine": "exec",
                "image": "bagpipe.local/spark:0.2.0",
                "command": ["python3", "-c", hanging.program("/tmp")],
            },
            "playback": {"caseTimeout": f"{CASE_SECONDS}s"},
            "spark": jobs.spark(1, 1),
            "output": {"uri": "pvc://results/hanging"},
        },
    }


def in_stack(namespace: str, *command: str) -> str:
    """What a command prints in the stack's container; empty while there is none."""
    pods = fleet.pods(namespace, "hanging", "executor")
    if not pods:
        return ""
    name = pods[0]["metadata"]["name"]
    try:
        return k.kubectl("-n", namespace, "exec", name, "-c", "stack", "--", *command)
    except k.KubectlError:
        return ""


def processes(namespace: str) -> list[str]:
    """The command lines of all processes in the stack's container but those that list them."""
    every = "for each in /proc/[0-9]*; do tr '\\0\\n' '  ' < $each/cmdline; echo; done 2>/dev/null"
    lines = [line.strip() for line in in_stack(namespace, "sh", "-c", every).splitlines()]
    return [line for line in lines if line and "/proc/" not in line and not line.startswith("tr ")]


def sleeping(namespace: str) -> list[str]:
    return [line for line in processes(namespace) if hanging.is_sleeper(line)]


def test_nothing_of_a_hanging_stack_is_left_and_the_next_case_runs_well(namespace: str) -> None:
    k.in_toolbox(namespace, "mkdir", "-p", "/recordings/hanging")
    for name, content in hanging.CASES.items():
        k.in_toolbox(namespace, "sh", "-c", f"echo {content} > /recordings/hanging/{name}.bin")
    with jobs.applied(namespace, make_job()) as name:
        # Of each family the shell's own sleep and the daemon.
        k.await_that("all sleepers", lambda: len(sleeping(namespace)) == hanging.SLEEPERS, 90)
        began = ("ls", "/tmp/next-began")
        k.await_that("the next case", lambda: in_stack(namespace, *began), CASE_SECONDS + 30)
        left = processes(namespace)
        in_stack(namespace, "touch", "/tmp/go-on")
        assert [line for line in left if "sleep" in line.split()[0]] == []
        assert len([line for line in left if line.startswith("sh ")]) == 0
        programs = [line for line in left if line.partition(" -c ")[0].endswith("python3")]
        assert len(programs) == 1, left
        assert all("bagpipe-agent" in line for line in left if line not in programs)
        status = jobs.ended(namespace, name, 60)["status"]
    assert status["phase"] == "Failed"
    assert (status["cases"]["passed"], status["cases"]["errored"]) == (1, 1)
    (failure,) = status["failures"]
    assert (failure["case"], failure["reason"]) == ("a-hangs", "CaseDeadlineExceeded")
    _, rows = k.results(namespace, status["results"])
    hung, well = sorted(rows, key=lambda row: row["case"])
    assert CASE_SECONDS <= hung["seconds"] < CASE_SECONDS + 15
    assert (hung["attempts"], hung["starts"], hung["recorded"]) == (1, 1, None)
    assert (well["outcome"], well["attempts"], well["starts"]) == ("passed", 1, 1)
