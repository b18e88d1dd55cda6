"""What each kind of element costs a scene that holds one, and a scene that holds none.

A rigid chain of ten bars in a fresh process with an empty cache: CPU time of compiling its loop,
the number of kernels compiled, the time of a step; then the same with one more element of a kind.
The first and the last row are the same scene without any: what they differ by is the noise of the
machine. `INNER` names a kernel of each kind that only scenes with the kind compile.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

INNER = {
    "spring": "forces.force.spring_rate",
    "law": "forces.law.resistance",
    "bushing": "forces.frame.pull",
    "contact": "forces.contact.penetration",
    "joint friction": "forces.friction.along",
    "line row": "joints.line.value",
    "cam": "joints.slider._piece",
    "expression": "sensors.signal._channel",
    "kink": "kinks._begin_anew",
}
_ROOT = Path(__file__).parents[2]


def with_one(kind):
    """The chain and one element of a kind at its first bar, or none."""
    from tests.benchmarks.models import chain

    made, _ = chain(10)
    pair = ["ground", "b0.end"]
    if kind == "spring":
        made.add_force("one", "spring-damper", between=pair, stiffness=1.0)
    elif kind == "law":
        made.add_force("one", "spring-damper", between=pair, spring_force="x + x**3")
    elif kind == "bushing":
        made.add_force("one", "bushing", between=pair, stiffness=1.0)
    elif kind == "contact":
        shapes = [{"type": "plane"}, {"type": "sphere", "radius": 0.01}]
        made.add_marker("ground.floor", position=[0, 0, -2])
        made.add_force("one", "contact", between=["ground.floor", "b0.end"], shapes=shapes,
                       stiffness=1e6, restitution=0.5)  # fmt: skip
    elif kind == "kink":
        pulse = {"type": "step", "t1": 0.1, "y1": 1e-3}
        made.add_force("one", "force", at="b0.end", value=[pulse, 0, 0])
        made.set_dynamics(duration=1.0, accuracy=1e-3)
    elif kind == "expression":
        made.add_sensor("end", "position", of="b0.end")
        made.add_force("one", "force", at="b0.end", value=["-1e-3*end.z", 0, 0])
    elif kind is not None:
        _add_body(made, kind)
    return made


def _add_body(made, kind):
    """One more bar on a joint of its own."""
    made.add_body("extra", mass=1.0, inertia=[0.1, 0.1, 0.1], position=[0, 5, 0])
    between = ["ground.post", "extra"]
    made.add_marker("ground.post", position=[0, 5, 0])
    if kind == "line row":
        made.add_joint("one", "cylindrical-spherical", between=["ground", "extra"], axis="z")
    elif kind == "cam":
        made.add_curve("wire", x="t", y="0.1*t**2", range=[-3, 3])
        made.add_joint("one", "point-on-curve", between=between, curve="wire")
    else:
        made.add_joint("one", "revolute", between=between, axis="x")
        made.add_force("rub", "joint-friction", joint="one", radius=0.01, dynamic=0.1,
                       stiffness=1e3)  # fmt: skip


def measure(kind):
    """Compile and run one of them here; prints CPU seconds, kernels, inner kernels, µs per step."""
    from numba.core import event

    from flexmb.analysis.dynamics.analysis import prepare
    from flexmb.engine.compile import compile_system
    from tests.benchmarks import timing

    class Kernels(event.Listener):
        names: set[str] = set()

        def on_start(self, event):
            function = event.data["dispatcher"].py_func
            home = function.__module__.removeprefix("flexmb.engine.").removeprefix("kernels.")
            self.names.add(f"{home}.{function.__qualname__}")

        def on_end(self, event):
            pass

    model, listener = with_one(kind), Kernels()
    compiled = compile_system(model)
    begin = time.process_time()
    with event.install_listener("numba:compile", listener):
        prepare(compiled, model)
    seconds = time.process_time() - begin
    step, _, _ = timing.per_step(model, compiled, 1e-3, 2000)
    inner = [kind for kind, name in INNER.items() if name in listener.names]
    told = {"seconds": seconds, "kernels": len(listener.names), "inner": inner, "step": step}
    print(json.dumps(told))


def fresh(kind):
    """The same in a new process with an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        env = {**os.environ, "FLEXMB_CACHE_DIR": cache}
        code = f"from tests.benchmarks.kinds import measure; measure({kind!r})"
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, cwd=_ROOT, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
    return json.loads(done.stdout.strip().splitlines()[-1])


def main():
    print("Chain of 10 bars and one element of a kind; fresh process, empty cache")
    print(f"{'one more':>16} {'compile s':>10} {'kernels':>8} {'us/step':>8}  compiled for")
    for kind in (None, *INNER, None):
        found = fresh(kind)
        inner = ", ".join(found["inner"]) or "nothing else"
        print(
            f"{kind or 'nothing':>16} {found['seconds']:10.1f} {found['kernels']:8} "
            f"{1e6 * found['step']:8.2f}  {inner}",
            flush=True,
        )


if __name__ == "__main__":
    main()
