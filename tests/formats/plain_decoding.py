"""What rosbags makes of single messages: the way independent of ours that ours is held against."""

from functools import partial, reduce

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import normalize_fieldname

from formats.rosbag.definitions import BUILT_IN, DURATION


def decoder(definition):
    """Return what decodes one message with the classes that rosbags writes, which take long; SerdeError."""
    store = get_typestore(Stores.EMPTY)
    store.register({name: definition.types[name] for name in definition.types.keys() - BUILT_IN.keys()})
    decode = store.deserialize_ros1 if definition.ros1 else store.deserialize_cdr
    return partial(decode, typename=definition.type)


def extract(messages, leaf, request):
    """Take one value from each message; tell whether some message has the element asked for, be it NaN."""
    column, present = request.blank(len(messages)), False
    for i, message in enumerate(messages):
        value = _walk(message, leaf.path)
        if request.key is not None:
            value = _element(message, value, leaf, request.key)
        if value is not None:
            column[i], present = _plain(value, leaf.base, request.kind), True
    return column, present


def _walk(message, path):
    return reduce(getattr, map(normalize_fieldname, path), message)


def _element(message, values, leaf, key):
    if isinstance(key, str):
        names = []
        if leaf.names is not None and leaf.inner:
            names = [_walk(element, leaf.names) for element in values]
        elif leaf.names is not None:
            names = list(_walk(message, leaf.names))
        key = names.index(key) if key in names else len(values)
    return _walk(values[key], leaf.inner) if key < len(values) else None


def _plain(value, base, kind):
    if kind == "time":
        return np.datetime64(value.sec * 1_000_000_000 + value.nanosec, "ns")
    if base == DURATION:
        return value.sec + value.nanosec / 1e9
    return value
