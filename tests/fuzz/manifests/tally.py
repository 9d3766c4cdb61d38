"""What a campaign has done, counted, and summarized in a few lines."""

import threading
from collections import Counter
from dataclasses import dataclass, field

# Reasons of ends that are listed; a job's reason may be whatever its forged account says.
_MOST_REASONS = 25
FORGED = ("statuses", "pods", "pod statuses", "config maps")
PHASES = {"crd": "with the CRDs of this checkout", "any-crd": "with CRDs that let anything pass"}


@dataclass
class Tally:
    """Counts by what was counted, from several threads."""

    counts: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, what: str, count: int = 1) -> None:
        """Counts something."""
        with self._lock:
            self.counts[what] += count

    def end(self, how: str) -> None:
        """Counts an ended job by its reason."""
        with self._lock:
            self.ends[how] += 1

    def lines(self) -> list[str]:
        """The figures as they are printed."""
        of = self.counts
        written = of["written"]
        shares = [
            f"{label}: {of[f'{phase} written']} written, "
            + self._share(f"{phase} accepted", of[f"{phase} written"])
            for phase, label in PHASES.items()
        ]
        ends = [f"{reason} {count}" for reason, count in self.ends.most_common(_MOST_REASONS)]
        accepted = self._share("accepted", written)
        return [
            f"manifests: {written} written, {accepted}, {of['refused']} refused by admission",
            *shares,
            f"edits: {of['edits']} accepted, {of['edits refused']} refused",
            f"deletes of living objects: {of['deletes']}",
            *(self._forged(what) for what in FORGED),
            f"answers of a driver that lies: {of['answers']}",
            f"jobs that ended: {sum(self.ends.values())}: {', '.join(ends) or 'none'}",
            f"faults of the API server's own (5xx): {of['odd answers']}",
        ]

    def _share(self, what: str, of: int) -> str:
        count, word = self.counts[what], what.rsplit(maxsplit=1)[-1]
        return f"{count} {word} ({count / (of or 1):.0%})"

    def _forged(self, what: str) -> str:
        refused = self.counts[f"{what} refused"]
        return f"forged {what}: {self.counts[what]} accepted, {refused} refused"
