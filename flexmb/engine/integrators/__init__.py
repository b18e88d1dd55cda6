"""The registry of methods: by their word in a scene, made from its `[dynamics]`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexmb.engine.integrators.explicit import bogacki_shampine
from flexmb.engine.integrators.generalized_alpha import generalized_alpha
from flexmb.engine.method import Method

__all__ = ["METHODS"]

METHODS: dict[str, Callable[[Any], Method]] = {
    "generalized-alpha": lambda spec: generalized_alpha(spec.spectral_radius),
    "explicit-rk": lambda spec: bogacki_shampine(),
}
