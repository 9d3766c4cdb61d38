"""The dashboard of engineers: what the jobs of schedules found, night after night."""

from charts.monitoring.board import GOOD, NONE_IS_GOOD, Board, Panel, address

_WHOSE = "job_namespace, schedule"
_NAME = "{{job_namespace}}/{{schedule}}"
_JOB = (
    "Its job",
    address("job", namespace="${__field.labels.job_namespace}",
            job_name="${__field.labels.job_name}"),
)  # fmt: skip


def _cases(state: str) -> str:
    """Of the last jobs of the chosen schedules, by schedule; each replica of an operator has it."""
    chosen = f'schedule=~"$schedule",state=~"{state}"'
    return f"sum by ({_WHOSE}) (max by ({_WHOSE}, state) (bagpipe_schedule_job_cases{{{chosen}}}))"


def _with_job(figure: str) -> str:
    """The figure with the name of the job, which the link needs."""
    info = f'max by ({_WHOSE}, job_name) (bagpipe_schedule_job_info{{schedule=~"$schedule"}})'
    return f"({figure}) * on ({_WHOSE}) group_right () {info}"


_SECONDS = f'max by ({_WHOSE}) (bagpipe_schedule_job_seconds{{schedule=~"$schedule"}})'
_SHARE = f"{_cases('passed')} / ({_cases('passed|failed|invalid|errored')} > 0)"

NIGHTS = Board(
    "nights",
    "Bagpipe / Nights",
    "What the last jobs of schedules found: verdicts, criteria, what got worse, slow and flaky.",
    {
        "Now": [
            Panel("Red schedules", "short", "Schedules whose last job did not pass, by verdict.",
                  [(("max by (verdict)"
                     ' (bagpipe_schedules_last_job{verdict=~"Failed|Invalid|Errored"})'),
                    "{{verdict}}")], "number", normal="0 of each.", colors=NONE_IS_GOOD),
            Panel("Green schedules", "short", "Schedules whose last job passed.",
                  [('max(bagpipe_schedules_last_job{verdict="Passed"})', "passed")], "number",
                  normal="as many as there are schedules that are not suspended.", colors=GOOD),
            Panel("Red for", "s", "Since a job of the schedule that is red the longest passed.",
                  [("max(bagpipe_schedules_longest_red_seconds)", "red")], "number",
                  normal="0; two days ring an alarm.", colors=NONE_IS_GOOD),
            Panel("Regressed cases", "short", "Cases that got worse than in their baseline.",
                  [(f"sum({_cases('regressed')})", "cases")], "number", normal="0.",
                  colors=NONE_IS_GOOD),
        ],
        "Over the nights": [
            Panel("Verdict", "short", "1 while it is that of the schedule's last job.",
                  [((f"max by ({_WHOSE}, job_name, verdict)"
                    ' (bagpipe_schedule_job_info{schedule=~"$schedule"})'),
                    f"{_NAME} {{{{verdict}}}}")],
                  normal="one line for each schedule, Passed.", links=(_JOB,)),
            Panel("Cases that passed", "percentunit", "Share of the cases of each last job.",
                  [(_SHARE, _NAME)], normal="100% but for cases in quarantine."),
            Panel("Cases that did not pass", "short", "Of each last job, by state.",
                  [(("sum by (state) (max by (job_namespace, schedule, state)"
                    ' (bagpipe_schedule_job_cases{schedule=~"$schedule",'
                    'state=~"failed|invalid|errored|quarantined"}))'), "{{state}}")],
                  normal="0; quarantined ones are known and have a last day."),
            Panel("Criteria that fail", "short", "Cases per hour in which a criterion failed.",
                  [(('sum by (criterion) (increase(bagpipe_criteria_judged_total{outcome="failed"}'
                    "[1h]))"), "{{criterion}}")], normal="0."),
            Panel("Criteria without evidence", "short", "Cases per hour that it could not judge.",
                  [(('sum by (criterion) (increase(bagpipe_criteria_judged_total{outcome="invalid"}'
                    "[1h]))"), "{{criterion}}")], normal="0."),
            Panel("Runs that did not pass", "short", "Per hour, by reason, of all jobs.",
                  [("sum by (reason) (increase(bagpipe_case_faults_total[1h])) > 0", "{{reason}}")],
                  normal="none, or MachineBusy now and then."),
        ],
        "The last jobs, the worst first": [
            Panel("Regressions", "short", "Cases that got worse than in their baseline.",
                  [(f"sort_desc({_with_job(_cases('regressed'))})", _NAME)], "bars",
                  normal="0.", links=(_JOB,), colors=NONE_IS_GOOD),
            Panel("Flakiest", "short", "Cases whose rounds do not agree, by no more than chance.",
                  [(f"topk(10, {_with_job(_cases('flaky'))})", _NAME)], "bars",
                  normal="0; a handful at most.", links=(_JOB,)),
            Panel("Slowest", "s", "From a job's start to its end.",
                  [(f"topk(10, {_with_job(_SECONDS)})", _NAME)], "bars",
                  normal="what it was last week, within a fifth.", links=(_JOB,)),
            Panel("Time of a job", "s", "From its start to its end, night after night.",
                  [(_SECONDS, _NAME)], normal="flat; what rises ends in the morning one day.",),
        ],
    },
    {"schedule": "label_values(bagpipe_schedule_job_info, schedule)"},
    any_of_them=True,
    leads_to=("fleet", "job"),
    time="now-14d",
)  # fmt: skip
