"""What the stacks are asked: how the drive is played to them, and by which limits they pass.

The criteria are those that a user in good faith would write, and no stricter: what a liar gets by
has to be caught by Bagpipe, and not by a criterion that was written against it. A job asks all of
them, to save a start of Spark for each; a row is judged by the one that it names, as if the job
had no other.
"""

from dataclasses import dataclass, field, replace
from typing import Any

ANSWER = "/answer"
X, Y = "pose.position.x", "pose.position.y"
TRUTH = {"topic": ANSWER, "fields": [X, Y], "truth": "/truth", "recording": True, "max": 0.5}
CRITERIA: dict[str, dict[str, Any]] = {
    "all answers": {"presence": {"topic": ANSWER, "min": 50}},
    "some answer": {"presence": {"topic": ANSWER, "min": 1}},
    "fast": {"rate": {"topic": ANSWER, "min": 9.5}},
    "quick": {"latency": {"topic": ANSWER, "max": "1500ms"}},
    # For who is honest: no wait for a processor breaks it, which is shorter than play and drain.
    "not stuck": {"latency": {"topic": ANSWER, "max": "12s", "minCoverage": 0.5}},
    "close": {"error": TRUTH | {"metric": "max"}},
    "close on average": {"error": TRUTH | {"metric": "rmse"}},
    "close at last": {"error": TRUTH | {"metric": "final"}},
    "ahead": {"bounds": {"topic": ANSWER, "field": X, "min": -1.0}},
    "near": {"bounds": {"topic": ANSWER, "field": X, "max": 1000.0}},
    "sane": {"expression": {"topic": ANSWER, "holds": "!(msg.pose.position.x > 1000.0)"}},
    "arrived": {
        "finalPose": {
            "topic": ANSWER,
            "position": [98.0, 1.0],
            "maxDistance": 0.5,
            "yaw": 0.0,
            "maxYawError": 0.1,
        }
    },
    "small": {"resources": {"maxMemory": "200Mi"}},
    "no alarm": {"presence": {"topic": "/alarm", "min": 0, "max": 0}},
    "a map": {"presence": {"topic": "/map_frame", "min": 1}},
    "apart": {"separation": {"ego": "/ego", "obstacles": "/obstacles", "minDistance": 2.0}},
    "known fault": {"error": TRUTH | {"metric": "max"}, "expectFailure": True},
}
EVALUATE = [{"name": name} | kind for name, kind in CRITERIA.items()]
# In lock-step and in max bag time waits for the stack: nobody may ask how late an answer was.
WITHOUT_LATENCY = [each for each in EVALUATE if "latency" not in each]
RECORDED = [ANSWER, "/alarm", "/map_frame", "/status", "/ego", "/obstacles"]


@dataclass(frozen=True)
class Job:
    """What rows share: how the drives are played, and fields of source, stack and spec."""

    name: str
    playback: dict[str, Any]
    changed: dict[str, Any] = field(default_factory=dict)
    engine: str = "ros1"
    # For stacks that come: a machine with other work shows some of them after half a minute.
    subscribe: str = "120s"

    def spec(self, bags: list[str]) -> dict[str, Any]:
        """The manifest's spec without its stack."""
        uris = [f"pvc://recordings/{bag}" for bag in bags]
        patience = {"caseTimeout": "300s"}
        if self.engine == "exec":
            return {"source": {"files": uris}, "playback": patience}
        source = {
            "bags": uris,
            "topics": ["/pose"],
            "fragment": {"length": "2s", "warmUp": "1s"},
        }
        return {
            "source": source | self.changed.get("source", {}),
            "playback": patience | {"subscribeTimeout": self.subscribe} | self.playback,
            "record": {"topics": RECORDED},
            "evaluate": EVALUATE if self.playback["mode"] == "realtime" else WITHOUT_LATENCY,
        } | {key: self.changed[key] for key in ("faultPolicy",) if key in self.changed}


def steps(deadline: str, **more: Any) -> dict[str, Any]:
    """Lock-step that waits for an answer to each pose; who gives none costs no more than that."""
    step = {"trigger": "/pose", "answer": ANSWER, "deadline": deadline, "optional": True}
    return {"mode": "lockstep", "steps": [step | more]}


# Played by the clock, as a robot lives it.
LIVE = Job("live", {"mode": "realtime"})
STEPPED = Job("stepped", steps("100ms"))
# Where somebody answers each pose: one that is slow keeps the play waiting, and misses nothing.
STEADY = Job("steady", steps("60s"))
SIMULATED = Job("simulated", steps("2s"), {"parameters": {"/use_sim_time": True}})
# For a stack that is waited for in vain.
IN_VAIN = replace(SIMULATED, name="in-vain", subscribe="10s")
SIMULATED_LIVE = Job(
    "simulated-live", {"mode": "realtime"}, {"parameters": {"/use_sim_time": True}}
)
STAMPED = Job("stamped", steps("100ms", by="stamp", optional=False))
FAST = Job("fast", {"mode": "max"})
# The recording has the answers of the old software under the same name, and they are played too.
OLD = Job("old", {"mode": "max"}, {"source": {"topics": ["/pose", "/answer"]}})
TOLERANT = Job(
    "tolerant",
    {"mode": "realtime"},
    {
        "faultPolicy": [
            {"cause": "NodeRespawned", "action": "allow"},
            {"cause": "StackCrashed", "action": "allow"},
            {"cause": "MessagesLost", "action": "allow"},
        ]
    },
)
LEAVING = Job(
    "leaving",
    {"mode": "realtime"},
    {"faultPolicy": [{"cause": "StackExited", "action": "allow"}]},
)
PROGRAMS = Job("programs", {}, engine="exec")


def of_ros2(job: Job) -> Job:
    """The same, played to nodes of ROS 2."""
    changed = dict(job.changed)
    if "parameters" in changed:
        changed["parameters"] = {
            f"/**{name}": value for name, value in changed["parameters"].items()
        }
    return replace(job, name=f"ros2-{job.name}", changed=changed, engine="ros2")


@dataclass(frozen=True)
class Question:
    """What a row is asked: a criterion of a job (none: the job's own word), over a drive."""

    job: Job
    criterion: str = ""
    drive: str = "drive"
    fragment: int = 0


PRESENCE = Question(STEPPED, "all answers")
PRESENCE_LIVE = Question(LIVE, "all answers")
PRESENCE_STEADY = Question(STEADY, "all answers")
SOME = Question(STEPPED, "some answer")
SOME_LIVE = Question(LIVE, "some answer")
SOME_STEADY = Question(STEADY, "some answer")
SOME_MAX = Question(FAST, "some answer")
LATENCY = Question(LIVE, "quick")
LATENCY_LOOSE = Question(LIVE, "not stuck")
LATENCY_SIM = Question(SIMULATED_LIVE, "not stuck", "zero")
ERROR_SIM = Question(SIMULATED, "close")
ERROR_IN_VAIN = Question(IN_VAIN, "close")
ERROR = Question(STEPPED, "close")
ERROR_LIVE = Question(LIVE, "close")
ERROR_RMSE = Question(STEPPED, "close on average")
ERROR_FINAL = Question(STEPPED, "close at last")
ERROR_LATER = Question(LIVE, "close", "later")
EXPECTED_LIVE = Question(LIVE, "known fault")
BY_STAMPS = Question(STAMPED, "close")
RATE = Question(LIVE, "fast")
RATE_STEADY = Question(STEADY, "fast")
BOUNDS = Question(STEPPED, "ahead")
BOUNDS_ABOVE = Question(STEPPED, "near")
HOLDS = Question(STEPPED, "sane")
ARRIVED = Question(STEPPED, "arrived")
CHEAP = Question(STEPPED, "small")
CHEAP_LIVE = Question(LIVE, "small")
QUIET = Question(STEPPED, "no alarm")
LEAD_IN = Question(STEPPED, "some answer", "warm", 1)
LEAD_IN_LIVE = Question(LIVE, "some answer", "warm", 1)
OLD_ANSWERS = Question(OLD, "all answers")
LATCHED_MAP = Question(LIVE, "a map")
ALLOWED = Question(TOLERANT, "some answer")
ALL_LEFT = Question(LEAVING, "all answers")
APART = Question(LIVE, "apart")
EXPECTED = Question(STEPPED, "known fault")
PROGRAM = Question(PROGRAMS, drive="number")
