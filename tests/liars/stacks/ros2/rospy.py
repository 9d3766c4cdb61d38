"""The part of rospy's interface that the liars use, over the middleware of ROS 2.

So each liar is one text, and a node of either: this folder on PYTHONPATH makes it one of ROS 2. It
is executed as by rclpy: one thread takes and calls, one message after the other. LIAR_TRACED makes
it report its callbacks, as rclcpp's nodes do. A queue without a bound has room for a thousand.
"""

import atexit
import contextlib
import ctypes
import os
import pathlib
import signal
import sys
import threading
import time
import traceback

import cdr
import genpy
import rmw
from genpy import Duration
from genpy import Time as _Time
from rosgraph_msgs.msg import Clock

__all__ = ["Duration"]

_MOST = 64
_UNBOUND = 1000
_PAUSE = 100_000_000
_over = threading.Event()
_at_shutdown = []
_renamed = dict(word.split(":=", 1) for word in sys.argv if ":=" in word)


class Time(_Time):
    @staticmethod
    def now():
        return genpy.Time.from_sec(time.time()) if _node.time is None else _node.time


class _Node:
    """The one of this process: what it subscribes to, and the thread that calls back."""

    def __init__(self):
        self.handle = self.time = None
        self.context = rmw.Context()
        self.endpoints, self.subscriptions = [], []
        self.lock = threading.RLock()
        self.pause = 0.0

    def begin(self, name):
        if rmw.init(None, ctypes.byref(self.context)) != rmw.OK:
            sys.exit("the middleware does not start")
        self.handle = rmw.create_node(ctypes.byref(self.context), name.encode(), b"/")
        self.set = rmw.create_wait_set(ctypes.byref(self.context), _MOST)
        threading.Thread(target=self.spin, daemon=True).start()

    def spin(self):
        while not _over.is_set():
            with self.lock:
                known = list(self.subscriptions)
            if not known:
                _over.wait(0.001)
                continue
            for ready in self.wait(known):
                if ready in self.subscriptions:
                    ready.execute()
                    _over.wait(self.pause)

    def wait(self, known):
        room = (ctypes.c_void_p * len(known))(*[one.endpoint.contents.data for one in known])
        things = rmw.Things(len(known), room)
        limit = rmw.Span(0, _PAUSE)
        nothing = [None] * 4
        rmw.wait(ctypes.byref(things), *nothing, self.set, ctypes.byref(limit))
        return [one for one, ready in zip(known, room, strict=True) if ready]

    def end(self):
        with self.lock:
            endpoints, self.endpoints, self.subscriptions = self.endpoints, [], []
        for destroy, endpoint in endpoints:
            destroy(self.handle, endpoint)
        if self.handle is not None:
            rmw.destroy_node(self.handle)
            self.handle = None


_node = _Node()


def _qos(depth, latch=False):
    durability = rmw.TRANSIENT_LOCAL if latch else rmw.VOLATILE
    return rmw.Qos(rmw.KEEP_LAST, depth, rmw.RELIABLE, durability)


def _endpoint(create, destroy, kind, topic, qos):
    topic = _renamed.get(topic, topic)
    support = rmw.type_support(kind)
    made = create(_node.handle, support, topic.encode(), ctypes.byref(qos), None)
    if not made:
        sys.exit(f"the middleware makes nothing of {topic}")
    _node.endpoints.append((destroy, made))
    return made


class Publisher:
    def __init__(self, topic, kind, queue_size=None, latch=False):
        qos = _qos(1 if latch else queue_size or _UNBOUND, latch)
        parts = (rmw.create_publisher, rmw.destroy_publisher, kind, topic, qos)
        self.endpoint = _endpoint(*parts)

    def publish(self, message):
        data = ctypes.create_string_buffer(cdr.written(message))
        sent = rmw.Message(ctypes.cast(data, ctypes.c_void_p), len(data) - 1)
        rmw.publish(self.endpoint, ctypes.byref(sent), None)


class Subscriber:
    # buff_size is of rospy's sockets alone: here one message is taken at a time.
    def __init__(self, topic, kind, callback, queue_size=None, buff_size=None):
        self.kind, self.callback, self.message = kind, callback, rmw.Message()
        depth = queue_size or _UNBOUND
        parts = (rmw.create_subscription, rmw.destroy_subscription, kind, topic, _qos(depth))
        self.endpoint = _endpoint(*parts)
        traced = os.environ.get("LIAR_TRACED")
        self.trace = contextlib.nullcontext()
        if traced:
            self.trace = rmw.Tracepoints(_node.handle, self.endpoint, topic, depth)
        with _node.lock:
            _node.subscriptions.append(self)

    def execute(self):
        data = rmw.taken(self.endpoint, self.message)
        if data is None:
            return
        with self.trace:
            try:
                self.callback(cdr.read(self.kind, data))
            except Exception:  # noqa: BLE001  as rospy: written, and lived with
                traceback.print_exc()

    def unregister(self):
        """To be called where callbacks are."""
        with _node.lock:
            _node.subscriptions.remove(self)
        _node.endpoints.remove((rmw.destroy_subscription, self.endpoint))
        rmw.destroy_subscription(_node.handle, self.endpoint)


def Timer(period, callback, oneshot):  # noqa: N802  rospy's name
    """Once; a thread of its own calls back."""
    assert oneshot
    timer = threading.Timer(period.to_sec(), callback, [None])
    timer.daemon = True
    timer.start()
    return timer


def init_node(name, anonymous=False):
    name = _renamed.get("__name", name)
    _node.begin(f"{name}_{os.getpid()}_{time.time_ns()}" if anonymous else name)
    atexit.register(_shut_down)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: _over.set())
    parameters = os.environ.get("BAGPIPE_PARAMETERS")
    if parameters and '"use_sim_time": true' in pathlib.Path(parameters).read_text():
        _node.time = genpy.Time()
        Subscriber("/clock", Clock, _set_time, queue_size=1)


def _set_time(clock):
    _node.time = clock.clock


def pause_between(seconds):
    """Sleep so long after each callback; rospy has no such thing."""
    _node.pause = seconds


def spin():
    while not _over.wait(0.5):
        pass


def is_shutdown():
    return _over.is_set()


def on_shutdown(callback):
    _at_shutdown.append(callback)


def signal_shutdown(_reason):
    _shut_down()


def _shut_down():
    for callback in _at_shutdown:
        callback()
    _at_shutdown.clear()
    _over.set()
    _node.end()


def myargv(words):
    return [word for word in words if ":=" not in word]
