"""Collisions of links along a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optim.planning.formulation.link_pairs import Collision, LinkPair, collisions
from optim.planning.transcription.motion import PhasedMotion, normalised
from optim.planning.verification.verify import FINER
from spacerobot.arrays import Array


def course_collisions(phased_motion: PhasedMotion, pairs: Sequence[LinkPair]) -> list[Collision]:
    """Pairs of links that overlap along a course, looked at where its limits are, the deepest first.

    Parameters
    ----------
    phased_motion
        The motion.
    pairs
        What is looked at.
    """
    if not pairs:
        return []
    places = np.arange(FINER) / FINER
    q, time = list[Array](), list[Array]()
    for begin, motion in zip(phased_motion.begins, phased_motion.motions, strict=True):
        shares = np.append((motion.mesh.starts[:, None] + motion.mesh.widths[:, None] * places).ravel(), 1.0)
        model = motion.problem.stage.scene.model
        q.append(normalised(model, motion.parts(motion.along(shares))[0]))
        time.append(begin + shares * motion.duration_s)
    return collisions(pairs, model, np.vstack(q), np.concatenate(time))
