"""Pieces of recordings, as a spec has them, as parts of one case."""

import hashlib
import json
from dataclasses import replace
from functools import partial

from bagpipe.pieces import Piece, RecordedTopics, SequencePart
from bagpipe.plan.bag_tail import BagError, BagTail, message_times, read_tail
from bagpipe.plan.fragments import Window, check_encoding, cut_one, has_messages
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.part import Part
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.texts import duration_nanoseconds


class PartError(Exception):
    """A piece that can't be played, of the bag `bag`; `reason` is CamelCase."""

    def __init__(self, bag: str, reason: str, message: str) -> None:
        super().__init__(f"{bag}: {message}")
        self.bag = bag
        self.reason = reason


class PartPlanner:
    """Plans pieces whose messages have one encoding; each bag's tail is read once."""

    def __init__(self, storage: Storage, encoding: str) -> None:
        self._storage = storage
        self._encoding = encoding
        self._read: dict[str, tuple[BagTail, OpenFile]] = {}

    def sequence(self, pieces: list[SequencePart], topics: list[str], warm_up: int) -> list[Part]:
        """The pieces one after the other, from the first one's own time on.

        The lead-in of `warm_up` ns lies before the first. Raises PartError.
        """
        parts: list[Part] = []
        for piece in pieces:
            lead_in = 0 if parts else warm_up
            to = None if piece.to is None else duration_nanoseconds(piece.to)
            pause = duration_nanoseconds(piece.pause)
            planned = self._part(piece, to, topics, lead_in)
            for _ in range(piece.times):
                at = parts[-1].end + pause if parts else planned.window.start
                parts.append(replace(planned, at=at))
                planned = _without_lead_in(planned)
        return parts

    def beside(self, pieces: list[RecordedTopics], start: int, length: int) -> list[Part]:
        """The pieces at the same time, from `start` on for `length` ns. Raises PartError."""
        parts = []
        for piece in pieces:
            tail, _ = self._opened(piece.bag)
            present = {connection.topic for connection in tail.connections}
            if missing := [topic for topic in piece.topics if topic not in present]:
                raise PartError(
                    piece.bag,
                    "NoMatchingTopics",
                    f"the topics {', '.join(missing)} are not in the bag; it has"
                    f" {', '.join(sorted(present)[:10])}",
                )
            to = piece.from_nanoseconds + length
            parts.append(replace(self._part(piece, to, piece.topics, 0), at=start))
        return parts

    def _part(self, piece: Piece, to: int | None, topics: list[str], lead_in: int) -> Part:
        tail, file = self._opened(piece.bag)
        begin = min(chunk.start_time for chunk in tail.chunks)
        last = max(chunk.end_time for chunk in tail.chunks)
        start = begin + piece.from_nanoseconds
        end = last + 1 if to is None else begin + to
        window = Window(max(begin, start - lead_in), start, end)
        self._check(piece, topics, window)
        if not self._has_messages(piece, topics, window):
            raise PartError(
                piece.bag,
                "NoMatchingTopics",
                f"the piece from {piece.from_} on has no message of the topics; the bag is"
                f" {(last - begin) / 1e9:.3f} s long and has"
                f" {', '.join(sorted({c.topic for c in tail.connections})[:10])}",
            )
        found = cut_one(tail, topics, window)
        return Part(
            bag=piece.bag,
            version=file.version,
            topics=topics,
            window=window,
            at=start,
            connections=tail.declarations,
            ranges=found.ranges,
            messages=found.messages,
            stated=found.stated,
        )

    def _has_messages(self, piece: Piece, topics: list[str], window: Window) -> bool:
        tail, file = self._opened(piece.bag)
        try:
            return has_messages(tail, topics, window, partial(message_times, file.read))
        except StorageError as error:
            raise PartError(piece.bag, "BagUnreadable", str(error)) from error

    def _check(self, piece: Piece, topics: list[str], window: Window) -> None:
        tail, file = self._opened(piece.bag)
        try:
            check_encoding(tail, topics, self._encoding)
            check_left_out(tail, topics, partial(message_times, file.read), window)
        except BagError as error:
            raise PartError(piece.bag, error.reason, str(error)) from error
        except StorageError as error:
            raise PartError(piece.bag, "BagUnreadable", str(error)) from error

    def _opened(self, uri: str) -> tuple[BagTail, OpenFile]:
        if uri not in self._read:
            try:
                file = self._storage.open(uri)
                tail = read_tail(file.read, file.size)
            except BagError as error:
                raise PartError(uri, error.reason, str(error)) from error
            except StorageError as error:
                raise PartError(uri, "BagUnreadable", str(error)) from error
            self._read[uri] = (tail, file)
        return self._read[uri]


def _without_lead_in(part: Part) -> Part:
    window = part.window
    return replace(part, window=Window(window.start, window.start, window.end))


def version_of(parts: list[Part]) -> str:
    """One mark for all of them: it changes with any of their bags, windows and places."""
    text = json.dumps([part.as_row() for part in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32] if parts else ""
