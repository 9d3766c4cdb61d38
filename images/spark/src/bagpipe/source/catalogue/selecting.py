"""Which recordings of a catalogue a job is about. Pure, but for the table that is read."""

import posixpath
import re
from collections.abc import Sequence
from dataclasses import dataclass

from bagpipe.expressions import Expression, ExpressionError, UnknownNamesError
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.rows import URI, Table
from bagpipe.texts import bag_uri

# Each is opened to be planned.
MOST_SELECTED = 10_000
_MOST_URI = 1024
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_ROOT = re.compile(r"(?:pvc|s3|gs|az|hdfs|https)://[^/]+/")


@dataclass(frozen=True)
class Selected:
    """The URIs, sorted and each once; how many rows there were, and how many were selected."""

    uris: list[str]
    rows: int
    selected: int


@dataclass(frozen=True)
class Choice:
    """`source.catalogue` as it is written."""

    uri: str
    where: str
    within: Sequence[str] = ()
    # Where results go, which no recording may be around.
    output: str = ""

    def of(self, table: Table) -> Selected:
        """Raises CatalogueError."""
        if URI not in table.columns:
            raise CatalogueError(f"{self.uri} has no column {URI}: it has {_listed(table.columns)}")
        expression = self._compiled(table.columns)
        used = [name for name in table.columns if name in expression.names]
        uris = set[str]()
        rows = selected = 0
        for row in table.rows(used):
            rows += 1
            try:
                holds = expression.holds(row.values)
            except ExpressionError as error:
                kinds = _shown(table.kinds(used), row.values)
                raise CatalogueError(
                    f"{self.uri} {row.place}: {self._place()} {error} ({kinds})"
                ) from error
            if holds:
                selected += 1
                uris.add(self._checked(row.uri, row.place))
                if len(uris) > MOST_SELECTED:
                    raise CatalogueError(
                        f"{self._place()} selects more than {MOST_SELECTED:,} recordings of"
                        f" {self.uri}: narrow it"
                    )
        if not uris:
            kinds = "; ".join(f"{name} has {kind}" for name, kind in table.kinds(used).items())
            raise CatalogueError(
                f"{self._place()} selects none of the {rows:,} rows of {self.uri}"
                f"{f' ({kinds})' if kinds else ''}: nothing could be shown by a job without cases"
            )
        return Selected(sorted(uris), rows, selected)

    def _compiled(self, columns: list[str]) -> Expression:
        names = [name for name in columns if _NAME.fullmatch(name)]
        try:
            return Expression.compiled(self.where, names)
        except UnknownNamesError as error:
            raise CatalogueError(
                f"{self._place()} {error}, which is no column of {self.uri}: it has"
                f" {_listed(names)}"
            ) from error
        except ExpressionError as error:
            raise CatalogueError(f"{self._place()} {error}") from error

    def _place(self) -> str:
        return f"source.catalogue.where ({self.where[:200]})"

    def _checked(self, written: str, place: str) -> str:
        """A row's URI as a whole one, by the rules of source.bags and within what may be read."""
        where = f"{self.uri} {place}, column {URI}"
        if not written or len(written) > _MOST_URI or not written.isprintable():
            raise CatalogueError(
                f"{where}: it is empty, longer than {_MOST_URI} letters or has letters that can't"
                " be shown: write a URI, or a path relative to the catalogue"
            )
        whole = written if "://" in written else self._beside(written)
        try:
            whole = bag_uri(whole)
        except ValueError as error:
            raise CatalogueError(f"{where}: {error}") from error
        if re.search(r"[*?[]", whole):
            raise CatalogueError(f"{where}: {whole!r} has a wildcard, and a row is one recording")
        if re.search(r"/\.?(?=/)|/\.$", whole.partition("://")[2]):
            raise CatalogueError(
                f"{where}: {whole!r} has an empty part or '.': write each folder once, or the same"
                " recording has several names"
            )
        allowed = self.within or [root_of(self.uri)]
        if not any(whole.startswith(f"{each.rstrip('/')}/") for each in allowed):
            raise CatalogueError(
                f"{where}: {whole!r} is not within {_listed(allowed)}: write what else the job"
                " may read into source.catalogue.within"
            )
        if f"{self.output}/".startswith(f"{whole.rstrip('/')}/"):
            raise CatalogueError(f"{where}: output.uri is inside of {whole!r}: write another")
        return whole

    def _beside(self, path: str) -> str:
        return posixpath.join(posixpath.dirname(self.uri), path.removeprefix("./"))


def root_of(uri: str) -> str:
    """The claim, bucket or server of a URI; of a path of the pod, its folder."""
    found = _ROOT.match(uri)
    return found[0] if found else f"{posixpath.dirname(uri)}/"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 30} more" if len(names) > 30 else ""
    return ", ".join(name[:60] for name in names[:30]) + more


def _shown(kinds: dict[str, str], values: dict[str, object]) -> str:
    return "; ".join(
        f"{name} is {'empty' if values[name] is None else repr(values[name])[:40]}, the column has"
        f" {kind}"
        for name, kind in kinds.items()
    )
