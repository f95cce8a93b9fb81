"""Solve results stored in files, so that an interrupted plan or front resumes.

Each result is one file, written atomically. Its name is a hash of the scene, the request and the initial
motion. Results may therefore be stored in any order, and outdated ones are never read.
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

from optim.json_files import plain
from optim.planning.formulation.link_pairs import Collision
from optim.planning.search.plan_solver import SolveRequest, SolveResult, SolverRun
from optim.planning.solver.ipopt import TIME_LIMIT, Solution
from optim.planning.transcription.mesh import Mesh
from optim.planning.verification.verify import VerificationResult, Violation
from spacerobot.common.files import write_bytes
from spacerobot.common.version import __version__

ARRAYS = ("w", "multipliers", "bound_multipliers")


@dataclasses.dataclass(frozen=True)
class ResultStore:
    """Folder of solve results; nothing is stored if the folder is None.

    Attributes:
        folder: Folder of the stored results.
        fingerprint: Fingerprint of everything that the results depend on.
    """

    folder: Path | None = None
    fingerprint: str = ""

    def find(self, request: SolveRequest) -> SolveResult | None:
        """Stored result of a request; None if there is none, or if its file is damaged."""
        if self.folder is None:
            return None
        try:
            with np.load(self._file(request), allow_pickle=False) as stored:
                fields = json.loads(str(stored["told"]))
                runs = tuple(
                    SolverRun(**(one | {key: tuple(one[key]) for key in ("costs", "violations")}))
                    for one in fields["runs"]
                )
                solution, verification = fields["solution"], fields["verification"]
                if solution is not None:
                    solution = Solution(**{name: stored[name] for name in ARRAYS}, **solution)
                if verification is not None:
                    verification = VerificationResult(
                        **(
                            verification
                            | {"violations": tuple(Violation(**v) for v in verification["violations"])}
                        )
                    )
                cost = np.inf if fields["cost"] is None else fields["cost"]
                meshes = tuple(Mesh(tuple(knots)) for knots in fields["meshes"])
                apart = tuple(Collision(**(one | {"only": tuple(one["only"])})) for one in fields["apart"])
                return SolveResult(runs, solution, meshes, cost, verification, fields["cause"], apart)
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None

    def add(self, request: SolveRequest, result: SolveResult) -> None:
        """Store a result.

        Raises:
            ResultError: If it cannot be written.
        """
        late = any(solve.status == TIME_LIMIT for solve in result.runs)
        if self.folder is None or late or not (result.runs or result.solution):
            return  # what time ended may come farther another time
        buffer = io.BytesIO()
        fields: dict[str, Any] = {
            "runs": [vars(solve) for solve in result.runs],
            "meshes": [mesh.knots for mesh in result.meshes],
            "cost": result.cost,
            "cause": result.cause,
            "apart": [vars(one) for one in result.apart],
            "solution": None,
            "verification": None if result.verification is None else dataclasses.asdict(result.verification),
        }
        arrays_by_name = {}
        if result.solution is not None:
            parts = vars(result.solution)
            arrays_by_name = {name: parts[name] for name in ARRAYS}
            fields["solution"] = {name: value for name, value in parts.items() if name not in ARRAYS}
        arrays = arrays_by_name | {"told": np.array(json.dumps(plain(fields)))}
        np.savez(buffer, allow_pickle=False, **arrays)
        write_bytes(self._file(request), buffer.getvalue())

    def _file(self, request: SolveRequest) -> Path:
        assert self.folder is not None
        text = f"{__version__} {self.fingerprint} {request.key}"
        return self.folder / f"plan-{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
