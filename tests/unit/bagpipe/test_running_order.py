"""Which cases begin first: by what earlier jobs took for them, else as they were planned."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver.job import run
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.running_order import in_running_order
from bagpipe.plan.case import Case
from bagpipe.plan.expected import Earlier, earlier_of, longest_first
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan
from bagpipe.spec import EarlierResults, JobFile
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.places import By

SECOND = 10**9
OLD = "pvc://results/out/old/uid-old"


def case(name: str, seconds: float = 10.0, size: int = 9) -> Case:
    window = Window(0, 0, round(seconds * SECOND))
    return Case(f"{name}-x", "pvc://recordings/a.bag", "9-1", window, [], [(0, size)], 1, name)


def row(name: str, seconds: Any, **more: Any) -> dict[str, Any]:
    window = [0, 0, 10 * SECOND]
    found = {"case": f"{name}-x", "fragment": name, "seconds": seconds, "window": window}
    return found | {"outcome": "passed"} | more


def names(cases: list[Case]) -> list[str]:
    return [each.fragment for each in cases]


def test_the_longest_case_of_earlier_results_begins_first() -> None:
    cases = [case("a", size=3), case("b", size=2), case("c", size=1)]
    earlier = earlier_of([row("a", 5.0), row("b", 60.0, attempts=2), row("c", 20.0)])
    assert names(longest_first(cases, earlier)) == ["b", "c", "a"]


def test_without_earlier_times_the_cases_stay_as_planned() -> None:
    cases = [case("b"), case("a"), case("c")]
    assert longest_first(cases, Earlier()) == cases
    assert longest_first(cases, earlier_of([row("a", 0), row("b", math.inf)])) == cases


def test_a_new_case_takes_its_fragments_time_else_that_of_its_seconds_of_recording() -> None:
    earlier = earlier_of([row("a", 20.0), row("b", 30.0), row("c", 40.0, case="c-other")])
    # Three seconds for one of recording, so "new" is expected to take 36.
    cases = [case("a"), case("b"), case("c"), case("new", 12.0)]
    assert names(longest_first(cases, earlier)) == ["c", "new", "b", "a"]


def test_a_case_of_which_nothing_is_known_begins_first() -> None:
    earlier = earlier_of([row("a", 20.0, window=None)])
    assert names(longest_first([case("a"), case("new")], earlier)) == ["new", "a"]


def job_after(tmp_path: Path, text: str | None, **spec: Any) -> tuple[JobFile, Storage]:
    storage = Storage({"results": str(tmp_path), "recordings": str(tmp_path)})
    if text is not None:
        with storage.create(f"{OLD}/results.jsonl") as file:
            file.write(text.encode())
    return make_job(storage.volumes, **spec), storage


def lines(*rows: dict[str, Any]) -> str:
    return "".join(json.dumps(each) + "\n" for each in rows)


CASES = [case("a"), case("b"), case("c")]
TIMES = lines(row("a", 5.0), row("b", 7.0), row("c", 60.0))


def test_a_job_that_goes_on_runs_first_what_took_longest(tmp_path: Path) -> None:
    job, storage = job_after(tmp_path, TIMES)
    resumed = job.model_copy(update={"resume": EarlierResults(job="old", results=OLD, cases=3)})
    assert names(in_running_order(resumed, CASES, storage)) == ["c", "b", "a"]
    assert in_running_order(job, CASES, storage) == CASES


def test_a_job_with_a_baseline_runs_first_what_took_longest_there(tmp_path: Path) -> None:
    job, storage = job_after(tmp_path, TIMES, baseline={"results": OLD})
    assert names(in_running_order(job, CASES, storage)) == ["c", "b", "a"]


def test_a_case_that_did_not_pass_shows_nothing_of_how_long_it_takes(tmp_path: Path) -> None:
    times = lines(row("a", 5.0), row("b", 7.0), row("c", 1.0, outcome="failed"))
    job, storage = job_after(tmp_path, times, baseline={"results": OLD})
    # 0.6 s for a second of recording: 6 s for c.
    assert names(in_running_order(job, CASES, storage)) == ["b", "c", "a"]


@pytest.mark.parametrize(
    "text",
    [
        None,
        "not a row\n",
        lines(row("a", 5.0), row("b", 9.0, attempts="many")),
        lines(row("a", 5.0), row("b", 9.0, window=["x", 0, 1])),
        lines(row("a", 5.0), row("b", 9.0, result=[1])),
        lines(row("a", 5.0), row("b", 9.0, attempts=math.inf)),
    ],
)
def test_results_that_cant_be_read_leave_the_order_and_the_job(
    tmp_path: Path, text: str | None
) -> None:
    job, storage = job_after(tmp_path, text, baseline={"results": OLD})
    assert in_running_order(job, CASES, storage) == CASES


class Handed(Exception):  # noqa: N818  what a place got, and no error
    """The cases that a place was to run."""


class Planned(By):
    """A place whose plan has these cases, and that runs none of them."""

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002  the base class's signature
        return Plan(CASES, [])


def hand(cases: list[Case], keeper: Keeper) -> None:  # noqa: ARG001  as any
    raise Handed(names(cases))


def test_the_driver_hands_out_the_longest_case_first(tmp_path: Path) -> None:
    job, storage = job_after(tmp_path, TIMES, baseline={"results": OLD})
    entries = [{"case": case.id} for case in CASES]
    counts = {"planned": len(CASES), "passed": len(CASES)}
    manifest = {"cases": entries, "counts": counts, "reason": "AllCasesRan"}
    with storage.create(f"{OLD}/manifest.json") as file:
        file.write(json.dumps(manifest).encode())
    with pytest.raises(Handed) as handed:
        run(job, Progress("pvc://results/r"), Planned(hand))
    assert handed.value.args == (["c", "b", "a"],)
