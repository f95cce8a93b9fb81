"""Which samples are there: half-open intervals of whole numbers, kept sorted and merged."""

from __future__ import annotations

from bisect import bisect_right

Interval = tuple[int, int]


class Intervals:
    """Set of samples; adding costs the logarithm of the number of gaps, whatever was added before."""

    def __init__(self) -> None:
        self._begins: list[int] = []
        self._ends: list[int] = []
        self._size = 0

    def __len__(self) -> int:
        """Samples in all."""
        return self._size

    def add(self, begin: int, end: int) -> bool:
        """Add samples begin to end - 1; False, and nothing happens, if one of them is there already."""
        i = bisect_right(self._begins, begin)
        if (i and self._ends[i - 1] > begin) or (i < len(self._begins) and self._begins[i] < end):
            return False
        joins_left = i > 0 and self._ends[i - 1] == begin
        joins_right = i < len(self._begins) and self._begins[i] == end
        if joins_left and joins_right:
            self._ends[i - 1] = self._ends.pop(i)
            self._begins.pop(i)
        elif joins_left:
            self._ends[i - 1] = end
        elif joins_right:
            self._begins[i] = begin
        else:
            self._begins.insert(i, begin)
            self._ends.insert(i, end)
        self._size += end - begin
        return True

    def gaps(self, count: int) -> list[Interval]:
        """Those of 0 to count - 1 that are not there, in order."""
        edges = zip([0, *self._ends], [*self._begins, count], strict=True)
        return [(begin, end) for begin, end in edges if begin < end]
