"""What a dashboard is made of, and how it becomes Grafana's JSON by Grafana's own library."""

import json
from dataclasses import dataclass, field
from typing import Any, Literal

from grafana_foundation_sdk.builders import bargauge, prometheus, stat, timeseries
from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models import dashboard as models
from grafana_foundation_sdk.models.common import VizOrientation

SOURCE = models.DataSourceRef(type_val="prometheus", uid="${datasource}")
RATE = "[$__rate_interval]"


# From which figure on a number has which colour. Without one it says nothing of good and bad.
Colors = tuple[tuple[float | None, str], ...]
NEUTRAL: Colors = ((None, "text"),)
GOOD: Colors = ((None, "green"),)
NONE_IS_GOOD: Colors = ((None, "green"), (1, "red"))
ONE_IS_GOOD: Colors = ((None, "red"), (1, "green"), (2, "red"))


@dataclass(frozen=True)
class Panel:
    """One panel: `queries` are pairs of an expression and its legend."""

    title: str
    unit: str  # Grafana's: s, bytes, Bps, percentunit, short, ops, reqps
    description: str
    queries: list[tuple[str, str]]
    kind: Literal["lines", "number", "bars"] = "lines"
    normal: str = ""  # what it shows on a good day
    # Title and address for each series, with variables of its labels.
    links: tuple[tuple[str, str], ...] = ()
    colors: Colors = NEUTRAL  # of numbers and bars


@dataclass(frozen=True)
class Board:
    """One dashboard: rows of panels below their titles, and variables by name and query."""

    name: str
    title: str
    description: str
    rows: dict[str, list[Panel]]
    variables: dict[str, str] = field(default_factory=dict)
    any_of_them: bool = False  # whether variables may be several, and are all at first
    leads_to: tuple[str, ...] = ()  # names of other boards
    time: str = "now-3h"

    @property
    def panels(self) -> list[Panel]:
        """All panels."""
        return [panel for row in self.rows.values() for panel in row]


def as_json(board: Board) -> str:
    """The file that Grafana's sidecar loads."""
    made = (
        builders.Dashboard(board.title)
        .uid(f"bagpipe-{board.name}")
        .description(board.description)
        .tags(["bagpipe"])
        .readonly()
        .time(board.time, "now")
        .refresh("30s")
        .timezone("browser")
        .with_variable(
            builders.DatasourceVariable("datasource").label("Prometheus").type("prometheus")
        )
    )
    for name, query in board.variables.items():
        variable = _variable(name, query)
        made.with_variable(_of_all(variable) if board.any_of_them else variable)
    for name in board.leads_to:
        made.link(_link(name))
    for title, panels in board.rows.items():
        made.with_row(builders.Row(title))
        for panel in panels:
            made.with_panel(_panel(panel))
    return json.dumps(made.build(), cls=JSONEncoder, indent=1, sort_keys=True) + "\n"


def _variable(name: str, query: str) -> builders.QueryVariable:
    return (
        builders.QueryVariable(name)
        .label(name.replace("_", " "))
        .query(query)
        .datasource(SOURCE)
        .refresh(models.VariableRefresh.ON_TIME_RANGE_CHANGED)
        .sort(models.VariableSort.ALPHABETICAL_ASC)
    )


def _of_all(variable: builders.QueryVariable) -> builders.QueryVariable:
    everything = models.VariableOption(selected=True, text="All", value="$__all")
    return variable.multi(True).include_all(True).all_value(".*").current(everything)


def address(board: str, **variables: str) -> str:
    """Where a board is found by its uid, for the same time, with variables set."""
    given = "".join(f"&var-{name}={value}" for name, value in variables.items())
    return f"/d/bagpipe-{board}?${{__url_time_range}}{given}"


def _link(name: str) -> builders.DashboardLink:
    title = name.replace("-", " ").capitalize()
    made = builders.DashboardLink(title).type(models.DashboardLinkType.LINK)
    return made.url(f"/d/bagpipe-{name}").keep_time(True)


_KINDS: dict[str, Any] = {"lines": timeseries.Panel, "number": stat.Panel, "bars": bargauge.Panel}


def _panel(panel: Panel) -> Any:
    made: Any = _KINDS[panel.kind]()
    normal = f" Normal: {panel.normal}" if panel.normal else ""
    made.title(panel.title).description(panel.description + normal)
    made.unit(panel.unit).datasource(SOURCE)
    made.height(7).span(6 if panel.kind == "number" else 8)
    if panel.links:
        made.data_links([builders.DashboardLink(title).url(url) for title, url in panel.links])
    if panel.kind != "lines":
        made.thresholds(_thresholds(panel.colors))
    if panel.kind == "bars":
        made.min(0).orientation(VizOrientation.HORIZONTAL)
    if panel.kind == "lines":
        made.min(0).fill_opacity(10)
    for letter, (expression, legend) in zip("ABCDEFGH", panel.queries, strict=False):
        query = prometheus.Dataquery().expr(expression).legend_format(legend).ref_id(letter)
        made.with_target(query.range() if panel.kind == "lines" else query.instant())
    return made


def _thresholds(colors: Colors) -> builders.ThresholdsConfig:
    steps = [models.Threshold(value=value, color=color) for value, color in colors]
    return builders.ThresholdsConfig().mode(models.ThresholdsMode.ABSOLUTE).steps(steps)


def fleet(metric: str, by: str = "") -> str:
    """The sum of a gauge that each replica of an operator exports, also one that stands by."""
    labels = f"namespace, {by}" if by else "namespace"
    return f"sum{f' by ({by})' if by else ''} (max by ({labels}) ({metric}))"


def rate(metric: str, by: str = "") -> str:
    """The summed rate of a counter, by a label."""
    return f"sum{f' by ({by})' if by else ''} (rate({metric}{RATE}))"


def quantile(share: float, metric: str, by: str = "", among: str = "") -> str:
    """A quantile of a histogram, by a label; `among` joins it with what it is limited to."""
    labels = f"le, {by}" if by else "le"
    return f"histogram_quantile({share}, sum by ({labels}) (rate({metric}_bucket{RATE}){among}))"


def quantiles(metric: str, among: str = "") -> list[tuple[str, str]]:
    """The median and the slowest hundredth of a histogram."""
    return [(quantile(s, metric, among=among), f"{s:.0%}") for s in (0.5, 0.99)]


def mean(metric: str, by: str = "") -> str:
    """The mean of a histogram, by a label."""
    return f"{rate(f'{metric}_sum', by)} / {rate(f'{metric}_count', by)}"
