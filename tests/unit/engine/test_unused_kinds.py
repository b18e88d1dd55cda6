"""A scene loads, and compiles, the units of the kinds of elements that it holds, and no others."""

from __future__ import annotations

import pytest
from benchmarks.units import KINDS

from flexmb.engine import compiled_units
from flexmb.engine.compiled_calls import integration_units, prepare_integration
from flexmb.engine.method_selection import make_integrator

RATES = {"bodies.wrench.add_rate_arms", "bodies.wrench.add_rate_tangent"}
FORCES_OF_TIME = {"forces.load", "function.evaluate_functions"}


def row_units(*rows):
    """The units of kinds of rows."""
    units = ("value", "gradient", "curvature", "tangent")
    return {f"joints.row.{row}_{unit}" for row in rows for unit in units}


AXIS_ROWS = row_units("dot1", "angle") | {"joints.row.add_dot"}
SLIDER_CRANK = AXIS_ROWS | {
                "function.evaluate_functions", "sensors.joint_coordinate", "sensors.marker_motion",
                "sensors.sensor.sum_of_terms"}  # fmt: skip
# Modules whose units a scene with one more element calls, and the same scene without it does not.
# Beside them any element may need markers with axes, where the chain has points only. Jumps in time
# are part of units that all scenes call.
OWN = {
    None: set(),
    "spring": {"bodies.wrench.add_rate_arms", "forces.spring_damper"},
    "law": RATES | {"forces.force_characteristic", "forces.spring_damper.integral"},
    "bushing": RATES | {"forces.bushing", "forces.relative_motion"},
    "contact": RATES | {"forces.contact"},
    "revolute joint": row_units("dot1") | {"joints.row.add_dot"},
    "joint friction": AXIS_ROWS | {"forces.joint_friction", "joints.coordinate"},
    "line row": row_units("radial"),
    "cam": {"joints.coordinate", "joints.curve_marker"},
    "expression": FORCES_OF_TIME | {"sensors.feedback", "sensors.marker_motion",
                                    "sensors.sensor.sum_of_terms"},
    "time event": FORCES_OF_TIME | {"integrators.explicit_rk"},  # under error control
    "expression sensor": {"sensors.marker_motion", "sensors.sensor.expression",
                          "sensors.sensor.sum_of_terms"},
    "reaction sensor": {"sensors.sensor.wrench"},
    "planar": {"bodies.rigid_body.planar_inertia_forces", "bodies.rigid_body.planar_matrix"},
    "rigid slider-crank": SLIDER_CRANK,
    "flexible": SLIDER_CRANK | {"bodies.flexible_body"},
    "explicit-rk": {"integrators.explicit_rk"},
}  # fmt: skip


@pytest.fixture
def called(project, monkeypatch):
    """What tells the units that a chain with one more element of a kind calls.

    And those that are compiled with an empty cache, by the names in their sources.
    """
    monkeypatch.syspath_prepend(str(project))
    from tests.benchmarks.units import with_one

    def sets(kind):
        model, compiled = with_one(kind)
        method = make_integrator(model.dynamics)
        prepare_integration(compiled.system, method)
        entered, stored = integration_units(compiled.system, method), {}
        names = [unit.name for unit in entered]
        assert compiled_units._collect_missing(names, stored, lambda name: False) == []
        with monkeypatch.context() as empty:
            empty.setattr(compiled_units, "read_stored", lambda name: None)
            return set(stored), set(compiled_units.missing_units(entered))

    return sets


def module(name):
    """Module of a unit within the engine."""
    return short(name).rpartition(".")[0]


def short(name):
    """Name of a unit within the engine."""
    return name.removeprefix("flexmb.engine.").removeprefix("kernels.")


def test_all_kinds_are_told():
    assert set(OWN) == {None, *KINDS}


@pytest.mark.parametrize("kind", [None, *KINDS])
def test_no_other_kind_is_compiled(kind, called):
    """Friction in joints follows a coordinate of its joint, which costs nothing of another kind."""
    (plain, _), (calls, compiled) = called(None), called(kind)
    more = {short(name) for name in calls - plain}
    units_alone = OWN[kind] & more  # of a module that the chain calls too
    modules = {module(name) for name in more - units_alone}
    assert len(plain) < 100
    assert modules - {module(name) for name in plain} == OWN[kind] - units_alone
    # the chain has rows of coincidence only
    shared = {"bodies.marker", "bodies.wrench", "joints.constraint", "joints.point_joint"}
    assert modules - OWN[kind] <= shared
    assert compiled == calls
