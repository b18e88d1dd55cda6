"""Jobs that worker processes of the tests do, well or not."""

from __future__ import annotations

import os
import time
from typing import Any

from flexmb.errors import FlexmbError


def do(job: dict[str, Any]) -> dict[str, Any]:
    """The number of a job, after what it says shall happen."""
    what = job.get("what", "")
    if what == "refuse":
        raise FlexmbError("the crank is stuck")
    if what == "fault":
        raise ValueError("a mistake")
    if what == "die":
        os._exit(3)
    if what == "die once" and not os.path.exists(job["file"]):
        with open(job["file"], "w", encoding="utf-8"):
            os._exit(3)
    time.sleep(job.get("seconds", 0.0))
    return {"number": job["number"], "process": os.getpid()}
