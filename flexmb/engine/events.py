"""Events: moments at which a force has a kink, so that a step should end there.

Each contact is watched by its depth and the rate of this, and one with friction by what makes it
slide or stick; so is friction in each joint, and each stop by its penetration. A step over which a
contact may open and close unseen is found by the tangents to its depth at both ends. With error
control a step in which one of them crosses zero, and not just at its end, is repeated shorter, so
that it ends a little beyond the crossing (regula falsi; each shorter step is closer, and tries are
bounded). After it begins one of a small length, as forces may grow fast from there. With fixed
steps nothing is shortened.
Source: Shampine & Thompson, Event location for ordinary differential equations, Comput. Math.
Appl. 39 (2000) 43.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.triple import inner
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.forces import contact, element, joint_friction, law, measure
from flexmb.engine.method import AGE, EVENT_REST, EVENT_STEP, EVENT_TRIES, EVENTS, STEP
from flexmb.engine.tables import BRISTLE, OPEN

# A step is short enough if a crossing is this share of it before its end, by a straight line.
_NEAR = 0.02
_BEYOND = 1.01  # where it is aimed at, over the way to the crossing
_TRIES = 10
# Steps are not made shorter for events than this share of the run.
_SHORTEST = 1e-7
# Steps after an event in which no other one shortens steps, so that what flutters about zero, such
# as friction without load, does not stop the run.
_REST = 5.0
# First step after an event, over the one before it was shortened.
_RESTART = 0.1


@kernel
def _evaluate(sys, contacts, frictions, stops, wk, q, v, out):
    """What is watched, after position and velocity stages and grips."""
    now, n = wk.now, 0
    if contacts is not None:
        n = 3 * contacts.shape[0]
        for k in range(contacts.shape[0]):
            c = contacts[k]
            mi, mj = now.marker[c["I"]], now.marker[c["J"]]
            d, normal, _ = contact.penetration(c, mi, mj)
            g = contact.relative_velocity(c, normal, mi, mj)
            out[3 * k] = d
            out[3 * k + 1] = -inner(normal, g)
            out[3 * k + 2] = 0.0
            if c["model"] == BRISTLE and d > 0.0 and now.kept[c["kept"] + 1] != OPEN:
                N, _, _ = contact.normal_force(c, now.kept, d, -inner(normal, g))
                _, _, _, excess = contact.friction_force(c, now, normal, N, g, mj)
                out[3 * k + 2] = contact.slip(c, now.kept, normal, g, mj, excess)
    if frictions is not None:
        for k in range(frictions.shape[0]):
            f = frictions[k]
            out[n + k] = joint_friction.slip(
                f, sys.parts.coordinates, now.grip[k, 0], now.kept, q, v
            )
        n += frictions.shape[0]
    if stops is not None:
        for k in range(stops.shape[0]):
            row = sys.elements.laws[stops[k]]
            s, _ = measure.present(row, sys.parts.coordinates, now, v)
            out[n + k], _ = law.penetration(row, s)


@kernel
def _stages(sys, frictions, wk, q, v, lam):
    """Markers at a state, and the grips of its multipliers."""
    kinematics.position(sys.parts, wk.now, q)
    element.position(sys.elements, sys.parts.coordinates, wk.now, q)
    kinematics.velocity(sys.parts, wk.now, v)
    joint_friction.put_grips(sys, frictions, wk, lam)


@kernel
def begin(sys, contacts, frictions, stops, st, wk):
    """Before the first step: what is watched at the state."""
    if contacts is not None or frictions is not None or stops is not None:
        _stages(sys, frictions, wk, st.q, st.v, st.lam)
        wk.now.span[0] = 0.0
        _evaluate(sys, contacts, frictions, stops, wk, st.q, st.v, wk.events.before)


@kernel
def _crossing(events, k):
    """Share of the step at which number k crosses zero; 1: it does not."""
    a, b = events.before[k], events.now[k]
    if (a < 0.0 and b > 0.0) or (a > 0.0 and b < 0.0):
        return a / (a - b)
    return 1.0


@kernel
def _hidden(events, k, h):
    """Share of the step at which depth k may peak above zero, below it at both ends; 1: never.

    Where the tangents of both ends meet, which a depth that rises ever slower does not exceed.
    """
    a, b = events.before[k], events.now[k]
    rise, fall = h * events.before[k + 1], h * events.now[k + 1]
    if not (a < 0.0 and b < 0.0 and rise > 0.0 and fall < 0.0):
        return 1.0
    share = (b - a - fall) / (rise - fall)
    return share if 0.0 < share < 1.0 and a + rise * share > 0.0 else 1.0


@kernel
def _next(contacts, events, h):
    """Share of the step at which the first of all crosses zero; 1: none does.

    With h = 0 only what has crossed in the end counts.
    """
    share, n = 1.0, 0
    if contacts is not None:
        n = 3 * contacts.shape[0]
        for k in range(0, n, 3):
            share = min(share, _crossing(events, k), _crossing(events, k + 2))
            share = min(share, _hidden(events, k, h))
    for k in range(n, events.now.shape[0]):
        share = min(share, _crossing(events, k))
    return share


@kernel
def missed(sys, contacts, frictions, stops, settings, st, wk, h):
    """Whether the step that is proposed has an event well inside; then a shorter one is due."""
    if contacts is not None or frictions is not None or stops is not None:
        if settings.step > 0.0:
            return False
        memory = st.memory
        _stages(sys, frictions, wk, wk.trial.q, wk.trial.v, wk.trial.lam)
        _evaluate(sys, contacts, frictions, stops, wk, wk.trial.q, wk.trial.v, wk.events.now)
        share = _next(contacts, wk.events, h)
        tried = memory[EVENT_TRIES] >= _TRIES or memory[EVENT_REST] > 0.0
        if share >= 1.0 - _NEAR or tried:
            return False
        if memory[EVENT_TRIES] == 0.0:
            memory[EVENT_STEP] = h
        shorter = h * max(share * _BEYOND, 1e-3)
        if shorter < _SHORTEST * (settings.end - settings.start):
            return False
        memory[EVENT_TRIES] += 1.0
        memory[STEP] = shorter
        memory[AGE] = -1.0
        return True
    return False


@kernel
def accepted(sys, contacts, frictions, stops, settings, st, wk, h):
    """After an accepted step: count its events, and begin with a small step after one."""
    if contacts is not None or frictions is not None or stops is not None:
        if settings.step > 0.0:
            return
        memory = st.memory
        memory[EVENT_REST] = max(memory[EVENT_REST] - 1.0, 0.0)
        if _next(contacts, wk.events, 0.0) < 1.0:
            if memory[EVENT_REST] == 0.0:
                st.count[EVENTS] += 1
            longest = memory[EVENT_STEP] if memory[EVENT_TRIES] > 0.0 else h
            longest = max(_RESTART * longest, _SHORTEST * (settings.end - settings.start))
            if memory[EVENT_REST] == 0.0:
                memory[STEP] = min(memory[STEP], longest)
                memory[EVENT_REST] = _REST
            memory[EVENT_TRIES] = 0.0
        elif memory[EVENT_TRIES] > 0.0:  # the event is still to come, or it has gone away
            memory[STEP] = min(memory[STEP], h)
            memory[EVENT_TRIES] += 1.0
            if memory[EVENT_TRIES] > 2.0 * _TRIES:
                memory[EVENT_TRIES] = 0.0
        _evaluate(sys, contacts, frictions, stops, wk, st.q, st.v, wk.events.before)
