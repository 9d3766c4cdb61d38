"""Each test of criteria is run on messages of ROS 1, and on the same of ROS 2."""

import pytest

from tests.unit.evaluate import recordings


@pytest.fixture(params=recordings.FORMS[:2], autouse=True)
def form(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """What recordings are made of."""
    made_of: str = request.param
    monkeypatch.setattr(recordings, "form", made_of)
    return made_of
