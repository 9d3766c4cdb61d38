"""The schedules in the documentation are ones that the operator runs as they are."""

import re
from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api.objects import Json
from bagpipe_operator.schedules.cron import read_zone
from bagpipe_operator.schedules.decide import decide, time_zone_of
from bagpipe_operator.schedules.job import job_manifest
from bagpipe_operator.schedules.view import ScheduleView
from tests.unit.operator.schedules.world import make_schedule

DOCS = Path(__file__).parents[4] / "docs"


def schedule_of_the_page() -> Json:
    (block,) = re.findall(
        r"```yaml\n(.*?)```", (DOCS / "tasks/schedules.md").read_text(), re.DOTALL
    )
    loaded: Json = yaml.safe_load(block)
    return loaded


def schedule_of_the_example() -> Json:
    loaded: Json = yaml.safe_load((DOCS / "examples/schedule/schedule.yaml").read_text())
    return loaded


@pytest.mark.parametrize("read", [schedule_of_the_page, schedule_of_the_example])
def test_a_documented_schedule_makes_a_valid_job(read: object) -> None:
    assert callable(read)
    manifest = read()
    assert len(manifest["metadata"]["name"]) <= 31
    manifest["metadata"] = make_schedule()["metadata"] | manifest["metadata"]
    schedule = ScheduleView.from_object(manifest)
    zone = read_zone(time_zone_of(schedule))
    decision = decide(schedule, (), datetime(2026, 11, 20, 4, 0, 40, tzinfo=UTC), zone)
    assert decision.next_run is not None
    assert decision.next_run.strftime("%H:%M") == "01:30"
    job = job_manifest(schedule, decision.next_run)
    SimulationJobSpec.model_validate(job["spec"])
