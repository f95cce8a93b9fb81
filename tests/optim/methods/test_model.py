"""Programs that the NLP's steps solve."""

from __future__ import annotations

import numpy as np
import pytest

from optim.methods.local_model import solve_program


def test_a_nearly_singular_program_ends_at_a_good_point():
    # met in a rollout of a free arm; without a limit HiGHS goes round in circles for good
    hessian = np.zeros((7, 7))
    hessian[:5, :5] = [
        [
            0.034072140134313714,
            0.0017996946932415043,
            0.0020364736131789868,
            -0.046541321815873005,
            -0.006373719845675993,
        ],
        [
            0.0017996946932415043,
            0.00011773012122778745,
            4.2390637792537776e-05,
            -0.0021611178675812054,
            -0.0001640007210717553,
        ],
        [
            0.0020364736131789868,
            4.2390637792537776e-05,
            0.0008140808341062157,
            -0.0020119493913915852,
            -0.006573876525824228,
        ],
        [
            -0.046541321815873005,
            -0.0021611178675812054,
            -0.0020119493913915852,
            0.14281824912024035,
            -0.08047742828016474,
        ],
        [
            -0.006373719845675993,
            -0.0001640007210717553,
            -0.006573876525824228,
            -0.08047742828016474,
            0.38321556006701896,
        ],
    ]
    cost = np.array(
        [
            -0.02706192227677247,
            0.0007135237878666471,
            0.0007854042572564417,
            0.3039425752419358,
            -0.29038714617220945,
        ]
    )
    cost = np.append(cost, [0.0, 0.0])
    box = np.array([-1, -0.0, -0.0, -0.11204981, -0.2, 0, 0]), np.array([0, 1, 1, 0.43141073, 0.2, 0, np.inf])
    x = solve_program(cost, hessian, np.empty((0, 7)), np.empty(0), box)
    assert (box[0] - 1e-9 <= x).all()
    assert (x <= box[1] + 1e-9).all()
    assert cost @ x + x @ hessian @ x / 2 == pytest.approx(-0.0818, abs=2e-4)
