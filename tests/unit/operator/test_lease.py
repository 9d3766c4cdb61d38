"""Who leads: every transition of the decider, with clocks that only the test moves."""

import pytest

from bagpipe_operator.cluster import lease as leases
from bagpipe_operator.cluster.lease import Decision, Lease, Sighting, Step, Terms, decide

ME = Terms("me", 9)
WAIT = Step.WAIT


def held(by: str, version: str = "5", seconds: int = 9) -> Lease:
    return Lease(version, by, seconds, "2026-11-20T04:00:00.000000Z", 3)


def test_the_times_follow_from_the_duration() -> None:
    assert (ME.work_seconds, ME.period_seconds) == (6, 1.8)


@pytest.mark.parametrize(
    ("lease", "sighting", "now", "expected"),
    [
        # There is none, and there never was one.
        (None, Sighting(), 100.0, Decision(Step.CREATE)),
        # Somebody deleted it: its holder may believe in it for as long as it lasted.
        (None, Sighting("5", 98.0), 100.0, Decision(WAIT, 1.8)),
        (None, Sighting("5", 91.5), 100.0, Decision(WAIT, 0.5)),
        (None, Sighting("5", 91.0), 100.0, Decision(Step.CREATE)),
        (None, Sighting("5", 50.0), 100.0, Decision(Step.CREATE)),
        # It is ours, however long ago we wrote it.
        (held("me"), Sighting("5", 99.0), 100.0, Decision(Step.RENEW)),
        (held("me"), Sighting("5", 10.0), 100.0, Decision(Step.RENEW)),
        # It was given back, or never filled.
        (held(""), Sighting("5", 99.9), 100.0, Decision(Step.TAKE)),
        # It is another's who is alive, nearly silent, and silent for the whole duration.
        (held("other"), Sighting("5", 100.0), 100.0, Decision(WAIT, 1.8)),
        (held("other"), Sighting("5", 91.5), 100.0, Decision(WAIT, 0.5)),
        (held("other"), Sighting("5", 91.0), 100.0, Decision(Step.TAKE)),
        # The holder's duration counts, not ours; without one, ours does.
        (held("other", seconds=30), Sighting("5", 75.0), 100.0, Decision(WAIT, 1.8)),
        (held("other", seconds=30), Sighting("5", 70.0), 100.0, Decision(Step.TAKE)),
        (held("other", seconds=0), Sighting("5", 91.0), 100.0, Decision(Step.TAKE)),
    ],
)
def test_the_step(lease: Lease | None, sighting: Sighting, now: float, expected: Decision) -> None:
    found = decide(ME, lease, sighting, now)
    assert found.step is expected.step
    assert found.pause_seconds == pytest.approx(expected.pause_seconds)


def test_a_sighting_is_as_old_as_the_version() -> None:
    first = Sighting().of(held("other", "5"), 100.0)
    assert first == Sighting("5", 100.0)
    assert first.of(held("other", "5"), 107.0) == first
    assert first.of(held("other", "6"), 107.0) == Sighting("6", 107.0)


def test_no_moment_in_the_lease_is_believed() -> None:
    """A holder whose clock is years off is neither robbed nor waited for."""
    text = "2001-01-01T00:00:00.000000Z"
    spec = {"holderIdentity": "other", "leaseDurationSeconds": 9, "renewTime": text}
    lease = Lease.from_object({"metadata": {"resourceVersion": "5"}, "spec": spec})
    assert decide(ME, lease, Sighting("5", 99.0), 100.0).step is WAIT
    assert decide(ME, lease, Sighting("5", 90.0), 100.0).step is Step.TAKE


@pytest.mark.parametrize("spec", [None, {}, {"holderIdentity": None}])
def test_an_empty_lease_is_free(spec: object) -> None:
    lease = Lease.from_object({"metadata": {"resourceVersion": "5"}, "spec": spec})
    assert (lease.holder, lease.duration_seconds, lease.transitions) == ("", 0, 0)
    assert decide(ME, lease, Sighting("5", 100.0), 100.0).step is Step.TAKE


@pytest.mark.parametrize(
    ("step", "lease", "acquired", "transitions"),
    [
        (Step.CREATE, None, "now", 0),
        (Step.TAKE, held("other"), "now", 4),
        (Step.RENEW, held("me"), "2026-11-20T04:00:00.000000Z", 3),
    ],
)
def test_what_is_written(step: Step, lease: Lease | None, acquired: str, transitions: int) -> None:
    made = leases.manifest("system", "bagpipe", ME, step, lease, "now")
    assert made["spec"] == {
        "holderIdentity": "me",
        "leaseDurationSeconds": 9,
        "acquireTime": acquired,
        "renewTime": "now",
        "leaseTransitions": transitions,
    }
    assert made["metadata"].get("resourceVersion") == (lease.version if lease else None)


def test_a_lease_that_is_read_before_it_is_renewed_keeps_when_it_was_acquired() -> None:
    written = leases.manifest("system", "bagpipe", ME, Step.RENEW, held("me"), "now")
    written["metadata"]["resourceVersion"] = "6"
    assert Lease.from_object(written) == held("me", version="6")


def test_what_is_given_back_has_no_holder() -> None:
    made = leases.released("system", "bagpipe", held("me"), "now")
    # Who heeds the duration before the holder waits for a second, the least that is allowed.
    assert made["spec"] == {
        "holderIdentity": "",
        "leaseDurationSeconds": 1,
        "renewTime": "now",
        "leaseTransitions": 3,
    }
    assert made["metadata"]["resourceVersion"] == "5"
