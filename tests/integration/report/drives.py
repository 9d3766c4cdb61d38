"""Jobs of any size for the report: rows as the executors give them, with hostile words if asked."""

import random
from typing import Any

from bagpipe.compare.compare import compare
from bagpipe.driver.progress import Progress
from bagpipe.report.html import Report
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_spec

RAIN = ["off", "light", "heavy"]
SPEEDS = [10, 15, 20, 25, 30, 35]
VARIANTS = ["released", "pr-812"]
# Rows with figures of their own; a whole number of times all variants and values.
_DRAWN = 28 * len(VARIANTS) * len(RAIN) * len(SPEEDS)
HOSTILE = [
    "<script>window.hacked = 1</script>",
    "</script><script>window.hacked = 2</script>",
    "<img src=x onerror='window.hacked = 3'>",
    '"><svg onload=window.hacked=4>',
    "<!--<script>",
    "{{ 7 * 7 }} {% raw %} \u2028 \x00 '; window.hacked = 5; '",
    "javascript:window.hacked=6",
    "https://attacker.invalid/x.png",
]
EVALUATE = [
    {"name": "lane rate", "rate": {"topic": "/lane", "min": 9}},
    {"name": "offset", "bounds": {"topic": "/lane", "field": "offset", "min": -0.5, "max": 0.5}},
    {"name": "end pose", "finalPose": {"topic": "/lane", "position": [1, 2], "maxDistance": 0.5}},
]
PROVENANCE = {
    "bagpipe": "0.1.0", "agents": ["bagpipe-agent 0.1.0"], "labels": {"branch": "pr-812"},
    "annotations": {"sim.bagpipe.io/commit": "0c1f6d2"},
    "began": "2026-11-21T04:00:00Z", "ended": "2026-11-21T04:41:07Z", "seconds": 2467.0,
    "images": [{"container": "stack", "image": "registry.example/lane:pr-812",
                "digest": "registry.example/lane@sha256:" + "ab" * 32, "pods": 8}],
    "machines": [{"cpu": "AMD EPYC 7R13", "arch": "x86_64", "kernel": "6.1.0-18", "cpus": 8,
                  "cases": 288, "names": ["node-a", "node-b"]}],
    "seeds": [0], "discarded": {"MachineBusy": 6},
}  # fmt: skip
BUSY = {
    "reason": "MachineBusy", "seconds": 20.4,
    "message": "/lane_node lost 3 of 498 messages of /image while the player was 0.21 s late",
}  # fmt: skip
MACHINE = {
    "late_max_seconds": 0.004, "stall_max_seconds": 0.011, "cpu_pressure_seconds": 0.3,
    "throttled_seconds": 0.0, "steal_seconds": None, "busy": False,
    "message": "the machine had time: the player was at most 0.004 s late",
}  # fmt: skip
TIMINGS = {"assemble": 0.02, "master": 0.41, "stack": 0.9, "play": 20.0, "stop": 0.1}


def drive_rows(cases: int, hostile: bool = False) -> list[dict[str, Any]]:
    """`cases` rows: both variants over a matrix of rain and speed; heavy rain at speed fails.

    Beyond some, their figures and courses are those of earlier ones of the same variant and values.
    """
    chance = random.Random(7)  # noqa: S311  figures for a picture
    rows: list[dict[str, Any]] = []
    drawn: list[dict[str, Any]] = []
    for number in range(cases):
        variant = VARIANTS[number % 2]
        pair = number // 2
        rain, speed = RAIN[pair % 3], SPEEDS[pair // 3 % 6]
        fragment = f"night-drive-{pair // 18:04d}"
        hard = rain == "heavy" and speed >= (30 if variant == "released" else 25)
        case = f"{fragment}-{rain}-{speed}-{variant}"
        if number < _DRAWN:
            drawn.append(_row(chance, case, variant, hard))
        rows.append(drawn[number % _DRAWN] | {"case": case, "recorded": f"cases/{case}.a1.bag"})
        rows[-1] |= {"fragment": fragment, "values": {"rain": rain, "speed": speed}}
        rows[-1]["scenario"] = RAIN.index(rain) * len(SPEEDS) + SPEEDS.index(speed)
        if number % 97 == 5:
            rows[-1] |= _errored(number)
        if number % 71 == 11:
            rows[-1] |= {"discarded": [BUSY] * 2, "attempts": 3}
    if hostile:
        _poison(rows)
    return rows


def _row(chance: random.Random, case: str, variant: str, hard: bool) -> dict[str, Any]:
    rate = chance.gauss(7.9 if hard else 10.2, 0.35) + (0.15 if variant == "released" else 0)
    offset = abs(chance.gauss(0.42 if hard else 0.2, 0.06))
    pose = abs(chance.gauss(0.2, 0.06))
    criteria = [
        _finding("lane rate", "rate", rate, rate >= 9, "Hz", "at least 9 Hz", "higher"),
        _finding("offset", "bounds", offset, offset <= 0.5, "m", "-0.5 to 0.5 m", "lower"),
        _finding("end pose", "finalPose", pose, pose <= 0.5, "m", "at most 0.5 m", "lower"),
    ]
    failed = [finding for finding in criteria if finding["outcome"] == "failed"]
    for finding in criteria:
        finding["course"] = _course(chance, finding)
    log = [
        {"at": 0.04, "level": "info", "node": "/lane_node", "text": "map is loaded"},
        {"at": 10.02, "level": "warn", "node": "/lane_node", "text": "no marking for 0.2 s"},
    ]
    return {
        "case": case, "variant": variant, "log": log if failed else [], "seed": 0, "round": 0,
        "bag": "pvc://recordings/night.bag", "window": [0, 0, 20_000_000_000],
        "outcome": "failed" if failed else "passed",
        "reason": "CriterionFailed" if failed else "",
        "message": "; ".join(f"{f['name']}: {f['message']}" for f in failed),
        "stderr": [], "recorded": f"cases/{case}.a1.bag",
        "result": RESULT | {"timings": TIMINGS, "machine": MACHINE}, "criteria": criteria,
        "attempts": 1, "seconds": round(chance.gauss(21.5, 0.6), 3),
    }  # fmt: skip


def _finding(
    name: str, kind: str, figure: float, passed: bool, unit: str, limit: str, direction: str
) -> dict[str, Any]:
    text = f"{figure:.4g} {unit} on /lane"
    return {
        "name": name, "kind": kind, "outcome": "passed" if passed else "failed",
        "figure": figure, "unit": unit, "limit": limit, "direction": direction,
        "message": text if passed else f"{text}, and may be {limit}", "expected_failure": False,
        "coverage": 0.98,
        "covered": "193 messages without a longer silence in 98% of the window",
    }  # fmt: skip


def _course(chance: random.Random, finding: dict[str, Any]) -> dict[str, Any]:
    """As the executor takes it: more points of what failed, which goes wrong half the way."""
    bad = finding["outcome"] == "failed"
    count = 400 if bad else 100
    right = {"Hz": 10.2, "m": 0.2}[finding["unit"]]
    course = {"label": "/lane", "unit": finding["unit"], "low": None, "high": 0.5}
    if finding["unit"] == "Hz":
        course |= {"low": 9.0, "high": None}
    middle = [finding["figure"] if bad and n > count / 2 else right for n in range(count)]
    points = [
        [round(20 * n / count, 4), float(f"{chance.gauss(value, 0.03 * right):.5g}")]
        for n, value in enumerate(middle)
    ]
    if finding["name"] == "end pose":
        path = [[round(n / 2.5, 2), n - 49, 2 + 0.02 * n * finding["figure"]] for n in range(51)]
        course["plane"] = {"paths": [{"name": "/lane", "points": path}], "goal": [1, 2, 0.5]}
    return course | {"points": points}


def _errored(number: int) -> dict[str, Any]:
    return {
        "outcome": "errored", "reason": "StackExited", "criteria": [], "result": None,
        "message": f"the stack ended with status 139 after {number % 17} s",
        "stderr": ["[FATAL] lane_node: segmentation fault", f"  at frame {number}"],
    }  # fmt: skip


def _poison(rows: list[dict[str, Any]]) -> None:
    """Every text that others choose becomes hostile: names, values, messages, output, topics."""
    for number, row in enumerate(rows):
        evil = HOSTILE[number % len(HOSTILE)]
        row["case"] += evil
        row["fragment"] = row["fragment"] + evil
        row["variant"] = row["variant"] + HOSTILE[0]
        row["values"] = {HOSTILE[1]: evil, "speed": row["values"]["speed"]}
        row |= {"message": evil, "reason": evil, "stderr": [evil], "bag": evil}
        row["log"] = [{"at": 1.0, "level": evil, "node": evil, "text": evil}]
        row["criteria"] = [
            finding
            | {"name": HOSTILE[2], "unit": HOSTILE[0], "limit": evil, "message": evil}
            | {"course": {"label": evil, "unit": evil, "low": 9, "high": None, "points": [[0, 1]]}}
            for finding in row["criteria"][:1]
        ]
        topic = {"topic": evil, "sent": 1, "subscribers": [{"node": evil, "received": 1}]}
        row["result"] = {"ledger": {"topics": [topic]}, "timings": {evil: 1.0}}


def report_of(rows: list[dict[str, Any]], results: str, name: str = "lane-nightly") -> bytes:
    """report.html of a job with these rows, as its driver makes it."""
    spec = make_spec(
        evaluate=EVALUATE, record={"topics": ["/lane"]},
        variants=[{"name": variant} for variant in VARIANTS],
    )  # fmt: skip
    progress = Progress(results)
    progress.begin(len(rows))
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    compared = [c.as_json() for c in compare(rows, variants)]
    report = Report(spec, results, compared)
    for row in rows:
        progress.add(row | {"result": None})
        report.add(row)
    progress.finish()
    snapshot = progress.snapshot()
    manifest = {
        "job": {"name": name, "namespace": "lab", "uid": "u"}, "attempt": 1,
        "phase": snapshot["phase"], "verdict": snapshot["verdict"], "message": snapshot["message"],
        "counts": snapshot["cases"]
        | {"regressed": sum(c["counts"]["regressed"] for c in compared)},
        "ledger": snapshot["ledger"], "provenance": PROVENANCE,
    }  # fmt: skip
    return report.html(manifest, compared)
