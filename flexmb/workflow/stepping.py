"""A simulation row by row: for loops in Python that look at a motion while it is computed."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import SolverError

if TYPE_CHECKING:
    from flexmb.model import Model

Array = NDArray[np.float64]


class MotionState(NamedTuple):
    """The state at an output: time and sensors in the scene's units, all else in SI."""

    time: float
    sensors: dict[str, float]
    q: Array  # (nq,)
    v: Array  # (nv,)
    vd: Array  # (nv,)
    lam: Array  # (nc,)


def iterate_motion(model: Model, **dynamics: Any) -> Iterator[MotionState]:
    """Integrate a model and give the state at each output as soon as it is reached.

    One run without a scout, so its error is estimated, not measured; nothing is stored. A loop may
    end it at any time.

    Parameters
    ----------
    model : Model
        The model.
    **dynamics
        Fields of `[dynamics]`, as of `simulate`.

    Yields
    ------
    MotionState
        At each output, from the first state on.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; SolverError where the run fails.
    """
    from flexmb.analysis.dynamics.dynamics import prepare_dynamics
    from flexmb.analysis.procedure import failure_sentence
    from flexmb.engine.method import FINE
    from flexmb.model.scenes.dynamics import INSTEAD, drop_idle_options
    from flexmb.results import Columns
    from flexmb.results.channels import all_channels
    from flexmb.workflow.compiled_model import compile_source

    spec = model.dynamics
    fields = {} if spec is None else spec.model_dump(context=model.context)
    for new in dynamics:
        fields.pop(INSTEAD.get(new, ""), None)
    fields |= dynamics
    drop_idle_options(fields, dynamics)
    if fields.get("step") is None:
        fields["verify"] = False
    model = copy.copy(model)
    model.set_dynamics(**fields)
    system = compile_source(model)
    prepared = prepare_dynamics(system.compiled, model)
    run, names = prepared.run, system.compiled.layout.channels
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    channels = all_channels(Columns.of(system.compiled.layout), scene)
    scales = [float(model.units.outward(1.0, channels[name].unit or "")) for name in names]
    steps = 0
    while True:
        status = run.integrate(steps)
        rows = run.rows.read()
        for k in range(len(rows.t)):
            values = (float(x * f) for x, f in zip(rows.sensors[k], scales, strict=True))
            time = float(model.units.outward(rows.t[k], "s"))
            sensors = dict(zip(names, values, strict=True))
            yield MotionState(time, sensors, rows.q[k], rows.v[k], rows.vd[k], rows.lam[k])
        if status != FINE:
            at, step = float(run.state.t[0]), float(run.state.memory[0]["next_step"])
            raise SolverError(
                failure_sentence(status, run.compiled, prepared.model, run.work, at, step)
            )
        if run.finished:
            return
        steps = 1
