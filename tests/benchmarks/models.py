"""The models that are timed."""

from __future__ import annotations

from pathlib import Path

from flexmb.engine.compile import compile_system
from flexmb.fe import reduce
from flexmb.model import Model, load_scene

_CASES = Path(__file__).parents[2] / "cases"


def chain(n):
    """n bars of 1 kg and 1 m with spherical joints, horizontal, at rest, under gravity."""
    made = chain_model(n)
    return made, compile_system(made)


def planar_chain(n):
    """The same in the plane, with revolute joints."""
    made = chain_model(n, "revolute", plane="zx", axis="y")
    return made, compile_system(made)


def chain_model(n, joint="spherical", plane=None, **fields):
    """The same with joints of any type, not compiled."""
    made = Model(f"chain of {n}", gravity=[0, 0, -9.81], plane=plane)
    for k in range(n):
        made.add_body(
            f"b{k}", mass=1.0, center=[0.5, 0, 0], inertia=[0.01, 1 / 12, 1 / 12],
            position=[k, 0, 0],
        )  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        before = f"b{k - 1}.end" if k else "ground"
        made.add_joint(f"j{k}", joint, between=[before, f"b{k}"], **fields)
    made.set_dynamics(duration=1.0, step=1e-3, newton_tolerance=1e-6)
    return made


FORCES = {
    "bushing": {"stiffness": 1e5, "rotational_stiffness": 1e3},
    "damped bushing": {"stiffness": 1e5, "rotational_stiffness": 1e3, "damping": 10},
    "beam": {"E": 1e9, "G": 4e8, "A": 1e-4, "Iy": 1e-8, "Iz": 1e-8, "J": 1e-8},
    "law": {"spring_force": "1e4*x + 1e5*x**3"},
}


def held_by(force, n=10):
    """The bars of `chain`, each held to the one before by a force element across a gap of 0.1 m."""
    made = Model(f"chain of {n} by {force}", gravity=[0, 0, -9.81])
    kind = {"damped bushing": "bushing", "law": "spring-damper"}.get(force, force)
    for k in range(n):
        made.add_body(
            f"b{k}", mass=1.0, center=[0.5, 0, 0], inertia=[0.01, 1 / 12, 1 / 12],
            position=[0.1 + 1.1 * k, 0, 0],
        )  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        before = f"b{k - 1}.end" if k else "ground"
        made.add_force(f"f{k}", kind, between=[before, f"b{k}"], **FORCES[force])
    made.set_dynamics(duration=1.0, step=1e-3, newton_tolerance=1e-6)
    return made, compile_system(made)


def slider_crank(modes):
    """The case with a flexible rod of 6 + `modes` coordinates, in fixed steps."""
    fixed = {"dynamics.step": "1e-5", "dynamics.newton_tolerance": "1e-6"}
    made, bodies = reduced_slider_crank(modes, fixed)
    return made, compile_system(made, bodies), bodies["rod"].m


def reduced_slider_crank(modes, fixed=None):
    """The case with a flexible rod, and that rod reduced."""
    made = load_scene(
        _CASES / "slider_crank" / "scene.toml", {"bodies.rod.modes": str(modes), **(fixed or {})}
    )
    rod = made.bodies["rod"]
    body = reduce(
        made.path(rod.mesh), units=rod.units, material=rod.material,
        interfaces=dict(rod.interfaces), modes=rod.modes,
    )  # fmt: skip
    return made, {"rod": body}


def rigid_slider_crank():
    """The case with a rigid rod, with the sensors of the flexible one."""
    made = load_scene(_CASES / "rigid_slider_crank" / "scene.toml")
    made.add_sensor("rod_span", "position", of="rod.wrist", relative_to="crank.pin")
    return made, compile_system(made)
