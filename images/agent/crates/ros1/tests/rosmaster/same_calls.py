"""Makes the same random calls at two masters, and compares their answers and what nodes are told.

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
TYPES = ["pkg/One", "pkg/Two", "*"]
DEADLINE = 60


class Server(socketserver.ThreadingMixIn, xmlrpc.server.SimpleXMLRPCServer):
    daemon_threads = True


class Slave:
    """A node's slave API that keeps what it is told."""

    def __init__(self):
        self.server = Server(("127.0.0.1", 0), logRequests=False)
        self.uri = "http://127.0.0.1:%d/" % self.server.server_address[1]
        self.told = {}
        self.last = threading.Event()
        self.server.register_instance(self)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def _dispatch(self, method, params):
        assert params[0] == "/master", params
        self.told[(method, repr(params[1]))] = params[1:]
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
                value = value.replace(slave.uri, "slave %d" % at)
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

    def all_told(self):
        """What each node was told last of each topic and parameter, once all is told."""
        for at, slave in enumerate(self.slaves):
            name = "/last_%d" % at
            self.master.registerSubscriber(name, "/the_last", "*", slave.uri)
        self.master.registerPublisher("/last", "/the_last", "pkg/One", self.slaves[0].uri)
        for slave in self.slaves:
            assert slave.last.wait(DEADLINE), "a node was not told"
        return [
            {key: self.neutral(tree_or(value)) for key, value in slave.told.items()}
            for slave in self.slaves
        ]


class Uri:
    """Of this slave, at whichever master."""

    def __init__(self, at):
        self.at = at

    def __repr__(self):
        return "slave %d" % self.at


def tree_or(told):
    """Debian's master sends a tree as it is once the call goes out, with what was set after it."""
    key, *values = told
    return [key, *("a tree" if isinstance(value, dict) else value for value in values)]


def ordered(value):
    if isinstance(value, list):
        return sorted((ordered(one) for one in value), key=repr)
    return value


def value(chance, depth=0):
    kinds = [
        lambda: chance.randrange(-9, 9),
        lambda: chance.random(),
        lambda: chance.choice(["text", "", " <&> \n"]),
        lambda: chance.random() < 0.5,
        lambda: [value(chance, 3) for _ in range(chance.randrange(3))],
        lambda: {key: value(chance, depth + 1) for key in chance.sample("abcx", 2)},
        lambda: {},
    ]
    return chance.choice(kinds[: 5 if depth > 2 else 7])()


def call(chance):
    """A method and its arguments."""
    at = chance.randrange(len(NODES))
    node = NODES[at]
    # Now and then a node comes back under another address.
    uri = Uri(at + len(NODES) * (chance.random() < 0.2))
    topic, key, kind = chance.choice(TOPICS), chance.choice(KEYS), chance.choice(TYPES)
    # Who takes another's service over is known for ever to Debian's master.
    service = "/serves%d" % at
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
            ("noSuchMethod", [node]),
        ]
    )


def main(first, second, seed, calls):
    chance = random.Random(int(seed))
    sides = [Side(first), Side(second)]
    for number in range(int(calls)):
        method, arguments = call(chance)
        answers = [side.call(method, arguments) for side in sides]
        if answers[0] != answers[1]:
            sys.exit("call %d: %s%r: %r and %r" % (number, method, arguments, *answers))
    told = [side.all_told() for side in sides]
    for at, (one, other) in enumerate(zip(*told)):
        for key in sorted({*one, *other}):
            if one.get(key) != other.get(key):
                sys.exit("slave %d: %r: %r and %r" % (at, key, one.get(key), other.get(key)))
    print("equal", calls, sum(map(len, told[0])))


main(*sys.argv[1:])
