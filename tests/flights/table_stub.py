"""The part of pandas that the notebook uses, where pandas is not installed: columns by name, and means by group."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]


class Series(np.ndarray[Any, Any]):
    """Column: an array with the names of two methods."""

    def to_numpy(self) -> Values:
        return np.asarray(self)


class DataFrame:
    """Table of columns of one length."""

    def __init__(self, columns: dict[str, Values], index: list[str] | None = None) -> None:
        self._columns = {name: np.asarray(values).view(Series) for name, values in columns.items()}
        self.index = index

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return self._columns[key]
        if isinstance(key, list):
            return DataFrame({name: self._columns[name] for name in key})
        return DataFrame({name: values[np.asarray(key)] for name, values in self._columns.items()})

    def __setitem__(self, name: str, values: Values) -> None:
        self._columns[name] = np.asarray(values).view(Series)

    def abs(self) -> "DataFrame":
        return DataFrame({name: np.abs(values) for name, values in self._columns.items()})

    def groupby(self, keys: Values) -> "Groups":
        return Groups(self, np.asarray(keys))

    def to_numpy(self) -> Values:
        return np.column_stack(list(self._columns.values()))

    def means(self, rows: Values) -> dict[str, float]:
        return {name: float(values[rows].mean()) for name, values in self._columns.items()}


class Groups:
    """Rows of a table by their key."""

    def __init__(self, table: DataFrame, keys: Values) -> None:
        self._table, self._keys = table, keys

    def mean(self) -> DataFrame:
        names = [str(name) for name in np.unique(self._keys)]
        means = [self._table.means(self._keys == name) for name in names]
        return DataFrame({column: np.array([one[column] for one in means]) for column in means[0]}, index=names)
