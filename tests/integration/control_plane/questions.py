"""All that the dashboards and the alerts ask of Prometheus, and what of it has no answer."""

import itertools
from collections.abc import Iterator

from charts.monitoring.alerts import ALERTS
from charts.monitoring.board import Board
from charts.monitoring.boards import BOARDS, JOB
from tests.integration.control_plane.prometheus_server import Prometheus


def all_questions(namespace: str, jobs: list[str]) -> list[tuple[str, str]]:
    """Name and expression of every query of every panel, and of every alert's figure."""
    asked = [each for board in BOARDS for each in _of_board(board, namespace, jobs)]
    return asked + [(alert.name, alert.value) for alert in ALERTS]


def without_data(prometheus: Prometheus, asked: list[tuple[str, str]]) -> set[str]:
    """The names of what has no number; of several questions with one name one answer is enough."""
    names = {name for name, _ in asked}
    return names - {name for name, expression in asked if prometheus.values(expression)}


def _of_board(board: Board, namespace: str, jobs: list[str]) -> Iterator[tuple[str, str]]:
    """Each panel's expressions as Grafana would ask them, for each job where there is a choice."""
    names = jobs if board is JOB else [""]
    for (row, panels), name in itertools.product(board.rows.items(), names):
        place = f"{board.title.removeprefix('Bagpipe / ')}, {row}"
        for panel, number in ((p, n) for p in panels for n in range(len(p.queries))):
            asked = panel.queries[number][0].replace("$__rate_interval", "20s")
            asked = asked.replace("$namespace", namespace).replace("$job_name", name)
            asked = asked.replace("$schedule", ".*")
            # A later query of a panel is asked by its number; the first by the panel's name.
            yield f"{place}: {panel.title}{f' #{number}' if number else ''}", asked
