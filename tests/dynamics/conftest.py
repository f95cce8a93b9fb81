"""The shipped URDFs as models, each on the base it would have in a scene."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.oracles.random_trees import random_state

URDFS = sorted((Path(__file__).parents[2] / "urdf").glob("*.urdf"))


@pytest.fixture(params=URDFS, ids=lambda path: path.stem)
def urdf(request):
    return request.param


@pytest.fixture(params=["planar", "free-flyer", "fixed"])
def shipped_state(request, urdf):
    root = {"planar": [pin.JointModelPlanar()], "free-flyer": [pin.JointModelFreeFlyer()], "fixed": []}
    model = pin.buildModelFromUrdf(str(urdf), *root[request.param])
    if model.nv == 0:
        pytest.skip("an object without joints does not move on a fixed base")
    return random_state(model, np.random.default_rng(11))
