"""Columns of a parquet file as numbers or rows, with the sizes that the file claims looked at first."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dense_vs.errors import DenseVSError

MAX_VALUES = 200_000_000  # numbers of one column
MAX_BYTES = 2 << 30  # of one column of one row group, unpacked


class ParquetColumns:
    """A parquet file that is read by column.

    Args:
        path: of the file.

    Attributes:
        names: of its columns.
        count: number of rows.

    Raises:
        DenseVSError: pyarrow is not installed; missing, or no parquet file.
    """

    def __init__(self, path: Path):
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError as error:
            raise DenseVSError(
                "reading parquet needs pyarrow, which is not installed; pip install 'dense-vs[recordings]'"
            ) from error
        self.path, self._errors = path, (pa.ArrowException, OSError, ValueError, KeyError, MemoryError)
        if not path.is_file():
            raise DenseVSError(f"{path} does not exist")
        with self._reading():
            self._file = pq.ParquetFile(path)
            self.names = list(self._file.schema_arrow.names)
            self.count = int(self._file.metadata.num_rows)

    def numbers(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Columns of numbers or of lists of as many numbers each, float64 ``(rows, ...)``.

        Raises:
            DenseVSError: missing values, lists of different lengths, or no numbers.
        """
        self._check_sizes(names)
        with self._reading():
            table = self._file.read(columns=list(names))
            return {name: self._array(table.column(name), name) for name in names}

    def rows(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """All rows of some columns, as Python values."""
        return list(self.stream(names, batch=1024))

    def stream(self, names: Sequence[str], batch: int = 8) -> Iterator[dict[str, Any]]:
        """Rows of some columns, as Python values, a few at a time.

        Raises:
            DenseVSError: a column that is not there, or damage.
        """
        for name in names:
            if name not in self.names:
                raise DenseVSError(f"{self.path} has no column {name!r}; it has {', '.join(self.names)}")
        self._check_sizes(names)
        batches = self._file.iter_batches(batch_size=batch, columns=list(names), use_threads=False)
        while True:
            with self._reading():
                rows = next(batches, None)
            if rows is None:
                return
            yield from rows.to_pylist()

    def _array(self, column: Any, name: str) -> np.ndarray:
        import pyarrow as pa

        if column.null_count:
            raise DenseVSError(f"{self.path} has {column.null_count} missing values in column {name!r}")
        values = column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
        width = 1
        while pa.types.is_list(values.type) or pa.types.is_large_list(values.type) or _fixed(values.type):
            flat = values.flatten()
            each = len(flat) // max(len(values), 1)
            lengths = None if _fixed(values.type) else values.value_lengths()
            if each * len(values) != len(flat) or (lengths is not None and set(lengths.unique().to_pylist()) - {each}):
                raise DenseVSError(f"{self.path} has rows of different lengths in column {name!r}")
            values, width = flat, width * each
        if values.null_count or not (pa.types.is_floating(values.type) or pa.types.is_integer(values.type)):
            raise DenseVSError(f"{self.path} has {values.type} in column {name!r}; expected numbers, none missing")
        array = values.to_numpy(zero_copy_only=False).astype(np.float64)
        return array.reshape(-1, width) if width != 1 or len(array) != len(column) else array

    def _check_sizes(self, names: Sequence[str]) -> None:
        metadata = self._file.metadata
        for group in range(metadata.num_row_groups):
            for k in range(metadata.num_columns):
                chunk = metadata.row_group(group).column(k)
                path = chunk.path_in_schema  # of a leaf; lists add to the column's name
                if not any(path == name or path.startswith(f"{name}.") for name in names):
                    continue
                if chunk.num_values > MAX_VALUES or chunk.total_uncompressed_size > MAX_BYTES:
                    raise DenseVSError(
                        f"{self.path} claims {chunk.num_values} values and {chunk.total_uncompressed_size} bytes in "
                        f"column {chunk.path_in_schema}; expected at most {MAX_VALUES} and {MAX_BYTES}"
                    )

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except DenseVSError:
            raise
        except self._errors as error:
            raise DenseVSError(
                f"cannot read {self.path} as a parquet file: {' '.join(str(error).split())[:300]}"
            ) from error


def _fixed(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_fixed_size_list(kind)
