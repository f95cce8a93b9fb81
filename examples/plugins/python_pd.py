"""A controller whose law is a Python function: PD towards a wave of the joints, with limited torque rates.

spacerobot run paper --plugin python_pd.py --set 'robots.*.controllers={mine: {kind: python_pd}}'
"""

from typing import Literal

import numpy as np

import spacerobot as sr
from spacerobot.elements import HeldForces, PythonController, quantity


@sr.register
class PythonPd(PythonController):
    """Swing the joints about their initial positions; called every `period`, torques are held in between."""

    kind: Literal["python_pd"] = "python_pd"
    kp: float = quantity("N m/rad or N/m", "proportional gain", default=20.0, ge=0)
    kd: float = quantity("N m s/rad or N s/m", "derivative gain", default=10.0, ge=0)
    amplitude: float = quantity("rad or m", "amplitude of the wave", default=0.0, ge=0)
    rate: float = quantity("N m/s or N/s", "largest rate of change of each torque", default=100.0, gt=0)

    def updater(self, forces: HeldForces):
        """A function for each simulation, with what it remembers."""
        first, last = None, np.zeros(forces.size)

        def update(t, measurements):
            nonlocal first, last
            position, speed = measurements["joint_position"], measurements["joint_rate"]
            first = position if first is None else first
            target = first + self.amplitude * np.sin(t)
            step = self.rate * self.period
            last = np.clip(self.kp * (target - position) - self.kd * speed, last - step, last + step)
            return last

        return update
