"""Ctrl-C ends a command, but not while a module of others is half loaded."""

from __future__ import annotations

import importlib
import signal
import sys
import time

import pytest

from flexmb import __main__ as command

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers here")


@pytest.fixture
def handled(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGALRM)}
    signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.signal(signal.SIGINT, command._interrupt)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)


def within_flexmb(source, **names):
    """Run a text as if it stood in a file of flexmb."""
    exec(compile(source, command.__file__, "exec"), names)  # noqa: S102  a text of this test


def test_a_module_of_others_is_loaded_first(handled, tmp_path, monkeypatch):
    (tmp_path / "other_module.py").write_text(
        "import signal\nsignal.raise_signal(signal.SIGINT)\nLOADED = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    reached = []
    with pytest.raises(KeyboardInterrupt):
        within_flexmb(
            "load('other_module')\nreached.append(1)\nsleep(5)\nreached.append(2)",
            load=importlib.import_module, sleep=time.sleep, reached=reached,
        )  # fmt: skip
    assert sys.modules.pop("other_module").LOADED
    assert reached == [1]


def test_everything_else_ends_at_once(handled):
    with pytest.raises(KeyboardInterrupt):
        within_flexmb("raise_signal(number)", raise_signal=signal.raise_signal,
                      number=signal.SIGINT)  # fmt: skip


def test_an_exception_is_not_lost_where_an_object_goes(handled):
    class Goes:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    one = Goes()
    with pytest.raises(KeyboardInterrupt):
        del one
        time.sleep(5)
