"""The dashboards of those who run Bagpipe, and all of them in their order."""

from charts.monitoring.board import (
    ONE_IS_GOOD,
    RATE,
    Board,
    Panel,
    address,
    fleet,
    mean,
    quantile,
    quantiles,
    rate,
)  # fmt: skip
from charts.monitoring.nights import NIGHTS

_STEPS = ("created_to_accepted", "accepted_to_planned", "planned_to_running", "running_to_ended")

FLEET = Board(
    "fleet",
    "Bagpipe / Fleet",
    "All jobs: what waits, what runs, how it ends.",
    {
        "Now": [
            Panel("Jobs that run", "short", "Jobs that are planning or running.",
                  [(fleet('bagpipe_jobs{phase=~"Planning|Running"}', "phase"), "{{phase}}")],
                  "number"),
            Panel("Jobs that wait", "short", "Jobs whose driver has not started.",
                  [(fleet('bagpipe_jobs{phase="Pending"}'), "jobs")], "number"),
            Panel("Longest wait", "s", "For how long the oldest of them has been waiting.",
                  [("max(bagpipe_oldest_pending_job_seconds)", "wait")], "number"),
            Panel("Cases that run", "short", "Cases that run at this moment, in all jobs.",
                  [(fleet('bagpipe_unfinished_cases{state="running"}'), "cases")], "number"),
        ],
        "Jobs": [
            Panel("Jobs by phase", "short", "Jobs that the operator knows, those that ended too.",
                  [(fleet("bagpipe_jobs", "phase"), "{{phase}}")]),
            Panel("Jobs that ended", "short", "Per hour, by verdict; None: the job failed.",
                  [("sum by (phase, verdict) (increase(bagpipe_jobs_ended_total[1h]))",
                    "{{phase}} {{verdict}}")]),
            Panel("Jobs of pools", "short",
                  "Per hour, by how they began: taken over by a driver that waited, or why not.",
                  [("sum by (how) (increase(bagpipe_pool_jobs_total[1h]))", "{{how}}")]),
            Panel("Drivers that wait", "short",
                  "Drivers of pools that wait for another job, each with its executors.",
                  [(fleet("bagpipe_pool_drivers_waiting"), "drivers")]),
            Panel("Schedules by state", "short", "SimulationSchedules; Stalled ones start no job.",
                  [(fleet("bagpipe_schedules", "state"), "{{state}}")]),
        ],
        "Times of a job": [
            *(
                Panel(step.replace("_", " ").capitalize(), "s",
                      "Median and slowest hundredth of this transition, over the last hour.",
                      [((f"histogram_quantile({share}, sum by (le) "
                        f"(increase(bagpipe_job_{step}_seconds_bucket[1h])))"), f"{share:.0%}")
                       for share in (0.5, 0.99)])
                for step in _STEPS
            ),
            Panel("Start of scheduled jobs", "s", "How late the jobs of schedules were created.",
                  [(("histogram_quantile(0.99, sum by (le) "
                    "(increase(bagpipe_schedule_start_late_seconds_bucket[1h])))"), "99%")]),
        ],
        "Cases and pods": [
            Panel("Cases of unfinished jobs", "short", "By state, as the jobs' statuses say.",
                  [(fleet("bagpipe_unfinished_cases", "state"), "{{state}}")]),
            Panel("Cases that end", "ops", "Cases per second, over all drivers, by outcome.",
                  [(rate("bagpipe_cases_ended_total", "outcome"), "{{outcome}}")]),
            Panel("Pods", "short", "Pods of jobs by role and phase.",
                  [(fleet("bagpipe_pods", "role, phase"), "{{role}} {{phase}}")]),
            Panel("Slots in use", "percentunit", "Share of the places for cases in which one runs.",
                  [("sum(bagpipe_slots_busy) / sum(bagpipe_slots)", "busy")]),
            Panel("Jobs that run, by name", "short", "Cases that run, of each job with a driver.",
                  [(("sum by (job_namespace, job_name) (bagpipe_slots_busy * on (instance)"
                    " group_left (job_namespace, job_name) max by (instance, job_namespace,"
                    " job_name) (bagpipe_job_info))"), "{{job_namespace}}/{{job_name}}")], "bars",
                  links=(("This job", address("job", namespace="${__field.labels.job_namespace}",
                                              job_name="${__field.labels.job_name}")),)),
        ],
    },
    leads_to=("nights", "job"),
)  # fmt: skip

# A job has no label in the metrics of its driver; its info has, and the address joins them.
_THIS = 'bagpipe_job_info{job_namespace="$namespace",job_name="$job_name"}'
_OF = f" * on (instance) group_left () max by (instance) ({_THIS})"


def _rate_of_job(metric: str, by: str = "") -> str:
    return f"sum{f' by ({by})' if by else ''} (rate({metric}{RATE}){_OF})"


JOB = Board(
    "job",
    "Bagpipe / Job",
    "One job: progress, faults, replay and executors, by the metrics of its driver.",
    {
        "Progress": [
            Panel("Cases done", "percentunit", "Share of the planned cases that have ended.",
                  [('sum(bagpipe_cases{state=~"passed|failed|invalid|errored"}' + _OF + ")"
                    ' / sum(bagpipe_cases{state="planned"}' + _OF + ")", "done")], "number"),
            Panel("Cases left", "short", "Planned cases that have not ended.",
                  [('sum(bagpipe_cases{state="planned"}' + _OF + ")"
                    ' - sum(bagpipe_cases{state=~"passed|failed|invalid|errored"}' + _OF + ")",
                    "left")], "number"),
            Panel("Slots in use", "percentunit", "Share of the job's places in which a case runs.",
                  [(f"sum(bagpipe_slots_busy{_OF}) / sum(bagpipe_slots{_OF})", "busy")], "number"),
            Panel("Runs discarded", "short",
                  "Runs of cases that do not count: on a busy machine, with a fault of Bagpipe's.",
                  [('sum(bagpipe_cases{state="discarded"}' + _OF + ")", "runs")], "number"),
            Panel("Cases by state", "short", "What earlier drivers of the job did is among them.",
                  [(f"sum by (state) (bagpipe_cases{_OF})", "{{state}}")]),
            Panel("Cases that end", "ops", "Cases per second, by outcome.",
                  [(_rate_of_job("bagpipe_cases_ended_total", "outcome"), "{{outcome}}")]),
            Panel("Runs that did not pass", "ops",
                  "Per second, by reason; those that were tried again too.",
                  [(_rate_of_job("bagpipe_case_faults_total", "reason") + " > 0", "{{reason}}")]),
        ],
        "Replay": [
            Panel("Time of a case", "s", "With all its tries.",
                  quantiles("bagpipe_case_seconds", _OF)),
            Panel("Rate achieved against asked", "percentunit",
                  "Median and the slowest twentieth; in real time only.",
                  [(quantile(0.5, "bagpipe_replay_rate_ratio", among=_OF), "median"),
                   (quantile(0.05, "bagpipe_replay_rate_ratio", among=_OF), "slowest 5%")]),
            Panel("Ledger", "short", "Messages of the cases that count.",
                  [(f"sum by (counted) (bagpipe_ledger_messages{_OF})", "{{counted}}")]),
            Panel("Wait in lock-step", "s", "Mean time from the inputs to the stack's answer.",
                  [(_rate_of_job("bagpipe_lockstep_wait_seconds_total") + " / "
                    + _rate_of_job('bagpipe_lockstep_answers_total{result="answered"}'), "wait")]),
            Panel("Read from storage", "Bps", "Bytes of fragments, of cases that ended.",
                  [(_rate_of_job("bagpipe_fragment_read_bytes_total"), "read")]),
            Panel("Recorder's high-water mark", "bytes", "A recording may hold 1 GiB.",
                  quantiles("bagpipe_recorder_high_water_bytes", _OF)),
        ],
        "Executors": [
            Panel("Executors", "short", "Wanted by the job, and registered with its driver.",
                  [(f"sum by (state) (bagpipe_executors{_OF})", "{{state}}")]),
            Panel("Tasks of an executor", "short", "Cases that run on each; Spark's own figure.",
                  [(f"sum by (executor) (spark_executor_active_tasks{_OF})", "{{executor}}")]),
            Panel("Garbage collection", "percentunit",
                  "Share of its tasks' time that an executor's JVM collects garbage.",
                  [(_rate_of_job("spark_executor_gc_seconds_total", "executor") + " / "
                    + _rate_of_job("spark_executor_task_seconds_total", "executor"),
                    "{{executor}}")]),
            Panel("Failed tasks", "ops", "Per second, by executor; Spark's own figure.",
                  [(_rate_of_job("spark_executor_failed_tasks_total", "executor"),
                    "{{executor}}")]),
            Panel("Spark's storage memory", "percentunit", "Share that is in use, by executor.",
                  [((f"sum by (executor) (spark_executor_storage_memory_used_bytes{_OF}) / "
                    f"sum by (executor) (spark_executor_storage_memory_max_bytes{_OF})"),
                    "{{executor}}")]),
            Panel("JVM of an executor", "bytes", "The most heap that each has used; Spark's own.",
                  [(f"sum by (executor) (spark_executor_jvm_heap_peak_bytes{_OF})",
                    "{{executor}}")]),
            Panel("Driver's memory", "bytes", "Of the driver's Python; its JVM is a process more.",
                  [(f"sum(process_resident_memory_bytes{_OF})", "driver")]),
        ],
    },
    {
        "namespace": "label_values(bagpipe_job_info, job_namespace)",
        "job_name": 'label_values(bagpipe_job_info{job_namespace="$namespace"}, job_name)',
    },
    leads_to=("fleet", "nights"),
)  # fmt: skip

DATA_PLANE = Board(
    "data-plane",
    "Bagpipe / Data plane",
    "Storage, pipes, replay and recording, over the drivers and agents of all jobs.",
    {
        "Now, by the agents in the executors": [
            Panel("Slots", "short", "Places for cases, and those in which a case runs.",
                  [("sum(bagpipe_agent_slots_busy)", "busy"), ("sum(bagpipe_agent_slots)", "all")]),
            Panel("Through the pipes", "Bps", "Bytes of fragments as they come.",
                  [(rate("bagpipe_agent_fragment_received_bytes_total"), "received")]),
            Panel("Messages", "ops", "Played, warm-ups included, and recorded.",
                  [(rate("bagpipe_agent_played_messages_total"), "played"),
                   (rate("bagpipe_agent_recorded_messages_total"), "recorded")]),
            Panel("Rate achieved against asked, now", "percentunit", "In real time only.",
                  [(rate("bagpipe_agent_replay_bag_seconds_total") + " / "
                    + rate("bagpipe_agent_replay_due_seconds_total"), "achieved")]),
            Panel("Each wait in lock-step", "s", "From the inputs to the stack's answer.",
                  quantiles("bagpipe_agent_lockstep_wait_seconds")),
            Panel("Answers that do not come", "ops", "In lock-step, within their deadline.",
                  [(rate("bagpipe_agent_lockstep_unanswered_total"), "missing")]),
            Panel("Messages lost", "ops", "By the ledgers of the runs that end; it should be 0.",
                  [(rate('bagpipe_agent_ledger_messages_total{counted="dropped"}'), "lost")]),
            Panel("Recordings", "bytes", "Being made; and the largest one since an agent's start.",
                  [("sum(bagpipe_agent_recordings_size_bytes)", "being made"),
                   ("max(bagpipe_agent_recorder_high_water_bytes)", "largest")]),
            Panel("Smallest pipe", "bytes", "As a kernel gave it; 256 KiB were asked for.",
                  [("min(bagpipe_agent_pipe_size_bytes > 0)", "smallest")]),
            Panel("Ends of runs", "ops", "A result, a reason (aborted), or nothing (abandoned).",
                  [(rate("bagpipe_agent_cases_ended_total", "outcome"), "{{outcome}}")]),
            Panel("Deaths of slots", "short", "Processes that ended unasked, per hour.",
                  [("sum(increase(bagpipe_agent_slot_deaths_total[1h]))", "deaths")]),
            Panel("Agents", "short", "Containers that Prometheus reaches, by release.",
                  [("count by (version) (bagpipe_agent_info)", "{{version}}")]),
        ],
        "From storage through the pipe": [
            Panel("Read from storage", "Bps", "Bytes of fragments, of cases that ended.",
                  [(rate("bagpipe_fragment_read_bytes_total"), "read")]),
            Panel("Throughput of a pipe", "Bps",
                  "How fast a case's input came, its reading from storage included.",
                  [(quantile(0.5, "bagpipe_pipe_throughput_bytes_per_second"), "median"),
                   (quantile(0.05, "bagpipe_pipe_throughput_bytes_per_second"), "slowest 5%")]),
            Panel("Pipes below 256 KiB", "percentunit",
                  "Share of the cases whose node gave them a smaller pipe.",
                  [(rate('bagpipe_pipe_size_bytes_bucket{le="131072.0"}') + " / "
                    + rate("bagpipe_pipe_size_bytes_count"), "small")]),
        ],
        "Replay": [
            Panel("Rate achieved against asked", "percentunit", "In real time only.",
                  [(quantile(0.5, "bagpipe_replay_rate_ratio"), "median"),
                   (quantile(0.05, "bagpipe_replay_rate_ratio"), "slowest 5%")]),
            Panel("Lateness", "s", "How much later than due a case's latest message left.",
                  quantiles("bagpipe_replay_late_seconds")),
            Panel("Bag time per second", "short",
                  "Seconds of recordings that are played in a second, over all slots.",
                  [(rate("bagpipe_replay_bag_seconds_total"), "bag seconds"),
                   (rate("bagpipe_replay_played_seconds_total"), "seconds of slots")]),
            Panel("Parts of a case", "s", "Mean time of each part.",
                  [(mean("bagpipe_case_part_seconds", "part"), "{{part}}")]),
            Panel("Wait in lock-step", "s", "Mean time from the inputs to the stack's answer.",
                  [(rate("bagpipe_lockstep_wait_seconds_total") + " / "
                    + rate('bagpipe_lockstep_answers_total{result="answered"}'), "mean"),
                   (quantile(0.99, "bagpipe_lockstep_slowest_answer_seconds"),
                    "slowest of a case, 99%")]),
            Panel("Answers in lock-step", "ops", "Per second, by what came of them.",
                  [(rate("bagpipe_lockstep_answers_total", "result"), "{{result}}")]),
        ],
        "Proof and recording": [
            Panel("Messages", "short", "Sums of the ledgers of the jobs that run.",
                  [("sum by (counted) (bagpipe_ledger_messages)", "{{counted}}")]),
            Panel("Lossy runs", "ops", "Runs whose ledger showed a loss, by whose it was.",
                  [(rate('bagpipe_case_faults_total{reason="MachineBusy"}'), "busy machine"),
                   (rate('bagpipe_case_faults_total{reason="MessagesLost"}'), "stack")]),
            Panel("Recorded", "Bps", "Bytes of recorded messages.",
                  [(rate("bagpipe_recorded_bytes_total"), "recorded")]),
            Panel("Recorded messages", "ops", "Per second.",
                  [(rate("bagpipe_recorded_messages_total"), "recorded")]),
            Panel("Recorder's high-water mark", "bytes", "A recording may hold 1 GiB.",
                  quantiles("bagpipe_recorder_high_water_bytes")),
            Panel("Jobs whose results wait", "short", "Drivers that try storage again.",
                  [("sum(bagpipe_results_waiting)", "drivers")]),
        ],
    },
)  # fmt: skip

OPERATOR = Board(
    "operator",
    "Bagpipe / Operator",
    "The control plane: its queue, its calls, its leader.",
    {
        "Health": [
            Panel("Leaders", "short", "One of the replicas leads; 0 and 2 are faults.",
                  [("sum(bagpipe_leader)", "leaders")], "number", colors=ONE_IS_GOOD),
            Panel("Replicas", "short", "Replicas that Prometheus reaches, by release.",
                  [("count by (version) (bagpipe_operator_info)", "{{version}}")], "number"),
            Panel("Age of a status", "s", "Of the job that was looked at the longest ago.",
                  [("max(bagpipe_status_age_seconds)", "age")], "number"),
            Panel("Queue", "short", "Jobs that wait to be reconciled.",
                  [(fleet("bagpipe_queue_depth"), "jobs")], "number"),
        ],
        "Work": [
            Panel("Queue", "short", "Jobs that wait to be reconciled.",
                  [(fleet("bagpipe_queue_depth"), "jobs")]),
            Panel("Reconciles", "ops", "Per second, by result; faulted is a bug.",
                  [(rate("bagpipe_reconciles_total", "result"), "{{result}}")]),
            Panel("Time of a reconcile", "s", "With its calls to API server and driver.",
                  quantiles("bagpipe_reconcile_seconds")),
            Panel("Age of a status", "s", "Of the job that was looked at the longest ago.",
                  [("max(bagpipe_status_age_seconds)", "age")]),
            Panel("Objects from the watches", "ops", "Per second, by kind.",
                  [(rate("bagpipe_watch_events_total", "kind"), "{{kind}}")]),
            Panel("Questions to drivers", "ops", "Per second; silent ones did not answer in time.",
                  [(rate("bagpipe_driver_requests_total", "result"), "{{result}}")]),
        ],
        "API server": [
            Panel("Calls", "reqps", "By verb and status; none: no answer in time.",
                  [(rate("bagpipe_api_requests_total", "verb, code"), "{{verb}} {{code}}")]),
            Panel("Time of a call", "s", "The slowest hundredth, by verb.",
                  [(quantile(0.99, "bagpipe_api_request_seconds", "verb"), "{{verb}}")]),
            Panel("Wait of counts", "s", "How long counts wait while the API server is slow.",
                  [(fleet("bagpipe_status_progress_wait_seconds"), "wait")]),
            Panel("Statuses", "ops", "Changes per second: written, or put off to a later visit.",
                  [(rate("bagpipe_status_decisions_total", "decision"), "{{decision}}")]),
            Panel("Throttled", "reqps", "Calls that the API server refused with 429.",
                  [(rate("bagpipe_api_throttled_total"), "throttled")]),
        ],
        "Process": [
            Panel("Memory", "bytes", "Resident, by replica.",
                  [("process_resident_memory_bytes * on (instance) bagpipe_operator_info",
                    "{{instance}}")]),
            Panel("Processor", "percentunit", "Of one processor, by replica.",
                  [(f"rate(process_cpu_seconds_total{RATE}) * on (instance) bagpipe_operator_info",
                    "{{instance}}")]),
            Panel("Who leads", "short", "1 in the leader.",
                  [("bagpipe_leader", "{{instance}}")]),
            Panel("Jobs of schedules", "short", "Created per hour.",
                  [("sum(increase(bagpipe_schedule_jobs_started_total[1h]))", "jobs")]),
        ],
        "Notifications": [
            Panel("Notifications", "short", "Per hour, by receiver and what became of them.",
                  [("sum by (receiver, result) (increase(bagpipe_notifications_total[1h]))",
                    "{{receiver}} {{result}}")], normal="delivered alone."),
            Panel("Notifications that wait", "short", "To be sent, or to be sent again.",
                  [("max by (receiver) (bagpipe_notifications_waiting)", "{{receiver}}")],
                  normal="0 but for moments; 1000 is the most."),
            Panel("Time of a try", "s", "The slowest tenth, by receiver.",
                  [(quantile(0.9, "bagpipe_notification_seconds", "receiver"), "{{receiver}}")],
                  normal="below a second; 10 s is the deadline."),
        ],
    },
)  # fmt: skip

BOARDS = [FLEET, NIGHTS, JOB, DATA_PLANE, OPERATOR]
