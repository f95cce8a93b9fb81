"""Who rolls out: threads of this process, or machines. The numbers depend on neither."""

from optim.workers.threads import Threads
from optim.workers.workers import Arrays, Operation, Portable, Recipe, Workers

__all__ = ["Arrays", "Operation", "Portable", "Recipe", "Threads", "Workers"]
