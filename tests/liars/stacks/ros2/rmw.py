"""The part of ROS 2's middleware interface that a node needs, as C has it (tests/ros2/rmw.h).

Its functions are looked for among all that the process has loaded, as a linked program does it:
what was preloaded comes first.
"""

import ctypes
from ctypes import POINTER, Structure, byref, c_bool, c_char_p, c_int, c_size_t, c_uint64, c_void_p

OK = 0
KEEP_LAST, KEEP_ALL = 1, 2
RELIABLE, BEST_EFFORT = 1, 2
TRANSIENT_LOCAL, VOLATILE = 1, 2


class Span(Structure):
    _fields_ = [("seconds", c_uint64), ("nanoseconds", c_uint64)]


class Qos(Structure):
    _fields_ = [
        ("history", c_int),
        ("depth", c_size_t),
        ("reliability", c_int),
        ("durability", c_int),
        ("deadline", Span),
        ("lifespan", Span),
        ("liveliness", c_int),
        ("lease", Span),
        ("without_prefixes", c_bool),
    ]


class Context(Structure):
    _fields_ = [("implementation", c_char_p), ("domain", c_size_t), ("others", c_void_p * 64)]


class Holder(Structure):
    """What endpoints and guard conditions begin with."""

    _fields_ = [("implementation", c_char_p), ("data", c_void_p)]


class Message(Structure):
    _fields_ = [("data", c_void_p), ("length", c_size_t)]


class Things(Structure):
    _fields_ = [("count", c_size_t), ("things", POINTER(c_void_p))]


def _loaded(name):
    ctypes.CDLL(name, ctypes.RTLD_GLOBAL)


_loaded("librmw_implementation.so")
_all = ctypes.CDLL(None)


def _function(name, result, *arguments):
    found = getattr(_all, name)
    found.restype, found.argtypes = result, arguments
    return found


init = _function("rmw_init", c_int, c_void_p, c_void_p)
create_node = _function("rmw_create_node", c_void_p, c_void_p, c_char_p, c_char_p)
destroy_node = _function("rmw_destroy_node", c_int, c_void_p)
_CREATE = (c_void_p, c_void_p, c_char_p, c_void_p, c_void_p)
create_publisher = _function("rmw_create_publisher", POINTER(Holder), *_CREATE)
create_subscription = _function("rmw_create_subscription", POINTER(Holder), *_CREATE)
destroy_publisher = _function("rmw_destroy_publisher", c_int, c_void_p, POINTER(Holder))
destroy_subscription = _function("rmw_destroy_subscription", c_int, c_void_p, POINTER(Holder))
publish = _function("rmw_publish", c_int, POINTER(Holder), c_void_p, c_void_p)
take = _function("rmw_take_with_info", c_int, POINTER(Holder), *[c_void_p] * 4)
create_wait_set = _function("rmw_create_wait_set", c_void_p, c_void_p, c_size_t)
wait = _function("rmw_wait", c_int, *[c_void_p] * 7)


def taken(subscription, message):
    """The bytes of the next message, or None; `message` keeps its memory for the next one."""
    there, info = c_bool(False), ctypes.create_string_buffer(256)
    if take(subscription, byref(message), byref(there), info, None) != OK or not there.value:
        return None
    return ctypes.string_at(message.data, message.length)


def type_support(kind):
    """What a topic of a message class is made with."""
    package, name = kind._type.split("/")
    _loaded(f"lib{package}__rosidl_typesupport_c.so")
    symbol = f"rosidl_typesupport_c__get_message_type_support_handle__{package}__msg__{name}"
    return _function(symbol, c_void_p)()


class Tracepoints:
    """What rclcpp reports of a subscription; a node of Python reports nothing."""

    def __init__(self, node, subscription, topic, depth):
        _loaded("libtracetools.so")
        self._rcl, self._cpp, self._callback = (ctypes.create_string_buffer(8) for _ in range(3))
        started = ("ros_trace_callback_start", None, c_void_p, c_bool)
        self._start, self._end = (
            _function(*started),
            _function("ros_trace_callback_end", None, c_void_p),
        )
        words = (c_void_p, c_void_p, POINTER(Holder), c_char_p, c_size_t)
        _function("ros_trace_rcl_subscription_init", None, *words)(
            self._rcl, node, subscription, topic.encode(), depth
        )
        two = (None, c_void_p, c_void_p)
        _function("ros_trace_rclcpp_subscription_init", *two)(self._rcl, self._cpp)
        added = "ros_trace_rclcpp_subscription_callback_added"
        _function(added, *two)(self._cpp, self._callback)

    def __enter__(self):
        self._start(self._callback, False)

    def __exit__(self, *_):
        self._end(self._callback)
