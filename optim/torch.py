"""Rollouts as functions of PyTorch: quantities of simulations, with exact gradients by the adjoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from optim.evaluation import build_quantity_rollout, find_quantities, parameter_paths
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.optional import optional_module
from spacerobot.rollout import Rollout
from spacerobot.rollout.build import Backend
from spacerobot.scene import Scene, to_scene

__all__ = ["TorchRollout", "rollout"]


@dataclass(frozen=True)
class TorchRollout:
    """Function from values of parameters to quantities of a simulation, differentiable by PyTorch.

    Attributes:
        paths: Dotted paths of the k parameters.
        quantities: Names of the m quantities.
        prepared: The rollout that is evaluated.
        threads: Number of threads; one for each usable core if None. Results do not depend on it.
    """

    paths: tuple[str, ...]
    quantities: tuple[str, ...]
    prepared: Rollout = field(repr=False)
    threads: int | None = None

    @property
    def start(self) -> Any:
        """The scenario's values of the parameters: a tensor (k,) of double precision."""
        values = self.prepared.values()[self.prepared.indices(self.paths)]
        return _torch().as_tensor(values, dtype=_torch().float64)

    def __call__(self, values: Any) -> Any:
        """Return the quantities of a simulation for each row of values.

        Args:
            values: Tensor (k,) or (N, k), in the scenario's units.

        Returns:
            torch.Tensor: (m,) or (N, m), of the type of the values; NaN, with gradient NaN, where a
                simulation diverges.

        Raises:
            SpaceRobotError: If the values have another shape.
        """
        size = len(self.paths)
        if values.ndim not in (1, 2) or values.shape[-1] != size:
            raise SpaceRobotError(f"values of shape {tuple(values.shape)}, allowed: ({size},) or (N, {size})")
        result = _rollout_function().apply(values.reshape(-1, size), self)
        return result if values.ndim == 2 else result[0]

    def costs(self, values: Array) -> Array:
        """Quantities (N, m) of simulations with these values of the parameters (N, k)."""
        done = self.prepared.batch(self.paths, values, threads=self.threads)
        return np.column_stack([done.costs[name] for name in self.quantities])

    def pullback(self, values: Array, weights: Array) -> Array:
        """Gradients (N, k) of sums of the quantities, weighted in each simulation by ``weights`` (N, m)."""
        order = [self.quantities.index(name) for name in self.prepared.kernel.costs]
        return self.prepared.pullback(self.paths, values, weights[:, order], threads=self.threads)


def rollout(
    scene: Scene | StrPath,
    quantities: str | Sequence[str],
    parameters: str | Sequence[str],
    *,
    backend: Backend = "compiled",
    threads: int | None = None,
) -> TorchRollout:
    """Build a rollout as a function of PyTorch, ``torch.autograd.Function``.

    Its gradient is the discrete adjoint through all events, as in :func:`spacerobot.gradient`. A backward
    pass costs about four simulations, for any number of parameters and quantities.

    Args:
        scene: The scene, or the name or file of its scenario.
        quantities: Names of registered quantities; components are combined as in
            :func:`spacerobot.gradient`.
        parameters: Dotted paths of numbers, or of lists and sections, which match all numbers in them: a
            network's ``layers`` match all its weights and biases; ``*`` matches every key.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        threads: Number of threads; one for each usable core if None.

    Returns:
        TorchRollout: The function; ``start`` has the scenario's values.

    Raises:
        ScenarioError: If a quantity does not apply to the scene, or a controller has no gradient.
        SpaceRobotError: If PyTorch is not installed, or there is no such quantity or parameter.
    """
    _torch()
    scene, chosen = to_scene(scene), find_quantities(quantities)
    paths = parameter_paths(scene, parameters)
    prepared, _ = build_quantity_rollout(scene, chosen, paths, backend, many=False)
    prepared.indices(paths)
    return TorchRollout(paths, tuple(one.name for one in chosen), prepared, threads)


def _torch() -> Any:
    return optional_module("torch", "torch", "sr.torch")


def _rollout_function() -> Any:
    """Class of the function, made when PyTorch is loaded."""
    torch = _torch()

    class RolloutFunction(torch.autograd.Function):  # type: ignore[misc, name-defined, unused-ignore]
        """Rollouts of rows of parameters, and the pullback of the adjoint."""

        @staticmethod
        def forward(ctx: Any, values: Any, function: TorchRollout) -> Any:
            """Quantities (N, m) of values (N, k)."""
            ctx.save_for_backward(values)
            ctx.function = function
            costs = function.costs(values.detach().cpu().double().numpy())
            return torch.as_tensor(costs).to(values)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[misc, untyped-decorator, unused-ignore]
        def backward(ctx: Any, weights: Any) -> Any:
            """Gradient (N, k) by the values."""
            (values,) = ctx.saved_tensors
            rows, scales = (one.detach().cpu().double().numpy() for one in (values, weights))
            return torch.as_tensor(ctx.function.pullback(rows, scales)).to(values), None

    return RolloutFunction
