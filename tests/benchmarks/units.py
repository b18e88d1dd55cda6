"""What compiling costs: the first run, one more kind, everything; and what is compiled at all.

Each figure is of new processes: CPU seconds of all processes together, wall seconds beside them.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_ROOT = Path(__file__).parents[2]
KINDS = (
    "spring", "law", "bushing", "contact", "revolute joint", "joint friction", "line row", "cam",
    "expression",
    "time event", "expression sensor", "reaction sensor", "planar",
    "rigid slider-crank", "flexible", "explicit-rk",
)  # fmt: skip


def with_one(kind):
    """The chain and one element of a kind at its first bar, or none; model and compiled model.

    Or a slider-crank with a rigid rod, then with a flexible one.
    """
    from flexmb.engine.compile import compile_system
    from tests.benchmarks.models import chain_model, planar_chain, rigid_slider_crank, slider_crank

    if kind == "planar":
        return planar_chain(10)
    if kind == "rigid slider-crank":
        return rigid_slider_crank()
    if kind == "flexible":
        return slider_crank(14)[:2]
    made = chain_model(10)
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
    elif kind == "time event":
        pulse = {"type": "step", "t1": 0.1, "y1": 1e-3}
        made.add_force("one", "force", at="b0.end", value=[pulse, 0, 0])
        made.set_dynamics(duration=1.0, accuracy=1e-3)
    elif kind == "expression sensor":
        made.add_sensor("end", "position", of="b0.end")
        made.add_sensor("twice", "expression", value="2*end.z")
    elif kind == "reaction sensor":
        made.add_sensor("pin", "reaction", joint="j0")
    elif kind == "explicit-rk":
        made.set_dynamics(duration=1.0, step=1e-3, method="explicit-rk")
    elif kind == "expression":
        made.add_sensor("end", "position", of="b0.end")
        made.add_force("one", "force", at="b0.end", value=["-1e-3*end.z", 0, 0])
    elif kind is not None:
        _add_body(made, kind)
    return made, compile_system(made)


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
    if kind == "joint friction":
        made.add_force("rub", "joint-friction", joint="one", radius=0.01, dynamic=0.1,
                       stiffness=1e3)  # fmt: skip


def prepared(kind):
    """Make a run of one of them ready here; prints how many units were compiled, and how long."""
    from flexmb.engine.compiled_calls import prepare_integration
    from flexmb.engine.method_selection import make_integrator

    model, compiled = with_one(kind)
    begin = time.perf_counter()
    units = prepare_integration(compiled.system, make_integrator(model.dynamics))
    print(json.dumps({"units": units, "wall": time.perf_counter() - begin}))


def _python(code, cache):
    """Run code in a new process; what it prints, CPU seconds of it and its children, peak MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    env = {**os.environ, "FLEXMB_CACHE_DIR": cache}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, cwd=_ROOT, capture_output=True, text=True, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.stdout, cpu, after.ru_maxrss / 1e3


def _run(scene, folder, cache):
    """A whole run of a scene by the command line: wall and CPU seconds."""
    code = (
        "import sys; sys.argv = ['flexmb', 'run', " + repr(str(scene)) + ", '--no-picture', '-o', "
        + repr(folder) + "]; from flexmb.cli import main; main()"
    )  # fmt: skip
    begin = time.perf_counter()
    code = f"try:\n    exec({code!r})\nexcept SystemExit as end:\n    assert not end.code"
    _, cpu, _ = _python(code, cache)
    return time.perf_counter() - begin, cpu


def first_run(folder):
    """The README's slider-crank with an empty cache, then again."""
    scene = _ROOT / "cases" / "slider_crank" / "scene.toml"
    first, again = (_run(scene, f"{folder}/out", f"{folder}/first") for _ in range(2))
    print("Slider-crank of the README, empty cache, then again")
    for name, (wall, cpu) in (("first run", first), ("again", again)):
        print(f"  {name:>18} {wall:6.1f} s wall {cpu:6.1f} s CPU")
    print(f"  {'first less again':>18} {first[0] - again[0]:6.1f} s wall ", end="")
    print(f"{first[1] - again[1]:6.1f} s CPU", flush=True)


def one_more_kind(folder):
    """A chain that ran before and one more element of a kind, kind by kind, in one cache."""
    print("\nOne more kind in a chain of 10 bars that ran before, all that came before cached")
    print(f"{'kind':>18} {'units':>6} {'CPU s':>7} {'wall s':>7}")
    for kind in (None, *KINDS, None):
        code = f"from tests.benchmarks.units import prepared; prepared({kind!r})"
        out, cpu, _ = _python(code, f"{folder}/chain")
        _, again, _ = _python(code, f"{folder}/chain")
        made = json.loads(out.strip().splitlines()[-1])
        line = f"{kind or 'nothing':>18} {made['units']:6} {cpu - again:7.1f} {made['wall']:7.1f}"
        print(line, flush=True)


def everything(folder):
    """`flexmb warmup` with an empty cache."""
    begin = time.perf_counter()
    code = "import flexmb; d = flexmb.warmup(); print(d.units, d.compiled, d.size)"
    out, cpu, peak = _python(code, f"{folder}/all")
    units, compiled, size = map(int, out.split())
    wall = time.perf_counter() - begin
    print(
        f"\nflexmb warmup: {units} units, {compiled} compiled, {wall:.1f} s wall, {cpu:.1f} s CPU"
    )
    print(f"  {size / 1e6:.1f} MB on disk, at most {peak:.0f} MB of memory in a process")


def main():
    with tempfile.TemporaryDirectory() as folder:
        first_run(folder)
        one_more_kind(folder)
        everything(folder)


if __name__ == "__main__":
    main()
