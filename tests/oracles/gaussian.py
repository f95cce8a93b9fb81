"""Estimates of linear systems by conditioning one joint Gaussian distribution, without any recursion."""

from __future__ import annotations

import numpy as np


def conditioned(mean, covariance, rows, values, variance):
    """Mean and covariance of a Gaussian vector, given ``values = rows x + noise`` of equal variance."""
    spread = covariance @ rows.T
    gain = np.linalg.solve(rows @ spread + variance * np.eye(len(rows)), spread.T).T
    return mean + gain @ (values - rows @ mean), covariance - gain @ spread.T


def chained(first, spread, transition, forcing, noise):
    """Joint mean and covariance of x_0 .. x_N, where x_k = transition x_k-1 + forcing_k + noise_k.

    Args:
        first, spread: Mean (n,) and covariance (n, n) of x_0.
        transition, noise: Matrices (n, n), the same for each step.
        forcing: Known part of each step (N, n).
    """
    n, count = len(first), len(forcing) + 1
    means, powers = [np.array(first)], [np.eye(n)]
    for push in forcing:
        means.append(transition @ means[-1] + push)
        powers.append(transition @ powers[-1])
    # x is linear in (x_0, noise_1, ..., noise_N)
    effect = np.zeros((n * count, n * count))
    for k in range(count):
        for j in range(k + 1):
            effect[n * k : n * (k + 1), n * j : n * (j + 1)] = powers[k - j]
    sources = np.kron(np.eye(count), noise)
    sources[:n, :n] = spread
    return np.concatenate(means), effect @ sources @ effect.T
