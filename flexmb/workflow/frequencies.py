"""Natural frequencies of flexible bodies against the known answers of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from flexmb.workflow.reports import CheckOutcome

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

__all__ = ["frequency_outcomes"]


def frequency_outcomes(model: Model, bodies: Mapping[str, FlexBody]) -> list[CheckOutcome]:
    """One outcome for each known frequency of these bodies; a mode that is not there gives NaN."""
    from flexmb.flexbody.natural_modes import natural_frequencies

    outcomes = []
    for check in model.frequency_checks:
        if check.body not in bodies:
            continue
        found = natural_frequencies(bodies[check.body], check.held)
        value = float(found[check.mode - 1]) if check.mode <= len(found) else math.nan
        held = f"{', '.join(check.held)} held" if check.held else "free"
        outcomes.append(
            CheckOutcome(
                f"frequency {check.mode} of {check.body}, {held}",
                None,
                model.units.written(value, "Hz"),
                model.units.written(check.value, "Hz"),
                model.units.written(check.tolerance, "Hz"),
                check.source,
            )
        )
    return outcomes
