"""No stack that lies may pass, and none that is only odd may be refused."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.agent_binary import built
from tests.cached import cache
from tests.liars.army import Army
from tests.liars.row import Row
from tests.liars.table import ROWS

pytestmark = pytest.mark.integration


@pytest.fixture(scope="session")
def army(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[Army]:
    """The rows of all tests that were selected, running."""
    agent = Path(os.environ.get("BAGPIPE_AGENT") or built())
    gathered = Army(tmp_path_factory.mktemp("liars"), agent, cache() / "liars")
    wanted = [
        item.callspec.params.get("row")
        for item in request.session.items
        if hasattr(item, "callspec")
    ]
    gathered.start([row for row in wanted if isinstance(row, Row)])
    yield gathered
    gathered.end()


# Promise: no-evidence-no-pass
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_stack_is_judged_for_what_it_is(army: Army, row: Row) -> None:
    result = army.result_of(row)
    summary = str(result)
    for mark in row.marks:
        assert result.marks.get(mark), f"the stack has not run: {summary}"
    assert result.outcome in row.outcome.split("|"), summary
    if row.reason:
        assert result.reason == row.reason, summary
    for piece in row.says:
        assert piece in result.words, summary
