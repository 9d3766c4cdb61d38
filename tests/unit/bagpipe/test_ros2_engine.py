"""stack.engine: ros2 in the worker: what its spec says, what HELLO carries, and what is proved."""

import copy
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.engine.delivery import judge
from bagpipe.engine.ros2.proof import PROOF
from bagpipe.faults import ALLOWABLE, FAILURES, FaultPolicy, FaultRule
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.run.case_run import RunContext, case_map
from bagpipe.spec import SimulationJobSpec
from bagpipe.wire.hello_case import valid_case
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec

Json = dict[str, Any]
QOS = {"/scan": {"reliability": "bestEffort", "depth": 5}, "/map": {"durability": "transientLocal"}}
ALLOWED = FaultPolicy([FaultRule(cause="DeliveryUnproved", action="allow")])


def spec(stack: Json | None = None, **changed: Any) -> SimulationJobSpec:
    own = {"image": "stack:1", "command": ["run"], "engine": "ros2"} | (stack or {})
    return make_spec(stack=own, **changed)


def refusal(stack: Json | None = None, **changed: Any) -> str:
    with pytest.raises(ValidationError) as refused:
        spec(stack, **changed)
    return str(refused.value.errors()[0]["msg"]).removeprefix("Value error, ")


def hello(of: SimulationJobSpec) -> Any:
    case = Case("a", "pvc://r/a.mcap", "v", Window(0, 1, 2), [], [], 1)
    return case_map(case, RunContext("n/j", of, {}, "pvc://results/r"))


def test_hello_has_what_is_offered_for_each_topic_and_nil_for_the_rest() -> None:
    case = hello(spec({"ros2": {"qos": QOS}}))
    assert case["engine"] == "ros2"
    assert case["stack"]["qos"] == {
        "/scan": {"reliability": "bestEffort", "durability": None, "depth": 5},
        "/map": {"reliability": None, "durability": "transientLocal", "depth": None},
    }
    assert valid_case(case) == case
    for without in (spec(), spec({"ros2": {}}), make_spec()):
        assert hello(without)["stack"]["qos"] == {}


def test_hello_has_what_plays_and_no_other_player_is_one() -> None:
    for wanted in ("auto", "rcl", "dds"):
        case = hello(spec({"ros2": {"player": wanted}}))
        assert case["stack"]["player"] == wanted
        assert valid_case(case) == case
    for without in (spec(), spec({"ros2": {}}), make_spec()):
        assert hello(without)["stack"]["player"] == "auto"
    assert refusal({"ros2": {"player": "fastdds"}}) == "Input should be 'auto', 'rcl' or 'dds'"
    with pytest.raises(ValidationError):
        valid_case(hello(spec()) | {"stack": {"command": ["a"], "player": "fastdds"}})


def test_hello_has_the_nodes_that_have_to_be_active() -> None:
    case = hello(spec({"ros2": {"active": ["/planner", "/ns/map_server"]}}))
    assert case["stack"]["active"] == ["/planner", "/ns/map_server"]
    assert valid_case(case) == case
    for without in (spec(), spec({"ros2": {}}), make_spec()):
        assert hello(without)["stack"]["active"] == []


def test_hello_has_whether_nodes_wait_for_room_in_sockets() -> None:
    for wanted in (True, False):
        case = hello(spec({"ros2": {"flowControl": wanted}}))
        assert case["stack"]["flow_control"] is wanted
        assert valid_case(case) == case
    for without in (spec(), spec({"ros2": {}}), make_spec()):
        assert hello(without)["stack"]["flow_control"] is True
    assert refusal({"ros2": {"flowControl": "sometimes"}}).startswith("Input should be a valid boo")


@pytest.mark.parametrize(
    ("ros2", "says"),
    [
        ({"active": ["planner server"]}, "planner server"),
        ({"active": ["/a", "/a"]}, "/a"),
        ({"active": [f"/n{number}" for number in range(65)]}, "at most 64 items"),
        ({"active": ["/a"], "player": "dds"}, "stack.ros2.active has no meaning with stack.ros2"),
    ],
)
def test_nodes_that_nobody_could_wait_for_are_refused(ros2: Json, says: str) -> None:
    assert says in refusal({"ros2": ros2})


def test_a_node_that_left_its_state_fails_the_case_or_has_it_tried_again() -> None:
    assert "NodeInactive" in FAILURES
    assert "NodeInactive" not in ALLOWABLE
    assert FaultPolicy([FaultRule(cause="NodeInactive", action="retry")]).retries("NodeInactive")


@pytest.mark.parametrize("wrong", [{"depth": 0}, {"reliability": "best_effort"}, {"depth": "5"}])
def test_another_quality_of_service_is_none(wrong: Json) -> None:
    with pytest.raises(ValidationError):
        valid_case(hello(spec()) | {"stack": {"command": ["a"], "qos": {"/scan": wrong}}})


@pytest.mark.parametrize(
    "qos", [{"scan": {}}, {"/scan": {"depth": 0}}, {"/scan": {"depth": 100_001}},
            {"/scan": {"durability": "system"}}],
)  # fmt: skip
def test_what_no_player_could_offer_is_refused(qos: Json) -> None:
    assert refusal({"ros2": {"qos": qos}})


@pytest.mark.parametrize("engine", ["ros1", "exec"])
def test_other_engines_know_no_quality_of_service(engine: str) -> None:
    record = None if engine == "exec" else {"topics": ["/out"]}
    says = refusal({"engine": engine, "ros2": {"qos": QOS}}, record=record)
    assert says.startswith("stack.ros2 has a meaning with stack.engine: ros2 alone: write that")


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"record": None}, "record is missing: write for example record: {topics: [/tf]}"),
        ({"source": {"files": ["pvc://r/a"]}}, "source.files need stack.engine: exec: write"),
        ({"variants": [{"name": "a", "parameters": {"/rate": 1}}]}, "stack.parameters has /rate"),
    ],
)
def test_what_it_can_t_play_is_refused(changed: Json, says: str) -> None:
    assert refusal(**changed).startswith(says)


@pytest.mark.parametrize(
    "parameters",
    [
        {"/lane/threshold": 0.5, "/**/use_sim_time": True, "/ns/lane/pid.gain": "{{ gain }}"},
        {
            "/lane/wheels": [1, 2],
            "/lane/names": ["a", "b"],
            "/lane/pid": {"gain": 1.0, "i": [True]},
        },
        {"/*/lane/x": [], "/lane/mixed": [1, "{{ two }}"], "/a_1/b-c": ""},
    ],
)
def test_parameters_are_those_of_nodes(parameters: Json) -> None:
    assert hello(spec({"parameters": parameters}))["stack"]["parameters"] == parameters


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("/use_sim_time", True, "stack.parameters has /use_sim_time, which names no node"),
        ("/lane/", 1, "stack.parameters has /lane/, which names no node"),
        ("//x", 1, "stack.parameters has //x, which names no node"),
        ("/2nd/x", 1, "stack.parameters has /2nd/x, which names no node"),
        ("/lane/***/x", 1, "stack.parameters has /lane/***/x, which names no node"),
        ("/lane/x", None, "stack.parameters[/lane/x] is nothing that a parameter"),
        ("/lane/x", [1, 2.5], "stack.parameters[/lane/x] is nothing that a parameter"),
        ("/lane/x", [1, True], "stack.parameters[/lane/x] is nothing that a parameter"),
        ("/lane/x", [[1]], "stack.parameters[/lane/x] is nothing that a parameter"),
        ("/lane/x", {"a": {"b": [None]}}, "stack.parameters[/lane/x] is nothing that a parameter"),
    ],
)
def test_what_no_node_could_have_is_refused(name: str, value: Any, says: str) -> None:
    assert refusal({"parameters": {name: value}}).startswith(says)
    # A parameter server takes it.
    assert make_spec(stack={"image": "i", "command": ["c"], "parameters": {name: value}})


def result(*lines: tuple[str, str, str], sent: int = 3) -> Json:
    """RESULT with lines of (topic, node, strength), each of a topic of its own."""
    made = copy.deepcopy(RESULT)
    (topic,) = made["ledger"]["topics"]
    made["ledger"]["topics"] = [
        topic
        | {"topic": name, "sent": sent}
        | {"subscribers": [topic["subscribers"][0] | {"node": node, "strength": strength}]}
        for name, node, strength in lines
    ]
    for each in made["ledger"]["topics"]:
        each["subscribers"][0]["received"] = sent
    return made


@pytest.mark.parametrize(
    ("strength", "outcome"),
    [("called", "passed"), ("taken", "passed"), ("received", "invalid"), ("sent", "invalid")],
)
def test_a_delivery_is_proved_by_what_a_node_took(strength: str, outcome: str) -> None:
    found = result(("/scan", "/proved", "called"), ("/scan", "/lane", strength))
    judged = judge(found, proof=PROOF)
    assert (judged.outcome, judged.reason) == (
        outcome,
        "" if outcome == "passed" else "DeliveryUnproved",
    )
    # In ROS 1 the statistics of nodes are all that there is.
    assert judge(found).outcome == "passed"


def test_the_sentence_names_the_node_the_topic_and_the_cause() -> None:
    lines = [("/scan", f"/node_{n}", "received") for n in range(8)]
    judged = judge(result(("/tf", "/node_0", "sent"), *lines), proof=PROOF)
    assert judged.message.startswith(
        "what /node_0 got on /tf is proved no further than `sent`; so are /node_1, /node_2,"
        " /node_3, /node_4, /node_5 and 2 more: the ledger's library is not in its process"
    )
    for word in ("setuid", "cleared environment", "statically", "DeliveryUnproved, action: allow"):
        assert word in judged.message
    alone = judge(result(lines[0]), proof=PROOF).message
    assert alone.startswith(
        "what /node_0 got on /scan is proved no further than `received`: the ledger's"
    )


def test_where_nothing_was_sent_nothing_needs_a_proof() -> None:
    found = result(("/scan", "/lane", "received"), sent=0)
    assert list(PROOF.lacking(found)) == []
    assert judge(found, proof=PROOF).outcome == "passed"


def test_a_job_may_allow_what_is_unproved_and_it_is_reported_all_the_same() -> None:
    judged = judge(result(("/scan", "/lane", "received")), ALLOWED, proof=PROOF)
    assert judged.outcome == "passed"
    (allowed,) = judged.allowed
    assert allowed.cause == "DeliveryUnproved"
    assert allowed.message.startswith("what /lane got on /scan")


@pytest.mark.parametrize("strength", ["sent", "received"])
def test_nobody_knows_what_a_node_lost_that_is_not_counted(strength: str) -> None:
    """The ledger has it as lost, since nothing says otherwise."""
    found = result(("/scan", "/lane", strength))
    found["ledger"]["topics"][0]["subscribers"][0] |= {"received": 0, "dropped": 3}
    assert judge(found, proof=PROOF).reason == "DeliveryUnproved"
    assert judge(found, ALLOWED, proof=PROOF).outcome == "passed"
    # In ROS 1 a node that does not answer has lost it.
    assert judge(found).reason == "MessagesLost"


def test_lines_whose_figures_are_none_are_marked() -> None:
    strengths = ("sent", "received", "taken", "called")
    found = result(*((f"/{each}", "/lane", each) for each in strengths))
    PROOF.mark(found)
    lines = [topic["subscribers"][0].get("proved") for topic in found["ledger"]["topics"]]
    assert lines == [False, False, None, None]


def test_a_loss_goes_before_a_loss_that_is_only_possible() -> None:
    found = result(("/tf", "/other", "received"), ("/scan", "/lane", "taken"))
    found["ledger"]["topics"][1]["subscribers"][0] |= {"received": 2, "dropped": 1}
    assert judge(found, proof=PROOF).reason == "MessagesLost"
    both = judge(found, ALLOWED, proof=PROOF)
    assert (both.outcome, both.reason) == ("failed", "MessagesLost")


def test_its_reason_is_counted_by_name() -> None:
    fields = {"stack": {"image": "i", "command": ["c"], "engine": "ros2"}}
    metrics = DriverMetrics(Progress("pvc://results/r", slots=1), make_job({}, **fields))
    metrics.count(make_row("a", "invalid", "DeliveryUnproved"))
    name = "bagpipe_case_faults_total"
    counted = metrics.registry.get_sample_value(name, {"reason": "DeliveryUnproved"})
    assert counted == 1
