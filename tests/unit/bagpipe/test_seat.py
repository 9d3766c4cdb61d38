"""One job at a time, only by its own claim, and what was refused once stays refused."""

import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace

import pytest

from bagpipe.driver import own_claim, refused_lately
from bagpipe.driver import seat as seats
from bagpipe.driver.refused_lately import RefusedLately
from bagpipe.driver.seat import Claimed, Offer, Seat
from bagpipe.spec import JobFile
from bagpipe_operator.settings import Settings
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.offers import offer_of
from tests.waiting import PATIENCE, wait_until


class World:
    """A seat of the driver `d` in the namespace `lab`, and what the API server says."""

    def __init__(self) -> None:
        self.now = 0.0
        self.claims: dict[str, Claimed] = {}
        self.broken = False
        self.asked: list[str] = []
        self.looks = 0
        self.seat = Seat("d", "lab", 300.0, self.look_up, self.monotonic)

    def monotonic(self) -> float:
        self.looks += 1
        assert self.looks < 100_000, "who waits looks at the time without a pause"
        return self.now

    def look_up(self, job: str) -> Claimed | None:
        self.asked.append(job)
        if self.broken:
            raise OSError("nobody answers")
        return self.claims.get(job)

    def offer(
        self, name: str, claimed: bool = True, attempt: int = 1, sender: str = "operator"
    ) -> Offer:
        job = make_job({}).model_copy(
            update={"name": name, "uid": f"uid-{name}", "attempt": attempt}
        )
        if claimed:
            self.claims[name] = Claimed(f"uid-{name}", attempt, "d", "digest")
        return offer_of(job, sender=sender)


def test_a_claimed_job_is_taken_once_and_worked_on() -> None:
    world = World()
    offer = world.offer("a")
    assert world.seat.offer(offer) == "taken"
    assert world.seat.offer(offer) == "taken"  # the answer was lost: it is asked again
    assert world.seat.taken() == offer.read()
    assert world.asked == ["a"]


def test_a_job_that_claims_nothing_or_something_else_is_refused() -> None:
    for claim in (
        None,
        Claimed("another-uid", 1, "d", "digest"),
        Claimed("uid-a", 2, "d", "digest"),
        Claimed("uid-a", 1, "another-driver", "digest"),
        Claimed("uid-a", 1, "d", "another-digest"),
    ):
        world = World()
        offer = world.offer("a", claimed=False)
        if claim is not None:
            world.claims["a"] = claim
        assert world.seat.offer(offer) == "refused", claim


def test_a_job_of_another_namespace_is_refused_without_a_question() -> None:
    world = World()
    offer = world.offer("a")
    elsewhere = replace(offer, namespace="elsewhere")
    assert world.seat.offer(elsewhere) == "refused"
    assert world.asked == []


def test_a_driver_meets_a_thousand_jobs_and_takes_no_other() -> None:
    world = World()
    world.seat._met = {(f"uid-x{number}", 1) for number in range(999)}
    assert world.seat.offer(world.offer("a")) == "taken"
    world.seat.leave(stays=True)
    assert world.seat.offer(world.offer("b")) == "refused"
    assert world.seat.taken() is None


@pytest.mark.parametrize(
    ("refused", "line"), [(0, 0), (1, 1), (2, 2), (3, 3), (4, 3), (5, 3), (9, 3)]
)
def test_who_was_refused_waits_with_those_who_were_as_often_and_the_last_line_is_the_fourth(
    monkeypatch: pytest.MonkeyPatch, refused: int, line: int
) -> None:
    monkeypatch.setattr(seats, "_TURN_SECONDS", 0.001)
    world = World()
    for number in range(refused):
        assert world.seat.offer(world.offer(f"old-{number}", claimed=False)) == "refused"
    lines = world.seat._looking_up
    with lines[line].taken("another"):
        assert world.seat.offer(world.offer("a")) == "unknown"
    with ExitStack() as others:
        for turns in lines[:line] + lines[line + 1 :]:
            others.enter_context(turns.taken("another"))
        assert world.seat.offer(world.offer("a")) == "taken"


def test_who_waits_for_a_turn_and_a_look_up_is_answered_before_the_operator_goes() -> None:
    """One that comes later counts as none."""
    waits = [turns._patience_seconds for turns in World().seat._looking_up]
    assert waits == [0.3] * 4
    assert max(waits) + own_claim._PATIENCE_SECONDS < Settings.progress_seconds


def test_two_jobs_do_not_sit_down_together() -> None:
    world = World()
    assert world.seat.offer(world.offer("a")) == "taken"
    assert world.seat.offer(world.offer("b")) == "refused"
    assert world.seat.taken() == world.offer("a").read()


def test_what_was_refused_is_refused_when_the_seat_is_free_and_the_claim_is_there() -> None:
    """Its operator has made other pods for it."""
    world = World()
    world.seat.offer(world.offer("a"))
    refused = world.offer("b")
    assert world.seat.offer(refused) == "refused"
    world.seat.leave(stays=True)
    assert world.seat.offer(refused) == "refused"
    assert world.seat.offer(world.offer("b", attempt=2)) == "taken"


def test_a_job_that_has_left_does_not_run_a_second_time() -> None:
    world = World()
    offer = world.offer("a")
    world.seat.offer(offer)
    world.seat.leave(stays=True)
    assert world.seat.offer(offer) == "ended"
    assert world.seat.offer(world.offer("b")) == "taken"
    assert world.seat.offer(offer) == "ended"


def test_while_nobody_answers_the_answer_is_open() -> None:
    world = World()
    world.broken = True
    offer = world.offer("a")
    assert world.seat.offer(offer) == "unknown"
    world.broken = False
    assert world.seat.offer(offer) == "taken"


def test_a_driver_waits_for_so_long_from_the_last_job_s_end_on() -> None:
    world = World()
    world.now = 299.0
    assert world.seat.offer(world.offer("a")) == "taken"
    world.now = 2000.0
    world.seat.leave(stays=True)
    world.now = 2299.0
    assert world.seat.offer(world.offer("b")) == "taken"
    world.seat.leave(stays=True)
    world.now = 2599.0
    assert world.seat.offer(world.offer("c")) == "refused"
    assert world.seat.taken() is None
    world.now = 0.0  # whatever the clock does then
    assert world.seat.offer(world.offer("d")) == "refused"


def test_an_offer_that_comes_too_late_is_refused_though_nobody_has_looked_at_the_time() -> None:
    world = World()
    world.now = 300.25
    assert world.seat.offer(world.offer("a")) == "refused"
    assert world.seat.taken() is None


def test_who_waits_looks_up_each_half_second_and_at_the_end_of_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, waits = World(), []
    world.now = 298.75

    def wait(seconds: float) -> bool:
        waits.append(seconds)
        world.now += seconds
        return False

    monkeypatch.setattr(world.seat._changed, "wait", wait)
    assert world.seat.taken() is None
    assert waits == [0.5, 0.5, 0.25]


def test_one_that_may_not_stay_takes_no_other_job() -> None:
    world = World()
    world.seat.offer(world.offer("a"))
    world.seat.leave(stays=False)
    assert world.seat.taken() is None
    assert world.seat.offer(world.offer("b")) == "refused"


def test_who_offers_without_end_fills_no_memory_and_ends_no_job(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(seats, "MOST_MET", 3)
    world = World()
    offer = world.offer("a")
    assert world.seat.offer(offer) == "taken"
    for number in range(9):
        world.seat.offer(world.offer(f"x{number}"))
    assert len(world.seat._met) == 3
    assert world.seat.offer(offer) == "taken"
    assert world.seat.taken() == offer.read()
    world.seat.leave(stays=True)
    assert world.seat.taken() is None


def test_who_offers_what_claims_no_driver_keeps_no_job_from_its_own() -> None:
    """Anybody who reaches the driver may: the guess of a job's name and UID is no secret."""
    world = World()
    for number in range(2 * seats.MOST_MET):
        assert world.seat.offer(world.offer(f"x{number}", claimed=False)) == "refused"
    early = world.offer("a", claimed=False)
    assert world.seat.offer(early) == "refused"
    assert world.seat.offer(world.offer("a")) == "taken"


def test_a_look_up_that_hangs_keeps_neither_the_driver_s_work_nor_who_asks_for_another() -> None:
    world, asked, go_on = World(), threading.Event(), threading.Event()

    def hangs(_job: str) -> Claimed | None:
        asked.set()
        go_on.wait(PATIENCE)
        return None

    world.seat._look_up = hangs
    answers: list[str] = []
    forged = world.offer("x", claimed=False, sender="another pod")
    hanging = threading.Thread(target=lambda: answers.append(world.seat.offer(forged)))
    hanging.start()
    assert asked.wait(PATIENCE)
    assert world.seat.offer(world.offer("a")) == "unknown"
    world.seat.begin(make_job({}))
    world.seat.leave(stays=True)
    go_on.set()
    hanging.join(PATIENCE)
    assert answers == ["refused"]
    world.seat._look_up = world.look_up
    assert world.seat.offer(world.offer("a")) == "taken"


def test_offers_of_another_pod_without_a_pause_keep_no_job_from_its_driver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(seats, "_TURN_SECONDS", PATIENCE)
    world, asked, ended = World(), threading.Event(), threading.Event()

    def look_up(job: str) -> Claimed | None:
        asked.set()
        time.sleep(0.002)  # an API server
        return world.look_up(job)

    world.seat = Seat("d", "lab", 300.0, look_up, lambda: world.now)
    forged = world.offer("x", claimed=False, sender="another pod")

    def flood() -> None:
        while not ended.is_set():
            world.seat.offer(forged)

    threads = [threading.Thread(target=flood) for _ in range(8)]
    for thread in threads:
        thread.start()
    assert asked.wait(PATIENCE)
    try:
        assert world.seat.offer(world.offer("a")) == "taken"
    finally:
        ended.set()
        for thread in threads:
            thread.join(PATIENCE)


@pytest.mark.parametrize(
    ("addresses", "look_up_seconds", "refused"),
    [(20, 0.03, 0), (20, 0.03, 1), (20, 0.03, 2), (1, 0.4, 0), (1, 0.4, 1)],
)
def test_neither_many_pods_nor_a_slow_api_server_let_forgeries_keep_a_job_from_its_driver(
    addresses: int, look_up_seconds: float, refused: int
) -> None:
    """With the patience that a driver has, also from an operator that was refused lately."""
    world, ended = World(), threading.Event()
    met: Counter[str] = Counter()

    def look_up(job: str) -> Claimed | None:
        time.sleep(look_up_seconds)
        return world.look_up(job)

    world.seat = Seat("d", "lab", 300.0, look_up, lambda: world.now)

    def flood(sender: str) -> None:
        forged = world.offer("x", claimed=False, sender=sender)
        while not ended.is_set():
            if world.seat.offer(forged) == "refused":
                met[sender] += 1

    for number in range(refused):  # jobs that were deleted while they were offered
        assert world.seat.offer(world.offer(f"old-{number}", claimed=False)) == "refused"
    senders = [f"10.0.0.{number}" for number in range(addresses)]
    threads = [threading.Thread(target=flood, args=(sender,)) for sender in senders]
    for thread in threads:
        thread.start()
    try:
        wait_until(
            lambda: all(met[sender] >= 3 for sender in senders), PATIENCE, "each was refused thrice"
        )
        offer = world.offer("a")
        answers = [world.seat.offer(offer) for _ in range(5)]  # as an operator does in 10 s
        assert answers == ["taken"] * 5
    finally:
        ended.set()
        for thread in threads:
            thread.join(PATIENCE)


def test_who_was_refused_is_remembered_for_so_long_and_until_a_claim_shows_them_right(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(refused_lately, "MOST", 2)
    now = 0.0
    refused = RefusedLately(lambda: now)
    for address in "abc":
        refused.note(address, was_refused=True)
    assert [refused.times(address) for address in "abc"] == [0, 1, 1]
    refused.note("c", was_refused=False)
    assert refused.times("c") == 0
    now = refused_lately.SECONDS - 1
    refused.note("b", was_refused=True)
    assert refused.times("b") == 2
    now += refused_lately.SECONDS
    assert refused.times("b") == 0
    refused.note("b", was_refused=True)
    assert refused.times("b") == 1


def test_only_what_claims_the_driver_is_read_and_what_can_t_be_read_is_refused_for_ever() -> None:
    world, read = World(), []

    def no_job() -> None:
        read.append(1)

    forged = replace(world.offer("a", claimed=False), read=no_job)
    assert (world.seat.offer(forged), read) == ("refused", [])
    unreadable = replace(world.offer("a"), read=no_job)
    assert (world.seat.offer(unreadable), read) == ("refused", [1])
    assert world.seat.offer(world.offer("a")) == "refused"
    assert world.seat.offer(world.offer("b")) == "taken"


def test_a_seat_that_was_closed_from_a_signal_s_handler_takes_nobody() -> None:
    world = World()
    with world.seat._changed:  # the handler runs wherever the main thread is
        world.seat.close()
    assert world.seat.offer(world.offer("a")) == "refused"
    assert world.seat.taken() is None


def test_who_waits_learns_of_the_closing() -> None:
    seat = Seat("d", "lab", 100 * PATIENCE, World().look_up)
    found: list[JobFile | None] = []
    waiting = threading.Thread(target=lambda: found.append(seat.taken()))
    waiting.start()
    seat.close()
    waiting.join(PATIENCE)
    assert found == [None]


def test_who_waits_is_woken_by_a_job() -> None:
    claims: dict[str, Claimed] = {}
    seat = Seat("d", "lab", PATIENCE, claims.get)
    found: list[JobFile | None] = []
    waiting = threading.Thread(target=lambda: found.append(seat.taken()))
    waiting.start()
    world = World()
    offer = world.offer("a")
    claims |= world.claims
    assert seat.offer(offer) == "taken"
    waiting.join(PATIENCE)
    assert found == [offer.read()]
