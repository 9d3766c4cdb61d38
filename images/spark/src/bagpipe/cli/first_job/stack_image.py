"""What is in a stack's image, as far as this machine can see it without running anything of it.

Formats: OCI image layout, https://github.com/opencontainers/image-spec; `docker save`.
"""

import functools
import gzip
import io
import json
import re
import shutil
import subprocess
import tarfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from bagpipe.engine_fields import engine_names, fields_of

_MOST_JSON_BYTES = 16 << 20
_MOST_LAYER_BYTES = 16 << 30
_MOST_LAYERS = 200
# Of the archive of an image: layers, and a few files for each.
_MOST_FILES = 10_000
# What stands before a member: a long name, or attributes, which tarfile reads whole.
_MOST_HEADER_BYTES = 1 << 20
_BEFORE_MEMBERS = frozenset(
    {
        tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE, tarfile.GNUTYPE_LONGNAME,
        tarfile.GNUTYPE_LONGLINK,
    }
)  # fmt: skip
_MOST_MEMBERS = 2_000_000
_SECONDS = 60.0
_ASK_SECONDS = 15.0
_TOOLS = ("docker", "podman")
_DIGEST = re.compile(r"sha256:[0-9a-f]{64}")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._/:@-]{0,1023}")
_ENTRYPOINT = "ros_entrypoint.sh"
_SETUP = re.compile(r"opt/ros/([a-z]+)/setup[.]bash")
_PLACEHOLDER = "registry.example/your-stack:1"


class ImageError(ValueError):
    """An archive or a folder that is no image; the sentence says what is wrong with it."""


@dataclass(frozen=True)
class Files:
    """What of ROS is among an image's files: the engines that find what they need, and the
    `distributions` below /opt/ros.
    """

    engines: frozenset[str] = frozenset()
    entrypoint: bool = False
    distributions: tuple[str, ...] = ()


@dataclass(frozen=True)
class StackImage:
    """An image: its name, its configuration as far as it is known, and its files if it was seen.

    `unseen` says why something of it was not.
    """

    name: str
    config: dict[str, Any] | None = None
    files: Files | None = None
    unseen: list[str] = field(default_factory=list)

    def sentences(self, engine: str) -> list[str]:
        """What was found, and what a job of this engine will miss."""
        return [*self._of_config(), *self._of_files(engine), *self.unseen]

    def _of_config(self) -> Iterator[str]:
        if self.config is None:
            return
        entrypoint = self.config.get("Entrypoint")
        user = self.config.get("User") or "root"
        yield f"Found: entrypoint {entrypoint or 'none'}, user {user}."
        environment = self.config.get("Env")
        for variable in environment if isinstance(environment, list) else []:
            if isinstance(variable, str) and variable.startswith("ROS_DISTRO="):
                yield f"Found: {variable}."
        if entrypoint and not _is_ros_entrypoint(entrypoint):
            yield (
                "Its entrypoint is not used: a job's command runs as it is written, through"
                " /ros_entrypoint.sh alone."
            )

    def _of_files(self, engine: str) -> Iterator[str]:
        if self.files is None:
            return
        if self.files.distributions:
            yield f"Found: ROS in /opt/ros/{', /opt/ros/'.join(self.files.distributions)}."
        example = fields_of(engine).example
        if engine in self.files.engines and example:
            yield f"Found: {example.needed}."
        elif example:
            yield (
                f"MISSING: {example.needed}, which stack.engine: {engine} needs: {example.remedy}."
            )
        if self.files.distributions and not self.files.entrypoint:
            yield (
                "MISSING: /ros_entrypoint.sh: write a command that sources /opt/ros/"
                f"{self.files.distributions[0]}/setup.bash itself, such as [bash, -c, ...]."
            )


def look_at(image: str, clock: Callable[[], float] = time.monotonic) -> StackImage:
    """An image by its name, or of an archive or a folder. Raises ImageError."""
    path = Path(image)
    if path.is_dir():
        return _of_store(_Folder(path), clock)
    if path.is_file():
        try:
            with tarfile.open(path, "r:", tarinfo=_Member) as archive:
                return _of_store(_Archive(archive), clock)
        except (tarfile.TarError, OSError) as error:
            raise ImageError(
                f"{image} is no archive of an image ({error}): write one by `docker save IMAGE -o"
                " FILE`, or give the image's name"
            ) from error
    return _of_tool(image)


class _Folder:
    """An OCI layout in a folder."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def open(self, name: str) -> IO[bytes]:
        """A file; raises KeyError where there is none."""
        path = self._path / name
        if not path.is_file() or not path.resolve().is_relative_to(self._path.resolve()):
            raise KeyError(name)
        return path.open("rb")


class _Member(tarfile.TarInfo):
    """A member of an archive whose name, or what else stands before it, is no flood."""

    def _proc_member(self, archive: tarfile.TarFile) -> tarfile.TarInfo:
        if self.type in _BEFORE_MEMBERS and self.size > _MOST_HEADER_BYTES:
            raise tarfile.ReadError(f"a member's name has {self.size:,} bytes")
        made: tarfile.TarInfo = super()._proc_member(archive)  # type: ignore[misc]
        return made


class _Archive:
    """An archive of an OCI layout, or of `docker save`."""

    def __init__(self, archive: tarfile.TarFile) -> None:
        self._archive = archive
        for number, _ in enumerate(archive):
            if number == _MOST_FILES:
                raise tarfile.ReadError(f"it has more than {_MOST_FILES:,} files")

    def open(self, name: str) -> IO[bytes]:
        """A file; raises KeyError where there is none."""
        found = None
        for known in (name, f"./{name}"):
            try:
                found = self._archive.extractfile(known)
                break
            except KeyError:
                continue
        if found is None:
            raise KeyError(name)
        return found


def _of_store(store: _Folder | _Archive, clock: Callable[[], float]) -> StackImage:
    try:
        name, config_at, layers = _parts(store)
        whole = _json(store, config_at)
    except (
        LookupError,
        TypeError,
        AttributeError,
        ValueError,
        RecursionError,
        OSError,
        tarfile.TarError,
    ) as error:
        raise ImageError(
            f"this is no image ({type(error).__name__}: {error}): an index.json or a manifest.json"
            " with its blobs is expected, as `docker save` or `buildah push oci-archive:` write it"
        ) from error
    config = whole.get("config") if isinstance(whole, dict) else None
    unseen = []
    if not _NAME.fullmatch(name):
        name = _PLACEHOLDER
        unseen.append("CHANGE: the archive has no name of the image: write it")
    files = None
    try:
        files = _files(store, layers, clock)
    except (KeyError, OSError, ValueError, EOFError, zlib.error, tarfile.TarError) as error:
        unseen.append(f"Its files were not seen: {error}.")
    return StackImage(name, config if isinstance(config, dict) else {}, files, unseen)


def _parts(store: _Folder | _Archive) -> tuple[str, str, list[str]]:
    """The image's name, and where its configuration and its layers are, the lowest first."""
    try:
        store.open("manifest.json").close()
    except KeyError:
        pass
    else:
        saved = _json(store, "manifest.json")[0]
        return str((saved.get("RepoTags") or [""])[0]), saved["Config"], list(saved["Layers"])
    index = _json(store, "index.json")
    for _ in range(4):
        chosen = index["manifests"][0]
        notes = chosen.get("annotations") or {}
        name = str(notes.get("org.opencontainers.image.ref.name") or "")
        index = _json(store, _blob(chosen["digest"]))
        if "layers" in index:
            layers = [_blob(layer["digest"]) for layer in index["layers"]]
            return name, _blob(index["config"]["digest"]), layers
    raise ValueError("indexes of indexes")


def _blob(digest: str) -> str:
    if not _DIGEST.fullmatch(digest):
        raise ValueError(f"{digest[:80]!r} is no digest by sha256")
    return f"blobs/{digest.replace(':', '/')}"


def _json(store: _Folder | _Archive, name: str) -> Any:
    with store.open(name) as file:
        text = file.read(_MOST_JSON_BYTES + 1)
    if len(text) > _MOST_JSON_BYTES:
        raise ValueError(f"{name[:80]} is larger than 16 MiB")
    return json.loads(text)


def _files(store: _Folder | _Archive, layers: list[str], clock: Callable[[], float]) -> Files:
    """What of ROS is there when all layers lie over each other. Raises ValueError past a bound."""
    until = clock() + _SECONDS
    if len(layers) > _MOST_LAYERS:
        raise ValueError(f"{len(layers)} layers, expected at most {_MOST_LAYERS}")
    there: set[str] = set()
    budget = _Budget(_MOST_LAYER_BYTES, _MOST_MEMBERS, until, clock)
    for layer in layers:
        with store.open(layer) as file:
            _lay_over(there, file, budget)
    return Files(
        engines=frozenset(_found(there)),
        entrypoint=_ENTRYPOINT in there,
        distributions=tuple(sorted(m[1] for name in there if (m := _SETUP.fullmatch(name)))),
    )


@functools.cache
def _signs() -> dict[str, re.Pattern[str]]:
    """By which files each engine's middleware is known."""
    examples = ((name, fields_of(name).example) for name in engine_names())
    return {name: re.compile(example.file) for name, example in examples if example}


def _found(there: set[str]) -> Iterator[str]:
    """The engines that find what they need among these paths."""
    for name, sign in _signs().items():
        if any(sign.fullmatch(path) for path in there):
            yield name


def _lay_over(there: set[str], file: IO[bytes], budget: "_Budget") -> None:
    magic = file.read(4)
    file.seek(0)
    if magic == b"\x28\xb5\x2f\xfd":
        raise ValueError("a layer is packed by zstd")
    packed = magic.startswith(b"\x1f\x8b")
    plain: Any = gzip.GzipFile(fileobj=file) if packed else file
    added: set[str] = set()
    with tarfile.open(fileobj=_Counted(plain, budget), mode="r|", tarinfo=_Member) as layer:
        for member in layer:
            budget.take(0, 1)
            name = member.name.removeprefix("./").strip("/")
            folder, _, last = name.rpartition("/")
            if last == ".wh..wh..opq":
                there -= {each for each in there if each.startswith(f"{folder}/")}
            elif last.startswith(".wh."):
                gone = f"{folder}/{last[4:]}".lstrip("/")
                there -= {each for each in there if each == gone or each.startswith(f"{gone}/")}
            elif not member.isdir() and _of_interest(name):
                added.add(name)
    there |= added


def _of_interest(name: str) -> bool:
    return name == _ENTRYPOINT or any(p.fullmatch(name) for p in (_SETUP, *_signs().values()))


@dataclass
class _Budget:
    """Bytes, members and time that may still be taken."""

    bytes: int
    members: int
    until: float
    clock: Callable[[], float]

    def take(self, size: int, members: int) -> None:
        """Raises ValueError where nothing is left."""
        self.bytes -= size
        self.members -= members
        if self.bytes < 0 or self.members < 0:
            raise ValueError("its layers are larger than this program reads (16 GiB)")
        if self.clock() > self.until:
            raise ValueError(f"its layers take longer than {_SECONDS:.0f} s to read")


class _Counted(io.RawIOBase):
    """A stream whose bytes count."""

    def __init__(self, inner: Any, budget: _Budget) -> None:
        self._inner = inner
        self._budget = budget

    def read(self, size: int = -1) -> bytes:
        """As the stream does."""
        data: bytes = self._inner.read(size)
        self._budget.take(len(data), 0)
        return data


def _of_tool(image: str) -> StackImage:
    if not _NAME.fullmatch(image):
        raise ImageError(
            f"--image {image!r} is no image's name, and there is no such file or folder: write for"
            " example registry.example/lane:1.4"
        )
    for tool in filter(shutil.which, _TOOLS):
        config = _inspected(tool, image)
        if config is not None:
            why = (
                f"Its files were not seen: `{tool} save {image} -o stack.tar`, and --image"
                " stack.tar, look for ROS 1 and ROS 2 in them."
            )
            return StackImage(image, config, None, [why])
    why = (
        "Nothing of the image was seen: no docker or podman of this machine has it. An archive of"
        " it (--image stack.tar) is looked into."
    )
    return StackImage(image, None, None, [why])


def _inspected(tool: str, image: str) -> dict[str, Any] | None:
    """The configuration of an image that a tool of this machine has; None where it has none."""
    words = [tool, "image", "inspect", "--", image]
    try:
        done = subprocess.run(
            words, capture_output=True, timeout=_ASK_SECONDS, check=False, stdin=subprocess.DEVNULL
        )
        found = json.loads(done.stdout)[0]["Config"] if done.returncode == 0 else None
    except (OSError, subprocess.TimeoutExpired, ValueError, LookupError, TypeError):
        return None
    return found if isinstance(found, dict) else None


def _is_ros_entrypoint(entrypoint: object) -> bool:
    return isinstance(entrypoint, list) and any(
        isinstance(word, str) and word.endswith(_ENTRYPOINT) for word in entrypoint
    )
