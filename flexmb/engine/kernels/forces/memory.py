"""Memory of the elements: what contacts and frictions remember from one accepted step to the next.

`State.kept` is the memory itself, written only when a step is accepted. Forces are evaluated with
the copy `Now.kept`, and with the time since, `Now.span`; kept[0] is the time of the memory.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.kernels.forces import contact, joint_friction


@kernel
def put_span(contacts, now, t):
    """The time since the memory was written."""
    if contacts is not None and now.kept.shape[0] > 0:
        now.span[0] = t - now.kept[0]


@kernel
def keep(sys, contacts, frictions, now, t, q, v, kept):
    """Write the memory at an accepted state, after its position and velocity stages and grips."""
    if (contacts is not None or frictions is not None) and kept.shape[0] > 0:
        contact.keep(contacts, now, kept)
        joint_friction.keep(frictions, sys.parts.coordinates, now, q, v, kept)
        kept[0] = t
        copy(kept, now.kept)
        now.span[0] = 0.0


@kernel
def begin(sys, contacts, frictions, now, t, q, kept):
    """Memory at the first state, after its position and velocity stages: bristles free."""
    if (contacts is not None or frictions is not None) and kept.shape[0] > 0:
        for i in range(kept.shape[0]):
            kept[i] = 0.0
        kept[0] = t
        joint_friction.begin(frictions, sys.parts.coordinates, q, kept)
        copy(kept, now.kept)
        now.span[0] = 0.0
        contact.keep(contacts, now, kept)
        copy(kept, now.kept)
