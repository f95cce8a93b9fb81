"""Parameters p of a scenario as symbols, and constants c evaluated once for each rollout."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.symbolic.noise import NoiseTable


@dataclass(frozen=True)
class WindowTable:
    """Indices of a table's rows and of its window, the copy of the present row.

    Attributes:
        cursor: Index of the cursor that selects the row.
        first, window: Indices in c of the first row and of the window; ``first`` is -1 for noise.
        width, count: Numbers in a row, and number of rows.
        noise: Index of the first row among the random numbers of a rollout; -1 if the rows are in c.
    """

    cursor: int
    first: int
    window: int
    width: int
    count: int
    noise: int = -1


class Parameters:
    """Symbols of the numbers that the closed loop depends on, created at first use.

    A number that is exactly zero may be a *structural* zero (:meth:`sparse`), so that a planar arm costs no
    more than a planar algorithm. Numbers in ``vary`` always have symbols.

    Args:
        numbers: Nominal value of each number by its dotted path, in the scenario's units.
        vary: Paths of numbers, or of lists of numbers, that have symbols although they are exactly zero.
    """

    def __init__(self, numbers: Mapping[str, float], vary: Collection[str] = ()) -> None:
        self._numbers = dict(numbers)
        self._vary = frozenset(vary)
        self._symbols: dict[str, ca.SX] = {}

    def __call__(self, path: str) -> ca.SX:
        """Symbol of one number (1x1)."""
        if path not in self._symbols:
            self._symbols[path] = ca.SX.sym(path)
        return self._symbols[path]

    def __contains__(self, path: str) -> bool:
        """Whether the scenario has a number with this path."""
        return path in self._numbers

    def vector(self, path: str) -> ca.SX:
        """Symbols of three numbers (3x1)."""
        return ca.vertcat(*(self(f"{path}.{i}") for i in range(3)))

    def sparse(self, path: str) -> ca.SX:
        """Symbol of one number (1x1); a structural zero if it is exactly zero and not in ``vary``."""
        if self._numbers[path] == 0 and path not in self._vary:
            return ca.SX(1, 1)
        return self(path)

    def sparse_vector(self, path: str) -> ca.SX:
        """Symbols of three numbers (3x1), with structural zeros as in :meth:`sparse`."""
        return ca.vertcat(*(self.sparse(f"{path}.{i}") for i in range(3)))

    def varies(self, path: str) -> bool:
        """Whether ``vary`` has a number, or an entry of a list of numbers."""
        return any(varied == path or varied.startswith(f"{path}.") for varied in self._vary)

    def value(self, path: str) -> float:
        """Nominal value of one number."""
        return self._numbers[path]

    def nominal(self, expression: ca.SX) -> Array:
        """Nominal value of an expression of the numbers, as an array of the expression's shape."""
        value: Array = ca.evalf(ca.substitute(expression, self.symbols, self.values)).full()
        return value

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the numbers with symbols, in the order of the parameter vector."""
        return tuple(self._symbols)

    @property
    def symbols(self) -> ca.SX:
        """The parameter vector (np x 1)."""
        return ca.vertcat(*self._symbols.values()) if self._symbols else ca.SX(0, 1)

    @property
    def values(self) -> Array:
        """Nominal values of the parameter vector (np,)."""
        return np.array([self._numbers[path] for path in self._symbols], dtype=float)


class Constants:
    """Constants c: expressions of the parameters that are evaluated once for each rollout."""

    def __init__(self) -> None:
        self._symbols: list[ca.SX] = []
        self._expressions: list[ca.SX] = []
        self._jumps: dict[str, int] = {}
        self._switches: dict[str, int] = {}
        self._cursors: dict[str, ca.SX] = {}
        self._tables: dict[str, WindowTable] = {}
        self.noise: list[NoiseTable] = []

    def jump(self, name: str, time: ca.SX) -> ca.SX:
        """Symbol (1x1) of a time [s] at which the dynamics are discontinuous.

        Expressions may only compare the symbol with the time. The same name returns the same symbol.
        """
        if name not in self._jumps:
            self._jumps[name] = len(self._symbols)
            self._symbols.append(ca.SX.sym(f"{name}.jump"))
            self._expressions.append(time)
        return self._symbols[self._jumps[name]]

    @property
    def jumps(self) -> tuple[int, ...]:
        """Indices of the jump times in c."""
        return tuple(self._jumps.values())

    def switch(self, name: str, initial: bool = False) -> ca.SX:
        """Symbol (1x1) of a switch, 0 or 1, which has its initial value until an event changes it.

        The same name returns the same symbol.
        """
        if name not in self._switches:
            self._switches[name] = len(self._symbols)
            self._symbols.append(ca.SX.sym(name))
            self._expressions.append(ca.SX(float(initial)))
        return self._symbols[self._switches[name]]

    @property
    def switches(self) -> Mapping[str, int]:
        """Indices of the switches in c, by name."""
        return dict(self._switches)

    def cursor(self, name: str, row: ca.SX) -> int:
        """Index of a cursor: a row number (1x1) of tables, as an expression of (t, x, c).

        The row may change at jumps and events only. The same name returns the same cursor.
        """
        self._cursors.setdefault(name, row)
        return [*self._cursors].index(name)

    @property
    def cursors(self) -> ca.SX:
        """Row of each cursor (n x 1)."""
        return ca.vertcat(ca.SX(0, 1), *self._cursors.values())

    def window(self, name: str, rows: ca.SX, cursor: int) -> ca.SX:
        """Symbols (width x 1) of the present row of a table.

        A rollout copies a row into them whenever the cursor changes, so that a long table costs no more than
        a short one. The same name returns the same symbols.

        Args:
            name: Name of the table.
            rows: Rows as expressions of the parameters (count x width).
            cursor: Index of the cursor that selects the row, from :meth:`cursor`.
        """
        if name not in self._tables:
            count, width = rows.shape
            symbols = [f"{name}[{i},{j}]" for i in range(count) for j in range(width)]
            symbols += [f"{name}[{j}]" for j in range(width)]
            first, entries = len(self._symbols), ca.vertsplit(ca.densify(ca.vec(rows.T)))
            self._symbols += [ca.SX.sym(symbol) for symbol in symbols]
            self._expressions += [*entries, *entries[:width]]
            self._tables[name] = WindowTable(cursor, first, first + count * width, width, count)
        place = self._tables[name]
        return ca.vertcat(*self._symbols[place.window : place.window + place.width])

    def random(self, sensor: str, rows: int, width: int, cursor: int) -> ca.SX:
        """Symbols (width x 1) of the present row of a sensor's standard normal numbers.

        Args:
            sensor: Name of the sensor, unique in the closed loop.
            rows, width: Number of samples, and numbers in each sample.
            cursor: Index of the cursor that selects the row, from :meth:`cursor`.
        """
        first = sum(table.rows * table.width for table in self.noise)
        self.noise.append(NoiseTable(sensor, rows, width))
        window = len(self._symbols)
        self._symbols += [ca.SX.sym(f"{sensor}.noise[{j}]") for j in range(width)]
        self._expressions += [ca.SX(0)] * width
        self._tables[f"{sensor}.noise"] = WindowTable(cursor, -1, window, width, rows, first)
        return ca.vertcat(*self._symbols[window:])

    @property
    def tables(self) -> tuple[WindowTable, ...]:
        """Indices of the tables in c."""
        return tuple(self._tables.values())

    def hoist(self, name: str, expression: ca.SX) -> ca.SX:
        """Matrix of new constants that replaces an expression of the parameters, of the same shape.

        Structural zeros and numbers are left as they are.
        """
        hoisted = ca.SX(expression.sparsity())
        rows, columns = expression.sparsity().row(), expression.sparsity().get_col()
        for row, column in zip(rows, columns, strict=True):
            entry = expression[row, column]
            if entry.is_constant():
                hoisted[row, column] = entry
            else:
                symbol = ca.SX.sym(f"{name}[{row},{column}]")
                self._symbols.append(symbol)
                self._expressions.append(entry)
                hoisted[row, column] = symbol
        return hoisted

    def expanded(self, expression: ca.SX) -> ca.SX:
        """Expression with the constants replaced by their expressions of the parameters."""
        if not self._symbols or not ca.depends_on(expression, self.symbols):
            return expression
        return ca.substitute(expression, self.symbols, self.expressions)

    @property
    def symbols(self) -> ca.SX:
        """Symbols of the constants c (nc x 1)."""
        return ca.vertcat(*self._symbols) if self._symbols else ca.SX(0, 1)

    @property
    def expressions(self) -> ca.SX:
        """Constants c as expressions of the parameters (nc x 1)."""
        return ca.vertcat(*self._expressions) if self._expressions else ca.SX(0, 1)
