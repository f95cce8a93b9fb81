"""A contact too short for the steps that are tried is named, with the step that it needs."""

from __future__ import annotations

import pytest

import spacerobot as sr
from spacerobot.common.errors import DivergedError
from spacerobot.rollout import step_choice

STIFF = {
    "contacts.bump.stiffness": 1e8,
    "contacts.bump.longest_step": None,
    "target.base.position": [1.85, 0.05, 0],  # so near that it touches after 0.1 s
    "simulation": {"duration": 0.2, "output_step": 0.1, "tolerance": 1e-8},
}


def test_a_refusal_for_a_stiff_contact_names_its_longest_step(monkeypatch):
    monkeypatch.setattr(step_choice, "HALVINGS", 6)
    with pytest.raises(DivergedError) as fault:
        sr.simulate(sr.load_scene("bounce", STIFF))
    assert (
        "contacts.bump touches for 0.0043 s: take steps of about 9e-05 s there alone" in fault.value.message
    )
    given = STIFF | {"contacts.bump.longest_step": 9e-5}
    assert sr.simulate(sr.load_scene("bounce", given)).completed
