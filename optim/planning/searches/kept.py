"""Attempts kept in files, so that a plan or a front that was killed goes on where it was.

Each attempt is one file, written whole or not at all, named by all that it depends on: the scene, what was
asked, and the motion that it began with. Nothing has to be in order, and what no longer fits is never found.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

import spacerobot
from optim.json_values import plain
from optim.planning.formulation.link_pairs import Collision
from optim.planning.searches.bench import Ask, Attempt, Solve
from optim.planning.solver.solve import TIME_LIMIT, Solved
from optim.planning.transcription.mesh import Mesh
from optim.planning.verification.verdict import Verdict, Violation
from spacerobot.files import write_bytes

ARRAYS = ("w", "multipliers", "bound_multipliers")


@dataclasses.dataclass(frozen=True)
class Kept:
    """A folder of attempts; nothing is kept if it is None.

    Attributes
    ----------
    folder
        Where they lie.
    fingerprint
        What all of them depend on.
    """

    folder: Path | None = None
    fingerprint: str = ""

    def find(self, ask: Ask) -> Attempt | None:
        """What was found when this was asked; None if it was not asked yet, or its file is spoilt."""
        if self.folder is None:
            return None
        try:
            with np.load(self._file(ask), allow_pickle=False) as stored:
                return _attempt({name: stored[name] for name in stored.files})
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None

    def add(self, ask: Ask, attempt: Attempt) -> None:
        """Keep what was found.

        Raises
        ------
        ResultError
            If it cannot be written.
        """
        late = any(solve.status == TIME_LIMIT for solve in attempt.solves)
        if self.folder is None or late or not (attempt.solves or attempt.solved):
            return  # what time ended may come farther another time
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **_arrays(attempt))
        write_bytes(self._file(ask), buffer.getvalue())

    def _file(self, ask: Ask) -> Path:
        assert self.folder is not None
        text = f"{spacerobot.__version__} {self.fingerprint} {ask.key}"
        return self.folder / f"plan-{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"


def _arrays(attempt: Attempt) -> dict[str, Any]:
    told: dict[str, Any] = {
        "solves": [vars(solve) for solve in attempt.solves],
        "meshes": [mesh.knots for mesh in attempt.meshes],
        "cost": attempt.cost,
        "blame": attempt.blame,
        "apart": [vars(one) for one in attempt.apart],
        "solved": None,
        "verdict": None if attempt.verdict is None else dataclasses.asdict(attempt.verdict),
    }
    found = {}
    if attempt.solved is not None:
        parts = vars(attempt.solved)
        found = {name: parts[name] for name in ARRAYS}
        told["solved"] = {name: value for name, value in parts.items() if name not in ARRAYS}
    return found | {"told": np.array(json.dumps(plain(told)))}


def _attempt(stored: dict[str, Any]) -> Attempt:
    told = json.loads(str(stored["told"]))
    solves = tuple(
        Solve(**(one | {key: tuple(one[key]) for key in ("costs", "violations")})) for one in told["solves"]
    )
    solved, verdict = told["solved"], told["verdict"]
    if solved is not None:
        solved = Solved(**{name: stored[name] for name in ARRAYS}, **solved)
    if verdict is not None:
        verdict = Verdict(**(verdict | {"violations": tuple(Violation(**v) for v in verdict["violations"])}))
    cost = np.inf if told["cost"] is None else told["cost"]
    meshes = tuple(Mesh(tuple(knots)) for knots in told["meshes"])
    apart = tuple(Collision(**(one | {"only": tuple(one["only"])})) for one in told["apart"])
    return Attempt(solves, solved, meshes, cost, verdict, told["blame"], apart)
