"""The driver's metrics, from the rows of its cases. The process is one job's, so no metric but
`bagpipe_job_info` has a label of the job: Prometheus distinguishes drivers by their address.
"""

import logging
from collections.abc import Iterator, Mapping
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe.case_reasons import REASONS
from bagpipe.driver.progress import Progress
from bagpipe.driver.spark_executors import SparkExecutors
from bagpipe.engine_fields import fields_of
from bagpipe.row_facts import OUTCOMES, discarded_runs
from bagpipe.run.case_run import Row
from bagpipe.source_fields import source_fields
from bagpipe.spec import JobFile, SimulationJobSpec

log = logging.getLogger(__name__)

_MEBIBYTE = 1 << 20
_SECONDS = (0.1, 0.3, 1, 3, 10, 30, 60, 120, 300, 900, 3600)
FINDINGS = ("passed", "failed", "invalid")
_PARTS = ("assemble", "master", "stack", "subscribe", "lead_in", "play", "drain", "run", "stop")
_PIPE_SIZES = (4096, 8192, 16384, 32768, 65536, 131072, 262144, 524288, 1048576)
_THROUGHPUTS = tuple(n * 1e6 for n in (1, 3, 10, 30, 100, 300, 1000, 3000))
_RATIOS = (0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 0.99, 1.0, 1.01, 1.1)
_RECORDINGS = tuple(n * _MEBIBYTE for n in (1, 4, 16, 64, 128, 256, 512, 768, 896, 1024))


class _ProgressCollector(Collector):
    """The job's counts as gauges: what an earlier driver of the job did is among them."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def collect(self) -> Iterator[GaugeMetricFamily]:
        snapshot = self._progress.snapshot()
        cases = GaugeMetricFamily(
            "bagpipe_cases",
            "Cases of the job by state; crashed, lost, regressed and quarantined ones are among "
            "the others, and discarded counts runs that do not count.",
            labels=["state"],
        )
        for state, count in snapshot["cases"].items():
            cases.add_metric([state], count)
        yield cases
        ledger = GaugeMetricFamily(
            "bagpipe_ledger_messages",
            "The ledger's sums over the cases that count, in messages.",
            labels=["counted"],
        )
        for counted, count in snapshot["ledger"].items():
            ledger.add_metric([counted], count)
        yield ledger
        yield GaugeMetricFamily(
            "bagpipe_slots",
            "Places for cases that the job asked for, at most.",
            value=self._progress.slots,
        )
        yield GaugeMetricFamily(
            "bagpipe_slots_busy", "Places in which a case runs.", value=snapshot["cases"]["running"]
        )
        yield GaugeMetricFamily(
            "bagpipe_results_waiting",
            "1 while results can't be kept and storage is tried again.",
            value=bool(snapshot["warning"]),
        )


def _own_reasons(spec: SimulationJobSpec) -> frozenset[str]:
    """Those that the job's engine and its source declare."""
    return fields_of(spec.stack.engine).reasons | source_fields(spec.source.kind).reasons


class DriverMetrics:
    """Counters, histograms and gauges of one driver, in a registry of their own."""

    def __init__(self, progress: Progress, job: JobFile) -> None:
        self.registry = CollectorRegistry()
        self._reasons = REASONS | _own_reasons(job.spec)
        self._asks_for_a_rate = job.spec.playback.mode == "realtime"
        spark = job.spec.spark
        self.executors = SparkExecutors(lambda: spark.executors_for(progress.left()))
        self.registry.register(_ProgressCollector(progress))
        self.registry.register(self.executors)
        ProcessCollector(registry=self.registry)
        info = Gauge(
            "bagpipe_job_info",
            "1; the labels name the job of this driver. Join other metrics of the driver with it "
            "by `instance`.",
            ["job_namespace", "job_name", "job_uid", "attempt", "engine", "mode"],
            registry=self.registry,
        )
        info.labels(
            job_namespace=job.namespace, job_name=job.name, job_uid=job.uid, attempt=job.attempt,
            engine=job.spec.stack.engine, mode=job.spec.playback.mode,
        ).set(1)  # fmt: skip
        self._criteria = frozenset(criterion.name for criterion in job.spec.evaluate)
        self._count_cases()
        self._count_criteria()
        self._count_pipes()
        self._count_replays()

    def _count_cases(self) -> None:
        self._ended = self._counter(
            "bagpipe_cases_ended",
            "Cases that this driver brought to an end, by outcome.",
            "outcome",
        )
        for outcome in OUTCOMES:
            self._ended.labels(outcome)
        self._faults = self._counter(
            "bagpipe_case_faults",
            "Runs of cases that did not pass, those that were tried again too, by reason; a reason "
            "of the user's own program or evaluator is counted as Other.",
            "reason",
        )
        for reason in (*sorted(self._reasons), "Other"):
            self._faults.labels(reason)
        self._seconds = self._histogram(
            "bagpipe_case_seconds", "Time of a case with all its tries.", _SECONDS
        )
        self._parts = Histogram(
            "bagpipe_case_part_seconds",
            "Time of the parts of a case: assemble (its input comes through the pipe), master, "
            "stack (they start), subscribe, lead_in, play, drain, run (a program), stop.",
            ["part"], buckets=_SECONDS, registry=self.registry,
        )  # fmt: skip
        for part in _PARTS:
            self._parts.labels(part)

    def _count_criteria(self) -> None:
        """A spec has at most 100, and what a row says beside them is not counted."""
        self._judged = self._counter(
            "bagpipe_criteria_judged",
            "Findings of the criteria of spec.evaluate over the cases that ended, by outcome.",
            "criterion",
            "outcome",
        )
        for criterion in self._criteria:
            for outcome in FINDINGS:
                self._judged.labels(criterion, outcome)

    def _count_pipes(self) -> None:
        self._read = self._counter(
            "bagpipe_fragment_read_bytes",
            "Bytes of fragments that were read from storage and went through the pipe.",
        )
        self._pipe = self._histogram(
            "bagpipe_pipe_size_bytes",
            "Size of a case's pipe as the kernel gave it: 256 KiB were asked for.",
            _PIPE_SIZES,
        )
        self._throughput = self._histogram(
            "bagpipe_pipe_throughput_bytes_per_second",
            "How fast a case's input came through the pipe, its reading from storage included.",
            _THROUGHPUTS,
        )
        self._high_water = self._histogram(
            "bagpipe_recorder_high_water_bytes",
            "The most that a case's recording held; it may hold 1 GiB.",
            _RECORDINGS,
        )
        self._recorded = self._counter("bagpipe_recorded_bytes", "Bytes of recorded messages.")
        self._messages = self._counter("bagpipe_recorded_messages", "Recorded messages.")

    def _count_replays(self) -> None:
        self._ratio = self._histogram(
            "bagpipe_replay_rate_ratio",
            "The rate at which a case was played, as a share of the rate that was asked for; not "
            "in the mode `max`, which asks for none.",
            _RATIOS,
        )
        self._late = self._histogram(
            "bagpipe_replay_late_seconds",
            "How much later than due a case's latest message left.",
            (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10),
        )
        self._bag_time = self._counter(
            "bagpipe_replay_bag_seconds", "Time of the recordings that was played."
        )
        self._played = self._counter(
            "bagpipe_replay_played_seconds", "Time that playing it took, summed over the slots."
        )
        self._waits = self._counter(
            "bagpipe_lockstep_wait_seconds",
            "Time from inputs' release to the stack's answer, over the answers that came.",
        )
        self._answers = self._counter(
            "bagpipe_lockstep_answers",
            "Answers that lock-step waited for: answered, no_output, skipped.",
            "result",
        )
        for result in ("answered", "no_output", "skipped"):
            self._answers.labels(result)
        self._slowest = self._histogram(
            "bagpipe_lockstep_slowest_answer_seconds", "A case's slowest answer in lock-step.",
            _SECONDS,
        )  # fmt: skip

    def _counter(self, name: str, text: str, *labels: str) -> Counter:
        return Counter(name, text, labels, registry=self.registry)

    def _histogram(self, name: str, text: str, buckets: tuple[float, ...]) -> Histogram:
        return Histogram(name, text, buckets=buckets, registry=self.registry)

    def count(self, row: Row) -> None:
        """Count a case that this driver brought to an end; one that was taken over is not."""
        if "ran_in" in row:
            return
        self._ended.labels(row["outcome"]).inc()
        reasons = [run["reason"] for run in discarded_runs(row)]
        reasons += [row["reason"]] if row["reason"] else []
        for reason in reasons:
            self._faults.labels(reason if reason in self._reasons else "Other").inc()
        for finding in row.get("criteria") or []:
            if finding.get("name") in self._criteria and finding.get("outcome") in FINDINGS:
                self._judged.labels(finding["name"], finding["outcome"]).inc()
        if "seconds" in row:
            self._seconds.observe(row["seconds"])
        try:
            self._count_result(row["result"] or {})
        except (KeyError, TypeError, ValueError, ZeroDivisionError):
            # A figure less is no reason to end a job.
            log.exception("case %s: its result can't be counted in the metrics", row["case"])

    def _count_result(self, result: Mapping[str, Any]) -> None:
        if not result:
            return
        timings = result.get("timings") or {}
        for part, seconds in timings.items():
            if part in _PARTS:
                self._parts.labels(part).observe(seconds)
        fed = result.get("input_bytes", 0)
        self._read.inc(fed)
        self._pipe.observe(result.get("pipe_bytes", 0))
        if timings.get("assemble"):
            self._throughput.observe(fed / timings["assemble"])
        if recorded := result.get("recorded"):
            self._high_water.observe(recorded["high_water_bytes"])
            self._recorded.inc(recorded["bytes"])
            self._messages.inc(recorded["messages"])
        if playback := result.get("playback"):
            self._count_playback(playback)

    def _count_playback(self, playback: Mapping[str, Any]) -> None:
        played = playback.get("played_seconds", 0.0)
        self._played.inc(played)
        self._bag_time.inc(playback["achieved_rate"] * played)
        if self._asks_for_a_rate:
            self._ratio.observe(playback["achieved_rate"] / playback["asked_rate"])
            self._late.observe(playback["late_max_seconds"])
        for step in playback.get("steps", []):
            self._waits.inc(step["waited_seconds"])
            if step["answered"]:
                self._slowest.observe(step["slowest_seconds"])
            for result in ("answered", "no_output", "skipped"):
                self._answers.labels(result).inc(step[result])
