"""Which samples are there: against a plain set, and as quick with many chunks."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from optim.campaign.store.intervals import Intervals


@settings(deadline=None, max_examples=200, derandomize=True)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(1, 12)), max_size=30))
def test_it_is_a_set(pieces):
    found, known = Intervals(), set()
    for begin, length in pieces:
        piece = set(range(begin, begin + length))
        assert found.add(begin, begin + length) == (not piece & known)
        if not piece & known:
            known |= piece
        assert len(found) == len(known)
        gaps = found.gaps(72)
        assert {i for a, b in gaps for i in range(a, b)} == set(range(72)) - known
        assert all(a < b for a, b in gaps)
        assert all(first[1] < second[0] for first, second in pairwise(gaps))


class Counted(int):
    """A number that counts how often it is compared."""

    times = 0

    def __lt__(self, other):
        Counted.times += 1
        return super().__lt__(other)


def test_a_hundred_thousand_chunks():
    """In an order in which nothing joins until the end; each is looked for by halving."""
    found = Intervals()
    for parity in (0, 1):
        for begin in range(parity, 100_000, 2):
            assert found.add(Counted(10 * begin), 10 * begin + 10)
            assert len(found)
    assert found.gaps(1_000_000) == []
    assert 100_000 < Counted.times < 20 * 100_000
