"""Order the statements of a straight-line function so that a processor finds independent work at any moment.

CasADi finishes one chain of operations before it begins the next, and a processor looks only some hundred
instructions ahead: it would wait for each result in turn. Here, a list scheduler for a plain model of a
processor issues what lies on the longest remaining chain first. The operations stay the same.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH = 3
"""Operations that the model begins in each cycle."""

WINDOW = 1000
"""How far ahead of the oldest statement not yet issued it looks, which bounds how much must be kept."""

LANES_WINDOW = 400
"""The same for vectors, of which each that finds no register costs a whole vector's store and load: eight
lanes are 5 % faster than with 1000, a single rollout would be 6 % slower."""

LATENCY, DIVISION, TURN = 4, 13, 60
"""Cycles after which the result of a sum or product, a quotient, or a sine or cosine is there."""

_REGISTER = re.compile(r"\ba\d+\b")


@dataclass(frozen=True)
class _Statement:
    text: str
    needs: tuple[int, ...]
    latency: int


def order_statements(lines: Sequence[str], window: int = WINDOW) -> list[str]:
    """The same statements in an order that keeps a processor busy, each register written once.

    Args:
        lines: Statements ``a0=...;``.
        window: How far to look ahead, in statements.
    """
    # statements whose register names are their own places, with the places of what each needs
    place: dict[str, int] = {}
    statements: list[_Statement] = []
    for line in lines:
        target, _, value = line.partition("=")
        needs = tuple({place[register] for register in _REGISTER.findall(value)})
        renamed = _REGISTER.sub(lambda match: f"a{place[match.group()]}", value)
        if _REGISTER.fullmatch(target):
            place[target] = len(statements)
            target = f"a{len(statements)}"
        if "casadi_sin(" in value or "casadi_cos(" in value:
            latency = TURN
        else:
            latency = DIVISION if "/" in value else LATENCY
        statements.append(_Statement(f"{target}={renamed}", needs, latency))
    # places in the order of issue: within the window, the longest remaining chain comes first
    users: list[list[int]] = [[] for _ in statements]
    for i, statement in enumerate(statements):
        for need in statement.needs:
            users[need].append(i)
    chain = [0] * len(statements)
    for i in range(len(statements) - 1, -1, -1):
        chain[i] = statements[i].latency + max((chain[user] for user in users[i]), default=0)
    missing = [len(statement.needs) for statement in statements]
    when = [0] * len(statements)  # cycle at which everything that a statement needs is there
    beyond = [
        i for i, count in enumerate(missing) if count == 0
    ]  # could be issued but for the window; a heap
    waiting: list[tuple[int, int]] = []  # within the window, by cycle
    ready: list[tuple[int, int]] = []  # by chain
    issued, oldest, cycle = [False] * len(statements), 0, 0
    order: list[int] = []
    while len(order) < len(statements):
        while issued[oldest]:
            oldest += 1
        while beyond and beyond[0] < oldest + window:
            i = heapq.heappop(beyond)
            heapq.heappush(waiting, (when[i], i))
        if not ready and waiting:
            cycle = max(cycle, waiting[0][0])
        while waiting and waiting[0][0] <= cycle:
            i = heapq.heappop(waiting)[1]
            heapq.heappush(ready, (-chain[i], i))
        for _ in range(min(WIDTH, len(ready))):
            i = heapq.heappop(ready)[1]
            issued[i] = True
            order.append(i)
            for user in users[i]:
                missing[user] -= 1
                when[user] = max(when[user], cycle + statements[i].latency)
                if missing[user] == 0:
                    heapq.heappush(beyond, user)
            if len(order) == len(statements):
                break
        cycle += 1
    return [statements[i].text for i in order]
