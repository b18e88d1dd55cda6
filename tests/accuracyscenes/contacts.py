"""Motions with events: a ball that bounces, a stop, a block that sticks and slips."""

from __future__ import annotations

import numpy as np

from flexmb.model import Model

from .scene import Scene

G = 9.81
_HEIGHT, _STIFFNESS = 0.5, 1e5


def bouncing(size=1.0):
    """A ball falls 0.5 m on a linear spring of contact, without losses."""
    made = Model("ball", gravity=[0, 0, -G * size])
    made.add_body("ball", mass=1, inertia=[0.004 * size**2] * 3,
                  position=[0, 0, (0.1 + _HEIGHT) * size])  # fmt: skip
    made.add_force("floor", "contact", between=["ball", "ground"], exponent=1,
                   shapes=[{"type": "sphere", "radius": 0.1 * size}, {"type": "plane"}],
                   stiffness=_STIFFNESS)  # fmt: skip
    made.add_sensor("ball", "position", of="ball")
    return made


def bouncing_truth(t):
    """A parabola, and half a harmonic swing about where the spring bears the weight."""
    w, sag = np.sqrt(_STIFFNESS), G / _STIFFNESS
    speed, fall = np.sqrt(2 * G * _HEIGHT), np.sqrt(2 * _HEIGHT / G)
    touch = 2 * (np.pi - np.arctan2(speed / w, sag)) / w  # −sag cos + v/w sin, from first touch
    phase = np.mod(t + fall, 2 * fall + touch)
    flight = speed * phase - 0.5 * G * phase**2
    late = phase - 2 * fall
    depth = -sag + sag * np.cos(w * late) - speed / w * np.sin(w * late)
    return {"ball.z": 0.1 + np.where(phase < 2 * fall, flight, depth)}


def between_stops(size=1.0):
    """A mass thrown to and fro between two stops without losses."""
    made = Model("stops")
    made.add_body("m", mass=1, inertia=[size**2] * 3, velocity=[2 * size, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "m"], axis="x")
    made.add_force("stops", "translational-stop", joint="guide", lower=-0.3 * size,
                   upper=0.3 * size, stiffness=1e4)  # fmt: skip
    made.add_sensor("m", "position", of="m")
    return made


def between_stops_truth(t):
    free, w = 0.3 / 2, 100.0
    touch = np.pi / w
    half = 2 * free + touch
    count, phase = np.divmod(t + free, half)
    x = np.where(phase < 2 * free, -0.3 + 2 * phase, 0.3 + 2 / w * np.sin(w * (phase - 2 * free)))
    return {"m.x": np.where(count % 2 == 0, x, -x)}


CONTACTS = {
    "bouncing ball": Scene(bouncing, 3.0, bouncing_truth),
    "mass between stops": Scene(between_stops, 3.0, between_stops_truth),
}
