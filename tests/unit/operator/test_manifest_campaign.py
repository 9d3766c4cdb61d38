"""What `make fuzz TARGET=manifests` takes for a failure, and what for an end."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.fuzz.manifests.campaign import BATCH, ended_by, seeded_batch
from tests.fuzz.manifests.canary import Canaries, CanaryError
from tests.fuzz.manifests.health import Health, UnhealthyError
from tests.fuzz.manifests.tally import Tally
from tests.fuzz.manifests.values import Json

STAMP = "2026-11-20 04:00:00,000"


def health(log: Path, alive: bool = True, faults: float | None = 0.0, probe: int = 200) -> Health:
    """Over an operator that is made up; it looks at the probe once a second by itself."""
    operator = SimpleNamespace(
        log=log,
        server=SimpleNamespace(alive=alive),
        logged=log.read_text,
        metric=lambda _name: faults,
        ask=lambda _path: (probe, "no sweep for 40 s"),
    )
    return Health(cast("Any", operator))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "operator.log"
    path.write_text(f"{STAMP} WARNING bagpipe_operator.runtime.work: x: 409: ERROR is a word\n")
    return path


def test_a_healthy_operator_passes(log: Path) -> None:
    again = "kopf._cogs.clients.watching: Request attempt #1/6 failed; will retry: GET x"
    with log.open("a") as file:
        file.write(f"{STAMP} ERROR {again}\n")
    looked = health(log)
    looked.check()
    looked.stop()


@pytest.mark.parametrize(
    "line",
    [
        "Traceback (most recent call last):",
        f"{STAMP} ERROR kopf.objects: Handler 'on_pod' failed",
        f"{STAMP} CRITICAL asyncio: no more",
        f"{STAMP} ERROR bagpipe_operator.runtime.work: job x: unexpected fault; again in 0.5 s",
    ],
)
def test_a_line_that_nobody_thought_of_fails(log: Path, line: str) -> None:
    looked = health(log)
    looked.check()
    with log.open("a") as file:
        file.write(f"{line}\n")
    with pytest.raises(UnhealthyError, match="unexpected error"):
        looked.check()
    looked.stop()


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"alive": False}, "has ended"),
        ({"faults": 1.0}, "met a fault"),
        ({"faults": None}, "does not answer"),
    ],
)
def test_an_operator_that_died_or_met_a_fault_fails(log: Path, what: Json, message: str) -> None:
    looked = health(log, **what)
    with pytest.raises(UnhealthyError, match=message):
        looked.check()
    looked.stop()


def test_a_probe_that_failed_once_fails(log: Path) -> None:
    looked = health(log, probe=503)
    looked.stop()
    looked.look()
    with pytest.raises(UnhealthyError, match="no sweep for 40 s"):
        looked.check()


@pytest.mark.parametrize(
    ("complete", "passed", "right"),
    [("True", "True", True), ("False", "False", False), ("True", "False", False)],
)
def test_a_canary_has_to_pass(complete: str, passed: str, right: bool) -> None:
    failed = "False" if complete == "True" else "True"
    states = {"Complete": complete, "Failed": failed, "Passed": passed}
    conditions = [{"type": type_, "status": status} for type_, status in states.items()]
    status = {"phase": "x", "conditions": conditions}
    if right:
        Canaries._judge(status)
        return
    with pytest.raises(CanaryError, match="ended as x"):
        Canaries._judge(status)


@pytest.mark.parametrize("odd", [None, "x", {}, {"conditions": 5}, {"conditions": [5, {"a": 1}]}])
def test_an_odd_status_is_no_end(odd: Json) -> None:
    assert ended_by(odd) == ""


def test_an_end_is_reported_with_its_reason() -> None:
    condition = {"type": "Failed", "status": "True", "reason": "SpecInvalid"}
    assert ended_by({"conditions": [condition]}) == "Failed/SpecInvalid"


def test_a_batch_follows_from_its_seed_and_number() -> None:
    def objects(seed: int, number: int) -> list[Json]:
        return [manifest.object for manifest in seeded_batch(seed, number, lax=False)]

    assert len(objects(1, 0)) == BATCH
    assert objects(1, 0) == objects(1, 0)
    assert objects(1, 0) != objects(1, 1)
    assert objects(1, 0) != objects(2, 0)


def test_the_figures_are_reported() -> None:
    tally = Tally()
    for what in ("written", "written", "accepted", "crd written", "refused"):
        tally.add(what)
    tally.end("Failed/SpecInvalid")
    lines = tally.lines()
    assert lines[0] == "manifests: 2 written, 1 accepted (50%), 1 refused by admission"
    assert "jobs that ended: 1: Failed/SpecInvalid 1" in lines
