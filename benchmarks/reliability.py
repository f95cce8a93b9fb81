"""Rare failures of the paper's scenario by every estimator: ``python -m benchmarks.reliability``.

Prints the table of docs/validation/reliability.md: the probability that a tip error exceeds a limit, by our
estimators, by plain Monte Carlo for the larger probabilities, and by OpenTURNS (if it is installed) on the
same limit state.
"""

from __future__ import annotations

import numpy as np

import spacerobot as sr
from benchmarks.table_row import markdown_head
from optim.reliability.limit_state import CountedLimitState, LimitState, build_limit_state

LIMITS = (2.2e-3, 2.5e-3, 2.7e-3, 2.85e-3)  # m
PLAIN = 100_000  # rollouts of plain Monte Carlo


def plain(state: LimitState) -> str:
    """Cell of plain Monte Carlo."""
    rng, hits = np.random.default_rng(1), 0
    for _ in range(PLAIN // 10_000):
        hits += int(np.sum(state.values(rng.standard_normal((10_000, len(state.names)))) < 0))
    return cell(hits / PLAIN, 1 / np.sqrt(max(hits, 1)), PLAIN)


def openturns(state: CountedLimitState) -> dict[str, str]:
    """Cells of OpenTURNS: importance sampling after FORM, and subset simulation."""
    try:
        import openturns as ot  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        return {}
    k = len(state.names)
    ot.RandomGenerator.SetSeed(0)
    function = ot.PythonFunction(
        k,
        1,
        func=lambda z: [float(state.values(np.array([z]))[0])],
        func_sample=lambda z: state.values(np.asarray(z))[:, None],
        gradient=lambda z: state.gradients(np.array([z]))[1].T,
    )
    variable = ot.CompositeRandomVector(ot.Function(function), ot.RandomVector(ot.Normal(k)))
    event = ot.ThresholdEvent(variable, ot.Less(), 0.0)
    estimates = {}
    form = ot.FORM(ot.AbdoRackwitz(), event, ot.Point(k))
    form.run()
    sampling = ot.PostAnalyticalImportanceSampling(form.getResult())
    subset = ot.SubsetSampling(event)
    for name, algorithm in {"importance": sampling, "subset": subset}.items():
        before = state.rollouts
        algorithm.setMaximumCoefficientOfVariation(0.1)
        algorithm.setMaximumOuterSampling(40 if name == "importance" else 4)
        algorithm.setBlockSize(500)
        algorithm.run()
        result = algorithm.getResult()
        estimate, variation = result.getProbabilityEstimate(), result.getCoefficientOfVariation()
        estimates[name] = cell(estimate, variation, state.rollouts - before)
    return estimates


def cell(probability: float, variation: float, rollouts: int) -> str:
    """Cell of the table: probability, coefficient of variation and number of rollouts."""
    return f"{probability:.3g} (± {100 * variation:.0f} %; {rollouts})"


def main() -> None:
    """Print the table as Markdown."""
    scene = sr.load_scene("paper")
    columns = ("importance", "line", "subset", "plain", "OpenTURNS importance", "OpenTURNS subset")
    print(*markdown_head(["limit, mm", *columns]), sep="\n")
    for limit in LIMITS:
        ours = [
            sr.failure_probability(scene, "tip_error_peak", limit, method=method)
            for method in ("importance", "line", "subset")
        ]
        cells = [cell(one.probability, one.variation, one.rollouts + one.gradients) for one in ours]
        state = CountedLimitState(build_limit_state(scene, "tip_error_peak", limit))
        theirs = openturns(state)
        cells.append(plain(state) if ours[0].probability > 1e-4 else "-")
        cells += [theirs.get(name, "not installed") for name in ("importance", "subset")]
        print(f"| {1e3 * limit:g} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
