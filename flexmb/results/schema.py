"""What stands in a result file: one table, read by the writer and by the reader.

Every dataset has its final shape and its place in the file before the run starts, so that while
the run goes on no bookkeeping of HDF5 changes: only numbers are written, the row counter last. That
is why a file is readable after a kill at any moment. `/progress` says how many rows are valid;
rows beyond it hold nothing. Of q, v, vd, lam, reactions, sensors and energy only those columns are
stored that the scene keeps; their numbers are in /layout/kept.

=============  ==================  ==========================================================
dataset        shape               meaning
=============  ==================  ==========================================================
/time          (n,)                time [s]
/q             (n, nq)             positions, per body r [m], p [-], eta [m kg^1/2 or as scaled]
/v             (n, nv)             velocities, per body r_dot [m/s], w [rad/s, body axes], eta_dot
/vd            (n, nv)             accelerations
/lam           (n, nc)             constraint multipliers [N or N m]
/reactions     (n, 12 reactions)   of each joint and driver: force [N] and moment [N m] on marker J
                                   in its axes, then on marker I in its axes
/sensors       (n, channels)       sensor channels, SI
/energy        (n, energies)       energies and works [J]
/drift         (n, 2)              largest constraint violation: position, velocity
/progress      (2,)                valid rows; status code (index into `STATUS`)
/span          (2,)                duration and number of output intervals, NaN if not told so;
                                   they replace those of the scene when a run is extended
/report        text of fixed size  JSON: statistics and the message of the end
/layout/*                          names and offsets of all columns
/layout/kept/* (k,)                numbers of the stored columns of each table
/scene         text                the scene as JSON
/texts/*       text                further texts, such as the scene file's own
/flexbodies/*  text                per body the path of its file, relative to this file
/state/0, 1    (bytes,)            two slots of the integrator's complete state
/state/arrays  text                its arrays, JSON: names, types, shapes
/state/saves   (2,)                number of the save in each slot, 0: none; /state/rows: rows then
=============  ==================  ==========================================================
"""

from __future__ import annotations

from typing import Final

from flexmb.engine.layout import Layout

FORMAT: Final = "flexmb-result"
VERSION: Final = 3

STATUS: Final = ("running", "finished", "stopped", "failed")

# dataset -> which column count of the layout it has; time is one column without a second axis
TABLES: Final = {
    "time": "",
    "q": "nq",
    "v": "nv",
    "vd": "nv",
    "lam": "nc",
    "reactions": "reactions",
    "sensors": "channels",
    "energy": "energies",
    "drift": "drift",
}

DRIFT: Final = ("position", "velocity")

REPORT_BYTES: Final = 65536  # room for statistics and message, reserved before the run


def widths(layout: Layout) -> dict[str, int]:
    """Number of columns of every table."""
    counts = {
        "": 1,
        "nq": layout.nq,
        "nv": layout.nv,
        "nc": layout.nc,
        "reactions": 12 * len(layout.reactions),
        "channels": len(layout.channels),
        "energies": len(layout.energies),
        "drift": len(DRIFT),
    }
    return {name: counts[key] for name, key in TABLES.items()}
