"""Settings from the environment, and the sentence for one that can't be used."""

import pytest

from bagpipe_operator.settings import SettingError, Settings


def test_defaults() -> None:
    settings = Settings.from_environment({})
    assert settings == Settings()
    assert (settings.stuck_seconds, settings.watch_namespaces) == (30.0, ())


def test_what_the_chart_sets() -> None:
    settings = Settings.from_environment(
        {
            "BAGPIPE_SPARK_IMAGE": "r/spark:2",
            "BAGPIPE_WATCH_NAMESPACES": "lanes, maps,",
            "BAGPIPE_STUCK_SECONDS": "7.5",
            "BAGPIPE_WORKERS": "2",
        }
    )
    assert settings.spark_image == "r/spark:2"
    assert settings.watch_namespaces == ("lanes", "maps")
    assert (settings.stuck_seconds, settings.workers) == (7.5, 2)


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
