"""What the operator remembers of the cluster, and when it refuses to step back."""

from dataclasses import replace

from bagpipe_operator.api.kept_spec import unpacked
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.patience import Patience
from tests.unit.operator.builders import make_driver, make_executor, make_job


def test_a_job_s_pods_by_name() -> None:
    view = View()
    for pod in (make_executor("x", 2), make_driver("x"), make_executor("x", 1), make_driver("y")):
        view.put_pod(pod.view())
    assert [p.name for p in view.pods("uid-of-x")] == ["x-1-driver", "x-1-exec-1", "x-1-exec-2"]
    driver = view.driver("uid-of-x", 1)
    assert driver is not None
    assert driver.name == "x-1-driver"


def test_an_older_job_does_not_replace_a_newer_one() -> None:
    view = View()
    new, old = make_job("x"), make_job("x")
    new.object["metadata"]["resourceVersion"] = "10"
    old.object["metadata"]["resourceVersion"] = "9"
    assert view.put_job(new.view()) is True
    assert view.put_job(old.view()) is False
    known = view.job("uid-of-x")
    assert known is not None
    assert known.resource_version == "10"


def test_a_late_deletion_does_not_drop_the_successor() -> None:
    view = View()
    first, second = make_driver("x").object(), make_driver("x").object()
    second["metadata"]["uid"] = "younger"
    from_object = type(make_driver("x").view()).from_object
    view.put_pod(from_object(first))
    view.put_pod(from_object(second))
    view.drop_pod(from_object(first))
    assert [p.uid for p in view.pods("uid-of-x")] == ["younger"]
    view.drop_pod(from_object(second))
    assert view.pods("uid-of-x") == ()


def test_a_late_word_of_a_namesake_does_not_replace_a_younger_pod() -> None:
    view = View()
    first, second = make_driver("x").ended(1).object(), make_driver("x").running().object()
    first["metadata"]["resourceVersion"] = "9"
    second["metadata"] |= {"uid": "younger", "resourceVersion": "10"}
    from_object = type(make_driver("x").view()).from_object
    view.put_pod(from_object(second))
    view.put_pod(from_object(first))
    assert [(p.uid, p.phase) for p in view.pods("uid-of-x")] == [("younger", "Running")]


def test_a_pod_whose_label_is_written_again_and_again_is_kept_once() -> None:
    """It is anybody's to write, and each word of it would stay in the operator's memory."""
    view, pod = View(), make_driver("x").view()
    for number in range(100):
        pod = replace(pod, job_uid=f"uid-{number}", resource_version=str(10 + number))
        assert view.put_pod(pod)
    assert [kept.job_uid for kept in view.all_pods()] == ["uid-99"]
    assert (len(view._pods), view.uids()) == (1, ["uid-99"])
    view.drop_pod(pod)
    assert (len(view._pods), view.uids()) == (0, [])


def test_a_bare_pod_is_understood() -> None:
    bare = {"metadata": {"name": "p", "namespace": "n", "uid": "u"}}
    pod = type(make_driver("x").view()).from_object(bare)
    assert (pod.phase, pod.attempt, pod.containers, pod.ended) == ("Pending", 0, (), False)


def test_patience_counts_only_what_is_seen_without_a_break() -> None:
    patience = Patience()
    assert patience.observe("x", ["a"], 10.0) == {"a": 0.0}
    assert patience.observe("x", ["a", "b"], 15.0) == {"a": 5.0, "b": 0.0}
    assert patience.observe("x", ["b"], 20.0) == {"b": 5.0}
    assert patience.observe("x", ["a"], 25.0) == {"a": 0.0}
    patience.forget("x")
    assert patience.observe("x", ["a"], 30.0) == {"a": 0.0}


def test_a_pod_behind_a_scheduling_gate_is_not_unschedulable() -> None:
    """Kueue holds the pods of a job that queues by such a gate; nobody has looked for a node."""
    pod = make_driver("x").unschedulable("0/3 nodes are available.")
    assert pod.view().unschedulable == "0/3 nodes are available."
    pod.status["conditions"][0] |= {
        "reason": "SchedulingGated",
        "message": "Scheduling is blocked due to non-empty scheduling gates",
    }
    assert pod.view().unschedulable == ""


def test_of_an_ended_job_only_that_is_kept_by_which_it_goes() -> None:
    view = View()
    job = make_job("x").with_spec("stack.parameters", {"/map": "x" * 1000})
    job.with_spec("ttlAfterFinished", "60s")
    view.put_job(job.view())
    kept = view.job("uid-of-x")
    assert kept is not None
    assert kept.packed is not None
    assert kept.spec == {"ttlAfterFinished": "60s"}
    entire = unpacked(kept.packed)
    assert entire is not None
    assert entire["spec"] == job.object["spec"]
    job.with_status(conditions=[{"type": "Complete", "status": "True"}])
    view.put_job(job.view())
    kept = view.job("uid-of-x")
    assert kept is not None
    assert (kept.finished, kept.spec) == (True, {"ttlAfterFinished": "60s"})
    assert kept.packed == b""
