"""The receivers that an administrator allows: as the chart writes them, and for whom they are."""

import json
from typing import Any

import pytest

from bagpipe_operator.receivers import EVENTS, MOST_RECEIVERS, Receivers, read_receivers
from bagpipe_operator.settings import SettingError, Settings

URL = "https://notify.example.com/T0/s3cr3t"


def one(**changes: Any) -> dict[str, Any]:
    return {"name": "team-slack", "url": URL} | changes


def test_a_receiver_gets_all_events_of_jobs_that_name_it() -> None:
    (read,) = read_receivers(json.dumps([one()]))
    assert (read.name, read.url, read.events) == ("team-slack", URL, frozenset(EVENTS))
    assert read.takes_from("lanes")
    assert Receivers([read]).of_all("lanes") == []


def test_no_receivers_are_none() -> None:
    assert read_receivers("") == read_receivers("[]") == ()
    assert Settings.from_environment({}).receivers == ()


def test_namespaces_bound_who_may_name_it() -> None:
    receivers = Receivers(read_receivers(json.dumps([one(namespaces=["lanes"], always=["maps"])])))
    found = {name: receivers.named("team-slack", name) for name in ("lanes", "maps", "others")}
    assert [name for name, each in found.items() if each] == ["lanes", "maps"]
    assert [each.name for each in receivers.of_all("maps")] == ["team-slack"]
    assert receivers.of_all("lanes") == []
    assert receivers.named("nobody", "lanes") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "no JSON"),
        ("{}", "a list of at most 16"),
        (json.dumps([one()] * (MOST_RECEIVERS + 1)), "a list of at most 16"),
        (json.dumps([one(), one()]), "two receivers are called team-slack"),
        (json.dumps([one(name="Team Slack")]), "write for example team-slack"),
        (json.dumps([one(name="n" * 41)]), "at most 40"),
        (json.dumps([5]), "a receiver's name"),
        (json.dumps([one(url="file:///etc/passwd")]), "url of team-slack"),
        (json.dumps([one(url="https://me:s3cr3t@example.com/")]), "without a user's name"),
        (json.dumps([one(url="https://example.com/a b")]), "url of team-slack"),
        (json.dumps([one(events=["ended"])]), "passed, failed, invalid, errored, regressed"),
        (json.dumps([one(events="failed")]), "events of team-slack is no list"),
        (json.dumps([one(namespaces=[5])]), "namespaces of team-slack is no list"),
    ],
)
def test_what_is_wrong_is_refused_with_what_to_write(text: str, words: str) -> None:
    with pytest.raises(SettingError, match=words) as refused:
        Settings.from_environment({"BAGPIPE_NOTIFICATIONS": text})
    assert "s3cr3t" not in str(refused.value)


def test_an_address_is_shown_nowhere() -> None:
    settings = Settings.from_environment({"BAGPIPE_NOTIFICATIONS": json.dumps([one()])})
    assert "team-slack" in repr(settings)
    assert "s3cr3t" not in repr(settings)
