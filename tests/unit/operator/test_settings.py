"""Settings from the environment, and the sentence for one that can't be used."""

import pytest

from bagpipe_operator.settings import SettingError, Settings


def test_defaults() -> None:
    settings = Settings.from_environment({})
    assert settings == Settings()
    assert (settings.stuck_seconds, settings.watch_namespaces) == (30.0, ())
    assert not settings.own_evaluators


def test_what_the_chart_sets() -> None:
    settings = Settings.from_environment(
        {
            "BAGPIPE_SPARK_IMAGE": "r/spark:2",
            "BAGPIPE_WATCH_NAMESPACES": "lanes, maps,",
            "BAGPIPE_STUCK_SECONDS": "7.5",
            "BAGPIPE_WORKERS": "2",
            "BAGPIPE_PROGRESS_WAIT_SECONDS": "12",
            "BAGPIPE_OWN_EVALUATORS": "true",
            "BAGPIPE_STORAGE_HOSTS": "S3.lab, *.example.com,",
        }
    )
    assert settings.storage_hosts == ("s3.lab", "*.example.com")
    assert settings.own_evaluators
    assert settings.spark_image == "r/spark:2"
    assert settings.watch_namespaces == ("lanes", "maps")
    assert (settings.stuck_seconds, settings.workers) == (7.5, 2)
    assert settings.progress_wait_seconds == 12


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("soon", "BAGPIPE_STUCK_SECONDS is 'soon': write a number, for example 30"),
        ("0", "BAGPIPE_STUCK_SECONDS is '0': write a number above zero"),
    ],
)
def test_a_wrong_one_is_named(text: str, sentence: str) -> None:
    with pytest.raises(SettingError, match=f"^{sentence}$"):
        Settings.from_environment({"BAGPIPE_STUCK_SECONDS": text})


def test_a_host_that_is_none_is_named() -> None:
    with pytest.raises(SettingError, match=r"^BAGPIPE_STORAGE_HOSTS: 'http://a' is no host"):
        Settings.from_environment({"BAGPIPE_STORAGE_HOSTS": "s3.lab,http://a"})


def test_whether_drivers_are_annotated() -> None:
    assert Settings.from_environment({}).scrape_annotations
    off = Settings.from_environment({"BAGPIPE_SCRAPE_ANNOTATIONS": "false"})
    assert not off.scrape_annotations
    with pytest.raises(SettingError, match="'no': write true or false"):
        Settings.from_environment({"BAGPIPE_SCRAPE_ANNOTATIONS": "no"})


def test_the_lease() -> None:
    named = {"BAGPIPE_LEASE_NAMESPACE": "system", "BAGPIPE_LEASE_NAME": "b-operator"}
    settings = Settings.from_environment(named | {"BAGPIPE_LEASE_SECONDS": "15"})
    found = (settings.lease_namespace, settings.lease_name, settings.lease_seconds)
    assert found == ("system", "b-operator", 15)


@pytest.mark.parametrize("text", ["2", "9.5"])
def test_a_lease_that_is_too_short_or_no_whole_number(text: str) -> None:
    with pytest.raises(SettingError, match=r"write a whole number of at least 3, for example 9$"):
        Settings.from_environment({"BAGPIPE_LEASE_SECONDS": text})
