"""The shares of error budgets against errors that are known in closed form or by textbook matrices.

A share must be within a factor of two of the true error, and the sum no less than it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.special import ellipj, ellipk

import flexmb

Array = NDArray[np.float64]
YOUNG, DENSITY, SIDE, LENGTH, FORCE = 2.1e11, 7800.0, 0.01, 1.0, 1.0
INERTIA, AREA = SIDE**4 / 12, SIDE**2
ROOTS = [1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349, 14.1371683910, 17.2787595321]
_OMEGA = np.sqrt(YOUNG * INERTIA / (DENSITY * AREA * LENGTH**4))
DURATION = float(2.6 * 2 * np.pi / (ROOTS[0] ** 2 * _OMEGA))


def exact_tip(t: Array) -> Array:
    """Tip of a cantilever under a sudden force: F L³/EI Σ 4/λ⁴ (1 - cos ωt), φ(L)² = 4/L."""
    scale = FORCE * LENGTH**3 / (YOUNG * INERTIA)
    return np.asarray(
        sum(4 / x**4 * scale * (1 - np.cos(x**2 * _OMEGA * t)) for x in [*ROOTS, *_high_roots()])
    )


def _high_roots() -> list[float]:
    return [(2 * k - 1) * np.pi / 2 for k in range(7, 30)]


def hermite_tip(t: Array, elements: int) -> Array:
    """The same by consistent matrices of cubic beam elements (Cook, Concepts, ch. 11)."""
    h, n = LENGTH / elements, 2 * elements + 2
    k = YOUNG * INERTIA / h**3 * np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    )  # fmt: skip
    m = DENSITY * AREA * h / 420 * np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    )  # fmt: skip
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for e in range(elements):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    squares, modes = eigh(K[2:, 2:], M[2:, 2:])
    tip = modes[-2]
    terms = tip**2 * FORCE / squares
    return np.asarray((terms * (1 - np.cos(np.sqrt(squares) * t[:, None]))).sum(axis=1))


def cantilever(folder: Path, mesh: str, sections: str, ends: tuple[str, str], modes: int) -> Path:
    scene = folder / "cantilever.toml"
    scene.write_text(
        f"""
title = "Cantilever"
gravity = "none"
[bodies.beam]
mesh = {mesh}
material = {{ E = {YOUNG}, nu = 0.0, density = {DENSITY} }}
sections = {{ all = {sections} }}
interfaces = {{ root = "{ends[0]}", tip = "{ends[1]}" }}
modes = {modes}
[joints.clamp]
type = "fixed"
between = ["ground", "beam.root"]
[forces.load]
type = "force"
at = "beam.tip"
value = [0, 0, {FORCE}]
[sensors.tip]
type = "position"
of = "beam.tip"
[dynamics]
duration = {DURATION!r}
accuracy = 1e-6
outputs = 150
"""
    )
    return scene


def share(made: flexmb.Budget, kind: str) -> float:
    return next(one for one in made.shares if one.kind == kind).values["tip"]


def relative(values: Array, exact: Array) -> float:
    return float(np.abs(values - exact).max() / np.ptp(values))


BEAM = f'{{ type = "rectangle", y = {SIDE}, z = {SIDE} }}'


@pytest.mark.slow
def test_modes_left_out_of_a_cantilever_under_a_sudden_load(tmp_path: Path) -> None:
    """Without vibration modes a beam of two interfaces is one cubic element."""
    scene = cantilever(
        tmp_path, f'{{ type = "beam", length = {LENGTH}, divisions = 16 }}', BEAM,
        ("start", "end"), 0,
    )  # fmt: skip
    made = flexmb.budget(scene, knobs=["mesh", "modes", "integration"], output=tmp_path, workers=1)
    t = np.linspace(0, DURATION, 151)
    true = relative(hermite_tip(t, 1), exact_tip(t))
    assert true > 0.01
    assert 0.5 * true < share(made, "modes") < 2.0 * true
    assert share(made, "mesh") < 0.01 * true
    assert made.total("tip") > 0.999 * true


@pytest.mark.slow
def test_the_mesh_of_a_cantilever_of_one_and_of_two_elements(tmp_path: Path) -> None:
    scene = cantilever(
        tmp_path, f'{{ type = "beam", length = {LENGTH}, divisions = 2 }}', BEAM,
        ("start", "end"), 6,
    )  # fmt: skip
    made = flexmb.budget(scene, knobs=["mesh", "integration"], output=tmp_path, workers=1)
    t = np.linspace(0, DURATION, 151)
    true = relative(hermite_tip(t, 2), exact_tip(t))
    assert 1e-4 < true < 0.1
    assert 0.5 * true < share(made, "mesh") < 2.0 * true
    assert made.total("tip") > 0.999 * true


@pytest.mark.slow
def test_the_mesh_of_a_plate_that_bends_into_a_cylinder(tmp_path: Path) -> None:
    """A clamped strip without lateral contraction is a beam; a coarse mesh of it is not."""
    mesh = f'{{ type = "plate", length = {LENGTH}, width = 0.1, divisions = [4, 1] }}'
    scene = cantilever(tmp_path, mesh, f'{{ type = "shell", thickness = {SIDE} }}', ("x0", "x1"), 6)
    text = scene.read_text().replace(f"value = [0, 0, {FORCE}]", f"value = [0, 0, {10 * FORCE}]")
    scene.write_text(text)
    made = flexmb.budget(scene, knobs=["mesh", "integration"], output=tmp_path, workers=1)
    run = flexmb.simulate(flexmb.load_scene(scene), output=tmp_path / "run")
    true = relative(run["tip.z"], exact_tip(run.time))
    assert true > 1e-4
    assert 0.5 * true < share(made, "mesh") < 2.0 * true
    assert made.total("tip") > 0.999 * true


@pytest.mark.slow
def test_the_interface_model_of_a_flat_pad(tmp_path: Path) -> None:
    """Between rigid faces it is stiffer by (1-ν)/((1+ν)(1-2ν)), apart from its edges."""
    scene = tmp_path / "pad.toml"
    scene.write_text(
        """
title = "Pad"
gravity = "none"
[bodies.pad]
mesh = { type = "box", size = [0.02, 1, 1], divisions = [2, 16, 16], elements = "hexahedron" }
material = { E = 2e9, nu = 0.3, density = 1000 }
interfaces = { root = "x0", tip = "x1" }
modes = 0
[joints.clamp]
type = "fixed"
between = ["ground", "pad.root"]
[forces.load]
type = "force"
at = "pad.tip"
value = ["1e5*sin(pi*t/0.1)**2", 0, 0]
[sensors.tip]
type = "position"
of = "pad.tip"
[dynamics]
duration = 0.1
accuracy = 1e-4
outputs = 20
"""
    )
    made = flexmb.budget(
        scene, knobs=["interface model", "integration"], output=tmp_path, workers=1
    )
    stiffer = 0.7 / (1.3 * 0.4)
    assert 0.7 * (stiffer - 1) < share(made, "interface model") < 1.05 * (stiffer - 1)


@pytest.mark.seconds
def test_the_step_of_a_pendulum(tmp_path: Path) -> None:
    """A uniform bar from the horizontal: sin(θ/2) = k sn(K - ωt, k), k = sin 45°."""
    made = flexmb.Model("Pendulum")
    made.set_gravity([0, -9.81, 0])
    made.add_body("bar", mass=1.0, center=[0.5, 0, 0], inertia=[0.01, 1 / 12, 1 / 12])
    made.add_joint("pivot", "revolute", between=["ground", "bar"], axis="z")
    made.add_sensor("swing", "angle", joint="pivot")
    made.set_dynamics(duration=1.5, step=0.01, outputs=50)
    budget = flexmb.budget(made, output=tmp_path, workers=1, target=0.001)
    run = flexmb.simulate(made, output=tmp_path / "run")
    omega = np.sqrt(1.5 * 9.81)
    sn = ellipj(ellipk(0.5) - omega * run.time, 0.5)[0]
    angle = 2 * np.arcsin(np.sqrt(0.5) * sn) - np.pi / 2
    true = relative(run["swing"], angle)
    integration = next(one for one in budget.shares if one.kind == "integration")
    assert integration.state == "converged"
    assert integration.ratio == pytest.approx(4.0, rel=0.1)  # order two
    assert 0.5 * true < integration.values["swing"] < 2.0 * true
    assert budget.total("swing") > 0.999 * true
    files = budget.save()
    assert [file.name for file in files] == ["budget.json", "budget.md", "budget.png"]
    assert "integration" in budget.sentence()
    page = flexmb.report(tmp_path)
    assert "error budget" in page.read_text()
