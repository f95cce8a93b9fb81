"""Ctrl-C while IPOPT computes ends the search without a warning by CasADi."""

import os
import signal
import sys

import numpy as np
import pytest
from scipy import sparse

from optim.planning.solver.casadi_messages import without_interrupts
from optim.planning.solver.ipopt import solve

SIZE = 60


class Circles:
    """Minimum of sum x_i subject to x_i^2 + x_i+1^2 <= 2, x >= -3; a search of milliseconds."""

    size, rows = SIZE, SIZE - 1
    places = np.arange(SIZE - 1)
    jacobian_pattern = sparse.csc_matrix(
        (np.ones(2 * SIZE - 2), (np.r_[places, places], np.r_[places, places + 1])), shape=(rows, size)
    )
    hessian_pattern = sparse.eye(SIZE, format="csc")

    def bounds(self):
        return np.full(SIZE, -3.0), np.full(SIZE, 3.0)

    def limits(self):
        return np.full(SIZE - 1, -np.inf), np.full(SIZE - 1, 2.0)

    def objective(self, w):
        return float(w.sum())

    def gradient(self, w):
        return np.ones(SIZE)

    def constraints(self, w):
        return w[:-1] ** 2 + w[1:] ** 2

    def jacobian(self, w):
        """Entries column by column: of row i - 1, then of row i, both 2 w_i."""
        return np.repeat(2 * w, 2)[1:-1]

    def hessian(self, w, factor, multipliers):
        return 2 * (np.r_[multipliers, 0] + np.r_[0, multipliers])


@pytest.mark.skipif(os.name == "nt", reason="no interval timers there")
def test_an_interrupt_within_the_solver_prints_nothing(capfd):
    """A timer interrupts as soon as it comes while IPOPT iterates, not one of its Python functions."""
    iterations = []

    def interrupt(number, frame):
        code = None if frame is None else frame.f_code
        if iterations and code and code.co_filename.endswith("casadi.py") and code.co_name == "call":
            signal.setitimer(signal.ITIMER_REAL, 0)
            raise KeyboardInterrupt

    first = np.linspace(-1, 1, SIZE)
    assert solve(Circles(), first).w.sum() == pytest.approx(-SIZE, rel=1e-6)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (until it comes there)
            signal.setitimer(signal.ITIMER_REAL, 1e-3, 1.7e-3)
            for _ in range(1000):
                iterations.clear()
                solve(Circles(), first, on_iteration=lambda *_: iterations.append(1))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert capfd.readouterr() == ("", "")


def test_other_messages_are_written(capsys):
    with without_interrupts():
        sys.stderr.write("CasADi - WARNING: the step is not finite\n")
    assert capsys.readouterr().err == "CasADi - WARNING: the step is not finite\n"
    with without_interrupts():
        sys.stderr.write('CasADi - WARNING("KeyboardInterruptException")\n')
    assert capsys.readouterr().err == ""
