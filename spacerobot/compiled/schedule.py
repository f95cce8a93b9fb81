"""Instruction scheduling: an order of statements that exposes instruction-level parallelism.

CasADi completes one chain of dependent operations before the next, and a processor looks only a few hundred
instructions ahead, so that it would wait for each result in turn. A list scheduler with a simple processor
model issues first the statement with the longest remaining chain (critical path). The operations and their
results are unchanged.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH = 3
"""Operations that the processor model issues in each cycle."""

WINDOW = 1000
"""Statements after the oldest one not yet issued that may be issued. The window bounds the live registers."""

LANES_WINDOW = 400
"""Window for vectorised code, where each spilled register costs the store and load of a whole vector. Eight
lanes run 5 % faster than with 1000; a single rollout would run 6 % slower."""

LATENCY, DIVISION, TURN = 4, 13, 60
"""Latencies of a sum or product, a quotient, and a sine or cosine [cycles]."""

_REGISTER = re.compile(r"\ba\d+\b")


@dataclass(frozen=True)
class _Statement:
    text: str
    needs: tuple[int, ...]
    latency: int


def order_statements(lines: Sequence[str], window: int = WINDOW) -> list[str]:
    """Statements in scheduled order, with registers renamed so that each is written once.

    Args:
        lines: Statements ``a0=...;``.
        window: Look-ahead in statements.
    """
    # statements with registers renamed to the index of the statement, and indices of their operands
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
    # length of the longest chain of users, in cycles, which decides the priority within the window
    users: list[list[int]] = [[] for _ in statements]
    for i, statement in enumerate(statements):
        for need in statement.needs:
            users[need].append(i)
    chain = [0] * len(statements)
    for i in range(len(statements) - 1, -1, -1):
        chain[i] = statements[i].latency + max((chain[user] for user in users[i]), default=0)
    missing = [len(statement.needs) for statement in statements]
    when = [0] * len(statements)  # cycle at which all operands of a statement are available
    # heaps of statements all of whose operands are issued: outside the window, by index; within the window,
    # by the cycle of their operands; with available operands, the longest chain first
    beyond = [i for i, count in enumerate(missing) if count == 0]
    waiting: list[tuple[int, int]] = []
    ready: list[tuple[int, int]] = []
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
