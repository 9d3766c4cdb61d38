"""The alerts. Each has a figure that is there in good times too, so that a test can ask for it."""

from charts.monitoring.alert import Alert

_LOGS = "`kubectl logs -n bagpipe-system deployment/bagpipe-operator` says which call and why."

_OPERATOR = [
    Alert(
        "BagpipeOperatorAbsent", "operator", "critical",
        "absent(bagpipe_leader)", "", "2m",
        "Prometheus reaches no operator of Bagpipe.",
        "No replica of the operator has been scraped for two minutes.",
        "If it is down: jobs that run go on, no job starts, and no job's end is reported.",
        ("`kubectl get pods -n bagpipe-system`: is a pod there, and ready?",
         "`kubectl describe` it: an image that can't be pulled, no memory, no node?",
         ("If it runs, look at Prometheus' targets: is there a PodMonitor (or annotation), and"
         " does a NetworkPolicy (`networkPolicy.metricsFrom`) let Prometheus in?")),
    ),
    Alert(
        "BagpipeNoLeader", "operator", "critical",
        "sum(bagpipe_leader)", "== 0", "1m",
        "No replica of the operator leads.",
        "Replicas run, and none holds the Lease.",
        "Nothing is reconciled: no job starts, and no job's end is reported.",
        ("`kubectl get lease -n bagpipe-system`: who holds it, since when?",
         f"{_LOGS} It names a right that is missing on the Lease.",
         "A Lease whose holder is gone is taken over within `operator.leaseSeconds` and a fifth."),
    ),
    Alert(
        "BagpipeSeveralLeaders", "operator", "critical",
        "sum by (namespace) (bagpipe_leader)", "> 1", "1m",
        "{{ $value }} replicas of the operator say that they lead.",
        "More than one replica of a release believes that it holds the Lease.",
        "Writes are guarded by versions and UIDs, so little is at risk; work is done twice.",
        (("`kubectl get lease -n bagpipe-system`: are there two, of two releases? They must watch"
         " different namespaces."),
         "Do the nodes' clocks run equally fast? See docs/limits.md, replicas of the operator.",
         "Delete the pod that the Lease does not name."),
    ),
    Alert(
        "BagpipeReconcileFaults", "operator", "warning",
        'sum(increase(bagpipe_reconciles_total{result="faulted"}[10m]))', "> 0", "0m",
        "The operator met a bug of its own.",
        "A reconcile ended with an error that nobody thought of.",
        "The job that it was about is tried again and may not move; others are not touched.",
        ("Find `unexpected fault` in the operator's log: it names the job, with a traceback.",
         "Report it with the traceback and `kubectl get simjob -o yaml`.",
         "Suspending and resuming the job, or creating it again, may get around it."),
    ),
    Alert(
        "BagpipeReconcileSlow", "operator", "warning",
        "histogram_quantile(0.99, sum by (le) (rate(bagpipe_reconcile_seconds_bucket[10m])))",
        "> 5", "10m",
        "One reconcile in a hundred takes more than {{ $value | humanizeDuration }}.",
        "Reconciles wait: for the API server, or for drivers that do not answer.",
        "Statuses lag behind, and new jobs start late.",
        ("Dashboard Operator: is it the calls to the API server, or the questions to drivers?",
         "Raise `operator.workers` if drivers are silent, and mend why they are.",
         "See BagpipeApiErrors and BagpipeDriversSilent."),
    ),
    Alert(
        "BagpipeQueueLong", "operator", "warning",
        "max(bagpipe_queue_depth)", "> 500", "10m",
        "{{ $value }} jobs wait to be reconciled.",
        "More jobs change than the operator gets to.",
        "Statuses lag behind, and new jobs start late.",
        ("Is it a burst of new jobs? It passes.",
         "Dashboard Operator: are reconciles slow? See BagpipeReconcileSlow.",
         "Raise `operator.workers`, or split the namespaces between two releases."),
    ),
    Alert(
        "BagpipeStatusStale", "operator", "warning",
        "max(bagpipe_status_age_seconds)", "> 300", "2m",
        "A job has not been looked at for {{ $value | humanizeDuration }}.",
        "A job that has not ended is not reconciled, or its reconcile fails each time.",
        "Its status may be wrong, and it may not move.",
        (_LOGS,
         "Is the job's status refused (an older CRD)? Bring the CRDs up to date.",
         "Restart the operator's pod if it says nothing: nothing is lost by that."),
    ),
    Alert(
        "BagpipeApiErrors", "operator", "warning",
        'sum(rate(bagpipe_api_requests_total{code=~"5..|none|401|403"}[5m])) or vector(0)',
        "> 0.1", "5m",
        "The API server fails {{ $value | humanize }} calls a second.",
        "Calls of the operator end in errors, time out, or lack a right.",
        "What they were for is tried again, later and later.",
        ("Dashboard Operator, Calls: which verb, which code?",
         "401 and 403: were the chart's roles changed? `helm upgrade` brings them back.",
         "5xx and none: is the API server well, and does the network reach it?"),
    ),
    Alert(
        "BagpipeApiThrottled", "operator", "warning",
        "sum(rate(bagpipe_api_throttled_total[5m]))", "> 0", "5m",
        "The API server refuses calls of the operator as too many.",
        "API Priority and Fairness holds the operator back.",
        "Jobs start late, and statuses lag behind.",
        ("`kubectl get flowschemas`: into which level do the operator's calls fall?",
         "Give its ServiceAccount a FlowSchema of its own.",
         "Fewer `operator.workers` and a longer `operator.sweepSeconds` make fewer calls."),
    ),
    Alert(
        "BagpipeDriversSilent", "operator", "warning",
        'sum(rate(bagpipe_driver_requests_total{result="silent"}[10m])) /'
        " sum(rate(bagpipe_driver_requests_total[10m]))", "> 0.5", "10m",
        "{{ $value | humanizePercentage }} of the questions to drivers get no answer.",
        "The operator does not reach the drivers' port 8080, or they hang.",
        "Jobs run and end all the same; their statuses show no progress meanwhile.",
        (("Does a NetworkPolicy of the job's namespace close port 8080 to the operator? The chart's"
         " own (`networkPolicy.enabled`) leaves it open."),
         "`kubectl logs` of a driver: does it still plan, is it out of memory?",
         "Are nodes cut off? `kubectl get nodes`."),
    ),
]  # fmt: skip

_JOBS = [
    Alert(
        "BagpipeJobsWait", "jobs", "warning",
        "max(bagpipe_oldest_pending_job_seconds)", "> 900", "5m",
        "A job has been waiting for its driver for {{ $value | humanizeDuration }}.",
        "A job is Pending: its driver's pod does not start.",
        "It does not run until that is mended, or until `startDeadline` ends it.",
        ("`kubectl describe simjob`: the conditions Accepted and Running say what it waits for.",
         "See docs/operations/stuck-jobs.md for each reason.",
         "A queue of Kueue may hold it on purpose."),
    ),
    Alert(
        "BagpipeJobsFail", "jobs", "warning",
        'sum(increase(bagpipe_jobs_ended_total{phase="Failed"}[1h])) /'
        " sum(increase(bagpipe_jobs_ended_total[1h]))", "> 0.5", "5m",
        "{{ $value | humanizePercentage }} of the jobs of the last hour failed.",
        "More than half of the jobs could not be run to their end. A verdict Failed is not"
        " counted: that job has done its work.",
        "There are no verdicts where people wait for them.",
        ("`kubectl get simjob -A`: do they have one reason in common?",
         "See docs/tasks/failed-job.md.",
         "StorageFailed of many jobs is the storage; an image that is missing is the registry."),
    ),
    Alert(
        "BagpipeScheduleStalled", "jobs", "warning",
        'max(bagpipe_schedules{state="Stalled"})', "> 0", "5m",
        "{{ $value }} schedules start no jobs.",
        "A SimulationSchedule can't be understood, or its job can't be created.",
        "Its runs do not take place.",
        ("`kubectl get simsched -A`: the condition Stalled says why.",
         "Mend the schedule: it goes on by itself."),
    ),
    Alert(
        "BagpipeScheduleLate", "jobs", "warning",
        "sum(increase(bagpipe_schedule_start_late_seconds_count[1h])) -"
        ' sum(increase(bagpipe_schedule_start_late_seconds_bucket{le="60.0"}[1h]))',
        "> 0.5", "0m",
        "A schedule's job was created more than a minute late.",
        "The operator was away, or had no time, when a run was due.",
        "The run took place late, within its `startingDeadline`.",
        ("Was the operator down then? See BagpipeOperatorAbsent and BagpipeNoLeader.",
         "Is it busy? See BagpipeQueueLong."),
    ),
    Alert(
        "BagpipeNightRed", "jobs", "info",
        'max by (verdict) (bagpipe_schedules_last_job{verdict=~"Failed|Invalid|Errored"})',
        "> 0", "1m",
        "The last job of {{ $value }} schedules ended as {{ $labels.verdict }}.",
        "The last job of a schedule that ended did not pass: its software got worse, it gave no"
        " evidence (Invalid), or it could not be run (Errored).",
        "Nothing of Bagpipe's is at fault but where it is Errored; what was tested may be.",
        ("Dashboard Nights: which schedules, and how many of their cases?",
         "`bagpipe report` of the job, or report.html among its results: which cases, and why?",
         "`bagpipe history` says since which night; see docs/tasks/bisect.md for which commit.",
         "It goes with the next job that passes, or while the schedule is suspended."),
    ),
    Alert(
        "BagpipeNoGoodNight", "jobs", "warning",
        "max(bagpipe_schedules_longest_red_seconds)", "> 172800", "5m",
        "A schedule is red, and no job of it has passed for {{ $value | humanizeDuration }}.",
        "The last job of a schedule did not pass, and none has for two days.",
        "What gets worse meanwhile is not seen: a red night hides the next fault.",
        (("`kubectl get simsched -A -o custom-columns=NAMESPACE:.metadata.namespace,"
         "NAME:.metadata.name,PASSED:.status.lastPassedTime`: which one?"),
         "Mend what fails; `quarantine` takes cases that flake out of the verdict for a while.",
         ("A schedule that nobody waits for is better suspended. One that runs each week is red"
         " for two days after one bad run: silence this alert for it.")),
    ),
    Alert(
        "BagpipeNotificationsFail", "jobs", "warning",
        "sum by (receiver) (increase(bagpipe_notifications_total"
        '{result=~"failed|dropped"}[1h]))', "> 0", "0m",
        "{{ $labels.receiver }} does not get notifications of Bagpipe's.",
        "A receiver was not notified of a job's end: all tries failed, for half an hour or more,"
        " or too many were waiting for it.",
        "Somebody who relies on it does not learn how jobs ended. Jobs and other receivers are"
        " not touched.",
        (("The operator's log says `was not notified` with the reason, and so does the job's"
         " condition Notified."),
         ("It answered 401 or 403: do both have the same key? `its key can't be used`: is the"
         " Secret of `notifications.receivers[].secretName` there, with the key `key`?"),
         "It can't be reached: is it up, does a NetworkPolicy or a proxy stand between?",
         "What was lost is not sent again: `kubectl get simjob -A` has how the jobs ended."),
    ),
]  # fmt: skip

_ALL_CASES = "sum by (instance) (increase(bagpipe_cases_ended_total[15m]))"

_DATA_PLANE = [
    Alert(
        "BagpipeCasesErrored", "data-plane", "warning",
        'sum by (instance) (increase(bagpipe_cases_ended_total{outcome="errored"}[15m])) /'
        f" {_ALL_CASES}", "> 0.1", "5m",
        "{{ $value | humanizePercentage }} of a job's cases can't be run (driver"
        " {{ $labels.instance }}).",
        "Cases end without a verdict: the stack crashes, bags can't be read, storage fails.",
        "The job will fail, with the cases that ran kept in its results.",
        ("Dashboard Job, Runs that did not pass: which reason?",
         "`kubectl get simjob -o yaml`: `status.failures` has the first five, with words.",
         "See docs/tasks/failed-job.md for each reason."),
    ),
    Alert(
        "BagpipeJobWithoutProgress", "data-plane", "warning",
        "bagpipe_slots_busy * on (instance) (1 - clamp_max(sum by (instance)"
        " (increase(bagpipe_cases_ended_total[30m])), 1))", "> 0", "30m",
        "Cases run and none has ended for half an hour (driver {{ $labels.instance }}).",
        "All slots of a job work on cases that do not end.",
        "The job stands still until `playback.caseTimeout` ends them.",
        ("Are the cases just that long? Then silence this alert for the job.",
         "Dashboard Job: how do executors do? `kubectl logs` of one, container stack.",
         "See docs/operations/stuck-jobs.md."),
    ),
    Alert(
        "BagpipeExecutorsMissing", "data-plane", "warning",
        'sum by (instance) (bagpipe_executors{state="wanted"}) -'
        ' sum by (instance) (bagpipe_executors{state="registered"})'
        " * on (instance) clamp_max(sum by (instance) (bagpipe_slots_busy), 1)", "> 0", "15m",
        "A job lacks {{ $value }} of its executors (driver {{ $labels.instance }}).",
        "Executors of a job do not start, or are lost again and again.",
        "It runs more slowly, or not at all.",
        ("`kubectl get simjob -A`: the reason of the condition Running.",
         "`kubectl describe` an executor that is Pending: no room, no image, no volume?",
         "ExecutorOutOfMemory: raise `spark.executor.resources.memory` or lower `spark.slots`."),
    ),
    Alert(
        "BagpipeMachineBusy", "data-plane", "warning",
        'sum by (instance) (increase(bagpipe_case_faults_total{reason="MachineBusy"}[15m]))'
        f" / clamp_min({_ALL_CASES}, 1)", "> 1", "5m",
        "A case is played {{ $value | humanize }} times more than once, since its machine is too"
        " busy (driver {{ $labels.instance }}).",
        "Messages are lost while the executors' machines have no CPU for them; such a run proves"
        " nothing and is made again.",
        "The job takes longer, and cases end as MachineBusy when the tries are used up.",
        ("Fewer `spark.slots`, or more CPU in `stack.resources`: is the pod throttled?",
         "What else runs on the executors' nodes? results.jsonl says what was measured.",
         "Lower `playback.rate`, or use `max` or `lockstep`, which wait for the nodes."),
    ),
    Alert(
        "BagpipeReplaySlow", "data-plane", "warning",
        "histogram_quantile(0.5, sum by (instance, le)"
        " (increase(bagpipe_replay_rate_ratio_bucket[15m])))", "< 0.95", "5m",
        "Half of a job's cases are played slower than {{ $value | humanizePercentage }} of the"
        " rate asked for (driver {{ $labels.instance }}).",
        "The player can't keep the recording's time, because the stack reads too slowly or the"
        " node is too busy.",
        "The stack saw the data slower than it was recorded; its timing is not what it would be.",
        ("Dashboard Data plane: lateness and time of the parts.",
         "More CPU for the stack (`stack.resources`), fewer `spark.slots`.",
         "If the stack is the limit, use `lockstep`, where time is the recording's."),
    ),
    Alert(
        "BagpipeSlotsDie", "data-plane", "warning",
        "sum by (instance) (increase(bagpipe_agent_slot_deaths_total[15m]))", "> 2", "0m",
        "Slots of an executor die again and again: {{ $value | humanize }} in 15 minutes (agent"
        " {{ $labels.instance }}).",
        "The agent's process of a slot ends in the midst of cases: the kernel kills it for memory,"
        " or a case outlives its deadline and nothing else ends it.",
        "Its cases are run again, and end as errored when the tries are used up.",
        ("`kubectl logs` of the executor, container stack: `slot N ended with ...` says how.",
         "Signal 9 means memory: raise `stack.resources.limits.memory`, cut shorter fragments.",
         "Exit status 70 is a case past its deadline, whose last lines are before it."),
    ),
    Alert(
        "BagpipePipesSmall", "data-plane", "info",
        'sum by (instance) (increase(bagpipe_pipe_size_bytes_bucket{le="131072.0"}[15m])) /'
        " sum by (instance) (increase(bagpipe_pipe_size_bytes_count[15m]))", "> 0.5", "5m",
        "{{ $value | humanizePercentage }} of a job's cases got a small pipe (driver"
        " {{ $labels.instance }}).",
        "The node gives less than the 256 KiB asked for: its soft limit for pipes of a user"
        " (64 MiB) is used up.",
        "Cases come through the pipe more slowly; nothing is lost.",
        ("Raise `fs.pipe-user-pages-soft` on the nodes.",
         "Fewer `spark.slots`, or fewer executors on a node."),
    ),
    Alert(
        "BagpipeRecorderNearBound", "data-plane", "warning",
        "sum by (instance) (increase(bagpipe_recorder_high_water_bytes_count[1h])) - sum by"
        ' (instance) (increase(bagpipe_recorder_high_water_bytes_bucket{le="9.39524096e+08"}[1h]))',
        "> 0.5", "0m",
        "A recording came near its bound of 1 GiB (driver {{ $labels.instance }}).",
        "The stack publishes so much on the recorded topics that a case's recording held more"
        " than 896 MiB.",
        "A case whose recording passes 1 GiB ends as RecorderBudgetExceeded.",
        ("Record fewer topics (`record.topics`).", "Cut shorter fragments (`source.fragment`)."),
    ),
    Alert(
        "BagpipeResultsNotKept", "data-plane", "critical",
        "max by (instance) (bagpipe_results_waiting)", "> 0", "1m",
        "A job's results can't be kept (driver {{ $labels.instance }}).",
        "The driver can't write its journal or its manifest: the volume is full, or storage does"
        " not answer.",
        "The job fails as StorageFailed five minutes after the first such try.",
        ("The driver's log, and the condition Running, have storage's own words.",
         "Make room on the volume, or mend the storage: the driver goes on by itself.",
         "If it has failed: create it again with `resumeFrom`; what was journaled is not lost."),
    ),
]  # fmt: skip

ALERTS = [*_OPERATOR, *_JOBS, *_DATA_PLANE]
