"""The command ``flexmb``, also as ``python -m flexmb``."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 130  # exit code
_LATER = 0.02  # s
# An exception is lost where others call back, and leaves their modules half loaded: VTK's crash.
_IMPORT, _OURS = "<frozen importlib", os.path.dirname(__file__)
_CALLBACKS = ("weakref", "_weakrefset", "pydantic")


def main() -> None:
    """Run the command line; Ctrl-C ends it from the first moment on, while it is loaded."""
    try:
        usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if usual and sys.platform != "win32":
            signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
            signal.signal(signal.SIGINT, _interrupt)
        from flexmb.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(_INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Ctrl-C; a little later where others load a module, call back or remove an object."""
    imports = others = False
    while frame is not None:
        name, module = frame.f_code.co_filename, str(frame.f_globals.get("__name__", ""))
        if name.startswith(_IMPORT):
            imports = True
        elif name.startswith(_OURS):
            if imports and others:
                break
            imports = others = False
        elif module.startswith(_CALLBACKS) or frame.f_code.co_name == "__del__":
            break
        else:
            others = True
        frame = frame.f_back
    else:
        sys.unraisablehook = lambda _: None  # what objects say that go in the middle of their work
        if "logging" in sys.modules:
            sys.modules["logging"].disable()  # and what Dask does
        raise KeyboardInterrupt
    if sys.platform != "win32":
        signal.setitimer(signal.ITIMER_REAL, _LATER)


if __name__ == "__main__":
    main()
