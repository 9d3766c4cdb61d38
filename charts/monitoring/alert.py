"""What an alert is made of, and how it becomes a rule and a page of the runbook."""

from dataclasses import dataclass
from typing import Any, Literal

import yaml

RUNBOOKS = "docs/operations/alerts"


@dataclass(frozen=True)
class Alert:
    """One alert: it fires where `value`, a figure that is always there, meets `when` for `lasting`.

    `summary` may use the labels of the figure. `steps` are what a person does, in order.
    """

    name: str
    part: Literal["operator", "jobs", "data-plane"]
    severity: Literal["critical", "warning", "info"]
    value: str
    when: str
    lasting: str
    summary: str
    meaning: str
    impact: str
    steps: tuple[str, ...]

    @property
    def expression(self) -> str:
        """The rule's expression."""
        return f"{self.value} {self.when}".strip()

    def rule(self) -> dict[str, Any]:
        """As Prometheus reads it."""
        return {
            "alert": self.name,
            "expr": self.expression,
            "for": self.lasting,
            "labels": {"severity": self.severity, "part": self.part},
            "annotations": {
                "summary": self.summary,
                "description": f"{self.meaning} {self.impact}",
                "runbook": f"{RUNBOOKS}/{self.name}.md",
            },
        }

    def page(self) -> str:
        """Its page of the runbook."""
        steps = "\n".join(f"{number}. {step}" for number, step in enumerate(self.steps, 1))
        return (
            f"# {self.name}\n\n**{self.severity}**, of the group bagpipe-{self.part}. It fires"
            f" when this holds for {self.lasting}:\n\n```promql\n{self.expression}\n```\n\n"
            f"**Meaning.** {self.meaning}\n\n**Impact.** {self.impact}\n\n**What to do**\n\n"
            f"{steps}\n"
        )


def rules_file(alerts: list[Alert]) -> str:
    """All alerts as one file of rules, grouped by part."""
    parts = dict.fromkeys(alert.part for alert in alerts)
    groups = [
        {
            "name": f"bagpipe-{part}",
            "rules": [alert.rule() for alert in alerts if alert.part == part],
        }
        for part in parts
    ]
    header = "# Made by `python -m charts.monitoring.generate` from charts/monitoring/alerts.py.\n"
    return header + str(yaml.safe_dump({"groups": groups}, sort_keys=False, width=100))
