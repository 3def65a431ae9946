"""Readers of Parquet and Feather files: tables of Arrow with the same columns as CSV files."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import date
from typing import TYPE_CHECKING

from tgospa_eval.errors import InputError
from tgospa_eval.formats.headers import parse_columns
from tgospa_eval.formats.loading import TABLE, check_memory, check_parquet, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import Roles, find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.quoting import quoted

if TYPE_CHECKING:
    import pyarrow as pa


def arrow_rows(
    path: str,
    kind: str,
    schema: "pa.Schema",
    read: Callable[[Sequence[str]], "pa.Table"],
    options: ReadOptions,
    where: Callable[[int], str] | None = None,
) -> Rows:
    """Read the rows of an Arrow table, but only the columns that are used.

    Parameters
    ----------
    path, kind : str
        Path and kind of the file, for messages.
    schema : pyarrow.Schema
        Schema of all columns.
    read : callable
        Callable that receives names of columns and returns a table of these columns.
    options : ReadOptions
        Options of reading.
    where : callable, optional
        Callable that returns the file and number of a row, for messages; needed if the table has
        rows of several files.

    Raises
    ------
    InputError
        The content is damaged or wrong (see `formats.read`). In messages, rows count from 0.
    """
    from tgospa_eval.formats.frames import frame_rows  # lazy: pandas takes 50 MB

    with readable(path, kind):
        names = list(schema.names)
    roles = find_roles(names, options, path)
    subset = [names[column] for column in roles.used]
    check_types(schema, roles, path)
    with readable(path, kind):
        table = read(subset).select(subset)
        table.validate(full=True)  # pandas would check texts late or never
        check_dates(table, where or f"{path}, row {{}}".format)
        table = _exact(table, names[roles.id], None if roles.klass is None else names[roles.klass])
        frame = table.to_pandas(split_blocks=True, self_destruct=True, ignore_metadata=True)
    del table
    # Columns have other positions in the subset, so roles are assigned again. The user may have
    # mapped columns that are not used, and the subset lacks them. All mapped names are made
    # `shared` for `find_roles`, so that this is not an error.
    shared = replace(options, shared=tuple(parse_columns(options.columns)[0]))
    subset_roles = find_roles(subset, shared, path)
    whole = {name: getattr(roles, name) for name in ("unused", "passed", "missing")}
    return frame_rows(frame, replace(subset_roles, **whole), path, options.decimal, where)


@contextmanager
def readable(path: str, kind: str) -> Iterator[None]:
    """Convert the errors of Arrow and pandas about a damaged file to `InputError`."""
    import pyarrow as pa

    try:
        yield
    except (InputError, MemoryError):
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, OverflowError) as error:
        raise unreadable(path, kind, error) from None


def check_types(schema: "pa.Schema", roles: Roles, path: str) -> None:
    """Check that the used columns have plain values.

    Raises
    ------
    InputError
        A column has lists, structs, maps or bytes.
    """
    import pyarrow.types as kinds

    wanted = {roles.id: "ids", roles.time: "times"} | dict.fromkeys(roles.numbers, "numbers")
    wanted |= dict.fromkeys({*roles.texts} - roles.doubtful, "numbers or texts")
    if roles.klass is not None:
        wanted[roles.klass] = "classes"
    for column, what in wanted.items():
        kind = schema.field(column).type
        inner = kind.value_type if kinds.is_dictionary(kind) else kind
        if kinds.is_nested(inner) or "binary" in str(inner):
            remedy = {"numbers": what, "times": "numbers, timestamps or ISO texts"}.get(
                what, "texts or integers"
            )
            raise InputError(
                f"{path}, column {quoted(schema.names[column])}: {kind}, not {what}; write {remedy}"
            )


def check_dates(table: "pa.Table", where: Callable[[int], str]) -> None:
    """Check that all dates are in the range of Python's dates.

    Raises
    ------
    InputError
        A date is before the year 1 or after 9999.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    for name, column in zip(table.column_names, table.columns, strict=True):
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        if not pa.types.is_date(kind):
            continue
        dates = column.cast(kind)
        early = pc.less(dates, pa.scalar(date.min, kind))
        late = pc.greater(dates, pa.scalar(date.max, kind))
        row = pc.index(pc.or_(early, late), value=True).as_py()
        if row >= 0:
            raise InputError(
                f"{where(row)}, column {quoted(name)}: a date out of range (the years 1 to "
                "9999); write texts or numbers"
            )


def _exact(table: "pa.Table", *names: str | None) -> "pa.Table":
    """Convert the named columns to texts if they have integers and missing values.

    pandas would convert such columns to floats, which are not exact.
    """
    import pyarrow as pa

    for name in names:
        if name is not None and table[name].null_count and pa.types.is_integer(table[name].type):
            column = table.column_names.index(name)
            table = table.set_column(column, name, table[name].cast(pa.string()))
    return table


def read_parquet(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a Parquet file, but only the columns that are used.

    `role` has no effect.

    Raises
    ------
    InputError
        The file is not Parquet, or its content is wrong (see `formats.read`). In messages, rows
        count from 0.
    ConfigError
        pyarrow is not installed.
    """
    return _file_rows(path, "Parquet", data, options)


FIRST_VERSION = b"FEA1"


def read_feather(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a Feather file, but only the columns that are used.

    `role` has no effect.

    Raises
    ------
    InputError
        The file is not Feather, or its content is wrong (see `formats.read`). In messages, rows
        count from 0.
    ConfigError
        pyarrow is not installed.
    """
    if data.startswith(FIRST_VERSION):
        raise InputError(f"{path}: Feather of version 1; write version 2, the default since 2020")
    return _file_rows(path, "Feather", data, options)


def _file_rows(path: str, kind: str, data: bytes, options: ReadOptions) -> Rows:
    check_parquet(kind, f"{path}: ")
    if not data:
        raise InputError(
            f"{path}: the file is empty; a set without objects has a schema and no rows"
        )
    import pyarrow as pa

    take: Callable[..., pa.Table]
    with readable(path, kind):
        if kind == "Parquet":
            import pyarrow.parquet as pq  # lazy: slow to import

            file = pq.ParquetFile(pa.BufferReader(data))
            schema, rows, take = file.schema_arrow, file.metadata.num_rows, file.read
        else:
            import pyarrow.dataset as ds

            fragment = ds.IpcFileFormat().make_fragment(pa.py_buffer(data))
            schema, rows = fragment.physical_schema, fragment.count_rows()
            take = fragment.to_table

    def read(subset: Sequence[str]) -> "pa.Table":
        what = f"{rows:,} rows of {len(subset)} columns"
        check_memory(path, TABLE * 8 * rows * len(subset), len(data), options.max_input, what)
        return take(columns=subset)

    return arrow_rows(path, kind, schema, read, options)


ARGOVERSE_HEADERS = {
    "id": "track_uuid",
    "t": "timestamp_ns",
    "class": "category",
    "x": "tx_m",
    "y": "ty_m",
    "z": "tz_m",
}


def read_argoverse(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """Read the rows of a Feather file of Argoverse 2; by default the states are the centres (x, y).

    Raises
    ------
    InputError
        The file cannot be read, see `read_feather`.
    ConfigError
        pyarrow is not installed.
    """
    if not options.boxes:
        mapped, wanted = parse_columns(options.columns)
        wanted = wanted or ("x", "y")
        names = dict.fromkeys(("id", "t", "class", *mapped, *wanted))  # states in order
        headers = {name: mapped.get(name) or ARGOVERSE_HEADERS.get(name) for name in names}
        items = tuple(f"{name}={header}" if header else name for name, header in headers.items())
        options = replace(options, columns=items)
    return read_feather(path, data, options, role, given=given)
