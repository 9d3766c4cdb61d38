"""Values that a careless or hostile author writes, by the type that a schema asks for.

All of them are JSON that the API server can read; what it makes of them is its business.
"""

import random
from collections.abc import Callable
from typing import Any

Json = Any

LARGEST = 2**63 - 1
SMALLEST = -(2**63)

NUMBERS: tuple[Json, ...] = (
    0, -1, 1, -0.0, 0.1, 1e-320, 1e308, -1e308, 2**31 - 1, 2**31, -(2**31), 2**53 + 1, 999_999_999,
    10**12, 1e15, LARGEST, LARGEST - 1, SMALLEST, 1.5, 1e22,
)  # fmt: skip
MOMENTS = (
    "0000-01-01T00:00:00Z", "0001-01-01T00:00:00Z", "0001-01-01T00:00:00+23:59",
    "9999-12-31T23:59:59Z", "9999-12-31T23:59:59-23:59", "2026-11-20T04:00:00z",
    "2026-11-20t04:00:00Z", "2026-11-20T04:00:00.123456789Z", "2026-11-20T04:00:00+99:99",
    "2026-11-20T04:00:00,5Z", "2026-02-29T04:00:00Z", "2026-11-20T23:59:60Z",
    "1970-01-01T00:00:00Z", "2026-11-20T04:00:00", "2026-11-20", "now", "",
    "2026-11-20T04:00:00+14:00", "2999-01-01T00:00:00Z",
)  # fmt: skip
PATTERNS = (
    "/(a+)+b", "(x+x+)+y", "((a{1,1000}){1,1000}){1,1000}", "/(.*)*(.*)*(.*)*$", "/" + "(a|" * 900,
    "/[", "/(?P<a>x)(?P<a>y)", "/\\", "/(?=a)", "/(?:a?){64}a{64}", "/\\pL{1000}",
    "/[^\\x00-\\x{10FFFF}]", "(?i)(?s).*", "/.{0,1000}.{0,1000}.{0,1000}",
)  # fmt: skip
QUANTITIES = (
    "1e9999999", "-1", "0", "1E", "1e3", "9223372036854775807", "99999999999999999999Ti",
    "0.0000001", "1.5Gi", "1Ei", "1n", "+1", "1 Gi", "Inf", "NaN", "1e-9", "１Gi", "٣",
    "9" * 400 + "Ti", "m",
)  # fmt: skip
DURATIONS = (
    "999999999h", "0s", "-1s", "1e9s", "1h1h1h1h1h", "9" * 30 + "h", "0.0000000001s", ".5s", "1d",
    "PT1S", "1", "٣s", "1ms1us", "2562047h47m16.9s", "2562048h", "1" * 400 + ".1s",
    "999999h999999h",
)  # fmt: skip
CRONS = (
    "* * * * *", "0 0 31 2 *", "0 0 29 2 *", "*/0 * * * *", "60 * * * *", "0-59/1,0-59/1 * * * *",
    "* * * * * *", "@reboot", "@daily", "@DAILY ", "0 0 L * *", "0 0 * * 1#5", "* * * * MON-SUN",
    ",".join(["0"] * 900) + " * * * *", "٣ * * * *", "0 0 1 1 8", "TZ=UTC * * * * *", "-1 * * * *",
    "*/99999999999999999999 * * * *", "0 24 * * *", "0 0 0 * *", "0 0 31 4,6 *", "59-0 * * * *",
)  # fmt: skip
ZONES = (
    "../../../etc/passwd", "/etc/passwd", "Local", "UTC", "Etc/GMT+14", "right/UTC", "posixrules",
    "Europe/Berlin\0", "europe/berlin", "Europe", "Antarctica/Troll", "Africa/Casablanca",
    "A" * 300, "Pacific/Apia", "Europe/../Europe/Berlin", "Asia/", "Ⅷ",
)  # fmt: skip
URIS = (
    "pvc://", "pvc:///x", "pvc://a/../../etc", "file:///proc/self/environ", "s3://[::1]/x",
    "https://user:secret@host/x", "pvc://recordings/" + "[" * 200, "pvc://a/%00",
    "pvc://a/**/" * 40, "pvc://recordings/{" + "a," * 200 + "}", "gs://:99999999/x", "http://[",
    "pvc://a\n/b", "pvc://results/{{ x }}", "file:///mnt/../etc/passwd",
)  # fmt: skip
TEMPLATES = (
    "{{ x }}", "{{", "{{ x", "{% for i in range(10**9) %}a{% endfor %}", "{{ ''.__class__ }}",
    "{{ threshold }}" * 50, "{{{{ x }}}}", "${HOME}", "%s%n", "{0.__class__}",
    "{{" + " " * 5_000, "{{ x" + "\t" * 5_000 + "}",
)  # fmt: skip
TEXTS = (
    "", " ", "\0", "a\0b", "\n", "\t\r\n", "\u202eabc\u202c", "e" + "\u0301" * 300, "\ufeff",
    "\uffff", "\U0010ffff", "\u2028", "null", "true", "NaN", "Infinity", "-0", "0x10", "1_000", "~",
    "..", "/", "//", "-", "--help", "$(id)", "a b", "A" * 64, "a" * 254, "x" * 5_000, "é" * 1_025,
    "ß", "ı", "İ", "__class__", "__proto__", "constructor", "\x1b[31m", "<script>", "'; drop",
    "\x7f", "sim.bagpipe.io/x", "𝟙", "٣", "２",
)  # fmt: skip
NAMES = (
    "", "-", "a-", "-a", "A", "a.b", "a" * 40, "a" * 41, "a" * 63, "a" * 64, "0", "1-2",
    "x-1-driver", "x-99999999999", "x-999999999", "..", "a/b", "a b", "é", "xn--a", "null", "job",
    "kube-system",
)  # fmt: skip
LABELS = (
    {"sim.bagpipe.io/schedule": "nightly"}, {"sim.bagpipe.io/job-uid": "x"}, {"a": "b" * 63},
    {"a": "b" * 64}, {"": ""}, {"app.kubernetes.io/managed-by": "somebody"}, {"x/y/z": "1"},
    {"sim.bagpipe.io/attempt": "9" * 60},
)  # fmt: skip
ANNOTATIONS = (
    {"a/b": "x" * 60_000}, {"sim.bagpipe.io/scheduled-at": "never"}, {"k": "\0"}, {"k": "\u202e"},
    {f"a{n}": "b" for n in range(200)}, {"kubectl.kubernetes.io/last-applied-configuration": "{"},
)  # fmt: skip

WORDS = (*TEXTS, *PATTERNS, *QUANTITIES, *DURATIONS, *CRONS, *ZONES, *URIS, *TEMPLATES, *NAMES)
# Where the name of a field says what belongs into it, most hostile values are of that sort.
_SORTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("zone", ZONES), ("schedule", CRONS), ("time", MOMENTS), ("memory", QUANTITIES),
    ("cpu", QUANTITIES), ("size", QUANTITIES), ("limits", QUANTITIES), ("requests", QUANTITIES),
    ("uri", URIS), ("bag", URIS), ("results", URIS), ("files", URIS), ("length", DURATIONS),
    ("warmup", DURATIONS), ("timeout", DURATIONS), ("deadline", DURATIONS), ("max", DURATIONS),
    ("within", DURATIONS), ("from", DURATIONS), ("topic", PATTERNS), ("remap", PATTERNS),
    ("name", NAMES), ("parameters", TEMPLATES), ("holds", PATTERNS), ("value", TEMPLATES),
    ("command", TEMPLATES),
)  # fmt: skip


def deep(levels: int, kind: str = "list") -> Json:
    """Lists or objects in each other."""
    value: Json = "bottom"
    for _ in range(levels):
        value = [value] if kind == "list" else {"a": value}
    return value


def tree(rng: random.Random, levels: int = 3) -> Json:
    """Any JSON of moderate size: a whole manifest must stay below what etcd takes."""
    if levels == 0 or rng.random() < 0.4:
        return rng.choice([*NUMBERS, *TEXTS, None, True, False])
    if rng.random() < 0.5:
        return [tree(rng, levels - 1) for _ in range(rng.randrange(4))]
    return {rng.choice(TEXTS): tree(rng, levels - 1) for _ in range(rng.randrange(4))}


def text(rng: random.Random, field: str) -> str:
    """A hostile string for a field of that name."""
    sorts = [words for part, words in _SORTS if part in field.lower()]
    if sorts and rng.random() < 0.7:
        return rng.choice(rng.choice(sorts))
    if rng.random() < 0.02:
        return rng.choice("xé\0") * rng.choice((70_000, 300_000))
    return rng.choice(WORDS)


def container(rng: random.Random, _field: str) -> Json:
    """What stands where an object of any content may."""
    if rng.random() < 0.3:
        return deep(rng.choice((5, 28, 31, 32, 33, 60, 130)), rng.choice(("list", "object")))
    return {rng.choice(WORDS): tree(rng) for _ in range(rng.choice((0, 1, 3, 30)))}


def items(rng: random.Random, field: str) -> list[Json]:
    """A list of what does not belong together, or of very much that is the same."""
    if rng.random() < 0.3:
        return [text(rng, field)[:300]] * rng.choice((65, 300, 1_001))
    return [tree(rng) for _ in range(rng.randrange(5))]


_BY_TYPE: dict[str, Callable[[random.Random, str], Json]] = {
    "string": text,
    "integer": lambda rng, _field: rng.choice(NUMBERS),
    "number": lambda rng, _field: rng.choice(NUMBERS),
    "boolean": lambda rng, _field: rng.choice(("true", "yes", 0, 1, True, False)),
    "object": container,
    "array": items,
}


def hostile(rng: random.Random, type_: str, field: str) -> Json:
    """A value that is mostly of the type, and nothing that a friend would write."""
    make = _BY_TYPE.get(type_)
    return tree(rng) if make is None else make(rng, field)


def wrong(rng: random.Random, type_: str, field: str) -> Json:
    """A value of another type."""
    others = sorted(set(_BY_TYPE) - {type_, "integer" if type_ == "number" else ""})
    return hostile(rng, rng.choice(others), field)
