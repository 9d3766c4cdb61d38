"""Recordings that a catalogue names, played as those of source.bags are."""

from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.bags.source import Bags
from bagpipe.source.catalogue.choosing import chosen
from bagpipe.source.catalogue.fields import Catalogue
from bagpipe.source.catalogue.selecting import Choice
from bagpipe.source_spec import Source
from bagpipe.storage import Storage


class CatalogueSource(Bags):
    """source.catalogue: each case is a window of one of the selected recordings."""

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """The fragments of the selected recordings. Raises CatalogueError, a MatrixError."""
        own: Catalogue = self.spec.source.own
        choice = Choice(own.uri, own.where, tuple(own.within), self.spec.output.uri)
        uris, selection = chosen(choice, storage)
        made = self.plan_of(uris, conditions, storage)
        return Plan(made.cases, made.unplanned, selection)

    def alone(self, uri: str) -> Source:
        """One recording, whichever catalogue named it."""
        return super().alone(uri).model_copy(update={"catalogue": None})


SOURCE = CatalogueSource
