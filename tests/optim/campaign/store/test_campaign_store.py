"""Which samples a campaign's folder holds: against a plain set."""

import itertools

import numpy as np
import pytest

from optim.campaign.rollouts.evaluator import SampleTable
from optim.campaign.store.folder import CampaignStore
from spacerobot.common.errors import ResultError


def table(count):
    return SampleTable(*(np.zeros((count, *shape)) for shape in [(1,), (1, 1), (1,), (1, 0)]))


def test_samples_are_there_once_and_what_is_missing_is_the_rest(tmp_path):
    (tmp_path / "chunks").mkdir()
    store, known, rng = CampaignStore(tmp_path, 72), set(), np.random.default_rng(0)
    refused = 0
    for begin, length in zip(rng.integers(0, 61, 30), rng.integers(1, 12, 30), strict=True):
        piece = set(range(begin, begin + length))
        if piece & known:
            refused += 1
            with pytest.raises(ResultError, match="are there already"):
                store.add(int(begin), table(length))
        else:
            store.add(int(begin), table(length))
            known |= piece
        for found in (store, CampaignStore(tmp_path, 72)):  # what is noted, and what is on the disk
            assert found.done == len(known)
            gaps = found.missing
            assert {i for a, b in gaps for i in range(a, b)} == set(range(72)) - known
            assert all(a < b for a, b in gaps)
            assert all(one[1] < other[0] for one, other in itertools.pairwise(gaps))
    assert 5 < refused < 25
