"""``python -m flexmb`` does what the command ``flexmb`` does."""

from __future__ import annotations

from flexmb.cli import main

if __name__ == "__main__":
    main()
