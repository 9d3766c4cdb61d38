"""Which URIs a job has for recordings that were named by a path or a URI."""

import glob
import os
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from bagpipe.plan.rosbag2_metadata import METADATA
from bagpipe.storage import StorageError
from bagpipe.texts import BagUri

CLAIM = "recordings"
_PATTERNS = ("*.bag", "*.mcap", f"*/{METADATA}")
_LONGEST_NAME = 40
_URI: TypeAdapter[str] = TypeAdapter(BagUri)


@dataclass(frozen=True)
class Placed:
    """The URIs as a job has them, and the folders that stand for its claims on this machine."""

    bags: list[str]
    volumes: dict[str, str]

    @property
    def options(self) -> str:
        """What other verbs need to find them, behind a space."""
        words = (f" --volume {shlex.quote(f'{c}={f}')}" for c, f in sorted(self.volumes.items()))
        return "".join(words)

    @property
    def name(self) -> str:
        """A job's name after its first recording."""
        path = self.bags[0].rstrip("/").removesuffix(f"/{METADATA}")
        if "*" in path:
            path = path.rpartition("/")[0]
        stem = re.sub(r"[.](bag|mcap)$", "", path.rpartition("/")[2])
        plain = re.sub(r"[^a-z0-9]+", "-", stem.lower()).strip("-")
        name = plain if plain[:1].isalpha() else f"job-{plain}"
        return name[:_LONGEST_NAME].strip("-")


def placed(recordings: Sequence[str], volumes: dict[str, str]) -> Placed:
    """URIs as they are, and paths of this machine as places of a claim: of one in `volumes` that
    has them, else of `recordings`, for which the folder that has them all stands.

    Raises StorageError for what is not there or can't be named.
    """
    for each in filter(_is_uri, recordings):
        _check(each)
    paths = [_path(each) for each in recordings if not _is_uri(each)]
    known = dict(volumes)
    outside = [path for path in paths if _claim_of(path, volumes) is None]
    if outside:
        if CLAIM in volumes:
            raise StorageError(
                f"{outside[0]} is not in {volumes[CLAIM]}, which stands for the claim {CLAIM}: give"
                " --volume CLAIM=FOLDER for a folder that has it"
            )
        known[CLAIM] = os.path.commonpath([_folder_of(path) for path in outside])
    bags = [
        uri
        for each in recordings
        for uri in ([each] if _is_uri(each) else _in_claims(_path(each), known))
    ]
    used = {uri.removeprefix("pvc://").split("/", 1)[0] for uri in bags if uri.startswith("pvc://")}
    return Placed(list(dict.fromkeys(bags)), {c: f for c, f in known.items() if c in used})


def _check(uri: str) -> None:
    """A URI that no job can have is not asked for, and what may be a credential not repeated."""
    try:
        _URI.validate_python(uri)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False, include_context=False)[0]
        raise StorageError(fault["msg"].removeprefix("Value error, ")) from None


def _is_uri(recording: str) -> bool:
    return "://" in recording and not recording.startswith("file://")


def _path(recording: str) -> Path:
    path = Path(recording.removeprefix("file://"))
    try:
        found = path.resolve(strict=True)
        str(found).encode()
    except OSError as error:
        raise StorageError(f"{recording} can't be read: {error.strerror}") from error
    except UnicodeEncodeError as error:
        raise StorageError(
            f"{recording!a} has a name that is no UTF-8, which no URI has: rename it"
        ) from error
    return found


def _folder_of(path: Path) -> str:
    """The folder that stands for a claim: a folder of recordings itself."""
    return str(path if _is_folder_of_recordings(path) else path.parent)


def _is_folder_of_recordings(path: Path) -> bool:
    return path.is_dir() and not (path / METADATA).is_file()


def _claim_of(path: Path, volumes: dict[str, str]) -> str | None:
    return next((claim for claim, folder in volumes.items() if path.is_relative_to(folder)), None)


def _in_claims(path: Path, volumes: dict[str, str]) -> list[str]:
    claim = _claim_of(path, volumes)
    assert claim is not None  # noqa: S101  what no volume has was given one
    inside = path.relative_to(volumes[claim]).as_posix()
    # A name with a bracket or a star is no pattern.
    uri = f"pvc://{claim}/{'' if inside == '.' else glob.escape(inside)}"
    if not _is_folder_of_recordings(path):
        return [uri]
    patterns = [each for each in _PATTERNS if next(path.glob(each), None) is not None]
    if not patterns:
        raise StorageError(
            f"{path} has no recording (*.bag, *.mcap, or a folder with {METADATA}): name the folder"
            " that has them, or the files"
        )
    return [f"{uri.rstrip('/')}/{each}" for each in patterns]
