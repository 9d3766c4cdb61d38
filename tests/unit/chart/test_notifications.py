"""Receivers of notifications in the chart, and that the operator reads what the chart writes."""

import json
from typing import Any

import pytest

from bagpipe_operator.settings import Settings
from tests.unit.chart.test_chart import Object, of_kind, rendered, template

SLACK = {
    "name": "team-slack",
    "url": "https://notify.example.com/slack?a=1&b=<2>",
    "secretName": "slack-key",
    "events": ["failed", "regressed"],
    "namespaces": ["lanes"],
}
ARCHIVE = {"name": "archive", "url": "http://archive:80", "secretName": "a", "always": ["lanes"]}


def pod_spec(*receivers: dict[str, Any]) -> Object:
    values = [f"notifications.receivers={json.dumps(receivers)}"] if receivers else []
    (deployment,) = of_kind(rendered(*values), "Deployment")
    spec: Object = deployment["spec"]["template"]["spec"]
    return spec


def environment(spec: Object) -> dict[str, str]:
    return {e["name"]: e["value"] for e in spec["containers"][0]["env"]}


def test_the_operator_reads_what_the_chart_writes() -> None:
    settings = Settings.from_environment(environment(pod_spec(SLACK, ARCHIVE)))
    slack, archive = settings.receivers
    assert (slack.name, slack.url) == (SLACK["name"], SLACK["url"])
    assert slack.events == {"failed", "regressed"}
    assert [sorted(slack.namespaces), sorted(slack.always)] == [["lanes"], []]
    assert [archive.name, *archive.always] == ["archive", "lanes"]


def test_a_key_comes_from_a_secret_into_the_file_that_the_operator_opens() -> None:
    spec = pod_spec(SLACK, ARCHIVE)
    assert "slack-key" not in json.dumps(spec["containers"])
    mounts = {m["name"]: m for m in spec["containers"][0]["volumeMounts"]}
    volumes = {v["name"]: v["secret"] for v in spec["volumes"]}
    assert list(mounts) == list(volumes) == ["notify-team-slack", "notify-archive"]
    folder = Settings().notification_keys
    assert mounts["notify-team-slack"]["mountPath"] == f"{folder}/team-slack"
    assert all(mount["readOnly"] for mount in mounts.values())
    assert volumes["notify-team-slack"] == {
        "secretName": "slack-key",
        "items": [{"key": "key", "path": "key"}],
        "optional": True,
    }


def test_without_receivers_nothing_is_mounted() -> None:
    spec = pod_spec()
    assert "volumes" not in spec
    assert "volumeMounts" not in spec["containers"][0]
    assert "BAGPIPE_NOTIFICATIONS" not in environment(spec)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"url": "https://me:pass@notify.example.com/"}, "does not match pattern"),
        ({"url": "ftp://notify.example.com/"}, "does not match pattern"),
        ({"name": "Team Slack"}, "does not match pattern"),
        ({"secretName": ""}, "does not match pattern"),
        ({"events": ["ended"]}, "value must be one of"),
        ({"key": "whsec_"}, "'key' not allowed"),
        ({"name": "archive"}, "has two called archive"),
    ],
)
def test_wrong_receivers_are_refused(changes: dict[str, Any], words: str) -> None:
    listed = json.dumps([SLACK | changes, ARCHIVE])
    answer = template(f"notifications.receivers={listed}")
    assert answer.returncode != 0
    assert words in answer.stderr
