"""Makes the same random calls at two masters; compares their answers and notices to nodes.

Usage: same_calls.py URI URI SEED CALLS. Prints how many calls it compared; a difference ends it.
"""

import random
import socketserver
import sys
import threading
import xmlrpc.client
import xmlrpc.server

NODES = ["/one", "/ns/two", "/ns/deep/three"]
TOPICS = ["/t", "t", "u", "/ns/u", "~own", "/ns//t/", "bad name", "bad:name", "/", "", 5]
KEYS = ["a", "a/b", "/a/b/c", "~x", "/", "/ns/a", "//ns//a/", "b", "/b/", "~", "", 7]
TYPES = ["pkg/One", "pkg/Two", "*", "One", "pkg/msg/One", "", 5]
DEADLINE = 60


class Server(socketserver.ThreadingMixIn, xmlrpc.server.SimpleXMLRPCServer):
    daemon_threads = True


class Slave:
    """A node's slave API that keeps what it is notices."""

    def __init__(self):
        self.server = Server(("127.0.0.1", 0), logRequests=False)
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}/"
        self.notices = {}
        self.last = threading.Event()
        self.server.register_instance(self)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def _dispatch(self, method, params):
        self.notices[(params[0], method, repr(params[1]))] = params[1:]
        if params[1] == "/the_last":
            self.last.set()
        return 1, "", 0


class Side:
    """One of the two masters, with nodes of its own."""

    def __init__(self, uri):
        self.master = xmlrpc.client.ServerProxy(uri)
        self.uri = uri
        self.slaves = [Slave() for _ in range(2 * len(NODES))]

    def neutral(self, value):
        """Without what differs by nature: addresses, and the order of names."""
        if isinstance(value, str):
            for at, slave in enumerate(self.slaves):
                value = value.replace(slave.uri, f"slave {at}")
            return value.replace(self.uri, "master")
        if isinstance(value, (list, tuple)):
            return [self.neutral(one) for one in value]
        if isinstance(value, dict):
            return {key: self.neutral(one) for key, one in value.items()}
        return value

    def call(self, method, arguments):
        """Whether it was fine, and what it gave if so."""
        arguments = [self.slaves[one.at].uri if isinstance(one, Uri) else one for one in arguments]
        try:
            code, _, value = getattr(self.master, method)(*arguments)
        except xmlrpc.client.Fault:
            return "fault"
        if code != 1:
            return "refused"
        if method in ("getSystemState", "getPublishedTopics", "getTopicTypes", "getParamNames"):
            value = ordered(value)
        return self.neutral(value)

    def all_notices(self):
        """What each node was notices last of each topic and parameter, once all is notices."""
        for at, slave in enumerate(self.slaves):
            name = f"/last_{at}"
            self.master.registerSubscriber(name, "/the_last", "*", slave.uri)
        self.master.registerPublisher("/last", "/the_last", "pkg/One", self.slaves[0].uri)
        for slave in self.slaves:
            if not slave.last.wait(DEADLINE):
                sys.exit("a node was not notices")
        return [
            {key: self.neutral(without_tree(value)) for key, value in slave.notices.items()}
            for slave in self.slaves
        ]


class Uri:
    """Of this slave, at whichever master."""

    def __init__(self, at):
        self.at = at

    def __repr__(self):
        return f"slave {self.at}"


def without_tree(notice):
    """Debian's master sends a tree as it is once the call goes out, with what was set after it."""
    key, *values = notice
    return [key, *("a tree" if isinstance(value, dict) else value for value in values)]


def ordered(value):
    if isinstance(value, list):
        return sorted((ordered(one) for one in value), key=repr)
    return value


def value(chance, depth=0):
    kinds = [
        lambda: chance.randrange(-9, 9),
        chance.random,
        lambda: chance.choice(["text", "", " <&> \n"]),
        lambda: chance.random() < 0.5,
        lambda: chance.choice(["\x1b[0m", "\x00", "\ufffe", "\x7f\U0001f600"]),
        lambda: xmlrpc.client.Binary(chance.randbytes(4)),
        lambda: xmlrpc.client.DateTime("20261124T03:12:44"),
        lambda: chance.choice([float("inf"), float("-inf"), 1e300, -5e-324, 2**31 - 1, -(2**31)]),
        lambda: [value(chance, 3) for _ in range(chance.randrange(3))],
        lambda: {key: value(chance, depth + 1) for key in chance.sample("abcx", 2)},
        dict,
    ]
    return chance.choice(kinds[: 9 if depth > 2 else 11])()


def call(chance):
    """A method and its arguments."""
    at = chance.randrange(len(NODES))
    node = NODES[at]
    # Now and then a node comes back under another address.
    uri = Uri(at + len(NODES) * (chance.random() < 0.2))
    topic, key, kind = chance.choice(TOPICS), chance.choice(KEYS), chance.choice(TYPES)
    # Who takes another's service over is known for ever to Debian's master.
    service = f"/serves{at}"
    rosrpc = chance.choice(["rosrpc://here:1", "rosrpc://here:2", "here"])
    return chance.choice(
        [
            ("registerPublisher", [node, topic, kind, uri]),
            ("registerSubscriber", [node, topic, kind, uri]),
            ("unregisterPublisher", [node, topic, uri]),
            ("unregisterSubscriber", [node, topic, uri]),
            ("registerService", [node, service, rosrpc, uri]),
            ("unregisterService", [node, service, rosrpc]),
            ("lookupService", [node, chance.choice([service, "/none"])]),
            ("lookupNode", [node, chance.choice([*NODES, "two", "/none"])]),
            ("getPublishedTopics", [node, chance.choice(["", "/ns", "/", "deep", "/none"])]),
            ("getTopicTypes", [node]),
            ("getSystemState", [node]),
            ("getUri", [node]),
            ("setParam", [node, key, value(chance)]),
            ("setParam", [node, key, value(chance)]),
            ("setParam", [node, key]),
            ("getParam", [node, key]),
            ("deleteParam", [node, key]),
            ("hasParam", [node, key]),
            ("searchParam", [node, key]),
            ("getParamNames", [node]),
            ("subscribeParam", [node, uri, key]),
            ("unsubscribeParam", [node, uri, key]),
            ("getParam", [5, key]),
            ("getParam", [node, key, "more"]),
            ("registerPublisher", [node, topic, kind, uri, "more"]),
            ("getSystemState", [node, "more"]),
            ("lookupNode", [node]),
            ("noSuchMethod", [node]),
        ]
    )


def main(first, second, seed, calls):
    chance = random.Random(int(seed))  # noqa: S311
    sides = [Side(first), Side(second)]
    for number in range(int(calls)):
        method, arguments = call(chance)
        answers = [side.call(method, arguments) for side in sides]
        if answers[0] != answers[1]:
            sys.exit(f"call {number}: {method}{arguments!r}: {answers[0]!r} and {answers[1]!r}")
    notices = [side.all_notices() for side in sides]
    for at, (one, other) in enumerate(zip(*notices, strict=True)):
        for key in sorted({*one, *other}):
            if one.get(key) != other.get(key):
                sys.exit(f"slave {at}: {key}: {one.get(key)!r} and {other.get(key)!r}")
    print("equal", calls, sum(map(len, notices[0])))


main(*sys.argv[1:])
