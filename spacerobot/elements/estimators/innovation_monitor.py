"""Detection of a failed sensor by a chi-square test of a filter's innovations.

If model and noise are as the filter assumes, the innovations nu_k of a sensor with m components are white
with the covariance S_k, and the normalised innovations squared (NIS) nu_k^T S_k^-1 nu_k are independent
chi-square variables with m degrees of freedom (Mehra and Peschon, Automatica 7, 1971; Bar-Shalom, Li and
Kirubarajan 2001, 5.4). Their sum over a window of N samples has N m, and is outside of

    chi2^-1(p / 2) ... chi2^-1(1 - p / 2)

with the probability p. A sensor that drifts makes the sum too large. One that is frozen makes it too large
where the signal moves, and too small where it does not: its noise is always the same. Windows follow each
other without overlap, so that tests are independent, and false alarms have the rate F = p / (N T) with the
period T of the samples. A sensor that is lost gives no innovations: that is found by the time since the last.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import Name, quantity
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.contribution import Contribution, Output, memory
from spacerobot.elements.core.failure import detected_failures, detection
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.estimators.estimator import Estimator, EstimatorContext


@register
class InnovationMonitor(Estimator):
    """Chi-square test of a filter's innovations for a failed sensor, which the filter then stops using.

    List it after the filter.
    """

    kind: Literal["innovation_monitor"] = "innovation_monitor"
    filter: Name = Field(description="filter, by its key in `estimators`")
    signal: str = Field(description="signal whose samples are tested, for example `base_orientation`")
    window: int = Field(default=10, ge=1, le=10_000, description="N, number of samples of one test [1]")
    false_alarms: float = quantity("1/h", "F, rate of false alarms", default=0.01, gt=0)
    silence: float | None = quantity(
        "s",
        "time without a sample after which the sensor is lost; not tested if not given",
        default=None,
        gt=0,
    )
    reject: bool = Field(default=True, description="whether the filter stops using the sensor upon detection")

    def rejects(self) -> tuple[str, str] | None:
        """Filter and signal."""
        return (self.filter, self.signal) if self.reject else None

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: a silence limit that is not above the sensor's period plus delay."""
        sensor = robot.sensors.get(self.signal)
        if self.silence is None or sensor is None or sensor.errors is None:
            return
        sample_interval = sensor.errors.period + sensor.errors.delay
        if self.silence <= sample_interval:
            yield (
                "silence",
                f"found {self.silence:g} s, allowed: above period and delay of {self.signal}, "
                f"{sample_interval:g}",
            )

    def build(self, robot: EstimatorContext) -> Contribution:
        """Contribution: states and sample instants of the test, and the detection event."""
        from scipy.special import chdtri

        context, label = robot.context, robot.label
        offered = {innovation.signal: innovation for innovation in robot.innovations(self.filter)}
        if not offered:
            raise ScenarioError(f"found no filter {self.filter!r} above it", where=f"{context.path}.filter")
        if self.signal not in offered:
            message = f"no innovations of {self.signal!r}; {near_names(self.signal, offered)}"
            raise ScenarioError(message, where=f"{context.path}.signal")
        tested = offered[self.signal]
        detected, who = context.switch("detected"), f"{robot.robot}/{self.filter}.{self.signal}"
        # lower and upper bound of the sum without an alarm
        passes = min(self.false_alarms * self.window * tested.period_s / 3600, 1.0)
        freedoms = tested.size * self.window
        lower, upper = (float(chdtri(freedoms, part)) for part in (1 - passes / 2, passes / 2))
        clock = Clock.of(f"{label}.instants", context.time, tested.period, tested.delay)
        total, count = (memory(f"{label}.{key}", ca.SX.zeros(1)) for key in ("total", "count"))
        last_sample = memory(f"{label}.seen", ca.SX(-0.5))  # time of the last sample that was counted
        # sum of the last complete window; before the first one, the middle of the allowed range
        window_sum = memory(f"{label}.sum", ca.SX(tested.size * self.window))
        fresh = tested.used > last_sample.symbol
        new = total.symbol + ca.if_else(fresh, tested.square, 0)
        number = count.symbol + fresh
        window_full = number > self.window - 0.5
        updates = {
            last_sample.name: tested.used,
            total.name: ca.if_else(window_full, 0, new),
            count.name: ca.if_else(window_full, 0, number),
            window_sum.name: ca.if_else(window_full, new, window_sum.symbol),
        }
        excess = ca.fmax(window_sum.symbol / upper - 1, 1 - window_sum.symbol / lower)
        events = [
            clock.event(f"{label}.counted", "estimated", label, updates, silent=True),
            detection(f"{label}.detected", who, excess, detected),
        ]
        if self.silence is not None:
            since = context.time - ca.fmax(tested.used, 0) - context.number("silence")
            events.append(replace(detection(f"{label}.silent", who, since, detected), clock=True))
        text = "sum of normalised innovations squared over the last window"
        outputs = (
            Output("innovation_sum", window_sum.symbol, "1", text, "filter", who),
            Output("innovation_limit", ca.SX(upper), "1", "maximum sum that is no alarm", "filter", who),
            detected_failures(detected, robot.robot),
        )
        return Contribution(
            states=(last_sample, total, count, window_sum, clock.count), events=tuple(events), outputs=outputs
        )

    def words(self) -> str:
        """Signal, filter and window."""
        return f"tests innovations of {self.signal} in {self.filter}, {self.window} samples each"
