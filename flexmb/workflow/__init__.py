"""The whole chain in one call: scene to flexible bodies to system to run to files and pictures.

The command line and the Python API use the same functions.
"""

from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.catalog import TOPICS, Listing, listing
from flexmb.workflow.check import check_scene
from flexmb.workflow.mobility import mobility
from flexmb.workflow.place import output_folder
from flexmb.workflow.reducing import Reduced, ReducedScene, reduce_mesh, reduce_scene
from flexmb.workflow.reports import CheckOutcome, CheckReport, RunReport
from flexmb.workflow.resume import resume, resume_run
from flexmb.workflow.run import kinematics, run_model, run_scene, simulate
from flexmb.workflow.templates import new_scene, templates
from flexmb.workflow.warmup import Warmed, warmup

__all__ = [
    "TOPICS",
    "CheckOutcome",
    "CheckReport",
    "Listing",
    "Reduced",
    "ReducedScene",
    "RunReport",
    "Warmed",
    "check_scene",
    "flexible_bodies",
    "kinematics",
    "listing",
    "mobility",
    "new_scene",
    "output_folder",
    "reduce_mesh",
    "reduce_scene",
    "resume",
    "resume_run",
    "run_model",
    "run_scene",
    "simulate",
    "templates",
    "warmup",
]
