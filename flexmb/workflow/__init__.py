"""The whole chain in one call: scene to flexible bodies to system to run to files and pictures.

The command line and the Python API use the same functions.
"""

from flexmb.workflow.audit import Audit, EffectOutcome, audit
from flexmb.workflow.check import CheckReport, check_scene, mobility
from flexmb.workflow.check_all import SceneChecks, check_all
from flexmb.workflow.comparison import Comparison, compare
from flexmb.workflow.drive_forces import inverse_dynamics, inverse_scene
from flexmb.workflow.equilibria import equilibria, free_lengths, sweep_statics
from flexmb.workflow.flexible_bodies import (
    ReducedBody,
    ReducedScene,
    flexible_bodies,
    reduce_mesh,
    reduce_scene,
)
from flexmb.workflow.installation import (
    Installation,
    Warmup,
    examine_installation,
    machine,
    warmup,
)
from flexmb.workflow.linearize import linearize, render_mode_shapes, sweep_modes
from flexmb.workflow.listings import TOPICS, Listing, listing, new_scene, templates
from flexmb.workflow.part_analysis import PartReport, run_part
from flexmb.workflow.resume import resume, resume_run
from flexmb.workflow.run_report import CheckOutcome, RunReport
from flexmb.workflow.simulate import (
    MotionState,
    iterate_motion,
    kinematics,
    run_model,
    run_scene,
    simulate,
    statics,
)

__all__ = [
    "TOPICS",
    "Audit",
    "CheckOutcome",
    "CheckReport",
    "Comparison",
    "EffectOutcome",
    "Installation",
    "Listing",
    "MotionState",
    "PartReport",
    "ReducedBody",
    "ReducedScene",
    "RunReport",
    "SceneChecks",
    "Warmup",
    "audit",
    "check_all",
    "check_scene",
    "compare",
    "equilibria",
    "examine_installation",
    "flexible_bodies",
    "free_lengths",
    "inverse_dynamics",
    "inverse_scene",
    "iterate_motion",
    "kinematics",
    "linearize",
    "listing",
    "machine",
    "mobility",
    "new_scene",
    "reduce_mesh",
    "reduce_scene",
    "render_mode_shapes",
    "resume",
    "resume_run",
    "run_model",
    "run_part",
    "run_scene",
    "simulate",
    "statics",
    "sweep_modes",
    "sweep_statics",
    "templates",
    "warmup",
]
