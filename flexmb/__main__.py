"""The command ``flexmb``, also as ``python -m flexmb``."""

from __future__ import annotations

import sys

_INTERRUPTED = 130  # exit code


def main() -> None:
    """Run the command line; Ctrl-C ends it from the first moment on, while it is loaded."""
    try:
        from flexmb.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(_INTERRUPTED)


if __name__ == "__main__":
    main()
