"""The whole chain in one call: scene to flexible bodies to system to run to files and pictures.

The command line and the Python API use the same functions.
"""

from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.catalog import TOPICS, Listing, listing
from flexmb.workflow.check import check_scene
from flexmb.workflow.installation import Installation, Warmup, examine_installation, machine, warmup
from flexmb.workflow.mobility import mobility
from flexmb.workflow.place import output_folder, writable_folder
from flexmb.workflow.reducing import Reduced, ReducedScene, reduce_mesh, reduce_scene
from flexmb.workflow.reports import CheckOutcome, CheckReport, RunReport
from flexmb.workflow.resume import resume, resume_run
from flexmb.workflow.run import kinematics, run_model, run_scene, simulate
from flexmb.workflow.templates import new_scene, templates

__all__ = [
    "TOPICS",
    "CheckOutcome",
    "CheckReport",
    "Installation",
    "Listing",
    "Reduced",
    "ReducedScene",
    "RunReport",
    "Warmup",
    "check_scene",
    "examine_installation",
    "flexible_bodies",
    "kinematics",
    "listing",
    "machine",
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
    "writable_folder",
]
