"""A first wish to end is noted, a second one is granted."""

from __future__ import annotations

import os
import select
import signal

import pytest

from terrain_cli.processes import signals


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_the_first_is_noted_and_the_second_granted(name):
    number = getattr(signal, name)
    before = signal.getsignal(number)
    heard = []
    signal.signal(number, lambda *_: heard.append(name))
    try:
        with signals.noted() as stop:
            assert not select.select([stop], [], [], 0)[0]
            os.kill(os.getpid(), number)
            assert select.select([stop], [], [], 1)[0]
            assert heard == []
            os.kill(os.getpid(), number)
            assert heard == [name]
        os.kill(os.getpid(), number)
        assert heard == [name, name]
    finally:
        signal.signal(number, before)


def test_what_was_ignored_is_ignored_still():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals.noted() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not select.select([stop], [], [], 0.1)[0]
    finally:
        signal.signal(signal.SIGHUP, before)
