"""Workers that roll out: threads of this process, or other machines. The numbers do not depend on them."""

from optim.workers.threads import Threads
from optim.workers.workers import Arrays, Operation, Portable, Recipe, Workers

__all__ = ["Arrays", "Operation", "Portable", "Recipe", "Threads", "Workers"]
