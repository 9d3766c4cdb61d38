"""Jobs of ROS 2 nodes over MCAP: the worker, the real agent, the user's own client library (a
stand-in over Debian's Cyclone DDS) and nodes in processes of their own.
"""

import copy
import hashlib
import re
import shlex
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.waiting import PATIENCE, patient, wait_until

pytestmark = pytest.mark.integration

MESSAGES = 400
ALL = [{"name": "answers", "presence": {"topic": "/out", "min": MESSAGES}}]
LOCKSTEP = {"mode": "lockstep", "steps": [{"trigger": "/in", "answer": "/out"}]}


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, MESSAGES)


# In real time a message goes out whether there is room for it or not: so deep a queue is not filled
# by any pause of the machine, of which these tests say nothing. At full speed ten are enough.
DEPTHS = {"max": 10, "realtime": 2 * MESSAGES}


def relay(
    standin: Path, *options: str, program: str = "standin_node", depth: int = 10
) -> list[str]:
    """A node that answers each message of /in on /out; `depth` is of its queues, in messages."""
    subscription = f"/in:{ros2_recording.IMU}:{depth}:reliable"
    publisher = f"/out:std_msgs/msg/String:{depth}:reliable"
    topics = ["--sub", subscription, "--pub", publisher, "--relay", "/in=/out"]
    return [str(standin / program), "--name", "/relay", *topics, *options]


def spec(
    setup: dict[str, str], playback: dict[str, Any], command: list[str], **fields: Any
) -> SimulationJobSpec:
    stack = {
        "engine": "ros2",
        "image": "registry.example/relay:1",
        "command": command,
        "env": [{"name": name, "value": value} for name, value in setup.items()],
    } | fields.pop("stack", {})
    whole = {
        "source": {"bags": ["pvc://recordings/drive.mcap"], "fragment": {"length": "60s"}},
        "stack": stack,
        "playback": copy.deepcopy(playback),
        "record": {"topics": ["/out"]},
        "output": {"uri": "pvc://results/r"},
    }
    return SimulationJobSpec.model_validate(patient(whole | fields))


def run(spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> Row:
    """The row of the one case."""
    context = RunContext("lab/ros2", spec, folders, "pvc://results/r", str(agent.shared))
    (case,) = plan(spec, Storage(folders)).cases
    row = run_case(case, context)
    agent.await_no_descendants()
    return row


def digest(row: Row, folders: dict[str, str]) -> str:
    recorded = Path(folders["results"]) / "r" / row["recorded"]
    assert recorded.suffix == ".mcap"
    return hashlib.sha256(recorded.read_bytes()).hexdigest()


@pytest.mark.parametrize("mode", ["max", "realtime"])
def test_all_that_is_sent_is_called_and_recorded(
    mode: str, folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    job = spec(
        ros2_standin.environment(standin),
        {"mode": mode},
        relay(standin, depth=DEPTHS[mode]),
        evaluate=ALL,
    )
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    ledger = row["result"]["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
    assert ledger["strength"] == "called"
    assert row["result"]["recorded"]["messages"] == MESSAGES


def test_lock_step_records_the_same_bytes_each_time(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    digests = set()
    for program in ["standin_node", "standin_node", "standin_node_py"]:
        command = relay(standin, "--use-sim-time", program=program)
        parameters = {"parameters": {"/relay/use_sim_time": True}}
        job = spec(ros2_standin.environment(standin), LOCKSTEP, command, stack=parameters)
        row = run(job, folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        assert row["result"]["playback"]["steps"][0]["answered"] == MESSAGES
        digests.add(digest(row, folders))
    assert len(digests) == 1


def test_a_node_that_nobody_counts_proves_nothing(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    command = ["env", "-u", "LD_PRELOAD", *relay(standin)]
    row = run(
        spec(ros2_standin.environment(standin), {"mode": "max"}, command), folders, start_agent()
    )
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved"), row
    assert "what /relay got on /in is proved no further than `sent`" in row["message"]


def test_a_node_that_aborts_has_crashed(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    command = relay(standin, "--die-after", "50")
    row = run(
        spec(ros2_standin.environment(standin), {"mode": "max"}, command), folders, start_agent()
    )
    assert (row["outcome"], row["reason"]) == ("failed", "StackCrashed"), row


def test_nodes_that_fail_too_soon_to_be_seen_are_known_by_what_they_noted(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    # Between two looks at all processes, which come every 10 ms at first and every 100 ms later.
    names = [f"/brief{number}" for number in range(6)]
    brief = [
        shlex.join(relay(standin, "--name", name, "--fails-with", "3")) + "; sleep 0.3"
        for name in names
    ]
    script = "; ".join(["sleep 0.5", *brief, "exec " + shlex.join(relay(standin))])
    row = run(
        spec(ros2_standin.environment(standin), {"mode": "max"}, ["sh", "-c", script]),
        folders,
        start_agent(),
    )
    assert (row["outcome"], row["reason"]) == ("failed", "StackCrashed"), row
    ended = row["result"]["stack"]["ended"]
    assert [(one["name"], one["exit_status"]) for one in ended] == [(name, 3) for name in names]


@pytest.mark.parametrize(
    ("name", "expected"),
    [("/_ros2cli_4711", ("passed", "")), ("/other", ("failed", "NodeGone"))],
)
def test_who_is_started_from_the_command_line_may_leave_during_the_play(
    name: str,
    expected: tuple[str, str],
    tmp_path: Path,
    folders: dict[str, str],
    standin: Path,
    start_agent: Callable[..., RunningAgent],
) -> None:
    # Of what the stack publishes nobody has to take all.
    echo = [str(standin / "standin_node"), "--name", name, "--ends-after", "10"]
    echo += ["--sub", f"/out:std_msgs/msg/String:{MESSAGES}:reliable"]
    # All is played in 50 ms, less than a process may need to end on a busy machine.
    gone = str(tmp_path / "gone")
    answering = relay(standin, "--awaits", f"20:{gone}")
    leaving = shlex.join(echo) + "; " + shlex.join(["touch", gone])
    script = f"({leaving}) & exec {shlex.join(answering)}"
    job = spec(ros2_standin.environment(standin), LOCKSTEP, ["sh", "-c", script])
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["reason"]) == expected, row


@pytest.mark.usefixtures("soon_given_up")
def test_without_ros_2_a_sentence_names_what_to_do(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    nowhere = {"LD_LIBRARY_PATH": "/nowhere"}
    job = spec(nowhere, {"mode": "max", "subscribeTimeout": "20s"}, ["sleep", "60"])
    row = run(job, folders, start_agent())
    assert row["outcome"] == "errored", row
    # Nor does a player without librcl hide it: nobody is there for whom it could play.
    assert "librcl.so" in row["message"]
    assert "source the setup file" in row["message"]


def test_two_slots_of_one_machine_never_receive_from_each_other(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent(2)
    job = spec(ros2_standin.environment(standin), LOCKSTEP, relay(standin))
    context = RunContext("lab/ros2", job, folders, "pvc://results/r", str(agent.shared))
    (case,) = plan(job, Storage(folders)).cases
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(lambda _: run_case(case, context), range(4)))
    assert [row["outcome"] for row in rows] == ["passed"] * 4, rows
    # What a node receives from another slot would be in its count, and so in its answers.
    assert len({digest(row, folders) for row in rows}) == 1


# As many as some stacks have; on localhost ROS 2 has Cyclone DDS take 32.
PROCESSES = 40


def crowd(standin: Path) -> list[str]:
    """Processes that each subscribe to /in, the relay as the last of them."""
    topic = f"/in:{ros2_recording.IMU}:10:reliable"
    listeners = f'"$0/standin_node" --name "/listener_$one" --sub {topic} &'
    loop = f'for one in $(seq {PROCESSES - 1}); do {listeners} done; exec "$@"'
    return ["sh", "-c", loop, str(standin), *relay(standin)]


def test_forty_processes_of_a_stack_receive_all_of_it(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    names = ["/relay", *(f"/listener_{one}" for one in range(1, PROCESSES))]
    playback = {"mode": "max", "waitFor": names}
    setup = ros2_standin.environment(standin)
    row = run(spec(setup, playback, crowd(standin)), folders, start_agent())
    assert row["outcome"] == "passed", row
    ledger = row["result"]["ledger"]
    received = {one["node"]: one["received"] for one in ledger["topics"][0]["subscribers"]}
    assert received == dict.fromkeys(names, MESSAGES)
    assert ledger["strength"] == "called"


def test_where_the_users_settings_leave_no_place_in_the_domain_a_sentence_names_them(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    one = "<CycloneDDS><Domain><Discovery><MaxAutoParticipantIndex>1</MaxAutoParticipantIndex>"
    setup = ros2_standin.environment(standin)
    setup["CYCLONEDDS_URI"] = f"{one}</Discovery></Domain></CycloneDDS>"
    job = spec(setup, {"mode": "max"}, relay(standin))
    row = run(job, folders, start_agent())
    assert row["outcome"] == "errored", "\n".join(map(str, row.items()))
    assert "MaxAutoParticipantIndex" in row["message"], row


# More than a leak of one of each case takes to show.
CASES = 25
# Of what these cases have; the agent's own tests, which run beside these, have Fast DDS there.
OF_DDS = re.compile("cyclone|iceoryx|ledger|player")


Held = tuple[list[str], int]


def held(pid: int) -> Held:
    """What a process has open, without numbers, and how many threads it has."""
    files = []
    for one in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            files.append(one.readlink())
    kinds = sorted(re.sub(r"\d+", "", str(one)) for one in files)
    return kinds, len(list(Path(f"/proc/{pid}/task").iterdir()))


def shared_memory() -> list[str]:
    names = (one.name for one in Path("/dev/shm").iterdir())
    return sorted(filter(OF_DDS.search, names))


def test_many_cases_in_one_slot_leave_nothing_open(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    ros2_recording.write(Path(folders["recordings"]) / "drive.mcap", ["/in"], 5)
    agent = start_agent()
    job = spec(ros2_standin.environment(standin), {"mode": "max"}, relay(standin))
    (slot,) = agent.slot_processes()

    def now() -> tuple[Held, Held, list[str]]:
        return held(slot), held(agent.process.pid), shared_memory()

    before = now()
    outcomes = [run(job, folders, agent)["outcome"] for _ in range(CASES)]
    assert outcomes == ["passed"] * CASES
    assert agent.slot_processes() == [slot]
    try:
        # A case's row is there a moment before the slot has closed all of the case.
        wait_until(lambda: now() == before, PATIENCE, "")
    except AssertionError:
        assert now() == before
