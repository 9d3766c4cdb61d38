"""The alert rules, by Prometheus' own promtool: each fires on its failure and on no other day."""

import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from charts.monitoring.alerts import ALERTS
from charts.monitoring.generate import ROOT

RULES = ROOT / "charts/bagpipe/files/alerts.yaml"


def driver(name: str, **labels: str) -> str:
    all_labels = {"instance": "d:8080", **labels}
    pairs = [f'{key}="{value}"' for key, value in all_labels.items()]
    return f"{name}{{{','.join(pairs)}}}"


def histogram(name: str, fast: str, slow: str, bound: str) -> dict[str, str]:
    """Observations at or below a bound, and all of them."""
    return {
        driver(f"{name}_bucket", le=bound): fast,
        driver(f"{name}_bucket", le="+Inf"): slow,
        driver(f"{name}_count"): slow,
    }


Series = dict[str, str]
ENDED, FAULTS = "bagpipe_cases_ended_total", "bagpipe_case_faults_total"
ON, OFF, GROWS = "1+0x90", "0+0x90", "0+60x90"  # a sample a minute

# What is seen when something is wrong, and when it is not.
WORLDS: dict[str, tuple[Series, Series]] = {
    "BagpipeOperatorAbsent": ({}, {"bagpipe_leader": ON}),
    "BagpipeNoLeader": (
        {'bagpipe_leader{pod="a"}': OFF, 'bagpipe_leader{pod="b"}': OFF},
        {'bagpipe_leader{pod="a"}': ON, 'bagpipe_leader{pod="b"}': OFF},
    ),
    "BagpipeSeveralLeaders": (
        {'bagpipe_leader{pod="a",namespace="s"}': ON, 'bagpipe_leader{pod="b",namespace="s"}': ON},
        {'bagpipe_leader{pod="a",namespace="s"}': ON, 'bagpipe_leader{pod="b",namespace="t"}': ON},
    ),
    "BagpipeReconcileFaults": (
        {'bagpipe_reconciles_total{result="faulted"}': "0+1x90"},
        {'bagpipe_reconciles_total{result="faulted"}': "3+0x90",
         'bagpipe_reconciles_total{result="retried"}': GROWS},
    ),
    "BagpipeReconcileSlow": (
        histogram("bagpipe_reconcile_seconds", "0+1x90", "0+9x90", "2.0")
        | {driver("bagpipe_reconcile_seconds_bucket", le="10.0"): "0+9x90"},
        histogram("bagpipe_reconcile_seconds", GROWS, GROWS, "2.0"),
    ),
    "BagpipeQueueLong": ({"bagpipe_queue_depth": "600+0x90"}, {"bagpipe_queue_depth": "90+0x90"}),
    "BagpipeStatusStale": (
        {"bagpipe_status_age_seconds": "0+60x90"}, {"bagpipe_status_age_seconds": "20+0x90"},
    ),
    "BagpipeApiErrors": (
        {'bagpipe_api_requests_total{verb="GET",code="500"}': GROWS},
        {'bagpipe_api_requests_total{verb="GET",code="404"}': GROWS},
    ),
    "BagpipeApiThrottled": (
        {"bagpipe_api_throttled_total": "0+1x90"}, {"bagpipe_api_throttled_total": "5+0x90"},
    ),
    "BagpipeDriversSilent": (
        {'bagpipe_driver_requests_total{result="silent"}': "0+3x90",
         'bagpipe_driver_requests_total{result="answered"}': "0+1x90"},
        {'bagpipe_driver_requests_total{result="silent"}': "0+1x90",
         'bagpipe_driver_requests_total{result="answered"}': "0+3x90"},
    ),
    "BagpipeJobsWait": (
        {"bagpipe_oldest_pending_job_seconds": "0+60x90"},
        {"bagpipe_oldest_pending_job_seconds": "300+0x90"},
    ),
    "BagpipeJobsFail": (
        {'bagpipe_jobs_ended_total{phase="Failed",verdict="None"}': "0+3x90",
         'bagpipe_jobs_ended_total{phase="Complete",verdict="Passed"}': "0+1x90"},
        {'bagpipe_jobs_ended_total{phase="Failed",verdict="None"}': "0+1x90",
         'bagpipe_jobs_ended_total{phase="Complete",verdict="Failed"}': "0+9x90"},
    ),
    "BagpipeScheduleStalled": (
        {'bagpipe_schedules{state="Stalled"}': ON, 'bagpipe_schedules{state="Scheduled"}': ON},
        {'bagpipe_schedules{state="Stalled"}': OFF, 'bagpipe_schedules{state="Scheduled"}': ON},
    ),
    "BagpipeScheduleLate": (
        histogram("bagpipe_schedule_start_late_seconds", "0+1x90", "0+2x90", "60.0"),
        histogram("bagpipe_schedule_start_late_seconds", "0+2x90", "0+2x90", "60.0"),
    ),
    "BagpipeNightRed": (
        {'bagpipe_schedules_last_job{verdict="Errored"}': ON,
         'bagpipe_schedules_last_job{verdict="Passed"}': ON},
        {'bagpipe_schedules_last_job{verdict="Failed"}': OFF,
         'bagpipe_schedules_last_job{verdict="Passed"}': ON,
         'bagpipe_schedules_last_job{verdict="None"}': ON},
    ),
    "BagpipeNoGoodNight": (
        {'bagpipe_schedules_longest_red_seconds{pod="a"}': "172000+60x90",
         'bagpipe_schedules_longest_red_seconds{pod="b"}': OFF},
        {"bagpipe_schedules_longest_red_seconds": "86400+60x90"},
    ),
    "BagpipeNotificationsFail": (
        {'bagpipe_notifications_total{receiver="r",result="failed"}': "0+1x90",
         'bagpipe_notifications_total{receiver="r",result="delivered"}': GROWS},
        {'bagpipe_notifications_total{receiver="r",result="failed"}': "3+0x90",
         'bagpipe_notifications_total{receiver="r",result="delivered"}': GROWS},
    ),
    "BagpipeCasesErrored": (
        {driver(ENDED, outcome="errored"): "0+1x90", driver(ENDED, outcome="passed"): "0+4x90"},
        {driver(ENDED, outcome="errored"): OFF, driver(ENDED, outcome="failed"): "0+4x90"},
    ),
    "BagpipeJobWithoutProgress": (
        {driver("bagpipe_slots_busy"): "4+0x90", driver(ENDED, outcome="passed"): "7+0x90"},
        {driver("bagpipe_slots_busy"): "4+0x90", driver(ENDED, outcome="errored"): "0+1x90"},
    ),
    "BagpipeExecutorsMissing": (
        {driver("bagpipe_executors", state="wanted"): "8+0x90",
         driver("bagpipe_executors", state="registered"): "5+0x90",
         driver("bagpipe_slots_busy"): "4+0x90"},
        {driver("bagpipe_executors", state="wanted"): "8+0x90",
         driver("bagpipe_executors", state="registered"): "8+0x90",
         driver("bagpipe_slots_busy"): "4+0x90"},
    ),
    "BagpipeMachineBusy": (
        {driver(FAULTS, reason="MachineBusy"): "0+9x90",
         driver(ENDED, outcome="passed"): "0+3x90"},
        {driver(FAULTS, reason="MachineBusy"): "0+1x90",
         driver(FAULTS, reason="MessagesLost"): "0+50x90",
         driver(ENDED, outcome="passed"): "0+3x90"},
    ),
    "BagpipeReplaySlow": (
        histogram("bagpipe_replay_rate_ratio", "0+9x90", "0+9x90", "0.75"),
        {driver("bagpipe_replay_rate_ratio_bucket", le="0.99"): OFF}
        | histogram("bagpipe_replay_rate_ratio", "0+9x90", "0+9x90", "1.0"),
    ),
    "BagpipeSlotsDie": (
        {'bagpipe_agent_slot_deaths_total{instance="e:9811"}': "0+1x90"},
        {'bagpipe_agent_slot_deaths_total{instance="e:9811"}': "2+0x90",
         'bagpipe_agent_slot_deaths_total{instance="f:9811"}': "0+0x90"},
    ),
    "BagpipePipesSmall": (
        histogram("bagpipe_pipe_size_bytes", "0+9x90", "0+9x90", "131072.0"),
        histogram("bagpipe_pipe_size_bytes", "0+1x90", "0+9x90", "131072.0"),
    ),
    "BagpipeRecorderNearBound": (
        histogram("bagpipe_recorder_high_water_bytes", "0+8x90", "0+9x90", "9.39524096e+08"),
        histogram("bagpipe_recorder_high_water_bytes", "0+9x90", "0+9x90", "9.39524096e+08"),
    ),
    "BagpipeResultsNotKept": (
        {driver("bagpipe_results_waiting"): ON}, {driver("bagpipe_results_waiting"): OFF},
    ),
}  # fmt: skip


def promtool(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["promtool", *words], capture_output=True, text=True, timeout=60, check=False
    )


def judged(folder: Path, alert: str, world: Series, fires: bool) -> str:
    """What promtool says of a world in which the alert is to fire, or to be silent; empty: true.

    Only the name is compared, by asking Prometheus' own series of alerts.
    """
    firing = f'count(ALERTS{{alertname="{alert}",alertstate="firing"}})'
    samples = [{"labels": "{}", "value": 1 if fires else 0}]
    asked = {"expr": f"{firing} or vector(0)", "eval_time": "90m", "exp_samples": samples}
    test = {
        "rule_files": [str(RULES)],
        "evaluation_interval": "1m",
        "tests": [
            {
                "interval": "1m",
                "input_series": [{"series": s, "values": v} for s, v in world.items()],
                "promql_expr_test": [asked],
            }
        ],
    }
    path = folder / f"{alert}-{fires}.yaml"
    path.write_text(yaml.safe_dump(test))
    done = promtool("test", "rules", path)
    return "" if done.returncode == 0 else done.stdout + done.stderr


def test_prometheus_takes_the_rules() -> None:
    done = promtool("check", "rules", RULES)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(ALERTS)} rules found" in done.stdout


def test_every_alert_is_tried() -> None:
    assert [alert.name for alert in ALERTS] == list(WORLDS)


@pytest.mark.parametrize("alert", WORLDS)
def test_it_fires_on_its_failure_and_is_silent_without(alert: str, tmp_path: Path) -> None:
    wrong, well = WORLDS[alert]
    assert judged(tmp_path, alert, wrong, fires=True) == ""
    assert judged(tmp_path, alert, well, fires=False) == ""


@pytest.mark.parametrize("alert", ALERTS, ids=lambda alert: alert.name)
def test_every_alert_says_what_to_do(alert: Any) -> None:
    rule = alert.rule()
    assert (ROOT / rule["annotations"]["runbook"]).read_text() == alert.page()
    assert len(alert.steps) >= 2
    assert all(text.endswith((".", "?")) for text in (alert.meaning, alert.impact, *alert.steps))
