"""Who rolls out: threads of this process, or machines. The numbers depend on neither."""

from optim.workers.protocol import Arrays, Operation, Portable, Recipe, Workers
from optim.workers.threads import Threads

__all__ = ["Arrays", "Operation", "Portable", "Recipe", "Threads", "Workers"]
